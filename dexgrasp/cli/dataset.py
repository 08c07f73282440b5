"""The grasp dataset: rest poses, contact triples in closure, hand configurations that reach them.

examples:
  dexgrasp dataset generate --objects ycb6 --grasps-per-pose 3600 --out runs/ycb6 --workers 2
  dexgrasp dataset info runs/ycb6 --verify 500
"""

from typing import Annotated

from dexgrasp.cli.command import Answer, Argument, CellOptions, Command, Folder, check_mesh_options
from dexgrasp.cli.output import resumable, tables
from dexgrasp.data.dataset.settings import DatasetSettings
from dexgrasp.runs.pool import Backend
from dexgrasp.runs.progress import progress_bar
from dexgrasp_env.arrays import Fields
from dexgrasp_env.valid import CellFile, Count


class Generate(Command):
    """Make a dataset, rest pose by rest pose; what is there already is kept.

    examples:
      dexgrasp dataset generate --objects ycb6 --grasps-per-pose 3600 --out runs/ycb6 --workers 2
      dexgrasp dataset generate --objects scan.stl --mesh-scale 0.001 --grasps-per-pose 500 --out runs/scan

    A run that was interrupted goes on when the same command is given again; the files do not depend on --workers.

    Attributes:
        out: folder of the dataset.
    """

    settings: Annotated[DatasetSettings, {"least_load", "planner"}]
    out: Folder
    backend: Backend = Backend()

    def run(self) -> Answer:
        """Generate the dataset and return its summary."""
        from dexgrasp.data.dataset.generate import generate
        from dexgrasp.data.dataset.info import summary

        settings = self.settings
        check_mesh_options(settings.objects, settings)
        with resumable(f"finished files are kept in {self.out}"), progress_bar("file", "dataset") as bar:
            generate(settings, self.out, self.backend, bar)
        figures = summary(self.out)
        return Answer(figures, describe(figures))


class Info(Command, CellOptions):
    """Summarise a dataset, check some of it.

    Attributes:
        folder: of the dataset.
        verify: check N random grasps by independent means.
        robot: file or name of the cell that they are checked in (default: the data set's).
    """

    folder: Argument[Folder]
    verify: Count | None = None
    robot: Annotated[CellFile, {"of": "verify"}] = None

    def run(self) -> Answer:
        """Summarise it; exit code 1 if a checked grasp does not hold."""
        from dexgrasp.data.dataset.info import check_sample, summary

        figures, no = summary(self.folder), False
        if self.verify:
            figures["verify"] = check_sample(self.folder, self.verify, self.robot)
            no = figures["verify"]["passed"] < figures["verify"]["checked"]
        return Answer(figures, describe(figures), no)


def describe(figures: Fields) -> str:
    """Return the summary of a dataset as tables for a terminal."""
    from dexgrasp.evaluation.reasons import sentence

    blocked = {sentence(reason): count for reason, count in figures["blocked"].items()}
    return tables(figures | {"blocked": blocked})


COMMANDS = {"generate": Generate, "info": Info}
