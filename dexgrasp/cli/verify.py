"""`dexgrasp verify`: every constraint of a grasp checked again, independently of the planner."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from dexgrasp.cli.command import Answer, Argument, Command, InCell
from dexgrasp.cli.output import check_lines, mark

if TYPE_CHECKING:
    from dexgrasp.verify.check import Check


class Verify(Command, InCell):
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
        """Verify; every check of one file, of several what came of each."""
        from dexgrasp.grasp.file import read_grasp
        from dexgrasp.verify.verify import verify

        cell = self.cell
        records = [read_grasp(path, cell) for path in self.grasps]
        found = [_finding(record.object.name, verify(record)) for record in records]
        good = all(one["holds"] for one in found)
        if len(found) == 1:
            lines = [*check_lines(found[0]["checks"]), f"{found[0]['object']}: {_answer(found[0])}"]
            return Answer(found[0], "\n".join(lines), int(not good))
        each = [{"file": str(path)} | one for path, one in zip(self.grasps, found, strict=True)]
        lines = [f"{mark(one['holds'])}  {one['file']}: {_answer(one)}" for one in each]
        lines.append(f"{sum(one['holds'] for one in found)} of {len(found)} grasps hold every constraint")
        return Answer({"holds": good, "grasps": each}, "\n".join(lines), int(not good))


def _finding(name: str, checks: "list[Check]") -> dict[str, Any]:
    """What `--json` prints of a grasp."""
    holds = all(check.holds for check in checks)
    return {"object": name, "holds": holds, "checks": [asdict(check) for check in checks]}


def _answer(found: dict[str, Any]) -> str:
    failed = [check["name"] for check in found["checks"] if not check["holds"]]
    return f"NOT verified: {', '.join(failed)}" if failed else "every constraint holds"


COMMAND = Verify
