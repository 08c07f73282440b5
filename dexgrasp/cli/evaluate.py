"""`dexgrasp evaluate`: rollouts of several agents under the same protocols."""

import json
from typing import Annotated, Literal

from dexgrasp.cli.codes import INTERRUPTED, OK
from dexgrasp.cli.command import Answer, Command, Folder, check_mesh_options
from dexgrasp.cli.output import note, resumable
from dexgrasp.evaluation.settings import EvaluationSettings
from dexgrasp.evaluation.video import VideoSettings
from dexgrasp.runs import interrupt
from dexgrasp.runs.pool import Backend
from dexgrasp_env.valid import NATURAL, Rule, check, one_of

_VIDEOS = Rule(
    "a whole number >= 0, or failures",
    lambda value: value if value == "failures" else NATURAL.validate(value),
    lambda text: text if text == "failures" else int(text),
)


class Evaluate(Command):
    """Score agents on objects: success rates with intervals, failure reasons, planning times.

    examples:
      dexgrasp evaluate --agents random hardcoded --objects seen familiar --trials 3 --seed 0
      dexgrasp evaluate --agents bilevel --objects all20 --trials 6 --workers 8 --out runs/tables
      dexgrasp evaluate --agents my_package.policies:MyPolicy --objects sugar_box --video 1
      dexgrasp evaluate --agents bilevel --objects all20 --trials 6 --out runs/tables --video failures
      dexgrasp evaluate --agents bilevel --objects scan.stl --mesh-scale 0.001 --mesh-mass 0.3

    Every agent meets the same scenes: trial k of an object depends on --seed, the object and k alone. A run that was
    interrupted goes on when the same command is given again; other code, meshes or checkpoints are another evaluation.
    The folder of --out then holds trials.jsonl (a line a trial, with all that `dexgrasp replay` needs to make it
    again), summary.json (as --json prints it), run.json (the settings), grasps/ and videos/.

    NB: package.module:Class runs that module. Checkpoints (.zip) are read without running anything pickled in them.

    Attributes:
        out: folder for the results (default runs/<from the settings>).
        video: record the first K trials of every agent and object, or those that failed; also of a finished run.
    """

    settings: EvaluationSettings
    out: Folder | None = None
    video: Annotated[int | Literal["failures"], _VIDEOS, "K|failures"] = 0
    film: Annotated[VideoSettings, {"of": "video"}] = VideoSettings()
    backend: Backend = Backend()

    def run(self) -> Answer | int:
        """Evaluate; exit code 3 if it was interrupted or a worker died: finished trials are kept."""
        from dexgrasp.evaluation.evaluate import evaluate
        from dexgrasp.evaluation.protocol import get_protocol
        from dexgrasp.evaluation.report.tables import render_summary
        from dexgrasp.registry import check_name
        from dexgrasp_env.rendering import SHOW_CAMERAS
        from dexgrasp_env.robot.cell import make_cell

        settings = self.settings
        check_mesh_options(settings.objects, settings)
        check("camera", self.film.camera, one_of((*SHOW_CAMERAS, *make_cell(settings.robot).camera_names)))
        for agent in settings.agents:
            check_name(agent)
        folder = self.out or settings.default_folder()
        note(f"results go to {folder}")
        code = OK
        try:
            with resumable(f"finished trials are kept in {folder}"):
                evaluate(settings, folder, backend=self.backend, videos=self.video, film=self.film)
        except KeyboardInterrupt as stop:
            interrupt.acknowledge()
            note(f"dexgrasp evaluate: interrupted; {stop}")
            code = INTERRUPTED
        path = folder / "summary.json"
        if not path.is_file():
            return code
        summary = json.loads(path.read_bytes())
        floors = [get_protocol(name).floor_line for name in settings.parts]
        return Answer(summary, "\n".join([render_summary(summary), *filter(None, floors)]), code)
