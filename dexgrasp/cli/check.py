"""`dexgrasp check`: an exported trajectory looked at before a robot moves."""

from dataclasses import replace
from pathlib import Path

from dexgrasp.cli.command import Answer, Argument, Command, InCell, Seed
from dexgrasp.cli.output import check_lines, coloured
from dexgrasp_env.valid import Natural


class Check(Command, InCell):
    """Check a trajectory by an independent reader.

    examples:
      dexgrasp check robot/pear                           limits, timing, collisions
      dexgrasp check robot/pear --replay 20               and 20 open-loop replays, the object 3 mm and 1 deg off

    TRAJECTORY is a folder with arm.csv, hand.csv and segments.json, or a trajectory.json. What reads it shares no code
    with what wrote it, and refuses it where the object, its surroundings or the segments are not said. --replay needs
    scene.xml, from `dexgrasp export --format mjcf`, beside the trajectory. Exit code 0 only if all holds.

    Attributes:
        trajectory: a folder or a trajectory.json.
        replay: replay it N times in simulation.
        seed: of the object's errors.
    """

    trajectory: Argument[Path]
    replay: Natural = 0
    seed: Seed = 0

    def run(self) -> Answer:
        """Check, and replay if asked for."""
        import numpy as np
        from tqdm import tqdm

        from dexgrasp.export.check import check_trajectory
        from dexgrasp.export.read import read_trajectory
        from dexgrasp.export.replay import replay
        from dexgrasp.grasp.file import read_grasp
        from dexgrasp.grasp.verify.verify import verify

        folder = self.trajectory if self.trajectory.is_dir() else self.trajectory.parent
        recording = read_trajectory(self.trajectory, self.cell)
        checks, grasp = check_trajectory(recording, self.cell), folder / "grasp.json"
        if grasp.is_file():
            checks += [
                replace(check, name=f"grasp.json: {check.name}")
                for check in verify(read_grasp(grasp, self.cell))
                if not check.holds
            ]
        good = all(check.holds for check in checks)
        held = [
            replay(recording, folder / "scene.xml", np.random.default_rng([self.seed, k])).success
            for k in tqdm(range(self.replay), unit="replay", leave=False, delay=0.5)
        ]
        words = coloured("every check holds", "good") if good else coloured("NOT fit to run", "bad")
        lines = [*check_lines(checks), words]
        if held:
            lines.append(
                f"held in {sum(held)} of {len(held)} open-loop replays, the object 3 mm and 1 deg off"
            )
        return Answer(
            {"holds": good, "checks": checks, "replays": len(held), "held": sum(held)}, lines, not good
        )


COMMAND = Check
