"""`dexgrasp plan`: one grasp (or several) with its certificate, or the reason why there is none."""

import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from dexgrasp.cli.command import Answer, Argument, Command, File, Folder, Options, Scene, check_mesh_options
from dexgrasp.cli.output import make_folder, note
from dexgrasp_env.errors import InputError
from dexgrasp_env.valid import Count, Positive, check

if TYPE_CHECKING:
    from dexgrasp.planning.look import Look
    from dexgrasp.planning.result import PlanResult, Progress
    from dexgrasp_env.perception.cloud import Cloud


class Scan(Options):
    """Your own scene, instead of TARGET.

    Attributes:
        cloud: ply, pcd, xyz, npy or npz in the robot base frame; or a folder with cameras.yaml and depth images.
        unit: of that file's coordinates.
        object_near: a point near the object that is meant, m.
        mass: of the object, kg, where it is known.
    """

    cloud: File | None = None
    unit: Literal["m", "cm", "mm"] = "m"
    object_near: Annotated[tuple[float, float, float] | None, "X", "Y", "Z"] = None
    mass: Annotated[Positive | None, "KG"] = None


class Plan(Command, Scan, Scene):
    """Plan one grasp of an object on the table, or K that differ.

    examples:
      dexgrasp plan sugar_box                             a box of the catalogue, as four depth cameras see it
      dexgrasp plan my_part.stl --mesh-scale 0.001        your own mesh, drawn in millimetres
      dexgrasp plan pear --seed 3 --out grasps/pear       writes grasp.json and grasp.png
      dexgrasp plan pear --json | jq .certificate
      dexgrasp plan --cloud scene.ply --out out/scene     your own point cloud, in the robot base frame, metres
      dexgrasp plan pear --count 20 --out grasps/pear     20 grasps that differ: grasp_000.json is the firmest
      dexgrasp plan pear --friction 0.35                  a slippery one, and a planner that knows it: it counts on 5/7
                                                          of MU for closure, 6/7 for the forces (never over 0.5 and 0.6)

    The object is put on the table in a pose drawn from --seed, seen with the default sensor noise, and planned for
    without knowledge of its pose or mass. Exit code 1 says that there is no grasp; the reason is printed.

    Attributes:
        target: object of the catalogue or mesh file (obj, stl, ply, glb).
        agent: which planner.
        count: K grasps that differ, firmest first; with --out, grasp_000.json and so on (exit code 1 for fewer).
        out: folder for grasp.json and grasp.png.
    """

    target: Argument[str | None] = None
    agent: Annotated[str, "AGENT"] = "bilevel"
    count: Annotated[Count | None, "K"] = None
    out: Folder | None = None

    def run(self) -> Answer:
        """Plan, and write what was asked for."""
        from dexgrasp.cli.plan_results import describe, write_results
        from dexgrasp.runs.progress import progress_bar

        scan = self._read()
        if self.out is not None:
            make_folder(self.out)
        several = self.count is not None
        with progress_bar("step", "grasps", shown=several, delay=3, leave=False) as progress:
            found, content = self._plan(progress) if scan is None else self._plan_scan(scan, progress)
        answer = Answer(content, describe(content, found.sentence), int(not found.success))
        if self.out is not None and (found.success or several):
            try:
                note(write_results(self.out, found, content))
            except OSError as error:  # a full disk: what was found is printed all the same
                return replace(answer, failure=error)
        return answer

    def _read(self) -> "Cloud | None":
        """Read the cloud; let a mistake show before anything heavy is imported, which takes a second."""
        if self.count is not None:
            from dexgrasp.planning.settings import GRASPS

            check("count", self.count, GRASPS)
        if self.cloud is None:
            if self.target is None:
                raise InputError(
                    "name a TARGET: an object (see `dexgrasp list objects`), a mesh file, or --cloud FILE"
                )
            if (self.mass, self.object_near, self.unit) != (None, None, "m"):
                raise InputError(
                    "--mass, --object-near and --unit are of --cloud: of a TARGET the planner is told nothing "
                    "(--mesh-mass is a mesh's)"
                )
            check_target(self.target, self.agent, self)
            return None
        if self.target is not None:
            raise InputError("give a TARGET or --cloud, not both")
        if (self.agent, self.mesh_mass, self.mesh_scale) != ("bilevel", None, 1.0):
            raise InputError(
                "--agent, --mesh-scale and --mesh-mass do not apply to --cloud (its mass is --mass)"
            )
        from dexgrasp_env.perception.scan import read_scan

        return read_scan(self.cloud, self.unit)

    def _plan(self, progress: "Progress") -> "tuple[PlanResult, dict[str, Any]]":
        """Plan for the named object; return what came of it, and the same as JSON."""
        look, found = plan_target(str(self.target), self.agent, self, self.count, progress)
        return found, found.as_json(look.subject.identity, self.agent, look.subject.pose)

    def _plan_scan(self, scan: "Cloud", progress: "Progress") -> "tuple[PlanResult, dict[str, Any]]":
        """Plan on a cloud; return what came of it, and the same as JSON."""
        from dexgrasp.planning.seen import default_planner, plan_scene, scene_of
        from dexgrasp.planning.settings import PlannerSettings

        settings = None if self.friction is None else PlannerSettings.for_friction(self.friction)
        planner = default_planner(self.cell, settings)
        scene = scene_of(scan, near=self.object_near, seed=self.seed, cell=self.cell)
        home = self.cell.robot.home
        found = plan_scene(
            planner, scene, self.seed, home, mass=self.mass, count=self.count, progress=progress
        )
        return found, found.as_json(scan_name(Path(str(self.cloud))))


def check_target(target: str, agent: str, scene: Scene) -> None:
    """Let a mistake in the names show before anything heavy is imported.

    Raises:
        InputError: for an unknown cell, mount, object or agent, a set, or options that do not apply to the object.
    """
    from dexgrasp.registry import check_name
    from dexgrasp_env.objects.load import resolve_targets
    from dexgrasp_env.robot.cell import make_cell

    make_cell(scene.robot, scene.mount)
    found = resolve_targets([target])
    if len(found) > 1:
        raise InputError(f"{target!r} is a set: name one of its objects ({', '.join(found)})")
    check_mesh_options(found, scene.mesh_scale, scene.mesh_mass)
    check_name(agent)


def plan_target(
    target: str, agent_name: str, scene: Scene, count: int | None = None, progress: "Progress | None" = None
) -> "tuple[Look, PlanResult]":
    """Let an agent look at an object, and plan.

    Raises:
        InputError: for an unknown agent, or one that plans no grasps.
    """
    _import_mujoco()
    from dexgrasp.planning.look import look_at
    from dexgrasp.planning.result import PlansGrasps
    from dexgrasp.registry import agent_for

    agent = agent_for(agent_name, scene.friction)
    if not isinstance(agent, PlansGrasps):
        raise InputError(
            f"agent {agent_name!r} makes no certified plans: valid are bilevel, cvae, cvae_kinematics"
        )
    look = look_at(target, agent, scene.seed, **scene.env_settings)
    return look, agent.plan(look.observation, look.info, count, progress)


def _import_mujoco() -> None:
    """Import MuJoCo without the window library that it would bring; what draws chooses its own, see `rendering`."""
    if "mujoco" not in sys.modules:  # MUJOCO_GL was put aside
        os.environ["MUJOCO_GL"] = "disable"
        import mujoco  # noqa: F401

        del os.environ["MUJOCO_GL"]


def scan_name(path: Path) -> str:
    """Return what a scan is called: a file without its suffix, a folder whole (`scan0.08` has none)."""
    return path.resolve().name if path.is_dir() else path.stem


COMMAND = Plan
