"""Demonstrations of any agent: recorded, counted and replayed.

examples:
  dexgrasp demos generate --objects varied-0..99 --episodes 20 --out runs/demos --workers 2
  dexgrasp demos info runs/demos
  dexgrasp demos replay runs/demos --episodes 50
"""

from typing import Annotated

from dexgrasp.cli.command import Answer, Argument, CellOptions, Command, Folder
from dexgrasp.cli.output import resumable, tables
from dexgrasp.data.demonstrations.settings import DemoSettings, Formats
from dexgrasp.runs.pool import Backend
from dexgrasp.runs.progress import progress_bar
from dexgrasp_env.valid import Count


class Generate(Command):
    """Record an agent's rollouts and keep those that succeed.

    examples:
      dexgrasp demos generate --objects varied-0..99 --episodes 20 --out runs/demos --workers 2
      dexgrasp demos generate --agent hardcoded --objects seen --episodes 50 --noise 0.03 --out runs/hand
      dexgrasp demos generate --agent my_package.policies:Mine --objects ycb6 --control-mode ee_delta --out runs/mine
      dexgrasp demos generate --objects ycb6 --formats minari lerobot --out runs/both

    The agent acts in its own modes; what it commands is converted to --control-mode and replayed from the same scene
    under --obs-mode, and kept if that succeeds as well. OUT/data is a Minari data set,
    minari.MinariDataset("OUT/data"), OUT/lerobot one in the layout of LeRobot v3, OUT/robomimic/demos.hdf5 one in
    robomimic's. A run that was interrupted goes on when the same command is given again; the demonstrations do not
    depend on --workers. varied-0..99 are a hundred objects of random sizes that no test set has. The agent
    dexgrasp.agents.teacher:Teacher is `hardcoded` with choices that are easy to learn,
    dexgrasp.agents.teacher:PlansOnce is `bilevel` that looks once.

    Attributes:
        out: folder of the demonstrations.
        formats: of the data sets.
    """

    settings: Annotated[DemoSettings, {"chunk"}]
    out: Folder
    formats: Formats = ("minari",)
    backend: Backend = Backend()

    def run(self) -> Answer:
        """Record them and return their counts."""
        from dexgrasp.data.demonstrations.generate import generate

        with resumable(f"finished files are kept in {self.out}"), progress_bar("file", "demos") as bar:
            generate(self.settings, self.out, self.formats, self.backend, bar)
        return Info(folder=self.out).run()


class Info(Command):
    """Count demonstrations by object, and failures by reason.

    Attributes:
        folder: of the demonstrations.
    """

    folder: Argument[Folder]

    def run(self) -> Answer:
        """Return the counts."""
        from dexgrasp.data.demonstrations.info import summary

        figures = summary(self.folder)
        return Answer(figures, tables(figures))


class Replay(Command, CellOptions):
    """Play recorded actions again, from the same scenes: exit code 0 only if all still succeed.

    Attributes:
        folder: of the demonstrations.
        episodes: how many (default all).
    """

    folder: Argument[Folder]
    episodes: Count | None = None

    def run(self) -> Answer:
        """Replay the actions; exit code 1 if one fails."""
        from dexgrasp.data.demonstrations.info import replay_all

        with progress_bar("episode", "replay") as bar:
            figures = replay_all(self.folder, self.episodes, bar, self.robot)
        lines = [f"{figures['successes']} of {figures['replayed']} replays succeed"]
        lines += [
            f"episode {row['episode']}: {row['object']}, scene seed {row['scene_seed']}"
            for row in figures["failed"]
        ]
        return Answer(figures, lines, figures["successes"] < figures["replayed"])


COMMANDS = {"generate": Generate, "info": Info, "replay": Replay}
