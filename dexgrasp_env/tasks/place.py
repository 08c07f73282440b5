"""DexGrasp/Place-v1."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.utils import EzPickle
from numpy.typing import NDArray

from dexgrasp_env.errors import InputError
from dexgrasp_env.tasks.constants import GOAL_HEIGHT, GOAL_RADIUS, GOAL_STEPS, PLACE_X, PLACE_Y
from dexgrasp_env.tasks.lift import LiftEnv

_GOAL_LOW, _GOAL_HIGH = np.array([PLACE_X, PLACE_Y, GOAL_HEIGHT]).T


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

    def __init__(
        self, objects: str | Sequence[str] = "ycb6", reward_mode: str = "sparse", **kwargs: Any
    ) -> None:
        if kwargs.get("obs_mode", "state") != "state" or kwargs.get("disturbance") not in (None, "none"):
            raise InputError(
                "Place-v1 has obs_mode 'state' and no disturbance: valid are the other arguments"
            )
        super().__init__(objects=objects, reward_mode=reward_mode, **kwargs)
        EzPickle.__init__(self, objects=objects, reward_mode=reward_mode, **kwargs)
        size = sum(part.shape[0] for part in self.observation_space.values())  # type: ignore[attr-defined]
        self.observation_space = spaces.Dict(  # type: ignore[assignment]
            {
                "observation": spaces.Box(-np.inf, np.inf, (size,), np.float32),
                "achieved_goal": spaces.Box(-np.inf, np.inf, (3,), np.float32),
                "desired_goal": spaces.Box(
                    _GOAL_LOW.astype(np.float32), _GOAL_HIGH.astype(np.float32), dtype=np.float32
                ),
            }
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Start an episode; see `LiftEnv.reset`. The goal is drawn last."""
        observation, info = super().reset(seed=seed, options=options)
        record = self._episodes.records[0]
        record["goal"] = self.np_random.uniform(_GOAL_LOW, _GOAL_HIGH)
        return self._goal_observation(observation), self._goal_info(info)

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[dict[str, NDArray[Any]], float, bool, bool, dict[str, Any]]:
        """Advance 50 ms; see `LiftEnv.step`."""
        state, _, terminated, truncated, info = super().step(action)
        observation, record = self._goal_observation(state), self._episodes.records[0]
        achieved, desired = observation["achieved_goal"], observation["desired_goal"]
        reached = np.linalg.norm(achieved - desired) <= GOAL_RADIUS and not info["failure"]
        record["at_goal"] = record["at_goal"] + 1 if reached else 0
        reward = float(self.compute_reward(achieved, desired, info))
        return observation, reward, terminated, truncated, self._goal_info(info)

    def compute_reward(
        self, achieved_goal: NDArray[Any], desired_goal: NDArray[Any], info: Any
    ) -> NDArray[np.float64]:
        """Return the rewards (...,) of goals (..., 3) m; `info` is not used."""
        distance = np.linalg.norm(np.asarray(achieved_goal) - np.asarray(desired_goal), axis=-1)
        if self.settings.reward_mode == "dense":
            return -distance.astype(np.float64)
        return -(distance > GOAL_RADIUS).astype(np.float64)

    def _goal_observation(self, state: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
        return {
            "observation": np.concatenate(list(state.values())),
            "achieved_goal": state["object_pose"][:3].copy(),
            "desired_goal": self._episodes.records["goal"][0].astype(np.float32),
        }

    def _goal_info(self, info: dict[str, Any]) -> dict[str, Any]:
        steps = int(self._episodes.records["at_goal"][0])
        distance = float(np.linalg.norm(self.data.qpos[23:26] - self._episodes.records["goal"][0]))
        return info | {"is_success": steps >= GOAL_STEPS, "goal_distance": distance}
