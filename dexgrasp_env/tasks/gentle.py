"""The task of lifting without crushing, DexGrasp/LiftGentle-v0, and its page."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from dexgrasp_env.arrays import Arrays, Fields, Mask
from dexgrasp_env.tasks.episodes import Episodes
from dexgrasp_env.tasks.lift import LiftEnv
from dexgrasp_env.tasks.settings import LiftSettings
from dexgrasp_env.tasks.simulation import Physics
from dexgrasp_env.valid import Positive, one_of


@dataclass(frozen=True, kw_only=True)
class GentleSettings(LiftSettings):
    """Everything that `gym.make` accepts of `GentleEnv`, in checked form.

    Attributes:
        max_force: N that a finger should press the object with at most; agents are told.
    """

    max_force: Positive = 8.0
    backend: Annotated[str, one_of(("mujoco",))] = "mujoco"  # its forces are looked at in every physics step

    @property
    def agent_info(self) -> Fields:
        """Facts that an agent may know, by name."""
        return super().agent_info | {"max_force": self.max_force}


class GentleEpisodes(Episodes):
    """Episodes that end when a finger presses too hard."""

    task = "gentle"
    task_dtype = np.dtype([("peak", "f8")])  # N, the largest force of a finger at any physics step

    def __init__(self, settings: LiftSettings, number: int) -> None:
        super().__init__(settings, number)
        assert isinstance(settings, GentleSettings)
        self._most = 1.2 * settings.max_force  # with more an object is crushed
        for simulation in self.simulations.values():
            simulation.watches_forces = True

    @property
    def _crushed(self) -> Mask:
        return np.asarray(self.task_records["peak"] > self._most)

    def _finish(self, part: slice, where: Physics, judge: bool, state: Arrays) -> Arrays:
        """Note the largest force; a crushed object is no success."""
        if judge:
            peaks = self.task_records["peak"][part]
            np.fmax(peaks, where.peak_forces, out=peaks)
            crushed = self._crushed[part]
            self.rewards[part] *= ~(crushed & (self.rewards[part] > 0.0))
        return state

    def endings(self) -> tuple[Mask, Mask]:
        """Return which episodes have terminated, by a failure or a crushed object, and which are truncated, (N,)."""
        terminated, truncated = super().endings()
        return terminated | self._crushed, truncated

    def more_infos(self) -> Arrays:
        """Return the columns of infos about forces."""
        return super().more_infos() | {
            "peak_force": self.task_records["peak"].copy(),
            "is_crushed": self._crushed,
            "is_success": self.records["success"] & ~self._crushed,
        }


class GentleEnv(LiftEnv):
    """Pick an object up and hold it, and press it no harder than it bears.

    ## Description

    The scene, the robot, the task and its success of `LiftEnv`. The object bears `max_force` N from each finger, and
    20 % more; a finger that presses harder at any physics step (500 Hz) crushes it, whatever it was pressed against.
    The force is that of a whole finger on the object, pressing and friction together.

    ## Action Space

    As `LiftEnv`.

    ## Observation Space

    As `LiftEnv`. The info of a reset has `max_force`; `info` has `peak_force`, N, the largest so far, and `is_crushed`.

    ## Rewards

    As `LiftEnv`; from the step in which the object is crushed on no reward is above 0.

    ## Starting State

    As `LiftEnv`.

    ## Episode End

    As `LiftEnv`, and terminates when the object is crushed.

    ## Arguments

    Those of `LiftEnv`, with `backend="mujoco"` alone, and:

    | Argument | Default | Valid |
    | --- | --- | --- |
    | `max_force` | `8.0` | N above 0 |

    ## Version History

    * v0: as above; from 0.4.0.
    """

    episodes_type = GentleEpisodes
    settings_type = GentleSettings
