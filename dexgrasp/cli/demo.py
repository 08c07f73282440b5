"""`dexgrasp demo`: observe, plan, execute and show one grasp."""

import time
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from dexgrasp.cli.command import Answer, Command, Folder, SceneOptions
from dexgrasp.cli.output import note
from dexgrasp.cli.plan import check_target
from dexgrasp.evaluation.video import VideoSettings
from dexgrasp.runs.folder import make_folder
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError

if TYPE_CHECKING:
    from dexgrasp.agent import Agent
    from dexgrasp.planning.result import PlanResult
    from dexgrasp.planning.scene_setup import Look


class Demo(Command, SceneOptions):
    """Put an object on the table, plan a grasp from four depth cameras, lift it, save a video.

    examples:
      dexgrasp demo                                       the sugar box
      dexgrasp demo --object tetrahedron --seed 2 --out out/tetrahedron
      dexgrasp demo --object my_mesh.stl --mesh-scale 0.001
      dexgrasp demo --agent hardcoded                     the baseline, for comparison

    Writes demo.mp4, demo.png (the moments of the episode), cloud.png (what the cameras saw), grasp.json and grasp.png.
    Without a GL library the video and demo.png are left out, and said so.

    Attributes:
        object: name or mesh file.
        agent: who plans.
        out: folder.
        no_video: leave video and demo.png out: drawing takes time.
        no_pictures: leave all pictures out.
    """

    object: Annotated[str, "TARGET"] = "sugar_box"
    agent: Annotated[str, "AGENT"] = "bilevel"
    out: Folder = Path("out/demo")
    no_video: bool = False
    no_pictures: bool = False
    film: VideoSettings = VideoSettings()

    def run(self) -> Answer:
        """Run the demo; return outcome and times."""
        from dexgrasp.cli.plan_results import describe, write_results
        from dexgrasp.geometry.request import GraspRequest
        from dexgrasp.planning.result import PlansGrasps
        from dexgrasp.planning.scene_setup import look_at
        from dexgrasp.registry import make_agent
        from dexgrasp_env.rendering import rendering_fault

        check_target(self.object, self.agent, self)
        unwanted = self.no_video or self.no_pictures
        if unwanted and self.film != VideoSettings():
            raise InputError("--camera and --size are of a video, which is left out")
        make_folder(self.out)
        missing = "left out" if unwanted else rendering_fault()
        drawn = {} if missing else self.film.env_settings
        began, agent = time.perf_counter(), make_agent(self.agent)
        if self.friction is not None and isinstance(agent, PlansGrasps):
            agent = make_agent(self.agent, request=GraspRequest(friction=self.friction))
        seen = look_at(self.object, agent, self.seed, **self.env_settings, **drawn)
        agent.reset(seen.observation, seen.info)
        found = _result(agent)
        result = found.as_json(seen.subject.identity, self.agent, seen.subject.pose)
        if not self.no_pictures:
            _cloud_picture(self.out / "cloud.png", seen, found)
        if found.success:
            write_results(self.out, found, result, pictures=not self.no_pictures)
            print(describe(result))
        failure = agent.report.failure
        outcome = {"is_success": False, "failure": failure} if failure else _execute(agent, seen, self.out)
        outcome["seconds"] = time.perf_counter() - began
        seen.env.close()
        if missing and not unwanted:
            note(f"no video and no demo.png: {missing}")
        whole = result | {"outcome": outcome, "success": outcome["is_success"], "out": self.out}
        files = ", ".join(sorted(file.name for file in self.out.iterdir()))
        text = f"{result['object']}: {_sentence(outcome)}; {outcome['seconds']:.1f} s in all\n{self.out}: {files}"
        return Answer(whole, text, not outcome["is_success"])


def _result(agent: "Agent") -> "PlanResult":
    """Return the plan of an agent; of one without certificates, a result made of its report."""
    from dexgrasp.agent import report_of
    from dexgrasp.planning.result import PlanResult, PlansGrasps

    if isinstance(agent, PlansGrasps) and agent.result is not None:
        return agent.result
    report = report_of(agent)
    return PlanResult(shortfall=report.failure, planning_seconds=report.planning_seconds or 0.0)


def _execute(agent: "Agent", seen: "Look", folder: Path) -> Fields:
    """Execute the plan; record a video and a contact sheet of the episode where rendering works."""
    from dexgrasp.evaluation.video import Video
    from dexgrasp.runs.progress import progress_bar
    from dexgrasp_env.scene.constants import CONTROL_PERIOD

    env, observation = seen.env, seen.observation
    frames, info, steps, over = list[Any](), Fields(), 0, False
    with (
        progress_bar("step", "executing", leave=False) as bar,
        Video(folder / "demo.mp4") if env.unwrapped.render_mode else nullcontext() as video,
    ):
        while not over:
            observation, _, terminated, truncated, info = env.step(agent.act(observation))
            over = terminated or truncated or info["is_success"]
            steps += 1
            bar(steps, env.get_wrapper_attr("spec").max_episode_steps)
            if video is not None and (picture := video.add(env)) is not None:
                frames.append(picture)
    if frames:
        _contact_sheet(folder / "demo.png", frames)
    kept = (
        "is_success", "is_stable", "failure", "stage", "object_height", "object_slip", "object_tilt", "held_seconds",
    )  # fmt: skip
    return {key: info[key] for key in kept} | {
        "failure": info["failure"] or None,
        "simulated_seconds": round(CONTROL_PERIOD * steps, 2),
    }


def _contact_sheet(path: Path, frames: list[Any]) -> None:
    """Write six frames of the episode as one picture, left to right, top to bottom."""
    import imageio.v2 as imageio
    import numpy as np

    picks = [frames[k] for k in np.linspace(0, len(frames) - 1, 6).astype(int)]
    imageio.imwrite(path, np.vstack([np.hstack(picks[:3]), np.hstack(picks[3:])]))


def _cloud_picture(path: Path, seen: "Look", found: "PlanResult") -> None:
    """Draw the observed points and the true mesh, for agents that observe a cloud."""
    import numpy as np

    from dexgrasp_env.perception.picture import Drawing, scene_picture
    from dexgrasp_env.perception.scene import Scene

    if "cloud" in seen.observation and len(points := Scene.of_observation(seen.observation).target.points):
        true: Any = seen.env.unwrapped
        planned = None if found.target is None else found.target.distance.triangles
        title = f"{seen.subject.identity.name}: {len(points)} points from four cameras"
        mesh = true.simulation.object.mesh.copy().apply_transform(seen.subject.pose.T_world_object)
        shown = {"segmented points": points}, np.zeros((0, 3))
        solids = {"true mesh": np.asarray(mesh.triangles)}
        scene_picture(path, Drawing(*shown, hull=planned, solids=solids, title=title))


def _sentence(outcome: Fields) -> str:
    if not outcome["is_success"]:
        return f"NOT lifted: {outcome['failure'] or outcome.get('stage')}"
    stable = "firmly" if outcome["is_stable"] else "but it moved in the hand"
    return (
        f"lifted {100 * outcome['object_height']:.0f} cm and held for {outcome['held_seconds']:.1f} s, {stable} "
        f"(slip {1000 * outcome['object_slip']:.1f} mm)"
    )
