"""Settings of a set of demonstrations."""

from dataclasses import asdict, dataclass
from typing import Annotated

from dexgrasp.evaluation.settings import versions
from dexgrasp.registry import check_name
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.objects.load import Objects, OfObjects
from dexgrasp_env.robot.cell import make_cell
from dexgrasp_env.tasks.control import DIRECT_MODES
from dexgrasp_env.tasks.observations import OBS_MODES
from dexgrasp_env.tasks.randomisation import Draws, ranges
from dexgrasp_env.valid import (
    CellFile,
    Count,
    Friction,
    Mount,
    Natural,
    Rule,
    number,
    one_of,
    read,
    refuse_idle,
)

SCHEMA = 1
ENV_ID = "DexGrasp/Lift-v2"
MODES = "obs_mode", "control_mode"
Formats = tuple[Annotated[str, one_of(("minari", "lerobot", "robomimic"))], ...]
"""Formats of data sets, by name."""
CAMERA_KEYS = ("cloud", "cloud_normals", "cloud_mask", "table_plane", "depth", "rgb")
"""Observations of cameras, which with `observe="reset"` stay the same and are stored once."""


@dataclass(frozen=True)
class DemoSettings(OfObjects):
    """Settings that demonstrations depend on.

    Attributes:
        objects: objects, sets, varied-N, or mesh files.
        agent: who demonstrates; it sees and acts in its own modes.
        episodes: scenes tried of each object; those that end in success, twice, are kept.
        seed: of scenes, agent and noise.
        obs_mode: of the demonstrations.
        control_mode: of the demonstrations: what is commanded is converted.
        observe: when cameras look; a view seen once is stored once.
        noise: standard deviation added to what the agent commands, as a share of the velocity limits; the agent, which
            sees what comes of it, corrects it, and whoever learns from it learns to; 0.03 is much.
        friction: sliding friction coefficient (default 0.7).
        randomise: what every scene draws: friction, mass, size, gain, latency, joint_noise.
        robot: file of your cell (robot, table, mounts, limits, gains, torques and cameras), or of a robot alone
            (default: the simulated cell; on the command line $DEXGRASP_CELL, where it is set).
        mount: how the hand sits on the arm's flange (default: the robot's own).
        chunk: scenes a file while it is made.
    """

    objects: Annotated[Objects, "OBJECT"]
    agent: Annotated[str, Rule("an agent", check_name), "AGENT"] = "bilevel"
    episodes: Count = 10
    seed: Natural = 0
    obs_mode: Annotated[str, one_of(OBS_MODES)] = "state"
    control_mode: Annotated[str, one_of(DIRECT_MODES)] = "joint_delta"
    observe: Annotated[str, one_of(("reset", "step"))] = "reset"
    noise: Annotated[float, number(ge=0, le=1), "SHARE"] = 0.0
    friction: Annotated[Friction | None, "MU"] = None
    randomise: Draws = ()
    robot: CellFile = None
    mount: Mount = None
    chunk: Count = 25

    def __post_init__(self) -> None:
        """Validate combinations of fields.

        Raises:
            InputError: for an unknown cell or mount, a quantity that is drawn twice, or `observe` without cameras.
        """
        make_cell(self.robot, self.mount)
        ranges(self.randomise)
        refuse_idle(self, {"observe": (self.obs_mode != "state", "an obs_mode of cameras")})

    @property
    def env_arguments(self) -> Fields:
        """Keywords of `gym.make` for the demonstrations, without objects."""
        looks = {} if self.obs_mode == "state" else {"observe": self.observe}
        return {
            "obs_mode": self.obs_mode,
            "control_mode": self.control_mode,
            "robot": self.robot,
            "mount": self.mount,
            "friction": self.friction,
            "randomisation": ranges(self.randomise),
            **looks,
        }

    def as_json(self) -> Fields:
        """Return the settings as JSON, with the versions of cell and packages."""
        rest = {"cell": make_cell(self.robot).version, "versions": versions()}
        return asdict(self) | {"objects": list(self.objects)} | rest

    @classmethod
    def of_json(cls, saved: Fields, robot: str | None = None) -> "DemoSettings":
        """Return the settings that `as_json` wrote; `robot` replaces the path of a cell that has moved.

        Raises:
            InputError: if they are of another cell, or not valid.
        """
        saved = {**saved, "robot": robot or saved["robot"]}
        here = make_cell(saved["robot"]).version
        if (cell := saved["cell"]) != here:
            raise InputError(f"demonstrations of cell {cell!r}: this is {here!r}, give theirs with --robot")
        return read(cls, saved, "settings of the demonstrations:", more=True)
