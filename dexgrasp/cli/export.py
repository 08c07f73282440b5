"""`dexgrasp export`: a grasp as a trajectory for a robot's controllers."""

import shlex
from pathlib import Path
from typing import Annotated

from dexgrasp.cli.command import Answer, Argument, CellOptions, Command, Folder
from dexgrasp.runs.folder import make_folder
from dexgrasp_env.valid import Positive


class Export(Command, CellOptions):
    """Write the trajectory of a grasp file, from the approach to the end of the lift.

    examples:
      dexgrasp plan pear --out grasps/pear
      dexgrasp export grasps/pear/grasp.json --format csv --out robot/pear && dexgrasp check robot/pear
      dexgrasp export grasps/pear/grasp.json --format mjcf --out robot/pear && dexgrasp check robot/pear --replay 20

    The grasp lies beside as grasp.json; what `dexgrasp verify` rejects is not written, and exit code 1 says so.

    csv: arm.csv (1 kHz), hand.csv (333 Hz), s and rad, and segments.json; json: all of it in trajectory.json; ros2:
    arm.yaml and hand.yaml (trajectory_msgs/JointTrajectory: every tenth row of the arm's csv, every fifth of the
    hand's), grasp.yaml (moveit_msgs/Grasp), and the csv beside them; mjcf: scene.xml with its meshes, which loads by
    itself anywhere, and the csv beside it. `dexgrasp check` reads csv and json. The arm stays within the maker's limits
    of position, velocity, acceleration and jerk. The trajectory is open loop, and has never run on hardware: check it,
    try it slowly.

    Attributes:
        grasp: a grasp file of `dexgrasp plan --out`.
        format: csv, json, ros2 or mjcf.
        out: folder for the files.
        stiffness: Nm/rad of the hand's servos, for the squeeze as position offsets (default: the cell's, 10).
        force: write it also where `dexgrasp verify` rejects the grasp; the files say so.
    """

    grasp: Argument[Annotated[Path, "GRASP.json"]]
    format: Annotated[str, "F"] = "csv"
    out: Folder
    stiffness: Annotated[Positive | None, "K"] = None
    force: bool = False

    def run(self) -> Answer:
        """Write the files; exit code 1 if `verify` rejects the grasp."""
        from dexgrasp.export.grasp_export import export_grasp
        from dexgrasp.grasp.file import read_grasp, write_grasp
        from dexgrasp.grasp.record import as_json
        from dexgrasp.grasp.verify.verify import verify

        record = read_grasp(self.grasp, self.cell)
        rejected = [check.name for check in verify(record) if not check.holds]
        if rejected and not self.force:
            words = f"NOT exported: verify rejects it ({', '.join(rejected)}); --force writes it all the same"
            return Answer({"object": record.object.name, "files": [], "rejected": rejected}, words, 1)
        files = export_grasp(record, make_folder(self.out), self.format, self.stiffness, rejected)
        write_grasp(self.out / "grasp.json", as_json(record))
        lines = [f"wrote {file}" for file in files if file.suffix != ".obj"]
        cell = f" --robot {shlex.quote(self.robot)}" if self.robot else ""
        lines.append(f"check it before anything moves: dexgrasp check {shlex.quote(str(self.out))}{cell}")
        if rejected:
            lines.insert(0, f"verify rejects this grasp, and the files say so: {', '.join(rejected)}")
        return Answer({"object": record.object.name, "files": files, "rejected": rejected}, lines)
