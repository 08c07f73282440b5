"""`dexgrasp demo`: the main job in one go: look, plan, execute, show."""

import argparse
import time
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dexgrasp.cli.options import add_film, add_json, add_mesh, add_scene, add_seed

if TYPE_CHECKING:
    from dexgrasp.agent import Agent
    from dexgrasp.planning.look import Look
    from dexgrasp.planning.result import PlanResult

_EPILOG = """examples:
  dexgrasp demo                                       the sugar box
  dexgrasp demo --object tetrahedron --seed 2 --out out/tetrahedron
  dexgrasp demo --object my_mesh.stl --mesh-scale 0.001
  dexgrasp demo --agent hardcoded                     the baseline, for comparison

Writes demo.mp4, demo.png (the moments of the episode), cloud.png (what the cameras saw), grasp.json and grasp.png.
Without a GL library the video and demo.png are left out, and said so."""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "demo", help="plan a grasp, execute it, show and save the outcome", epilog=_EPILOG,
        description="Put an object on the table, plan a grasp from four depth cameras, lift it, save a video.",
    )  # fmt: skip
    parser.add_argument(
        "--object", default="sugar_box", metavar="TARGET", help="name or mesh file (default sugar_box)"
    )
    parser.add_argument("--agent", default="bilevel", metavar="NAME", help="who plans (default bilevel)")
    add_seed(parser, "of scene and planner")
    parser.add_argument(
        "--out", type=Path, default=Path("out/demo"), metavar="DIR", help="folder (default out/demo)"
    )
    parser.add_argument(
        "--no-video", action="store_true", help="leave video and demo.png out: drawing takes time"
    )
    add_film(parser)
    add_mesh(parser)
    add_scene(parser)
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Run the demo and print outcome and times."""
    from dexgrasp.cli.output import make_folder, note, print_json, say_when_compiling
    from dexgrasp.cli.plan import check_target, describe, scene_settings, write_results
    from dexgrasp.evaluation.video import Film
    from dexgrasp.planning import look
    from dexgrasp.registry import agent_for
    from dexgrasp_env.files import jsonable
    from dexgrasp_env.rendering import rendering_fault

    check_target(args.object, args)
    make_folder(args.out)
    say_when_compiling()
    settings = scene_settings(args)
    missing = "left out" if args.no_video else rendering_fault()
    if missing is None:
        settings |= Film(args.camera, args.size).env_settings
    began, agent = time.perf_counter(), agent_for(args.agent, args.friction)
    seen = look.look_at(args.object, agent, args.seed, **settings)
    agent.reset(seen.observation, seen.info)
    found, name = _result(agent), seen.subject.identity.name
    result = found.as_json(seen.subject.identity, args.agent, seen.subject.pose)
    _cloud_picture(args.out / "cloud.png", seen, found)
    if found.success:
        write_results(args.out, found, result)
        if not args.json:
            print(describe(result))
    failure = agent.report.failure
    outcome = (
        _execute(agent, seen, args.out) if failure is None else {"is_success": False, "failure": failure}
    )
    outcome["seconds"] = time.perf_counter() - began
    seen.env.close()
    if missing is not None and not args.no_video:
        note(f"no video and no demo.png: {missing}")
    if args.json:
        whole = {"outcome": outcome, "success": bool(outcome["is_success"]), "out": str(args.out)}
        print_json(jsonable(result | whole))
    else:
        print(_outcome_text(name, outcome, args.out))
    return 0 if outcome["is_success"] else 1


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
    imageio.imwrite(path, np.concatenate([np.concatenate(picks[:3], 1), np.concatenate(picks[3:], 1)], 0))


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
    cloud_picture(path, points, planned, true.simulation.object.mesh, seen.subject.pose.T_world_object, title)


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
