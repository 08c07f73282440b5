"""What `vary_constants.py` measures: plans of scenes, and looks at them, always of the same ones."""

import copy
import functools
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from close_objects import GOOD, purity_and_kept

from dexgrasp.agent import public_info
from dexgrasp.agents.bilevel import BilevelAgent
from dexgrasp.evaluation.protocol import get_protocol, trial_seeds
from dexgrasp.planning.settings import PlannerSettings
from dexgrasp_env.perception.pipeline import segment
from dexgrasp_env.perception.selection import TargetSelector
from dexgrasp_env.sensing.perception import Perception

MOST = 6.0  # weights: more load counts as so much

Outcome = dict[str, float]
"""Of a scene: `found`, `held`, `merit` (load, or purity and what is kept), `tried`, `seconds` of CPU time."""
Look = Callable[[], Outcome]
Shown = tuple[Any, Mapping[str, Any]]


@dataclass(frozen=True)
class Scenes:
    """Scenes of objects under a protocol.

    Attributes:
        objects: of them.
        trials: of each object.
        seed: of all.
        protocol: that makes them.
    """

    objects: tuple[str, ...]
    trials: int
    seed: int
    protocol: str

    @functools.cached_property
    def begun(self) -> list[tuple[gym.Env[Any, Any], int, int]]:
        """Environments, and seeds of scene and agent."""
        made, protocol = [], get_protocol(self.protocol)
        for target in self.objects:
            arguments = {**protocol.scene, **BilevelAgent.env_settings, "objects": [target]}
            env = gym.make(protocol.env_id, **arguments, disable_env_checker=True)
            seeds = [trial_seeds(self.seed, target, k) for k in range(self.trials)]
            made += [(env, own.scene, own.agent) for own in seeds]
        return made

    @functools.cached_property
    def shown(self) -> list[Shown]:
        """What the agent is shown of each at first."""
        return [env.reset(seed=scene) for env, scene, _ in self.begun]

    @functools.cached_property
    def looks(self) -> list[Look]:
        """What looks at each."""
        return [look(env, scene) for env, scene, _ in self.begun]


def plans(scenes: Scenes, settings: PlannerSettings | None, carry: bool) -> list[Outcome]:
    """Plan in each scene, and carry out what is found where that is asked for."""
    agent, outcomes = BilevelAgent(settings=settings, regrasps=0), []
    for (env, scene, seed), shown in zip(scenes.begun, scenes.shown, strict=True):
        observation, info = env.reset(seed=scene) if carry else shown
        agent.seed(seed)
        began = time.process_time()
        agent.reset(observation, public_info(env, info))
        seconds, plan = time.process_time() - began, agent.result
        assert plan is not None
        over = not (carry and plan.found)
        while not over:
            observation, _, terminated, truncated, info = env.step(agent.act(observation))
            over = terminated or truncated or info["is_success"]
        load = min(plan.found[0].grasp.certificate.load, MOST) if plan.found else 0.0
        numbers = float(bool(plan.found)), float(info["is_success"]), load, float(plan.log.tried), seconds
        outcomes.append(dict(zip(("found", "held", "merit", "tried", "seconds"), numbers, strict=True)))
    return outcomes


def look(env: gym.Env[Any, Any], seed: int) -> Look:
    """Return what finds the object again in the depth images of a scene, a point on it being named."""
    env.reset(seed=seed)
    unwrapped: Any = env.unwrapped
    model, data = unwrapped.simulation.model, copy.copy(unwrapped.simulation.data)
    perception = Perception(model, unwrapped.settings.cell.make_cameras())
    perception.reset(np.random.default_rng(seed))
    depths, shown = perception.measure(data, np.random.default_rng(seed)), perception.rays.segment(data)
    own, cameras = perception.robot.at(data), perception.believed
    bodies = np.where(shown >= 0, model.geom_bodyid[shown], -1)
    mask = bodies == model.body("object").id
    true = segment(depths, cameras, np.random.default_rng(seed), own, TargetSelector(mask=mask))
    near = perception._point(data, depths, masked=False)

    def found() -> Outcome:
        """Return what is found with the constants of now."""
        began = time.process_time()
        seen = segment(depths, cameras, np.random.default_rng(seed), own, near)
        seconds = time.process_time() - began
        purity, kept = purity_and_kept(seen, true, mask.ravel())
        merit = min(purity, kept)
        return {"found": float(merit > GOOD), "held": 0.0, "merit": merit, "tried": 1.0, "seconds": seconds}

    return found
