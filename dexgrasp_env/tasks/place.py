"""DexGrasp/Place-v1."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.utils import EzPickle
from numpy.random import Generator
from numpy.typing import NDArray

from dexgrasp_env.errors import InputError
from dexgrasp_env.tasks.constants import GOAL_HEIGHT, GOAL_RADIUS, GOAL_STEPS, PLACE_X, PLACE_Y
from dexgrasp_env.tasks.episodes import Episodes, Moment
from dexgrasp_env.tasks.lift import LiftEnv
from dexgrasp_env.tasks.records import TOLD
from dexgrasp_env.tasks.settings import LiftSettings
from dexgrasp_env.tasks.simulation import Simulation
from dexgrasp_env.tasks.views import Views

_SUCCESS = TOLD.index("is_success")
_GOAL_LOW, _GOAL_HIGH = np.array([PLACE_X, PLACE_Y, GOAL_HEIGHT]).T


class PlaceEpisodes(Episodes):
    """Episodes with a goal each."""

    def __init__(self, settings: LiftSettings, views: Views, number: int) -> None:
        super().__init__(settings, views, number)
        self._distances = np.zeros(number)  # m, of the objects' centres to their goals

    def observation_space(self) -> spaces.Dict:
        """Return the space that goal-conditioned learners want."""
        size = sum(int(np.prod(part.shape or ())) for part in super().observation_space().values())
        goals = _GOAL_LOW.astype(np.float32), _GOAL_HIGH.astype(np.float32)
        return spaces.Dict(
            {
                "observation": spaces.Box(-np.inf, np.inf, (size,), np.float32),
                "achieved_goal": spaces.Box(-np.inf, np.inf, (3,), np.float32),
                "desired_goal": spaces.Box(*goals, dtype=np.float32),
            }
        )

    def begin(self, i: int, rng: Generator, options: Mapping[str, Any] | None) -> Simulation:
        """Start episode `i`; the goal is drawn last."""
        simulation = super().begin(i, rng, options)
        self.records[i]["goal"] = rng.uniform(_GOAL_LOW, _GOAL_HIGH)
        return simulation

    def conclude(
        self, part: slice, moment: Moment, warnings: NDArray[np.int64], rngs: Sequence[Generator | None],
        alone: bool = False,
    ) -> dict[str, NDArray[Any]]:  # fmt: skip
        """Do what `Episodes.conclude` does; rewards, success and the observation are those of the goal."""
        state = super().conclude(part, moment, warnings, rngs)
        records, goals = self.records[part], self.records["goal"][part]
        self._distances[part] = np.linalg.norm(moment[0][:, -7:-4] - goals, axis=-1)
        observation = {
            "observation": np.concatenate(list(state.values()), axis=-1),
            "achieved_goal": state["object_pose"][:, :3].copy(),
            "desired_goal": goals.astype(np.float32),
        }
        achieved, desired = observation["achieved_goal"], observation["desired_goal"]
        self.rewards[part] = goal_rewards(achieved, desired, self.settings.reward_mode)
        reached = (goal_rewards(achieved, desired, "sparse") == 0.0) & (records["failure"] == 0)
        records["at_goal"] = np.where(reached & (records["elapsed"] > 0), records["at_goal"] + 1, 0)
        self.told[part, _SUCCESS] = records["at_goal"] >= GOAL_STEPS
        return {key: value[0] for key, value in observation.items()} if alone else observation

    def info(self, i: int) -> dict[str, Any]:
        """Return the info of episode `i`."""
        return super().info(i) | {"goal_distance": float(self._distances[i])}

    def more_infos(self) -> dict[str, NDArray[Any]]:
        """Return what `info` has more than that of `Episodes`, of all episodes."""
        return {"goal_distance": self._distances.copy()}


class PlaceEnv(LiftEnv):
    """Carry an object to a place above the table and hold it there: a goal-conditioned task.

    ## Description

    The scene, the robot and the physics of `LiftEnv`. A goal is drawn 0.15 to 0.35 m above the table, inside the area
    where objects are put. The task is solved when the object's centre has been within 3 cm of it for the last 1 s.

    ## Action Space

    As `LiftEnv`: a `Box(-1, 1, (n,), float32)` by `control_mode`.

    ## Observation Space

    A `Dict` as goal-conditioned learners want it (`GoalEnv`):

    | Key | Shape | Type | Meaning |
    | --- | --- | --- | --- |
    | `observation` | (125,) | float32 | the `state` observation of `LiftEnv`, its keys one after the other |
    | `achieved_goal` | (3,) | float32 | m, the object's centre |
    | `desired_goal` | (3,) | float32 | m, where it is to be |

    ## Rewards

    Of the distance d between achieved and desired goal alone, so that `compute_reward` gives those of other goals.

    | reward_mode | Reward |
    | --- | --- |
    | `sparse` | 0 within 3 cm, else -1 |
    | `dense` | -d, m |

    ## Starting State

    As `LiftEnv`.

    ## Episode End

    Terminates when the object is lost or numbers go wrong, truncates after 300 steps. Success ends nothing.

    ## Arguments

    Those of `LiftEnv`, with `reward_mode="sparse"` as default and `obs_mode="state"` alone; no `disturbance`.

    ## Version History

    * v1: first version.
    """

    episodes_type = PlaceEpisodes
    obs_modes = ("state",)

    def __init__(
        self, objects: str | Sequence[str] = "ycb6", reward_mode: str = "sparse", **kwargs: Any
    ) -> None:
        given = {"objects": objects, "reward_mode": reward_mode, **kwargs}
        super().__init__(**self.arguments(**given))
        EzPickle.__init__(self, **given)

    @classmethod
    def arguments(cls, **given: Any) -> dict[str, Any]:
        """Return all arguments: those given, and the defaults of the others.

        Raises:
            InputError: for cameras or a disturbance.
        """
        if given.get("obs_mode", "state") != "state" or given.get("disturbance") not in (None, "none"):
            raise InputError(
                "Place-v1 has obs_mode 'state' and no disturbance: valid are the other arguments"
            )
        return super().arguments(**{"reward_mode": "sparse", **given})

    def compute_reward(
        self, achieved_goal: NDArray[Any], desired_goal: NDArray[Any], info: Any
    ) -> NDArray[np.float64]:
        """Return the rewards (...,) of goals (..., 3) m; `info` is not used."""
        return goal_rewards(achieved_goal, desired_goal, self.settings.reward_mode)


def goal_rewards(achieved: NDArray[Any], desired: NDArray[Any], reward_mode: str) -> NDArray[np.float64]:
    """Return the rewards (...,) of goals (..., 3) m; see `PlaceEnv`."""
    distance = np.linalg.norm(np.asarray(achieved) - np.asarray(desired), axis=-1)
    if reward_mode == "dense":
        return -distance.astype(np.float64)
    return -(distance > GOAL_RADIUS).astype(np.float64)
