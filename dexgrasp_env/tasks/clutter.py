"""Lifting out of clutter, DexGrasp/ClutterSparse-v1, ClutterDense-v1 and ClutterHeap-v1, and its page."""

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from gymnasium import spaces
from numpy.random import Generator

from dexgrasp_env.arrays import Array, Arrays, Fields, Mask
from dexgrasp_env.errors import InputError
from dexgrasp_env.objects.catalogue import OBJECT_SETS
from dexgrasp_env.objects.load import Objects, object_name
from dexgrasp_env.poses import quat_conjugate, rotate
from dexgrasp_env.tasks.arrangement import set_out
from dexgrasp_env.tasks.constants import (
    AROUND_POINTS,
    CLUTTER_EPISODE_STEPS,
    HEAP_EPISODE_STEPS,
    MOST_NEIGHBOURS,
    NEIGHBOUR_MOVED,
    TOPPLED,
)
from dexgrasp_env.tasks.episodes import Episodes
from dexgrasp_env.tasks.lift import LiftEnv
from dexgrasp_env.tasks.observations import OBS_SUMS, unbounded
from dexgrasp_env.tasks.records import Records
from dexgrasp_env.tasks.settings import LiftSettings
from dexgrasp_env.tasks.simulation import Physics, Simulation
from dexgrasp_env.valid import Rule, number, one_of, pair


def _counts(value: Any) -> tuple[int, int]:
    count = number(ge=0, le=MOST_NEIGHBOURS, whole=True)
    return pair(count).validate((value, value) if np.ndim(value) == 0 else value)


@dataclass(frozen=True, kw_only=True)
class ClutterSettings(LiftSettings):
    """Everything that `gym.make` accepts of `ClutterEnv`, in checked form.

    Attributes:
        neighbours: least and most of them.
        neighbour_objects: that neighbours are drawn from, each as often as it comes.
        gaps: m, least and most between the outlines, from above, of a neighbour and of the nearest that stood there
            before; None: all are dropped into a heap, the object among them.
        mask: hint by which perception finds the object that is meant: `true`, its pixels; `perceived`, a point on it.
        bin: whether all stand in a bin; else on the open table.
    """

    objects: Objects = OBJECT_SETS["all20"]
    obs_mode: Annotated[str, one_of(OBS_SUMS)] = "state"
    neighbours: Annotated[
        tuple[int, int], Rule(f"a number from 0 to {MOST_NEIGHBOURS}, or a pair of them", _counts)
    ] = (4, 8)
    neighbour_objects: Objects = OBJECT_SETS["all20"]
    gaps: Annotated[tuple[float, float] | None, pair(number(ge=0, le=0.5))] = (0.02, 0.05)
    mask: Annotated[str, one_of(("true", "perceived"))] = "perceived"
    bin: bool = False
    backend: Annotated[str, one_of(("mujoco",))] = "mujoco"

    def needs(self) -> dict[str, tuple[bool, str]]:
        """Return what arguments need; the mask is of clouds, and neighbours' objects of neighbours."""
        return super().needs() | {
            "mask": (self.obs_mode.endswith("pointcloud"), "an obs_mode of clouds"),
            **dict.fromkeys(("neighbour_objects", "bin"), (self.neighbours[1] > 0, "neighbours")),
            "presentation": (self.gaps is not None, "gaps: a heap is dropped"),
            "starts": (False, "a task of one object"),
        }

    @property
    def target_selection(self) -> str:
        """Hint by which perception finds the object that is meant."""
        return self.mask

    @property
    def usual_steps(self) -> int:
        """Control steps at 20 Hz that episodes have without a disturbance."""
        return HEAP_EPISODE_STEPS if self.gaps is None else CLUTTER_EPISODE_STEPS


NEIGHBOURS = np.dtype(
    [
        ("neighbours", "i8"),
        ("rest", "f8", (MOST_NEIGHBOURS, 7)),  # poses before the robot moved
        ("drift", "f8", (MOST_NEIGHBOURS, 3)),  # m, by which they creep in an episode without the robot
        ("size", "f8", (MOST_NEIGHBOURS, 3)),  # m, of the boxes in their own frames
        ("hit", "?", (MOST_NEIGHBOURS,)),  # touched by the robot at any physics step
        ("toppled", "?", (MOST_NEIGHBOURS,)),
        ("farthest", "f8"),  # m, the farthest that any centre has been from where it would be
    ]
)


class ClutterEpisodes(Episodes):
    """Episodes with neighbours around the object."""

    task = "clutter"
    task_dtype = NEIGHBOURS

    def __init__(self, settings: LiftSettings, number: int) -> None:
        super().__init__(settings, number)
        assert isinstance(settings, ClutterSettings)
        if settings.disturbance.moves:
            raise InputError("Clutter has no moving objects: valid disturbances are none, pushed, shaken")
        self._clutter, self.furniture = settings, "bin" if settings.bin else ""
        self.neighbours = settings.neighbours[1]
        first = next(iter(self.simulations.values())).base
        self.options = ("object", "object_pose", "state")
        self._alone = first.nq, first.nsensordata  # of a scene without neighbours
        if settings.gaps is None:
            self.options = ("object", "state")  # where the object lies in a heap is not for anybody to say

    def observation_space(self) -> spaces.Dict:
        """Return the space of an observation of `Lift`, and what stands around."""
        parts = dict(super().observation_space())
        if self.settings.obs_mode.startswith("state"):
            parts["neighbour_poses"] = unbounded(self.neighbours, 7)
            parts["neighbour_sizes"] = spaces.Box(0.0, np.inf, (self.neighbours, 3), np.float32)
        if self.settings.obs_mode.endswith("pointcloud"):
            parts["around"] = unbounded(AROUND_POINTS, 3)
            parts["around_normals"] = spaces.Box(-1.0, 1.0, (AROUND_POINTS, 3), np.float32)
            parts["around_labels"] = spaces.Box(-1, np.iinfo(np.int16).max, (AROUND_POINTS,), np.int16)
        return spaces.Dict(parts)

    def _of(self) -> Fields:
        return super()._of() | {
            "neighbours": self.neighbours,
            "mask": self.settings.target_selection,
            "furniture": self.furniture,
        }

    def _set_out(self, i: int, pose: Array, rng: Generator, given: bool) -> Simulation:
        """Draw neighbours, and the object's pose where it is not given, until they are a scene that lies still."""
        slot, settings = self.slots[i], self._clutter
        draws = 60
        for _ in range(draws):
            count = rng.integers(*settings.neighbours, endpoint=True)
            drawn = rng.integers(len(settings.neighbour_objects), size=count)
            names = tuple(settings.neighbour_objects[k] for k in drawn)
            simulation = self._mount(i, slot.target, names, slot.variation)
            undisturbed = set_out(simulation, pose, settings.gaps, rng)
            if undisturbed is not None:
                poses, record = simulation.poses()[1:], self.task_records[i]
                record["neighbours"] = count
                record["rest"][:count] = poses
                record["drift"][:count] = (undisturbed[1:] - poses)[:, :3]
                for k, model in enumerate(simulation.neighbours):
                    record["size"][k] = model.extents
                return simulation
            if not given:
                pose = settings.draw_pose(simulation.object, slot.variation.size, rng)
        raise InputError(
            f"no scene with {self.neighbours} neighbours came to rest in {draws} draws: valid are fewer "
            "neighbours, wider gaps or smaller objects"
        )

    def _finish(self, part: slice, where: Physics, judge: bool, state: Arrays) -> Arrays:
        """Judge what became of the neighbours, and add them to `state`."""
        records, (qpos, _, sensors) = self.task_records[part], where.current
        poses = qpos[:, self._alone[0] :].reshape(len(records), -1, 7)
        there = np.arange(poses.shape[1]) < records["neighbours"][:, None]
        if judge:
            _judge(records, poses, there, sensors[:, self._alone[1] :] > 0)
        if self.settings.obs_mode.startswith("state"):
            seen = np.zeros((len(records), self.neighbours, 7), np.float32)
            seen[:, : poses.shape[1]] = np.where(there[..., None], np.nan_to_num(poses), 0.0)
            sizes = records["size"][:, : self.neighbours].astype(np.float32)
            more = {"neighbour_poses": seen, "neighbour_sizes": sizes}
            state = dict(sorted((state | more).items()))
        return state

    def more_infos(self) -> Arrays:
        """Return the columns of infos about neighbours."""
        moved, hit = self.task_records["farthest"], self.task_records["hit"]
        names = [
            " ".join(object_name(slot.neighbours[k]) for k in np.flatnonzero(row))
            for slot, row in zip(self.slots, hit, strict=True)
        ]
        return super().more_infos() | {
            "is_clean": self.records["success"] & (moved <= NEIGHBOUR_MOVED),
            "neighbours": self.task_records["neighbours"].copy(),
            "neighbours_moved": moved.copy(),
            "neighbours_hit": hit.sum(axis=1),
            "neighbours_toppled": self.task_records["toppled"].sum(axis=1),
            "neighbours_hit_names": np.array(names, object),
        }


def _judge(records: Records, poses: Array, there: Mask, touched: Mask) -> None:
    """Note how far neighbours (N, k) that are there have moved, which have toppled and which the robot touches."""
    count = poses.shape[1]
    rest, drift = records["rest"][:, :count], records["drift"][:, :count]
    moved = poses[..., :3] - rest[..., :3]
    along = (moved * drift).sum(-1) / np.maximum((drift * drift).sum(-1), 1e-12)
    moved -= np.clip(along, 0.0, 1.0)[..., None] * drift
    farthest = np.where(there, np.sqrt((moved * moved).sum(-1)), 0.0).max(axis=1, initial=0.0)
    records["farthest"] = np.fmax(records["farthest"], farthest)
    now, first = (rotate(quat_conjugate(at[..., 3:]), np.array([0.0, 0.0, 1.0])) for at in (poses, rest))
    records["toppled"][:, :count] |= there & ((now * first).sum(-1) < np.cos(TOPPLED))
    records["hit"][:, :count] |= touched


class ClutterEnv(LiftEnv):
    """Pick one object up among others, and leave those where they are.

    ## Description

    The robot, the physics, the task and its success of `LiftEnv`, among other objects: on the open table with gaps
    between their outlines, or in a heap where all were dropped. A success is clean if no neighbour's centre has ever
    been more than 2 cm from where it would be without the robot.

    | id | Neighbours | Scene |
    | --- | --- | --- |
    | `DexGrasp/ClutterSparse-v1` | 4-8 | gaps of 2-5 cm |
    | `DexGrasp/ClutterDense-v1` | 9-15 | gaps of 0.5-2 cm |
    | `DexGrasp/ClutterHeap-v1` | 8 | dropped |

    ## Action Space

    As `LiftEnv`.

    ## Observation Space

    That of `LiftEnv`; `cloud` has the points of the object that is meant. More, where K is the most neighbours:

    | Key | Shape | Type | obs_mode | Meaning |
    | --- | --- | --- | --- | --- |
    | `neighbour_poses` | (K, 7) | float32 | `state` | position m and quaternion wxyz; zeros where there are fewer |
    | `neighbour_sizes` | (K, 3) | float32 | `state` | m, their boxes in their own frames |
    | `around` | (4096, 3) | float32 | `pointcloud` | m, points of all else on the table |
    | `around_normals` | (4096, 3) | float32 | `pointcloud` | unit normals |
    | `around_labels` | (4096,) | int16 | `pointcloud` | object by number from 1; -1 of none, 0 no point |

    With `mask="true"` every pixel says whether it shows the object; with `mask="perceived"` one point on it is given,
    the middle one of those that the cameras see, and perception holds what it does for one thing with it.

    `info` has also `is_clean`, `neighbours` (how many), `neighbours_moved` (m, the farthest that any centre has been
    from where it would be), `neighbours_hit` (how many the robot has touched, at any physics step),
    `neighbours_hit_names` (theirs, with spaces between), `neighbours_toppled` (how many have turned their vertical by
    30 deg); with a point cloud `perception_doubtful`: the object may be two, or a part of the next.

    ## Rewards

    Those of `LiftEnv`.

    ## Starting State

    The object is drawn and placed as in `LiftEnv`. With gaps each neighbour, in a drawn rest pose, is slid from the
    object outwards to the first place where the nearest outline, from above, is as far as the gap drawn. In a heap all
    are dropped in a drawn order, turned at random, three at a time, about the drawn place or the nearest with room;
    what does not stay is laid down again. A scene is drawn again unless all of it rests on the table (x in 0.30-0.76,
    y in +-0.38), free of the robot, and nothing pierces another by 2 mm, sinks by 3 mm or, with gaps, floats, topples
    or slides by 3 mm. A heap creeps, by less than 2 cm in 15 s, which is no motion of a neighbour.
    `reset(options=...)` takes those of `LiftEnv`; a heap has no `object_pose`.

    ## Episode End

    As `LiftEnv`; the time limit is 600 control steps, 30 s, and in a heap 1,800, 90 s.

    ## Arguments

    Those of `LiftEnv`, and:

    | Argument | Default | Valid |
    | --- | --- | --- |
    | `neighbours` | `(4, 8)` | how many, or the least and the most, up to 25 |
    | `neighbour_objects` | `'all20'` | as `objects`: what neighbours are drawn from |
    | `gaps` | `(0.02, 0.05)` | m, least and most; None: dropped |
    | `mask` | `'perceived'` | `true`, `perceived` |
    | `bin` | `False` | True: walls 8 cm high stand around where all may be, where there are neighbours |

    ## Version History

    * v1: as above.
    """

    episodes_type = ClutterEpisodes
    settings_type = ClutterSettings
