"""`dexgrasp score`: grasp files, our own or others', under published protocols."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from dexgrasp.cli.command import Answer, Argument, CellOptions, Command, File, Folder, Scale, Seed
from dexgrasp.cli.output import note, tables
from dexgrasp_env.arrays import Fields
from dexgrasp_env.files import write_json
from dexgrasp_env.valid import Count


class Score(Command, CellOptions):
    """Score grasps of a floating hand: success by protocol with intervals, penetration, contacts.

    examples:
      dexgrasp plan sugar_box --out grasps && dexgrasp score grasps/grasp.json --protocol dgb_fc dgb_tabletop
      dexgrasp score theirs/*.npy --mesh meshes/ --protocol dgb_fc          files of DexGraspBench or BODex
      dexgrasp score frogger/*.npz --mesh ycb/ --protocol frogger_pick get_a_grip --workers 2 --out scores
      dexgrasp score mine.json --hand my_hand.xml --protocol dgb_fc         a plain JSON, another hand
      dexgrasp score leap/*.json --robot leap.yaml --protocol dgb_fc        our files of another robot

    Reads our grasp files, .npy or .pkl dictionaries, FRoGGeR-style .npz arrays and a plain JSON. Nothing in a file is
    executed: of a pickle arrays, numbers and texts are read, and one that holds anything else is refused.
    docs/scoring.md has formats, frames and what differs from the publications. The hand floats: no arm, no approach.
    Exit code 1 if no grasp succeeds under any of the protocols. `dexgrasp list protocols` says what each asks for.

    Attributes:
        files: grasp files: .json, .npz, .npy, .pkl.
        protocol: dgb_fc, dgb_tabletop, frogger_pick, get_a_grip.
        mesh: mesh files, or folders of them, for objects that the files only name.
        mesh_scale: factor from the meshes' unit to metres.
        hand: allegro, or the path of a hand's MJCF or of a robot's file, for files of others.
        seed: of the draws of pose noise.
        workers: processes; the outcome does not depend on it.
        out: write scores.json there, as --json prints it.
    """

    files: Argument[tuple[File, ...]]
    protocol: Annotated[tuple[str, ...], "PROTOCOL"] = ("dgb_fc",)
    mesh: Annotated[tuple[Path, ...], "PATH"] = ()
    mesh_scale: Annotated[Scale, {"of": "mesh"}] = 1.0
    hand: str = "allegro"
    seed: Seed = 0
    workers: Annotated[Count, "W"] = 1
    out: Folder | None = None

    def run(self) -> Answer:
        """Score; exit code 1 if no grasp succeeded."""
        from dexgrasp.evaluation.scoring.readers import ReadOptions
        from dexgrasp.evaluation.scoring.score import score_files

        options = ReadOptions(self.hand, self.mesh, self.mesh_scale, self.robot)
        content = score_files(self.files, self.protocol, options, seed=self.seed, workers=self.workers)
        if self.out is not None:
            write_json(self.out / "scores.json", content)
            note(f"results are in {self.out / 'scores.json'}")
        held = any(cell["successes"] for cell in content["protocols"].values())
        return Answer(content, render_scores(content), not held)


def render_scores(content: Fields) -> str:
    """Return the scores as tables for a terminal."""
    rows, grasps = content["rows"], dict[str, Fields]()
    labels = short_names([row["grasp"] for row in rows])
    for row in rows:
        verdict = grasps.setdefault(row["grasp"], {"grasp": labels[row["grasp"]], "object": row["object"]})
        verdict[row["protocol"]] = "held" if row["success"] else row["score"] or None
    protocols = [
        {
            "protocol": name, "held": f"{cell['successes']}/{cell['trials']}", "rate": f"{cell['rate']:.1%}",
            "95 %": cell["ci95"], "over objects": cell["ci95_objects"], "mean score": cell["mean_score"],
        }
        for name, cell in content["protocols"].items()
    ]  # fmt: skip
    failed = [
        {"grasp": labels[row["grasp"]], "protocol": row["protocol"], "why it failed": row["sentence"]}
        for row in rows
        if not row["success"]
    ]
    figures = {
        "scores": list(grasps.values()), "protocols": protocols, "failures": failed,
        **{f"mean {name}": value for name, value in content["metrics_mean"].items()},
    }  # fmt: skip
    if content["diversity"]:
        figures["variance in the first component (lower is more varied)"] = content["diversity"][0]
    return tables(figures)


def short_names(paths: Sequence[str]) -> dict[str, str]:
    """Return each path -> itself relative to the common folder of all."""
    common = os.path.commonpath([os.path.dirname(os.path.abspath(path)) for path in paths])
    return {path: os.path.relpath(path, common) for path in paths}
