"""The task of clearing the table, DexGrasp/Clear-v0: all that stands there goes into a tray; its page."""

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from dexgrasp_env.arrays import Arrays, Fields, Mask
from dexgrasp_env.errors import unknown_argument
from dexgrasp_env.tasks.clutter import NEIGHBOURS, ClutterEnv, ClutterEpisodes, ClutterSettings
from dexgrasp_env.tasks.constants import CLEAR_STEPS, MOST_NEIGHBOURS
from dexgrasp_env.tasks.episodes import Episodes
from dexgrasp_env.tasks.records import FAILURES, TOUCHING_HAND
from dexgrasp_env.tasks.settings import LiftSettings
from dexgrasp_env.tasks.simulation import Physics
from dexgrasp_env.valid import number

TRAY = np.array([[0.20, 0.41, 0.0], [0.76, 0.595, 0.08]])
"""Lowest and highest corner, m, of the space between the tray's walls, as assets/scene/tray.xml has them."""


@dataclass(frozen=True, kw_only=True)
class ClearSettings(ClutterSettings):
    """Everything that `gym.make` accepts of `ClearEnv`, in checked form.

    Attributes:
        count: objects on the table.
    """

    count: Annotated[int, number(ge=2, le=MOST_NEIGHBOURS + 1, whole=True)] = 8

    def __post_init__(self) -> None:
        object.__setattr__(self, "neighbours", (self.count - 1, self.count - 1))

    @classmethod
    def of(cls, **given: Any) -> LiftSettings:
        """Check the arguments of the environment.

        Raises:
            InputError: as `ClutterSettings.of`, or for what `count`, the tray and the reward say already.
        """
        derived = ("neighbours", "mask", "bin", "reward_mode", "reward_weights", "reward_scale")
        for name in set(derived) & set(given):
            raise unknown_argument(name, [key for key in cls.__dataclass_fields__ if key not in derived])
        return super().of(**given)

    @property
    def target_selection(self) -> str:
        """Hint by which perception finds an object: any will do."""
        return "any"

    @property
    def agent_info(self) -> Fields:
        """Facts that an agent may know, by name."""
        return super().agent_info | {"tray": TRAY.copy()}

    @property
    def usual_steps(self) -> int:
        """Control steps at 20 Hz that episodes have without a disturbance."""
        return CLEAR_STEPS * self.count


class ClearEpisodes(ClutterEpisodes):
    """Episodes in which everything goes into the tray."""

    task = "clear"
    task_dtype = np.dtype([*NEIGHBOURS.descr, ("in_tray", "i8"), ("off_table", "i8")])

    def __init__(self, settings: LiftSettings, number: int) -> None:
        super().__init__(settings, number)
        self.furniture = "tray"

    def _finish(self, part: slice, where: Physics, judge: bool, state: Arrays) -> Arrays:
        """Count what is in the tray and what has fallen, and reward the change."""
        state, notes = super()._finish(part, where, judge, state), self.task_records[part]
        if not judge:
            return state
        (qpos, _, sensors), count = where.current, 1 + self.neighbours
        centres = qpos[:, self._alone[0] - 7 :].reshape(len(notes), -1, 7)[:, :, :3]
        held = np.column_stack([sensors[:, self.rules.at[TOUCHING_HAND]], sensors[:, self._alone[1] :]]) > 0
        # m: centres so high are not in the tray, and so low they are off the table.
        inside = ((centres >= TRAY[0]) & (centres <= [*TRAY[1, :2], 0.25])).all(axis=2) & ~held
        fallen = centres[:, :, 2] < -0.05
        before = notes["in_tray"] - notes["off_table"]
        notes["in_tray"], notes["off_table"] = inside.sum(axis=1), fallen.sum(axis=1)
        self.rewards[part] = (notes["in_tray"] - notes["off_table"] - before) / count
        return state

    def endings(self) -> tuple[Mask, Mask]:
        """Return which episodes have terminated, as numbers went wrong, and which are truncated, (N,) each."""
        terminated, truncated = super().endings()
        return terminated & (self.records["failure"] != FAILURES.index("object_lost")), truncated

    def more_infos(self) -> Arrays:
        """Return the columns of infos about the objects."""
        touched = self.task_records["hit"].sum(axis=1) + self.records["touched"]
        counts = {name: self.task_records[name].copy() for name in ("in_tray", "off_table")}
        number = np.full(len(self.records), 1 + self.neighbours)
        done = {"is_success": counts["in_tray"] == number}
        return {**Episodes.more_infos(self), "objects": number, **counts, "touched": touched, **done}


class ClearEnv(ClutterEnv):
    """Clear the table: put everything that stands there into a tray.

    ## Description

    The robot, the physics and the scenes of `ClutterEnv` on the open table, with a tray beside where objects may
    stand: walls 80 mm high around x 0.20-0.76, y 0.41-0.595. An object is in the tray while its centre is within them,
    at most 25 cm high, and the robot does not touch it. The task is solved when all are.

    ## Action Space

    As `LiftEnv`.

    ## Observation Space

    That of `ClutterEnv`: `object_pose` is the first object's, `cloud` has the points of the one nearest to the middle
    of the table, `around` those of the others. Cameras do not see into the tray. The info of a reset has `tray`,
    (2, 3) m, the lowest and highest corner of its inside.

    `info` has more than that of `LiftEnv`: `objects` (how many), `in_tray`, `off_table` (pushed off it), `touched`
    (how many the robot has touched, looked at in every physics step).

    ## Rewards

    The change of `in_tray` less that of `off_table`, over the number of objects: 1 in all for a cleared table.

    ## Starting State

    As `ClutterEnv` with gaps.

    ## Episode End

    Terminates when numbers go wrong; an object that is lost ends nothing. The time limit is 400 control steps an
    object: 3,200 for the 8 of the id.

    ## Arguments

    Those of `ClutterEnv` without `neighbours`, `mask`, `bin` and those of rewards, and:

    | Argument | Default | Valid |
    | --- | --- | --- |
    | `count` | `8` | objects, 2 to 26 |

    ## Version History

    * v0: as above; from 0.4.0.
    """

    episodes_type = ClearEpisodes
    settings_type = ClearSettings
