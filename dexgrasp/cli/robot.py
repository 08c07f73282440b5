"""Robot files: what there is, one made of MJCF, one tested before anything is planned with it.

examples:
  dexgrasp robot list
  dexgrasp robot make --hand menagerie/leap_hand/right_hand.xml --out leap.yaml
  dexgrasp robot check leap.yaml
"""

from pathlib import Path
from typing import Annotated, Any

from dexgrasp.cli.command import Answer, Argument, Command
from dexgrasp.cli.doctor import finding_line
from dexgrasp.cli.figures import record_table
from dexgrasp_env.errors import InputError


class ListRobots(Command):
    """List the robots of ours, by the names that --robot takes."""

    def run(self) -> Answer:
        """List them."""
        from dexgrasp_env.robot.cell import make_cell, robot_files

        rows = [self._row(name, make_cell(name).robot) for name in robot_files()]
        return Answer({"robots": rows}, record_table(rows))

    @staticmethod
    def _row(name: str, robot: Any) -> dict[str, Any]:
        return {
            "name": name, "arm": robot.arm.name, "hand": robot.hand.name, "joints": robot.dof,
            "fingers": len(robot.hand.fingers), "mount": robot.mount.name,
        }  # fmt: skip


class Make(Command):
    """Make a robot file of MJCF: of a hand, of an arm, or of both; what is not given is ours, Panda or Allegro.

    examples:
      dexgrasp robot make --hand leap_hand/right_hand.xml --out leap.yaml
      dexgrasp robot make --hand right_hand.xml --arm ur5e.xml --out mine.yaml
      dexgrasp robot make --arm ur5e.xml --out ur5e_allegro.yaml

    Palm, fingers, tips and limits are read from the descriptions, the open posture and the arm's home are searched.
    What an MJCF does not say is assumed, and said: put in what the maker states. The hand's and the arm's files stand
    beside the robot's; the descriptions stay where they are.

    Attributes:
        out: the file to be.
        hand: MJCF of a hand alone, which does not float; or a hand's file (default: our Allegro).
        arm: MJCF of an arm alone; or an arm's file (default: our Panda).
    """

    out: Annotated[Path, "ROBOT.yaml"]
    hand: Annotated[Path | None, "HAND.xml"] = None
    arm: Annotated[Path | None, "ARM.xml"] = None

    def run(self) -> Answer:
        """Make it; say what was assumed."""
        from dexgrasp_env.robot.make import make_robot

        if self.out.suffix not in (".yaml", ".yml"):
            raise InputError(f"--out is {str(self.out)!r}: valid is a file that ends in .yaml")
        assumed = make_robot(self.hand, self.arm, self.out)
        lines = [f"{self.out} is written; test it with: dexgrasp robot check {self.out}"]
        lines += ["assumed:"] * bool(assumed) + [f"  {line}" for line in assumed]
        return Answer({"robot": str(self.out), "assumed": assumed}, "\n".join(lines))


class CheckRobot(Command):
    """Test a robot as users' robots fail; each fault is a line with its mend.

    examples:
      dexgrasp robot check leap.yaml

    Exit code 0 only if nothing has to be mended.

    Attributes:
        robot: file of a robot or of a cell, or the name of one of ours.
    """

    robot: Argument[Annotated[str, "FILE|NAME"]]

    def run(self) -> Answer:
        """Test it."""
        from dexgrasp.kinematics.robot_check import check_robot
        from dexgrasp_env.robot.cell import make_cell

        findings = check_robot(make_cell(self.robot))
        wrong = any(finding.level == "error" for finding in findings)
        return Answer(
            {"ok": not wrong, "findings": findings}, "\n".join(map(finding_line, findings)), int(wrong)
        )


COMMAND = {"list": ListRobots, "make": Make, "check": CheckRobot}
