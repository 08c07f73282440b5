"""`dexgrasp replay`: one trial of an evaluation made again, exactly."""

from typing import Annotated

from dexgrasp.cli.command import Answer, Argument, CellOptions, Command, Folder
from dexgrasp.cli.output import note
from dexgrasp.evaluation.video import VideoSettings
from dexgrasp_env.valid import Natural


class Replay(Command, CellOptions):
    """Make a trial of an evaluation again, and record it.

    examples:
      dexgrasp replay runs/tables --agent bilevel --object mask --trial 2
      dexgrasp replay runs/tables --agent bilevel --object mask --trial 2 --video

    The trial is made from the seeds and settings that its line in trials.jsonl holds, with the code that is here now.
    Exit code 0 if it comes out as recorded, to the last bit of height, slip and tilt; 1 if not, with the differences.

    Attributes:
        folder: the --out of an evaluation.
        agent: its name there.
        object: its name there.
        trial: number, from 0 on.
        protocol: where the evaluation has several.
        video: record it, into videos/ of RUN.
    """

    folder: Argument[Annotated[Folder, "RUN"]]
    agent: Annotated[str, "AGENT"]
    object: Annotated[str, "OBJECT"]
    trial: Annotated[Natural, "K"]
    protocol: Annotated[str | None, "PROTOCOL"] = None
    video: bool = False
    film: Annotated[VideoSettings, {"of": "video"}] = VideoSettings()

    def run(self) -> Answer:
        """Replay the trial; exit code 1 if the outcome differs."""
        from dexgrasp.evaluation.replay import replay

        film = self.film if self.video else None
        found = replay(
            self.folder,
            self.agent,
            self.object,
            self.trial,
            protocol=self.protocol,
            film=film,
            robot=self.robot,
        )
        if found.stale:
            note(f"note: the evaluation was made with other {' and '.join(found.stale)}")
        again = found.again
        content = {
            "same": not found.changed, "changed": found.changed, "stale": found.stale, "trial": again,
            "recorded": found.row, "grasp": found.grasp, "video": found.video,
        }  # fmt: skip
        outcome = "lifted and held" if again["success"] else f"failed: {again['reason']}"
        lines = [
            f"{self.agent} on {self.object}, trial {self.trial}: {outcome}, after {again['steps']} steps",
            *(f"  {key}: {found.row[key]} there, {again[key]} now" for key in found.changed),
            "not as recorded" if found.changed else "as recorded, to the last bit",
        ]
        if found.video is not None:
            lines.append(f"video: {found.video}")
        return Answer(content, lines, bool(found.changed))
