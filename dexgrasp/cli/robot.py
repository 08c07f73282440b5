"""Robot files: list them, make one of URDF or MJCF, test one before planning with it.

examples:
  dexgrasp robot list
  dexgrasp robot make menagerie/leap_hand/right_hand.xml --out leap.yaml
  dexgrasp robot check leap.yaml
"""

import shlex
from pathlib import Path
from typing import Annotated, Any

from dexgrasp.cli.command import Answer, Argument, Command, SceneOptions
from dexgrasp.cli.doctor import finding_line
from dexgrasp.cli.output import record_table
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.findings import Finding
from dexgrasp_env.yaml_file import YAML_SUFFIXES


class ListRobots(Command):
    """List our robots, by the names that --robot takes, and the recipes for public ones."""

    def run(self) -> Answer:
        """List robots and recipes."""
        from dexgrasp_env.robot.cell import make_cell, robot_files
        from dexgrasp_env.robot.recipes import recipes

        robots = {name: make_cell(name).robot for name in robot_files()}
        rows = [
            {
                "name": name, "arm": robot.arm.name, "hand": robot.hand.name, "joints": robot.dof,
                "fingers": len(robot.hand.fingers), "mount": robot.mount.name,
            }
            for name, robot in robots.items()
        ]  # fmt: skip
        known = [{"recipe": name, "source": r.source, "file": r.file} for name, r in recipes().items()]
        lines = [
            record_table(rows),
            "",
            "recipes for makers' files, see robot make --recipe:",
            record_table(known),
        ]
        return Answer({"robots": rows, "recipes": known}, lines)


class Make(Command):
    """Make a robot file of URDF or MJCF: of a hand, of an arm, or of both; what is not given is ours, Panda or Allegro.

    examples:
      dexgrasp robot make leap_hand/right_hand.xml --out leap.yaml
      dexgrasp robot make right_hand.xml --arm ur5e.xml --out mine.yaml
      dexgrasp robot make --arm ur5e.xml --out ur5e_allegro.yaml

    Palm, fingers, tips and limits are read from the descriptions, the open posture and the arm's home are searched.
    What they do not say is assumed, and printed: put in what the maker states. A line on a guess names the option that
    corrects it. The hand's and the arm's files stand beside the robot's; the descriptions stay where they are.

    Attributes:
        file: URDF or MJCF of a hand, of an arm, or of both: told apart by where it branches.
        out: the file to be (default: named as FILE is, here).
        hand: URDF or MJCF of a hand, or of an arm and a hand; or a hand's file (default: our Allegro).
        arm: URDF or MJCF of an arm, or of an arm and a hand; or an arm's file (default: our Panda).
        palm: body that bears the fingers, where another was taken.
        thumb: a body of the opposing finger, where another was taken.
        flip: last bodies of fingers whose pads are on the other side.
        recipe: of a known hand, see dexgrasp robot list.
        picture: of what was found (default: beside the file, where matplotlib is installed).
    """

    file: Argument[Annotated[Path | None, "FILE"]] = None
    out: Annotated[Path | None, "ROBOT.yaml"] = None
    hand: Annotated[Path | None, "HAND.xml"] = None
    arm: Annotated[Path | None, "ARM.xml"] = None
    palm: Annotated[str | None, "BODY"] = None
    thumb: Annotated[str | None, "BODY"] = None
    flip: Annotated[tuple[str, ...], "BODY"] = ()
    recipe: Annotated[str | None, "NAME"] = None
    picture: Annotated[Path | None, "PNG"] = None

    def run(self) -> Answer:
        """Write the robot file; report what was assumed."""
        from dexgrasp_env.robot.make import make_robot
        from dexgrasp_env.robot.part import NamedParts
        from dexgrasp_env.robot.recipes import hint_of, recipe_of

        hand, arm = self._parts()
        recipe = recipe_of(self.recipe, hand) if self.recipe else None
        first = hand or arm
        if first is None:
            raise InputError("name what to make a robot of: FILE, --hand or --arm")
        out = self.out or Path(f"{first.stem}.yaml")
        if out.suffix not in YAML_SUFFIXES:
            raise InputError(f"--out is {str(out)!r}: valid is a file that ends in .yaml")
        named = NamedParts(self.palm, self.thumb, self.flip)
        idle = self.given("palm", "thumb", "flip", "recipe")
        if idle and (hand is None or hand.suffix in YAML_SUFFIXES):
            raise InputError(f"{', '.join(idle)} would change nothing: no hand is made of URDF or MJCF here")
        assumed = make_robot(hand, arm, out, named if any(named) else None, recipe)
        if recipe is None and hand is not None:
            assumed += hint_of(hand)
        picture = _draw_found(out, self.picture)
        test = shlex.join(["dexgrasp", "robot", "check", str(out)])
        lines = [f"{out} is written; test it with: {test}"]
        lines += [f"{picture} shows what was found"] * (picture is not None)
        lines += ["assumed:"] * bool(assumed) + [f"  {line}" for line in assumed]
        return Answer({"robot": out, "picture": picture, "assumed": assumed}, lines)

    def _parts(self) -> tuple[Path | None, Path | None]:
        """Return the files that describe hand and arm."""
        from dexgrasp_env.robot.make import parts_of

        if self.file is None:
            return self.hand, self.arm
        if self.hand is not None:
            raise InputError("FILE and --hand both name a hand: valid is one of them")
        has_hand, has_arm = parts_of(self.file)
        if self.arm is not None and not has_hand:
            raise InputError(f"{self.file} is an arm, and --arm names another: valid is one of them")
        return self.file if has_hand else None, self.arm or (self.file if has_arm else None)


def _draw_found(robot: Path, path: Path | None) -> Path | None:
    """Draw the hand that was read, beside its robot file; return the picture, None without matplotlib."""
    from dexgrasp_env.robot.cell import make_cell
    from dexgrasp_env.robot.robot_file import read_robot

    try:
        from dexgrasp.grasp.picture import found_picture

        return found_picture(path or robot.with_suffix(".png"), make_cell(read_robot(robot)))
    except ImportError:
        if path is not None:
            raise
        return None


class CheckRobot(Command):
    """Test a robot as users' robots fail; each fault is a line with its mend.

    examples:
      dexgrasp robot check leap.yaml
      dexgrasp robot check leap.yaml --picture leap.png

    Exit code 0 only if nothing has to be mended and the planner has postures to start from; they are sampled once.

    Attributes:
        robot: file of a robot or of a cell, or the name of one of ours.
        picture: draw the hand there, open, closed and in three grasps, where nothing has to be mended.
    """

    robot: Argument[Annotated[str, "FILE|NAME"]]
    picture: Annotated[Path | None, "PNG"] = None

    def run(self) -> Answer:
        """Test the robot; exit code 1 if an error was found."""
        from dexgrasp.mechanics.kinematics.robot_check import check_robot, score
        from dexgrasp_env.robot.cell import make_cell

        cell = make_cell(self.robot)
        findings = check_robot(cell)
        if not any(finding.level == "error" for finding in findings):
            findings += _presses(cell)
        wrong = any(finding.level == "error" for finding in findings)
        if self.picture is not None and not wrong:
            findings += [
                Finding(
                    "warning", f"no grasp of {name} was found", "see why: dexgrasp plan OBJECT --robot FILE"
                )
                for name in _draw(cell, self.picture)
            ]
        lines = [*map(finding_line, findings), f"score {score(findings)} of 100"]
        return Answer({"ok": not wrong, "score": score(findings), "findings": findings}, lines, wrong)


def _presses(cell: Any) -> list[Finding]:
    """Report how many postures the planner can start from (it plans nothing without one), and the payload."""
    from dexgrasp.planning.atlas import hand_atlas
    from dexgrasp.planning.payload import payload

    mend = "other fingers in `grasp`, wider ranges, or `excluded` for links that overlap as they are built"
    try:
        count, mass = len(hand_atlas(cell).joints), payload(cell)
    except InputError as none:
        return [Finding("error", str(none), mend)]
    postures, lifts = f"{count} postures in which the hand can press", f"the hand lifts about {mass:.2g} kg"
    strengthen = "torque of its joints, Nm: most objects are heavier"
    return [  # with fewer postures plans are rare
        Finding("warning", postures, mend) if count < 200 else Finding("info", postures),
        Finding("warning", lifts, strengthen) if mass < 0.2 else Finding("info", lifts),
    ]


def _draw(cell: Any, path: Path) -> list[str]:
    """Draw the hand open, closed and in three grasps; return the objects that no grasp of was found."""
    from dexgrasp.cli.plan import plan_target
    from dexgrasp.grasp.picture import hand_picture
    from dexgrasp.mechanics.kinematics.robot_check import closed_posture

    grasps, missed = Fields(), list[str]()
    for name in ("soda", "sugar_box", "pear", "mustard_bottle", "lego"):
        plan = plan_target(name, "bilevel", SceneOptions(robot=cell))[1]
        if plan.grasp is None:
            missed.append(name)
        else:
            grasps[name] = plan.grasp, plan.target
        if len(grasps) == 3:
            break
    hand_picture(path, cell, {"open": cell.robot.home, "closed": closed_posture(cell)[0]}, grasps)
    return missed


COMMANDS = {"list": ListRobots, "make": Make, "check": CheckRobot}
