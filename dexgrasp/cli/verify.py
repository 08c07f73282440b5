"""`dexgrasp verify`: every constraint of a grasp checked again, independently of the planner."""

from pathlib import Path
from typing import Annotated

from dexgrasp.cli.command import Answer, Argument, CellOptions, Command
from dexgrasp.cli.output import check_lines, mark
from dexgrasp_env.arrays import Fields


class Verify(Command, CellOptions):
    """Check grasp files as `dexgrasp plan --out` writes them.

    examples:
      dexgrasp plan pear --out grasps/pear && dexgrasp verify grasps/pear/grasp.json
      dexgrasp plan pear --count 20 --out grasps/pear && dexgrasp verify grasps/pear/grasp_*.json

    Another way than the planner's: MuJoCo's kinematics and collision shapes, exact distances to the mesh, cone
    programmes. Every field of the file is computed again or held to what it must be: docs/grasp-file.md. Exit code 0
    only if all checks of all files hold, 1 otherwise.

    Attributes:
        grasps: grasp files, or the output of `plan --json`.
    """

    grasps: Argument[Annotated[tuple[Path, ...], "GRASP.json"]]

    def run(self) -> Answer:
        """Verify; return every check of a single file, or a line for each of several."""
        from dexgrasp.grasp.file import read_grasp
        from dexgrasp.grasp.verify.verify import verify

        cell = self.cell
        records = [read_grasp(path, cell) for path in self.grasps]
        found: list[Fields] = [
            {
                "file": path,
                "object": record.object.name,
                "holds": all(check.holds for check in checks),
                "checks": checks,
            }
            for path, record, checks in zip(self.grasps, records, map(verify, records), strict=True)
        ]
        held = sum(one["holds"] for one in found)
        no = held < len(found)
        if len(found) == 1:
            lines = [*check_lines(found[0]["checks"]), f"{found[0]['object']}: {_sentence(found[0])}"]
            return Answer(found[0], lines, no)
        lines = [f"{mark(one['holds'])}  {one['file']}: {_sentence(one)}" for one in found]
        lines.append(f"{held} of {len(found)} grasps hold every constraint")
        return Answer({"holds": not no, "grasps": found}, lines, no)


def _sentence(found: Fields) -> str:
    failed = [check.name for check in found["checks"] if not check.holds]
    return f"NOT verified: {', '.join(failed)}" if failed else "every constraint holds"
