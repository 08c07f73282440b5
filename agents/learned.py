"""Learned policies, by the path of their folder or, those that are shipped, by their name."""

from pathlib import Path
from typing import ClassVar

from dexgrasp.agent import BY_CLOUD, BY_STATE, Agent, Info, Observation, Report, cell_of
from dexgrasp.learning.imitation.bc_policy import BcPolicy
from dexgrasp.learning.imitation.cloud_grasp_policy import CloudGraspPolicy
from dexgrasp.learning.imitation.policy import Policy, PolicyRun
from dexgrasp.learning.reinforcement.grip_policy import GripPolicy
from dexgrasp.learning.reinforcement.rl_policy import RlPolicy
from dexgrasp.runs.weights import ABOUT, WEIGHTS, read_policy
from dexgrasp_env.arrays import Single
from dexgrasp_env.assets import asset_path
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import expand
from dexgrasp_env.robot.cell import default_cell


class LearnedAgent(Agent):
    """Acts by the policy of a folder, in numpy, in the environment settings that it was trained in."""

    shipped: ClassVar[str] = ""

    def __init__(self, folder: str | Path | None = None) -> None:
        """Read the policy.

        Args:
            folder: of `dexgrasp train`; that of the policy that is shipped under the class's name by default.

        Raises:
            InputError: if the folder holds no policy, or a damaged one.
        """
        path = expand(folder or asset_path("weights", self.shipped))
        about, arrays = read_policy(path)
        kinds: dict[str, type[Policy]] = {
            own.kind: own for own in (BcPolicy, CloudGraspPolicy, RlPolicy, GripPolicy)
        }
        kind = str(about.get("kind"))
        if kind not in kinds:
            raise InputError(f"{path}: policy of kind {kind!r}: valid are {', '.join(kinds)}")
        self._policy = kinds[kind](about, arrays)
        self.env_settings = dict(self._policy.env)  # type: ignore[misc]  # of the instance here
        self._run: PolicyRun | None = None

    @classmethod
    def files(cls, name: str) -> list[Path]:
        """Return the files of a policy's folder."""
        return [expand(name) / ABOUT, expand(name) / WEIGHTS]

    def reset(self, observation: Observation, info: Info) -> None:
        """Look at the object."""
        self._run = None
        self.report = Report()
        if info.get("perception_failure"):
            self.report.failure = str(info["perception_failure"])
            return
        try:
            cell = cell_of(info, default_cell())
            self._policy.check_robot(cell)
            self._run = self._policy.begin(observation, cell)
        except InputError as error:
            self.report.failure = str(error)

    def act(self, observation: Observation) -> Single:
        """Return the next action."""
        if self._run is None:
            raise InputError("this agent has nothing to look at: reset() says why in report.failure")
        return self._run.action(observation)


class BcAgent(LearnedAgent):
    """Cloned from demonstrations: sees the state, predicts set-points."""

    env_settings = BY_STATE
    shipped = "bc"


class RlAgent(LearnedAgent):
    """`bc` with a grip that reinforcement corrects: sees the state, decides once an episode where to take hold."""

    env_settings = BY_STATE
    shipped = "rl"


class BcCloudAgent(LearnedAgent):
    """Cloned from demonstrations of the planner: looks at the cloud once, then feels through the joints."""

    env_settings = BY_CLOUD
    shipped = "bc_cloud"
