"""`dexgrasp plan`: one or more grasps with their certificates, or the reason why there is none."""

import os
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np

from dexgrasp.cli.command import Answer, Argument, Command, Folder, SceneOptions, check_mesh_options
from dexgrasp.cli.output import note
from dexgrasp.cli.request import RequestOptions
from dexgrasp.cli.scan import CloudOptions, blocking_lines, chosen_line, draw_scan, list_lines, table_line
from dexgrasp.runs.folder import make_folder
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.valid import Count, Share

if TYPE_CHECKING:
    from collections.abc import Callable

    from dexgrasp.geometry.request import GraspRequest
    from dexgrasp.planning.result import PlanResult, Progress
    from dexgrasp.planning.scene_setup import Look
    from dexgrasp_env.arrays import Array, Mask
    from dexgrasp_env.perception.cloud import Cloud
    from dexgrasp_env.perception.detected import DetectedObject
    from dexgrasp_env.perception.scene import Scene


class Plan(Command, RequestOptions, CloudOptions, SceneOptions):
    """Plan one grasp of an object on the table, or K that differ.

    examples:
      dexgrasp plan sugar_box                             a box of the catalogue, as four depth cameras see it
      dexgrasp plan my_part.stl --mesh-scale 0.001        your own mesh, drawn in millimetres
      dexgrasp plan pear --seed 3 --out grasps/pear       writes grasp.json and grasp.png
      dexgrasp plan pear --json | jq .certificate
      dexgrasp plan --cloud scene.ply --out out/scene     your own point cloud, in the robot base frame, metres
      dexgrasp plan --cloud scene.ply --objects           what is seen there; point at one of them:
      dexgrasp plan --cloud scene.ply --object-near 0.5 0.1 0.03
      dexgrasp plan pear --count 20 --out grasps/pear     20 grasps that differ: grasp_000.json is the firmest
      dexgrasp plan pear --at-least 0.95                  a grasp that holds with this probability, or none
      dexgrasp plan mustard_bottle --approach side --avoid box:0.3,-0.5,0.0,0.8,0.5,0.06
                                                          from the side, above 6 cm
      dexgrasp plan pear --floating --out grasps/pear     in mid-air, by the hand alone: for dexgrasp score
      dexgrasp plan pear --friction 0.35                  a slippery one, and a planner that knows it: it counts on 5/7
                                                          of MU for closure, 6/7 for the forces (never over 0.5 and 0.6)

    The object is put on the table in a pose drawn from --seed, seen with the default sensor noise, and planned for
    without knowledge of its pose or mass. Exit code 1 says that there is no grasp, or none that
    bears the assumed weight, or none so sure as --at-least asks; the reason is printed.

    Attributes:
        target: object of the catalogue or mesh file (obj, stl, ply, glb, gltf, off, dae, 3mf).
        agent: which planner.
        count: K grasps that differ, firmest first; with --out, grasp_000.json and so on (exit code 1 for fewer).
        at_least: a grasp that is lifted and held with at least this probability, or none (exit code 1).
        out: folder for grasp.json and grasp.png, of a cloud also seen.png.
        floating: in mid-air, its shape known, no approach: for dexgrasp score.
    """

    target: Argument[str | None] = None
    agent: Annotated[str, "AGENT"] = "bilevel"
    count: Annotated[Count | None, "K"] = None
    at_least: Annotated[Share | None, "P"] = None
    out: Folder | None = None
    floating: bool = False

    def run(self) -> Answer:
        """Plan, and write the files that were asked for."""
        from dexgrasp.cli.plan_results import describe, write_results
        from dexgrasp.runs.progress import progress_bar

        scan = self._read()
        if self.out is not None:
            make_folder(self.out)
        if scan is not None and self.objects:
            return self._list(scan)
        several = self.count is not None
        with progress_bar("step", "grasps", shown=several, delay=3, leave=False) as progress:
            found, content = self._plan(progress) if scan is None else self._plan_scan(scan, progress)
        good = found.success and all(grasp.certificate.holds for grasp in found.grasps)
        answer = Answer(content, describe(content, found.sentence), not good)
        if self.out is not None and (found.success or several):
            try:
                note(write_results(self.out, found, content))
            except OSError as error:  # a full disk: what was found is printed all the same
                return replace(answer, failure=error)
        return answer

    def _read(self) -> "Cloud | None":
        """Validate the options, before heavy imports that take a second; return the cloud, None for a TARGET."""
        if self.cloud is None:
            if self.target is None:
                raise InputError(
                    "name a TARGET: an object (see `dexgrasp list objects`), a mesh file, or --cloud FILE"
                )
            if self.floating and (self.agent, self.at_least) != ("bilevel", None):
                raise InputError("--agent and --at-least do not apply to --floating")
            if self.of_request and (self.floating or self.agent != "bilevel"):
                raise InputError(f"{', '.join(self.of_request)} are of agent bilevel on a table")
            self._request(_nothing_marked)
            if self.of_cloud:
                raise InputError(
                    f"{', '.join(self.of_cloud)} are of --cloud: of a TARGET the planner is told nothing "
                    "(--mesh-mass is a mesh's)"
                )
            check_target(self.target, self.agent, self)
            return None
        if self.target is not None or self.floating:
            raise InputError("give a TARGET or --cloud, not both; --floating is of a TARGET")
        if (self.agent, self.mesh_mass, self.mesh_scale) != ("bilevel", None, 1.0):
            raise InputError(
                "--agent, --mesh-scale and --mesh-mass do not apply to --cloud (its mass is --mass)"
            )
        idle = self.given("count", "at_least", "mass", "friction", *RequestOptions.__annotations__)
        if self.objects and idle:
            raise InputError(f"{', '.join(idle)} would change nothing: --objects plans nothing")
        from dexgrasp_env.perception.scan import read_scan

        if line := self.order_line():
            note(line)
        return read_scan(self.cloud, self.unit, self.pose)

    def _request(self, marked: "Callable[[Mask], Array]") -> "GraspRequest":
        """Return the request with the options of the other groups; see `grasp_request`."""
        return self.grasp_request(
            marked, friction=self.friction, mass=self.mass, count=self.count, min_probability=self.at_least
        )

    def _plan(self, progress: "Progress | None") -> "tuple[PlanResult, Fields]":
        """Plan for the named object; return the result, and its JSON."""
        if self.floating:
            from dexgrasp.planning.floating import plan_floating
            from dexgrasp.planning.plan_scene import default_planner

            planner = default_planner(self.cell, None, "surface").asking(self._request(_nothing_marked))
            subject, found = plan_floating(
                planner,
                str(self.target),
                self.seed,
                scale=self.mesh_scale,
                mass=self.mesh_mass,
                progress=progress,
            )
        else:
            look, found = plan_target(str(self.target), self.agent, self, progress, self._request)
            subject = look.subject
        return found, found.as_json(subject.identity, self.agent, subject.pose)

    def _plan_scan(self, scan: "Cloud", progress: "Progress | None") -> "tuple[PlanResult, Fields]":
        """Plan on a cloud; return the result, and its JSON."""
        _import_mujoco()
        from dexgrasp.planning.plan_scene import default_planner, plan_scene
        from dexgrasp.planning.planner import Planner
        from dexgrasp_env.perception.selection import TargetSelector

        request = self._request(lambda mask: scan.points[TargetSelector(mask=mask).marks(scan)])
        began = time.perf_counter()
        scene, seen = self._look(scan)
        looked = time.perf_counter() - began
        if scene.reason == "several_objects":
            self._draw(scan, scene, seen)
            stand = "; ".join(line.strip() for line in list_lines(seen))
            raise InputError(
                f"several objects stand in reach: {stand}: point at one by --object-near, --box, --mask or --pixel"
            )
        if off := table_line(scene, self.cell):
            self.say(off)
        if scene.reason is None:
            self.say(chosen_line(seen))
            planner = default_planner(self.cell)
        else:  # nothing to plan on, and nothing to compile for it
            planner = Planner(cell=self.cell)
        there = self.seed, self.cell.robot.home
        found = plan_scene(planner.asking(request), scene, *there, progress=progress, relax=True)
        found.log.seconds = {"perception": looked} | found.log.seconds
        self._draw(scan, scene, seen, found)
        beside = {"seen": seen, "table": off, "in_the_way": blocking_lines(scene, seen, found)}
        return found, found.as_json(scan_name(Path(str(self.cloud)))) | beside

    def say(self, line: str) -> None:
        """Print a line on what was seen."""
        note(line)

    def _draw(
        self,
        scan: "Cloud",
        scene: "Scene",
        seen: "list[DetectedObject]",
        found: "PlanResult | None" = None,
    ) -> None:
        """Draw the perceived scene into the folder, if one is given."""
        if self.out is not None:
            note(draw_scan(self.out / "seen.png", scan, scene, seen, found, self.cell))

    def _look(self, scan: "Cloud") -> "tuple[Scene, list[DetectedObject]]":
        """Return the perceived scene of a cloud, and the objects detected in it."""
        from dexgrasp.geometry.completion import guesses_said
        from dexgrasp.planning.plan_scene import scene_of
        from dexgrasp_env.perception.detected import detected_objects
        from dexgrasp_env.perception.reasons import OF_FRAME

        look = partial(scene_of, selector=self.selector(), seed=self.seed, cell=self.cell)
        scene = look(scan)
        if scene.reason in OF_FRAME:
            scene = replace(scene, sentence="; ".join([scene.sentence, *self.frame_words(scan, look)]))
        return scene, detected_objects(guesses_said(scene), self.cell.seeing(scene.table).T_base_world)

    def _list(self, scan: "Cloud") -> Answer:
        """List the detected objects; draw them into the folder, if one is given."""
        scene, seen = self._look(scan)
        lines = [f"{len(seen)} objects (middles in the frame of the robot's base, m):", *list_lines(seen)]
        if not seen:
            lines = [f"no object: {scene.sentence or scene.reason}"]
        if off := table_line(scene, self.cell):
            lines.append(off)
        if self.out is not None:
            lines.append(draw_scan(self.out / "objects.png", scan, scene, seen, None, self.cell))
        return Answer({"objects": seen}, lines, not seen)


def check_target(target: str, agent: str, scene: SceneOptions) -> None:
    """Validate the names before heavy imports.

    Raises:
        InputError: for an unknown cell, mount, object or agent, a set, or options that do not apply to the object.
    """
    from dexgrasp.registry import check_name
    from dexgrasp_env.objects.load import resolve_targets

    _ = scene.cell  # makes it, or says why not
    found = resolve_targets([target])
    if len(found) > 1:
        raise InputError(f"{target!r} is a set: name one of its objects ({', '.join(found)})")
    check_mesh_options(found, scene)
    check_name(agent)


def plan_target(
    target: str,
    agent_name: str,
    scene: SceneOptions,
    progress: "Progress | None" = None,
    request: "Callable[[Callable[[Mask], Array]], GraspRequest] | None" = None,
) -> "tuple[Look, PlanResult]":
    """Observe an object with an agent, and plan.

    Args:
        target: name of the catalogue or path of a mesh.
        agent_name: which planner.
        scene: the options of the scene.
        progress: called with steps done and steps in all.
        request: makes the request, given a function that returns the points a mask of the mesh's faces marks; None: any
            grasp at the scene's friction.

    Raises:
        InputError: for an unknown agent, or one that plans no grasps.
    """
    _import_mujoco()
    from dexgrasp.geometry.request import GraspRequest
    from dexgrasp.planning.result import PlansGrasps
    from dexgrasp.planning.scene_setup import look_at
    from dexgrasp.registry import make_agent
    from dexgrasp_env.objects.load import is_ours, load_target

    if not is_ours(target):  # a mesh that cannot be read is refused before anything is compiled
        load_target(target, scene.mesh_scale, scene.mesh_mass)
    agent = make_agent(agent_name)
    if not isinstance(agent, PlansGrasps):
        raise InputError(
            f"agent {agent_name!r} makes no certified plans: valid are bilevel, cvae, cvae_kinematics"
        )
    look = look_at(target, agent, scene.seed, **scene.env_settings)
    if asked := GraspRequest(friction=scene.friction) if request is None else request(look.marked):
        agent = make_agent(agent_name, request=asked)
        agent.seed(scene.seed)
        assert isinstance(agent, PlansGrasps)  # as before
    return look, agent.plan(look.observation, look.info, progress, relax=True)


def _nothing_marked(_mask: "Mask") -> "Array":
    """Return a placeholder point (1, 3), where there is no cloud or mesh to mark."""
    return np.zeros((1, 3))


def _import_mujoco() -> None:
    """Import mujoco without its window library: rendering chooses its own, MUJOCO_GL is set aside by then."""
    if "mujoco" not in sys.modules:
        os.environ["MUJOCO_GL"] = "disable"
        import mujoco  # noqa: F401

        del os.environ["MUJOCO_GL"]


def scan_name(path: Path) -> str:
    """Return the name of a scan: a file without its suffix, a folder whole (`scan0.08` has none)."""
    return path.resolve().name if path.is_dir() else path.stem
