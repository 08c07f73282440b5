"""`dexgrasp train grip`: a cloned policy's grip, corrected by reinforcement."""

import argparse
from functools import partial
from pathlib import Path

from dexgrasp.cli.options import add_json, positive_float, positive_int
from dexgrasp.cli.training import add_seeds, add_torch, add_trials, train_each_seed

_EPILOG = """examples:
  dexgrasp train grip --objects varied-0..59 --from runs/bc --out runs/grip
  dexgrasp train grip --objects varied-0..59 --from runs/bc --friction 0.3 0.5 --mass 1 1.5 --out runs/grip --seed 0 1 2
  dexgrasp evaluate --agents runs/grip runs/bc --objects all20 --protocol robust

PPO of Stable-Baselines3, one decision an episode: from the first look the network shifts and tilts the palm by up to
3 cm and 0.2 rad and bends fingers and thumb, and a policy of `train bc` from the state acts with that. It begins with
no correction. Episodes are slippery and heavy by default, as a grip that holds there bears pushes as well. --out is an
agent by its path (JSON and safetensors). A run that was interrupted goes on when the same command is given again, on a
CPU to the same bits."""


def add_grip_parser(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add `train grip`."""
    parser = commands.add_parser(
        "grip", help="a cloned policy's grip, by reinforcement", epilog=_EPILOG,
        description="Correct the grip of a cloned policy by reinforcement.",
    )  # fmt: skip
    parser.add_argument("--objects", nargs="+", required=True, metavar="OBJECT", help="to learn on")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the policy")
    parser.add_argument(
        "--from", type=Path, dest="clone", metavar="DIR", required=True, help="a policy of `train bc`"
    )
    parser.add_argument(
        "--episodes", type=positive_int, default=3000, metavar="N", help="to learn from (default 3000)"
    )
    parser.add_argument(
        "--friction", type=positive_float, nargs=2, default=[0.3, 0.5], metavar=("LEAST", "MOST"),
        help="coefficients that episodes draw from (default 0.3 0.5)",
    )  # fmt: skip
    parser.add_argument(
        "--mass", type=positive_float, nargs=2, default=[1.0, 1.5], metavar=("LEAST", "MOST"),
        help="factors on masses that episodes draw from (default 1 1.5)",
    )  # fmt: skip
    parser.add_argument(
        "--num-envs", type=positive_int, default=16, metavar="N", help="side by side (default 16)"
    )
    parser.add_argument(
        "--rate", type=positive_float, default=2e-3, metavar="R", help="of Adam (default 0.002)"
    )
    add_seeds(parser)
    add_torch(parser)
    add_trials(parser, every=10, unit="round")
    add_json(parser)


def run_grip(args: argparse.Namespace) -> int:
    """Train a policy for each seed, print returns and successes."""
    from dexgrasp.reinforcement.grip_settings import GripSettings
    from dexgrasp.reinforcement.grip_training import GripTraining
    from dexgrasp_env.objects.load import resolve_targets

    settings = GripSettings(
        objects=tuple(resolve_targets(args.objects)), friction=tuple(args.friction), mass=tuple(args.mass),
        episodes=args.episodes, num_envs=args.num_envs, rate=args.rate, threads=args.threads,
    )  # fmt: skip
    return train_each_seed(args, "round", settings, partial(GripTraining, clone=args.clone))
