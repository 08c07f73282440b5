"""Make the file of pre-grasps that `DexGrasp/LiftFromGrasp` begins at: certified, each with its approach.

    python scripts/pregrasps.py assets/pregrasps.npz --objects all20 --each 4 --seed 71

For each object `bilevel` plans on the clouds of drawn scenes; of a plan that then holds in simulation the file keeps
the object's name and pose (7,), and the joints (16, n) rad from home to the fingers open around the object.
"""

import sys
from itertools import islice

import gymnasium as gym
import numpy as np
from tqdm import tqdm

import dexgrasp_env  # noqa: F401  (registers the environments)
from dexgrasp.agents.bilevel import BilevelAgent
from dexgrasp.cli.command import Argument, File, Script
from dexgrasp.cli.commands import run_script
from dexgrasp.evaluation.protocol import TrialSeeds
from dexgrasp.evaluation.trial import run_trial
from dexgrasp_env.arrays import Array
from dexgrasp_env.objects.load import Objects
from dexgrasp_env.valid import Count, Natural

_KNOTS = 16  # of a way
_TRIES = 5  # scenes for each that is wanted


class PreGraspFile(Script):
    """Plan pre-grasps and write them to a file.

    Attributes:
        out: file, .npz.
        objects: objects, or sets.
        each: pre-grasps of each object.
        seed: of the scenes.
    """

    out: Argument[File]
    objects: Objects
    each: Count = 4
    seed: Natural = 71

    def run(self) -> int:
        """Write the file; 1 where an object has fewer."""
        agent, rows = BilevelAgent(), list[tuple[str, Array, Array]]()
        for target in tqdm(self.objects):
            env = gym.make("DexGrasp/Lift-v2", objects=target, disable_env_checker=True, **agent.env_settings)
            seeds = range(self.seed, self.seed + _TRIES * self.each)
            ways = (way for seed in seeds if (way := _way(env, agent, seed)) is not None)
            rows += [(target, *way) for way in islice(ways, self.each)]
            env.close()
        names, poses, ways = zip(*rows, strict=True)
        np.savez_compressed(
            self.out, objects=np.array(names), poses=np.array(poses), ways=np.array(ways, np.float32)
        )
        print(f"{len(rows)} pre-grasps of {len(set(names))} objects")
        return int(len(rows) < self.each * len(self.objects))


def _way(env: gym.Env, agent: BilevelAgent, seed: int) -> tuple[Array, Array] | None:
    """Return the object's pose and the joints on the way to a pre-grasp that holds; None where none is found."""
    env.reset(seed=seed)
    pose = env.unwrapped.simulation.object_pose()
    outcome, _ = run_trial(env, agent, TrialSeeds(seed, seed))
    if not outcome.success or outcome.details.get("regrasps") or agent.result.found[0].script is None:
        return None
    way = agent.result.found[0].script.way("approach")
    knots = np.linspace(0.0, len(way) - 1.0, _KNOTS)
    return pose, np.stack([np.interp(knots, np.arange(len(way)), column) for column in way.T], axis=1)


if __name__ == "__main__":
    sys.exit(run_script(PreGraspFile))
