"""The task of bringing an object to a goal, DexGrasp/Place-v2: episodes, rewards of goals and its page."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from gymnasium import spaces
from numpy.random import Generator

from dexgrasp_env.arrays import AnyArray, Array, Arrays
from dexgrasp_env.tasks.constants import (
    GOAL_STEPS,
    PLACE_X,
    PLACE_Y,
    WORKSPACE_HIGH,
    WORKSPACE_LOW,
    at_pace,
)
from dexgrasp_env.tasks.control import DIRECT_MODES
from dexgrasp_env.tasks.episodes import Episodes
from dexgrasp_env.tasks.lift import LiftEnv
from dexgrasp_env.tasks.observations import OBS_SUMS, key_sizes, unbounded
from dexgrasp_env.tasks.records import FAILURES, TOUCHING_HAND
from dexgrasp_env.tasks.settings import LiftSettings
from dexgrasp_env.tasks.simulation import Physics, Simulation
from dexgrasp_env.valid import Rule, check, one_of


@dataclass(frozen=True)
class GoalSettings:
    """Ranges that goals are drawn from, and what reaching one means.

    Attributes:
        highest: m above the table.
        rise: m above where it lies, at least, of an object that is to be held.
        away: m from where it lies, at least, of one that is to be put down.
        radius: m: so near the goal is reached.
        wrong: m that the hand costs the dense reward, where it does not do what the goal says.
    """

    highest: float = 0.35
    rise: float = 0.05
    away: float = 0.10
    radius: float = 0.03
    wrong: float = 0.05


_GOALS = GoalSettings()


@dataclass(frozen=True, kw_only=True)
class PlaceSettings(LiftSettings):
    """Everything that `gym.make` accepts of `PlaceEnv`, in checked form."""

    reward_mode: Annotated[str, one_of(("sparse", "dense"))] = "sparse"
    obs_mode: Annotated[str, one_of(OBS_SUMS)] = "state"
    control_mode: Annotated[str, one_of((*DIRECT_MODES, "grasp"))] = "joint_delta"  # whole grasps lift

    def needs(self) -> dict[str, tuple[bool, str]]:
        """Return what arguments need; the reward is of goals, not of terms with weights."""
        return super().needs() | {
            "reward_weights": (False, "a task whose reward has terms"),
            "disturbance": (False, "a task of lifting"),
        }


class PlaceEpisodes(Episodes):
    """Episodes with a goal each."""

    task = "place"
    task_dtype = np.dtype(
        [
            ("goal", "f8", (4,)),  # m, where the object's centre is to be; and whether in the hand
            ("start", "f8", (3,)),  # m, where it lay at first
            ("moved", "?"),  # has it been away from there?
            ("at_goal", "i8"),  # consecutive control steps there
        ]
    )
    options = (*Episodes.options, "goal")

    def __init__(self, settings: LiftSettings, number: int) -> None:
        super().__init__(settings, number)
        self._order = list(key_sizes("state", settings.cell.robot))
        ends = np.array([[*WORKSPACE_LOW, -1.0], [*WORKSPACE_HIGH, 1.0]], np.float32)
        self._goals = spaces.Box(*ends, dtype=np.float32)
        self.truncating[FAILURES.index("object_lost")] = True
        self._distances = np.zeros(number)  # m, of the objects' centres to their goals

    def observation_space(self) -> spaces.Dict:
        """Return the space that goal-conditioned learners want."""
        parts = dict(super().observation_space()) | {"desired_goal": self._goals}
        if self.settings.obs_mode.startswith("state"):
            parts["observation"] = unbounded(sum(spaces.flatdim(parts.pop(key)) for key in self._order))
            parts["achieved_goal"] = self._goals
        return spaces.Dict(parts)

    def _begin(self, i: int, rng: Generator, options: Mapping[str, Any]) -> Simulation:
        """Start episode `i`; the goal is drawn last. A goal that is given has not been reached for any time yet."""
        simulation, record = super()._begin(i, rng, options), self.task_records[i]
        if not self.slots[i].resumed:
            record["start"] = simulation.object_pose()[:3]
            record["goal"] = self._draw(rng, record["start"])
        if options.get("goal") is not None:
            record["goal"] = self._check_goal(options["goal"])
            record["at_goal"] = self.records[i]["success"] = 0
        return simulation

    def _draw(self, rng: Generator, start: Array) -> Array:
        """Draw a goal: one that the object is to be held at, or put down at, away from where it lies."""
        held = rng.random() < 0.5
        low, high = np.array([PLACE_X, PLACE_Y, (start[2] + _GOALS.rise, _GOALS.highest)]).T
        while True:
            goal = rng.uniform(low, np.maximum(low, high))
            if held:
                return np.array([*goal, 1.0])
            if np.hypot(*(goal - start)[:2]) >= _GOALS.away:
                return np.array([*goal[:2], start[2], 0.0])

    def _check_goal(self, goal: Any) -> Array:
        space = self._goals

        def validate(value: Any) -> Array:
            """Return the goal that a value states."""
            given: Array = np.asarray(value, dtype=np.float32)
            if not space.contains(given) or not np.isin(given[3:], (0.0, 1.0)).all():
                raise ValueError
            return given

        words = f"4 numbers within {space.low} and {space.high}, the last 1 in the hand or 0 free"
        return check("goal", goal, Rule(words, validate))

    def _finish(self, part: slice, where: Physics, judge: bool, state: Arrays) -> Arrays:
        """Compute rewards, success and the observation from the goal."""
        records, notes, (qpos, _, sensors) = self.records[part], self.task_records[part], where.current
        centres = qpos[:, -7:-4]
        known = np.logical_and.reduce(np.isfinite(centres), axis=-1)
        centres = np.where(known[:, None], centres, 0.0)  # where nothing is known no goal is reached
        goals = notes["goal"].astype(np.float32)
        self._distances[part] = np.linalg.norm(centres - notes["goal"][:, :3], axis=-1)
        if judge:
            notes["moved"] |= np.linalg.norm(centres - notes["start"], axis=-1) > _GOALS.radius
        touching = sensors[:, self.rules.at[TOUCHING_HAND]] > 0
        hand = np.where(notes["moved"] & known, touching, -1.0)
        achieved = np.column_stack([centres, hand]).astype(np.float32)
        achieved = np.clip(achieved, self._goals.low, self._goals.high)
        self.rewards[part] = goal_rewards(achieved, goals, self.settings.reward_mode)
        reached = (goal_rewards(achieved, goals, "sparse") == 0.0) & (records["failure"] == 0)
        if judge:
            counts = reached & (records["elapsed"] > 0)
            notes["at_goal"] = np.where(counts, notes["at_goal"] + 1, 0)
            records["success"] = notes["at_goal"] >= at_pace(GOAL_STEPS, self.settings.frame_skip)
        if self.settings.obs_mode.startswith("state"):
            flat = np.concatenate([state[key] for key in self._order], axis=-1)
            state = {"achieved_goal": achieved, "desired_goal": goals, "observation": flat}
        else:
            state["desired_goal"] = goals
        return state

    def more_infos(self) -> Arrays:
        """Return the column of infos about the goal."""
        return super().more_infos() | {"goal_distance": self._distances.copy()}


class GoalRewards:
    """Rewards of other goals, for single and vector environments."""

    settings: LiftSettings

    def compute_reward(self, achieved_goal: AnyArray, desired_goal: AnyArray, info: Any) -> Array:
        """Return the rewards (...,) of goals (..., 4); `info` is not used."""
        return goal_rewards(achieved_goal, desired_goal, self.settings.reward_mode)


class PlaceEnv(GoalRewards, LiftEnv):
    """Bring an object to a place: hold it there in the air, or put it down and let go: a goal-conditioned task.

    ## Description

    The scene, the robot and the physics of `LiftEnv`. Half of the goals are in the air, from 5 cm above where the
    object lies to 35 cm above the table; half are on the table, at least 10 cm away; all inside the area where objects
    are put. The task is solved when for the last 1 s the object's centre has been within 3 cm of the goal and the hand
    has touched it, for goals in the air, or has let go of it, for goals on the table.

    ## Action Space

    As `LiftEnv`.

    ## Observation Space

    With `obs_mode="state"` a `Dict` as goal-conditioned learners want it (`GoalEnv`):

    | Key | Shape | Type | Meaning |
    | --- | --- | --- | --- |
    | `achieved_goal` | (4,) | float32 | m, the object's centre; 1 in the hand, 0 free, -1 where it has not been moved |
    | `desired_goal` | (4,) | float32 | m, where it is to be; 1 in the hand, 0 free |
    | `observation` | (125,) | float32 | the `state` observation of `LiftEnv`, its keys one after the other |

    With cameras it is that of `LiftEnv` and `desired_goal`. An object counts as moved once it has been 3 cm from where
    it lay.

    ## Rewards

    Of achieved and desired goal alone, d apart, so that `env.unwrapped.compute_reward` gives those of other goals.

    | reward_mode | Reward |
    | --- | --- |
    | `sparse` | 0 within 3 cm with the hand as the goal says, else -1 |
    | `dense` | -d, m, less 0.05 while the hand is not as the goal says |

    ## Starting State

    As `LiftEnv`; `reset(options={"goal": [x, y, z, hand]})` sets the goal, `hand` being 1 or 0, also beside `state`.

    ## Episode End

    Terminates when numbers go wrong, truncates after 300 steps and when the object is lost: no reward is above 0, so
    an end that counts as one would pay for throwing it away. Success ends nothing.

    ## Arguments

    Those of `LiftEnv`, with `reward_mode="sparse"` as default; no `disturbance`.

    ## Version History

    * v2: goals on the table, and what the hand is to do; cameras; a lost object truncates.
    * v1: withdrawn; goals in the air alone.
    """

    episodes_type = PlaceEpisodes
    settings_type = PlaceSettings


def goal_rewards(achieved: AnyArray, desired: AnyArray, reward_mode: str) -> Array:
    """Return the rewards (...,) of goals (..., 4); see `PlaceEnv`."""
    achieved, desired = np.asarray(achieved), np.asarray(desired)
    distance = np.linalg.norm((achieved - desired)[..., :3], axis=-1)
    wrong = ((achieved != desired) | (achieved < 0.0))[..., 3]
    if reward_mode == "dense":
        return -distance.astype(np.float64) - _GOALS.wrong * wrong
    return -(~(distance <= _GOALS.radius) | wrong).astype(np.float64)
