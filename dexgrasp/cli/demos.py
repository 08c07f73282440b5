"""`dexgrasp demos`: demonstrations of any agent, made, looked at and replayed."""

import argparse
from pathlib import Path
from typing import Any

from dexgrasp.cli.options import (
    add_cell,
    add_jobs,
    add_json,
    add_scene,
    add_seed,
    backend_of,
    number,
    positive_int,
)

_EPILOG = """examples:
  dexgrasp demos generate --objects varied-0..99 --episodes 20 --out runs/demos --workers 2
  dexgrasp demos generate --agent hardcoded --objects seen --episodes 50 --noise 0.03 --out runs/hand
  dexgrasp demos generate --agent my_package.policies:MyPolicy --objects ycb6 --control-mode ee_delta --out runs/mine
  dexgrasp demos generate --objects ycb6 --formats minari lerobot --out runs/both
  dexgrasp demos info runs/demos
  dexgrasp demos replay runs/demos --episodes 50

The agent acts in its own modes; what it commands is converted to --control-mode and replayed from the same scene under
--obs-mode, and kept if that succeeds as well. OUT/data is a Minari data set (minari.MinariDataset("OUT/data")),
OUT/lerobot one in the layout of LeRobot v3. A run that was interrupted goes on when the same command is given again;
the demonstrations do not depend on --workers. varied-0..99 are a hundred objects of random sizes that no test set has.
The agent dexgrasp.agents.teacher:Teacher is `hardcoded` with choices that are easy to learn."""

_NOISE = number(float, lambda value: 0.0 <= value <= 1.0, "a share from 0 to 1")


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "demos", help="demonstrations of any agent as Minari and LeRobot data sets", epilog=_EPILOG,
        description="Demonstrations to learn from.",
    )  # fmt: skip
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", dest="demos_command", required=True)
    generate = commands.add_parser(
        "generate", help="make demonstrations; resumable", epilog=_EPILOG,
        description="Have an agent act, and keep what succeeds.",
    )  # fmt: skip
    _add_generate(generate)
    info = commands.add_parser(
        "info", help="how many, of what, and why others failed",
        description="Say how many demonstrations there are, of what, and why others failed.",
    )  # fmt: skip
    info.add_argument("folder", type=Path, metavar="DIR", help="of the demonstrations")
    add_json(info)
    replay = commands.add_parser(
        "replay", help="play recorded actions again: do they still succeed?",
        description="Play recorded actions again, from the same scenes: exit code 0 only if all still succeed.",
    )  # fmt: skip
    replay.add_argument("folder", type=Path, metavar="DIR", help="of the demonstrations")
    replay.add_argument("--episodes", type=positive_int, metavar="N", help="how many (default all)")
    add_cell(replay)
    add_json(replay)


def _add_generate(parser: argparse.ArgumentParser) -> None:
    from dexgrasp_env.tasks.control import CONTROL_MODES
    from dexgrasp_env.tasks.observations import OBS_MODES

    parser.add_argument(
        "--agent", default="bilevel", metavar="AGENT", help="who demonstrates (default bilevel)"
    )
    parser.add_argument(
        "--objects", nargs="+", required=True, metavar="OBJECT", help="objects, sets, varied-N or mesh files"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the demonstrations")
    parser.add_argument(
        "--episodes", type=positive_int, default=10, metavar="N", help="scenes of each object (default 10)"
    )
    add_seed(parser)
    parser.add_argument("--obs-mode", choices=OBS_MODES, default="state", help="(default state)")
    parser.add_argument(
        "--control-mode", choices=CONTROL_MODES, default="joint_delta", help="(default joint_delta)"
    )
    parser.add_argument(
        "--observe", choices=("reset", "step"), default="reset",
        help="when cameras look; a view seen once is stored once (default reset)",
    )  # fmt: skip
    parser.add_argument(
        "--noise", type=_NOISE, default=0.0, metavar="SHARE",
        help="on what is commanded, of the velocity limits, for demonstrations that recover (default 0; 0.03 is much)",
    )  # fmt: skip
    parser.add_argument(
        "--formats", nargs="+", choices=("minari", "lerobot"), default=["minari"], help="(default minari)"
    )
    add_jobs(parser)
    add_scene(parser)
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Run `generate`, `info` or `replay`."""
    return {"generate": _generate, "info": _info, "replay": _replay}[args.demos_command](args)


def _generate(args: argparse.Namespace) -> int:
    from dexgrasp.cli.output import resumable
    from dexgrasp.demos.generate import generate
    from dexgrasp.demos.settings import DemoSettings
    from dexgrasp.runs.progress import progress_bar

    backend = backend_of(args)
    settings = DemoSettings.of(
        args.objects, agent=args.agent, episodes=args.episodes, seed=args.seed, obs_mode=args.obs_mode,
        control_mode=args.control_mode, observe=args.observe, noise=args.noise, friction=args.friction,
        robot=args.cell, mount=args.mount,
    )  # fmt: skip
    with resumable(f"finished files are kept in {args.out}"), progress_bar("file", "demos") as bar:
        generate(settings, args.out, tuple(args.formats), backend, bar)
    return _info(argparse.Namespace(folder=args.out, json=args.json))


def _info(args: argparse.Namespace) -> int:
    from dexgrasp.cli.output import print_json
    from dexgrasp.demos.info import summary
    from dexgrasp.runs.text import left_table, text_table

    figures = summary(args.folder)
    if args.json:
        print_json(figures)
        return 0
    loose = [[name, _shown(value)] for name, value in figures.items() if not isinstance(value, dict)]
    print(left_table(("figure", "value"), loose))
    for name in ("kept", "failures"):
        if figures.get(name):
            rows = [[key, str(count)] for key, count in figures[name].items()]
            print("\n" + text_table((name, "count"), rows))
    return 0


def _shown(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def _replay(args: argparse.Namespace) -> int:
    from dexgrasp.cli.output import print_json
    from dexgrasp.demos.info import replay_all
    from dexgrasp.runs.progress import progress_bar

    with progress_bar("episode", "replay") as bar:
        figures = replay_all(args.folder, args.episodes, bar, args.cell)
    if args.json:
        print_json(figures)
    else:
        print(f"{figures['successes']} of {figures['replayed']} replays succeed")
        for row in figures["failed"]:
            print(f"episode {row['episode']}: {row['object']}, scene seed {row['scene_seed']}")
    return int(figures["successes"] < figures["replayed"])
