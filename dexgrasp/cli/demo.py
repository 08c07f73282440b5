"""`dexgrasp demo`: the main job in one go: look, plan, execute, show."""

import time
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from dexgrasp.cli.command import Answer, Command, Folder, Scene
from dexgrasp.cli.output import make_folder, note, say_when_compiling
from dexgrasp.cli.plan import check_target
from dexgrasp.evaluation.video import Film
from dexgrasp_env.valid import Natural

if TYPE_CHECKING:
    from dexgrasp.agent import Agent
    from dexgrasp.planning.look import Look
    from dexgrasp.planning.result import PlanResult


class Demo(Command, Scene):
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
        seed: of scene and planner.
        out: folder.
        no_video: leave video and demo.png out: drawing takes time.
    """

    object: Annotated[str, "TARGET"] = "sugar_box"
    agent: Annotated[str, "AGENT"] = "bilevel"
    seed: Annotated[Natural, "S"] = 0
    out: Folder = Path("out/demo")
    no_video: bool = False
    film: Film = Film()

    def run(self) -> Answer:
        """Run the demo; return outcome and times."""
        from dexgrasp.cli.plan_results import describe, write_results
        from dexgrasp.planning import look
        from dexgrasp.registry import agent_for
        from dexgrasp_env.rendering import rendering_fault

        check_target(self.object, self.agent, self)
        make_folder(self.out)
        say_when_compiling()
        missing = "left out" if self.no_video else rendering_fault()
        drawn = {} if missing else self.film.env_settings
        began, agent = time.perf_counter(), agent_for(self.agent, self.friction)
        seen = look.look_at(self.object, agent, self.seed, **self.env_settings, **drawn)
        agent.reset(seen.observation, seen.info)
        found, (identity, pose) = _result(agent), seen.subject
        result = found.as_json(identity, self.agent, pose)
        _cloud_picture(self.out / "cloud.png", seen, found)
        if found.success:
            write_results(self.out, found, result)
            if not self.json:
                print(describe(result))
        failure = agent.report.failure
        outcome = {"is_success": False, "failure": failure} if failure else _execute(agent, seen, self.out)
        outcome["seconds"] = time.perf_counter() - began
        seen.env.close()
        if missing and not self.no_video:
            note(f"no video and no demo.png: {missing}")
        good = bool(outcome["is_success"])
        whole = result | {"outcome": outcome, "success": good, "out": self.out}
        return Answer(whole, _outcome_text(identity.name, outcome, self.out), int(not good))


def _result(agent: "Agent") -> "PlanResult":
    """Return what an agent planned; of one that certifies nothing, its report."""
    from dexgrasp.agent import report_of
    from dexgrasp.planning.result import PlanResult, PlansGrasps

    if isinstance(agent, PlansGrasps) and agent.result is not None:
        return agent.result
    report = report_of(agent)
    return PlanResult(shortfall=report.failure, planning_seconds=report.planning_seconds or 0.0)


def _execute(agent: "Agent", seen: "Look", folder: Path) -> dict[str, Any]:
    """Carry the plan out; record a video and the moments of the episode where rendering works."""
    from tqdm import tqdm

    from dexgrasp.evaluation.video import Video

    env, observation = seen.env, seen.observation
    video = Video(folder / "demo.mp4") if env.unwrapped.render_mode else None
    frames, info, steps = [], dict[str, Any](), 0
    limit = None if env.spec is None else env.spec.max_episode_steps
    with (
        tqdm(total=limit, desc="executing", unit="step", leave=False) as bar,
        nullcontext() if video is None else video,
    ):
        while True:
            observation, _, terminated, truncated, info = env.step(agent.act(observation))
            steps += 1
            bar.update()
            picture = None if video is None else video.add(env)
            if picture is not None:
                frames.append(picture)
            if terminated or truncated or info["is_success"]:
                break
    if frames:
        _contact_sheet(folder / "demo.png", frames)
    keys = (
        "is_success",
        "is_stable",
        "failure",
        "stage",
        "object_height",
        "object_slip",
        "object_tilt",
        "held_seconds",
    )
    outcome = {key: info[key] for key in keys} | {"failure": info["failure"] or None}
    return outcome | {"simulated_seconds": round(0.05 * steps, 2)}


def _contact_sheet(path: Path, frames: list[Any]) -> None:
    """Six moments of the episode in one picture, left to right, top to bottom."""
    import imageio.v2 as imageio
    import numpy as np

    picks = [frames[k] for k in np.linspace(0, len(frames) - 1, 6).astype(int)]
    imageio.imwrite(path, np.vstack([np.hstack(picks[:3]), np.hstack(picks[3:])]))


def _cloud_picture(path: Path, seen: "Look", found: "PlanResult") -> None:
    """What was seen over what is there; only for agents that see points."""
    from dexgrasp_env.perception.picture import cloud_picture
    from dexgrasp_env.perception.scene import Scene

    if "cloud" not in seen.observation:
        return
    points = Scene.of_observation(seen.observation).target.points
    if not len(points):
        return
    true: Any = seen.env.unwrapped
    planned = None if found.target is None else found.target.surface
    title = f"{seen.subject.identity.name}: {len(points)} points from four cameras"
    mesh = true.simulation.object.mesh.copy().apply_transform(seen.subject.pose.T_world_object)
    cloud_picture(path, points, planned, mesh, title)


def _outcome_text(name: str, outcome: dict[str, Any], folder: Path) -> str:
    files = ", ".join(sorted(f.name for f in folder.iterdir()))
    if outcome["is_success"]:
        stable = "firmly" if outcome["is_stable"] else "but it moved in the hand"
        head = (
            f"{name}: lifted {100 * outcome['object_height']:.0f} cm and "
            f"held for {outcome['held_seconds']:.1f} s, {stable} "
            f"(slip {1000 * outcome['object_slip']:.1f} mm)"
        )
    else:
        head = f"{name}: NOT lifted: {outcome['failure'] or outcome.get('stage')}"
    return f"{head}; {outcome['seconds']:.1f} s in all\n{folder}: {files}"


COMMAND = Demo
