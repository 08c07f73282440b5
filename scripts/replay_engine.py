"""Plays an exported trajectory in Bullet or Drake, whose solvers and contacts share no code with MuJoCo's.

    pip install -c constraints.txt pybullet drake
    dexgrasp export grasps/pear/grasp.json --format mjcf --out robot/pear
    python scripts/replay_engine.py robot/pear --engine drake --replay 5

The bodies are those of `scene.xml` as MuJoCo compiles it: shapes, inertias, joints, friction, servos, torque limits. A
replay takes about ten seconds. Exit code 0 if every one holds.
"""

import contextlib
import sys
from pathlib import Path
from typing import Literal

import mujoco
import numpy as np
from engines.scene import SetPoints, make_world, play
from tqdm import tqdm

from dexgrasp.cli.command import Argument, Folder, InCell, Script
from dexgrasp.cli.commands import run_script
from dexgrasp.export.read import Recording, read_trajectory
from dexgrasp.export.replay import HEIGHT, HOLD, displace, load_scene, set_points
from dexgrasp_env.valid import Count, Natural


def of_recording(recording: Recording) -> SetPoints:
    """Return the set-points of an exported trajectory, after which the object has to stay up."""
    times = np.union1d(recording.arm.times, recording.hand.times)
    end = float(recording.arm.times[-1])
    return SetPoints(times, np.array([set_points(recording, t) for t in times.tolist()]), end, end + HOLD)


def replay(recording: Recording, scene: Path, engine: str, rng: np.random.Generator | None = None) -> float:
    """Play a trajectory in an engine; return the object's least height, m, after the lift.

    Args:
        recording: as read.
        scene: `scene.xml` of `export --format mjcf`; the object starts at the keyframe `start`.
        engine: mujoco, bullet or drake.
        rng: draws the object's error; None leaves the object where it is.

    Raises:
        InputError: if the scene is none, or the engine is not installed.
    """
    model, data = load_scene(scene, recording)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    pose = data.qpos[int(model.joint("object").qposadr[0]) :][:7].copy()
    if rng is not None:
        displace(pose, rng)
    points = of_recording(recording)
    with contextlib.closing(make_world(engine, model, points.rows[0], pose)) as world:
        return play(world, points)


class ReplayEngine(Script, InCell):
    """Replays, prints how often it held; 1 unless always, 2 for bad input.

    Attributes:
        trajectory: a folder of `dexgrasp export --format mjcf`.
        engine: that plays it.
        replay: times.
        seed: of the object's errors: 3 mm and 1 degree.
    """

    trajectory: Argument[Folder]
    engine: Literal["bullet", "drake", "mujoco"] = "bullet"
    replay: Count = 1
    seed: Natural = 0

    def run(self) -> int:
        recording, scene = read_trajectory(self.trajectory, self.cell), self.trajectory / "scene.xml"
        heights = [
            replay(recording, scene, self.engine, np.random.default_rng([self.seed, k]))
            for k in tqdm(range(self.replay), unit="replay", leave=False)
        ]
        held = sum(height >= HEIGHT for height in heights)
        print(
            f"held in {held} of {len(heights)} open-loop replays in {self.engine}, the object 3 mm and 1 deg off"
        )
        return int(held < len(heights))


if __name__ == "__main__":
    sys.exit(run_script(ReplayEngine))
