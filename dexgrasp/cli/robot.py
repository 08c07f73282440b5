"""Robot files: list them, make one of URDF or MJCF, test one before anything is planned with it.

examples:
  dexgrasp robot list
  dexgrasp robot make --hand menagerie/leap_hand/right_hand.xml --out leap.yaml
  dexgrasp robot check leap.yaml
"""

import shlex
from pathlib import Path
from typing import Annotated, Any

from dexgrasp.cli.command import Answer, Argument, Command, Scene
from dexgrasp.cli.doctor import finding_line
from dexgrasp.cli.figures import record_table
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.findings import Finding

_SHOWN = ("soda", "sugar_box", "pear", "mustard_bottle", "lego")  # objects that are tried
_GRASPS = 3  # of them, that are drawn
_SEARCH = "see why: dexgrasp plan OBJECT --robot FILE"


class ListRobots(Command):
    """List the robots of ours, by the names that --robot takes."""

    def run(self) -> Answer:
        """List them."""
        from dexgrasp_env.robot.cell import make_cell, robot_files

        robots = {name: make_cell(name).robot for name in robot_files()}
        rows = [
            {
                "name": name, "arm": robot.arm.name, "hand": robot.hand.name, "joints": robot.dof,
                "fingers": len(robot.hand.fingers), "mount": robot.mount.name,
            }
            for name, robot in robots.items()
        ]  # fmt: skip
        return Answer({"robots": rows}, record_table(rows))


class Make(Command):
    """Make a robot file of URDF or MJCF: of a hand, of an arm, or of both; what is not given is ours, Panda or Allegro.

    examples:
      dexgrasp robot make --hand leap_hand/right_hand.xml --out leap.yaml
      dexgrasp robot make --hand right_hand.xml --arm ur5e.xml --out mine.yaml
      dexgrasp robot make --arm ur5e.xml --out ur5e_allegro.yaml

    Palm, fingers, tips and limits are read from the descriptions, the open posture and the arm's home are searched.
    What they do not say is assumed, and printed: put in what the maker states. The hand's and the arm's files stand
    beside the robot's; the descriptions stay where they are.

    Attributes:
        out: the file to be.
        hand: URDF or MJCF of a hand, or of an arm and a hand; or a hand's file (default: our Allegro).
        arm: URDF or MJCF of an arm, or of an arm and a hand; or an arm's file (default: our Panda).
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
        test = shlex.join(["dexgrasp", "robot", "check", str(self.out)])
        lines = [f"{self.out} is written; test it with: {test}"]
        lines += ["assumed:"] * bool(assumed) + [f"  {line}" for line in assumed]
        return Answer({"robot": self.out, "assumed": assumed}, lines)


class CheckRobot(Command):
    """Test a robot as users' robots fail; each fault is a line with its mend.

    examples:
      dexgrasp robot check leap.yaml
      dexgrasp robot check leap.yaml --picture leap.png

    Exit code 0 only if nothing has to be mended.

    Attributes:
        robot: file of a robot or of a cell, or the name of one of ours.
        picture: draw the hand there, open, closed and in three grasps, where nothing has to be mended.
    """

    robot: Argument[Annotated[str, "FILE|NAME"]]
    picture: Annotated[Path | None, "PNG"] = None

    def run(self) -> Answer:
        """Test it."""
        from dexgrasp.mechanics.kinematics.robot_check import check_robot
        from dexgrasp_env.robot.cell import make_cell

        cell = make_cell(self.robot)
        findings = check_robot(cell)
        wrong = any(finding.level == "error" for finding in findings)
        if self.picture is not None and not wrong:
            findings += [
                Finding("warning", f"no grasp of {name} was found", _SEARCH)
                for name in _draw(cell, self.picture)
            ]
        return Answer({"ok": not wrong, "findings": findings}, list(map(finding_line, findings)), wrong)


def _draw(cell: Any, path: Path) -> list[str]:
    """Draw the hand open, closed and in grasps; return the objects that it found no grasp of."""
    from dexgrasp.cli.plan import plan_target
    from dexgrasp.grasp.picture import hand_picture
    from dexgrasp.mechanics.kinematics.robot_check import closed_posture

    grasps, missed = Fields(), list[str]()
    for name in _SHOWN:
        plan = plan_target(name, "bilevel", Scene(robot=cell))[1]
        if plan.grasp is None:
            missed.append(name)
        else:
            grasps[name] = plan.grasp, plan.target
        if len(grasps) == _GRASPS:
            break
    hand_picture(path, cell, {"open": cell.robot.home, "closed": closed_posture(cell)[0]}, grasps)
    return missed


COMMAND = {"list": ListRobots, "make": Make, "check": CheckRobot}
