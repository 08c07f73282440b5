"""`dexgrasp check`: an exported trajectory checked before a robot runs it."""

from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Annotated, Any

from dexgrasp.cli.command import Answer, Argument, CellOptions, Command, Seed
from dexgrasp.cli.output import check_lines, coloured
from dexgrasp_env.valid import Natural, Rule


def _share(value: Any) -> str:
    """Return a share K/N of replays as it was written.

    Raises:
        ValueError: for anything else.
    """
    least, of = map(int, value.split("/"))
    if not 0 <= least <= of or not of:
        raise ValueError
    return f"{least}/{of}"


class Check(Command, CellOptions):
    """Check a trajectory by an independent reader.

    examples:
      dexgrasp check robot/pear                           limits, timing, collisions
      dexgrasp check robot/pear --replay 20               and 20 open-loop replays, the object 3 mm and 1 deg off

    TRAJECTORY is a folder with arm.csv, hand.csv and segments.json, or a trajectory.json. What reads it shares no code
    with what wrote it, and refuses it where the object, its surroundings or the segments are not said. --replay needs
    scene.xml, from `dexgrasp export --format mjcf`, beside the trajectory. Exit code 0 only if all holds, and of the
    replays at least 9 in 10 (--need).

    Attributes:
        trajectory: a folder or a trajectory.json.
        replay: replay it N times in simulation.
        need: the share of the replays that has to hold.
        seed: of the object's errors.
    """

    trajectory: Argument[Path]
    replay: Natural = 0
    need: Annotated[str, Rule("K/N, K of each N replays", _share), "K/N", {"of": "replay"}] = "9/10"
    seed: Annotated[Seed, {"of": "replay"}] = 0

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
        fit = all(check.holds for check in checks)
        held = [
            replay(recording, folder / "scene.xml", np.random.default_rng([self.seed, k]), self.cell).success
            for k in tqdm(range(self.replay), unit="replay", leave=False, delay=0.5)
        ]
        enough = sum(held) >= Fraction(self.need) * len(held)
        done = "held" if recording.facts.placed is None else "set down at its goal, nothing else touched,"
        said = [
            f"{done} in {sum(held)} of {len(held)} open-loop replays, the object 3 mm and 1 deg off"
            + f", {self.need} are needed" * (not enough)
        ] * bool(held)
        good = fit and enough
        words = coloured("every check holds", "good") if good else coloured("NOT fit to run", "bad")
        content = {
            "holds": good,
            "checks": checks,
            "replays": len(held),
            "held": sum(held),
            "need": self.need,
        }
        return Answer(content, [*check_lines(checks), "; ".join([words, *said])], not good)
