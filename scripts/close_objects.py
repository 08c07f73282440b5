"""Are close objects told apart, is one alone left whole, and is what is pointed at lifted clean?

    python scripts/close_objects.py --seed 3000 --scenes 100                       purity at gaps of 0.5 to 2 cm
    python scripts/close_objects.py --seed 3000 --scenes 100 --neighbours 0        objects alone: what is torn off
    python scripts/close_objects.py --seed 3000 --scenes 30 --play                 clean lifts of `bilevel`

Each scene has an object drawn from --objects and its neighbours, seen by four cameras; a point on it is named, as with
`mask="perceived"`. Purity: the share of the points held for the object that show it. Kept: the share of its points,
as its true mask gives them, that lie within 8 mm of one that is held for it. Good: both above 0.9. Doubtful is what
perception says of itself.
"""

import json
import sys
from typing import Annotated, Any

import gymnasium as gym
import numpy as np
from scipy.spatial import cKDTree
from tqdm import tqdm

import dexgrasp_env  # noqa: F401  (registers the environments)
from dexgrasp.agent import public_info
from dexgrasp.cli.command import Script
from dexgrasp.cli.commands import run_script
from dexgrasp.evaluation.statistics import wilson_interval
from dexgrasp.registry import make_agent
from dexgrasp_env.arrays import Mask
from dexgrasp_env.objects.load import resolve_targets
from dexgrasp_env.perception.scene import Scene
from dexgrasp_env.sensing.perception import Perception
from dexgrasp_env.valid import Count, Natural, one_of

GOOD, _NEAR, _STEPS = 0.9, 0.008, 400


def purity_and_kept(seen: Scene, true: Scene, mask: Mask) -> tuple[float, float]:
    """Return how pure the target of a scene is and what it keeps of that of its true mask; 0 where there is none.

    Args:
        seen: the scene.
        true: that in which the object is known by its mask.
        mask: (pixels,) that show the object.
    """
    if seen.reason or true.reason:
        return 0.0, 0.0
    far = cKDTree(seen.target.points).query(true.target.points)[0]
    return float(mask[seen.target.pixels].mean()), float((far < _NEAR).mean())


def told(env: Any, seed: int) -> dict[str, Any]:
    """Return purity, what is kept, and whether it is said to be doubtful, of the scene that an environment is in."""
    simulation = env.unwrapped.simulation
    perception = Perception(simulation.model, env.unwrapped.settings.cell.make_cameras())
    perception.reset(np.random.default_rng(seed))
    seen, true = (
        perception.observe(simulation.data, np.random.default_rng(seed), mask)
        for mask in ("perceived", "true")
    )
    if seen.reason or true.reason:
        return {"reason": seen.reason or true.reason}
    shown = simulation.model.geom_bodyid[perception.rays.segment(simulation.data).ravel()]
    purity, kept = purity_and_kept(seen, true, shown == simulation.model.body("object").id)
    row = {"purity": purity, "kept": kept}
    return row | {"good": min(row.values()) > GOOD, "doubtful": seen.target.doubtful}


def play(env: Any, agent: Any, observation: Any, info: dict[str, Any], seed: int) -> dict[str, Any]:
    """Let an agent lift what is pointed at; return what came of it."""
    agent.seed(seed)
    agent.reset(observation, public_info(env, info))
    for _ in range(_STEPS):
        observation, _, ended, cut, info = env.step(agent.act(observation))
        if ended or cut:
            break
    return {"lifted": bool(info["is_success"]), "clean": bool(info["is_clean"])}


def share(rows: list[dict[str, Any]], name: str) -> str:
    """Return how many rows have a name true, with a 95 % Wilson interval."""
    count = sum(bool(row.get(name)) for row in rows)
    low, high = wilson_interval(count, len(rows))
    return f"{name} {count} of {len(rows)} [{100 * low:.0f}, {100 * high:.0f}]"


class Close(Script):
    """Makes scenes, and says how well the object is told from what stands around."""

    objects: tuple[str, ...] = ("all20",)
    neighbours: Natural = 8
    gaps: tuple[float, float] = (0.005, 0.02)
    mask: Annotated[str, one_of(("perceived", "true"))] = "perceived"
    seed: Natural = 3000
    scenes: Count = 100
    play: bool = False

    def run(self) -> int:
        targets, rows = resolve_targets(self.objects), []
        agent: Any = make_agent("bilevel") if self.play else None
        for k in tqdm(range(self.scenes), disable=None):
            rows.append(self.row(targets[k % len(targets)], self.seed + k, agent))
            print(json.dumps(rows[-1]), flush=True)
        bad = [row for row in rows if not row.get("good")]
        told = ("good", "doubtful", *(("lifted", "clean") if agent else ()))
        print("; ".join(share(rows, name) for name in told))
        print(f"of those not good, {share(bad, 'doubtful') if bad else 'none'}")
        for name in ("purity", "kept"):
            low, middle = np.quantile([row.get(name, 0.0) for row in rows], (0.1, 0.5))
            print(f"{name}: median {middle:.3f}, lowest tenth {low:.3f}")
        return 0

    def row(self, target: str, seed: int, agent: Any) -> dict[str, Any]:
        """Return what is told in a scene, and what an agent makes of it."""
        settings = {
            "neighbours": self.neighbours,
            "gaps": self.gaps,
            "mask": self.mask,
            "obs_mode": "pointcloud",
        }
        settings |= agent.env_settings if agent else {}
        env = gym.make("DexGrasp/ClutterDense-v1", objects=target, disable_env_checker=True, **settings)
        observation, info = env.reset(seed=seed)
        row = {"target": target, "seed": seed} | told(env, seed)
        row |= play(env, agent, observation, info, seed) if agent else {}
        env.close()
        return row


if __name__ == "__main__":
    sys.exit(run_script(Close))
