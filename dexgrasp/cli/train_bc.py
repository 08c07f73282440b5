"""`dexgrasp train bc`: policies cloned from demonstrations."""

import argparse
from functools import partial
from pathlib import Path

from dexgrasp.cli.options import add_json, positive_int
from dexgrasp.cli.training import add_length, add_seeds, add_torch, add_trials, train_each_seed

_EPILOG = """examples:
  dexgrasp demos generate --objects varied-0..99 --episodes 20 --noise 0.03 --out runs/demos --workers 2
  dexgrasp train bc --data runs/demos --out runs/bc --minutes 10
  dexgrasp train bc --data runs/demos --view cloud --out runs/bc_cloud --epochs 30 --seed 0 1 2
  dexgrasp train bc --data runs/demos --out runs/bc --epochs 20 --try-on seen --trials 3 --every 5
  dexgrasp evaluate --agents runs/bc bilevel --objects all20

A policy sees the whole state, or joints and one look at a cloud, and predicts the set-points of the next 8 control
steps. --out then holds policy.json and policy.safetensors: an agent by its path, wherever agents are named. A run that
was interrupted goes on when the same command is given again, on a CPU to the same bits."""


def add_bc_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add `train bc`."""
    parser = commands.add_parser(
        "bc", help="a policy cloned from demonstrations", epilog=_EPILOG,
        description="Clone a policy from demonstrations.",
    )  # fmt: skip
    parser.add_argument(
        "--data", type=Path, nargs="+", required=True, metavar="DIR", help="of `dexgrasp demos generate`"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the policy")
    parser.add_argument(
        "--view",
        choices=("state", "cloud"),
        help="what the policy sees (default: what the demonstrations do)",
    )
    add_length(parser, steps=200, epochs=20)
    add_seeds(parser)
    add_torch(parser)
    parser.add_argument("--hidden", type=positive_int, default=512, metavar="N", help="width (default 512)")
    parser.add_argument(
        "--chunk", type=positive_int, default=8, metavar="N", help="set-points predicted (default 8)"
    )
    parser.add_argument(
        "--execute", type=positive_int, default=4, metavar="N", help="of them carried out (default 4)"
    )
    add_trials(parser, every=5, unit="epoch")
    add_json(parser)


def run_bc(args: argparse.Namespace) -> int:
    """Train a policy for each seed, print losses and successes."""
    from dexgrasp.imitation.cloning import Cloning
    from dexgrasp.imitation.settings import BcSettings, CloneNetwork
    from dexgrasp_env.errors import InputError

    if args.execute > args.chunk:
        raise InputError(f"--execute {args.execute}: valid are 1 to {args.chunk}, the --chunk")
    settings = BcSettings(
        view=args.view or _view(args.data[0]), epochs=args.epochs or BcSettings.epochs, execute=args.execute,
        threads=args.threads, network=CloneNetwork(hidden=args.hidden, chunk=args.chunk),
    )  # fmt: skip
    return train_each_seed(args, "epoch", settings, partial(Cloning, args.data))


def _view(folder: Path) -> str:
    from dexgrasp.demos.generate import read_about
    from dexgrasp.imitation.features import view_of

    return view_of(str(read_about(folder)["settings"].get("obs_mode")))
