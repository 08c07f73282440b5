"""`dexgrasp train ppo | sac`: policies by reinforcement, from nothing or from a clone."""

import argparse
from functools import partial
from pathlib import Path

from dexgrasp.cli.options import add_json, number, positive_float, positive_int, share
from dexgrasp.cli.training import add_seeds, add_torch, add_trials, train_each_seed

_EPILOG = """examples:
  dexgrasp train ppo --objects sugar_box --steps 2000000 --out runs/ppo
  dexgrasp train ppo --objects varied-0..29 --from runs/bc --steps 500000 --out runs/ppo_bc --try-on seen
  dexgrasp train sac --objects seen --from runs/bc --share 0.1 --out runs/sac_bc --seed 0 1 2
  dexgrasp evaluate --agents runs/ppo_bc runs/bc --objects all20 --protocol lift pushed slippery

Stable-Baselines3's algorithms on the native vector environment, dense reward. With --from, a cloned policy acts and a
share of the network's action is added to its own: what it can do already is the start. --out is an agent by its path
(JSON and safetensors). A run that was interrupted goes on when the same command is given again; rounds (one episode of
every environment) have seeds of their own, so that on a CPU it goes on to the same bits."""

_SPREAD = number(float, lambda value: -5.0 <= value <= 2.0, "a number from -5 to 2")


def add_rl_parsers(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add `train ppo` and `train sac`."""
    for name in ("ppo", "sac"):
        parser = commands.add_parser(
            name, help=f"a policy by reinforcement ({name.upper()})", epilog=_EPILOG,
            description=f"Train a policy with {name.upper()}.",
        )  # fmt: skip
        parser.add_argument("--objects", nargs="+", required=True, metavar="OBJECT", help="to learn on")
        parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the policy")
        parser.add_argument(
            "--from", type=Path, dest="clone", metavar="DIR", help="a policy of `train bc` to begin with"
        )
        parser.add_argument(
            "--share", type=share, default=0.2, metavar="S", help="of actions, with --from (default 0.2)"
        )
        parser.add_argument(
            "--steps",
            type=positive_int,
            default=1_000_000,
            metavar="N",
            help="control steps (default 1000000)",
        )
        parser.add_argument(
            "--num-envs", type=positive_int, default=16, metavar="N", help="side by side (default 16)"
        )
        parser.add_argument(
            "--rate", type=positive_float, default=3e-4, metavar="R", help="of Adam (default 0.0003)"
        )
        if name == "ppo":
            parser.add_argument(
                "--spread", type=_SPREAD, default=-1.0, metavar="L",
                help="logarithm of the standard deviation of exploration at first (default -1)",
            )  # fmt: skip
        add_seeds(parser)
        add_torch(parser)
        add_trials(parser, every=20, unit="round")
        add_json(parser)


def run_rl(args: argparse.Namespace) -> int:
    """Train a policy for each seed, print returns and successes."""
    from dexgrasp.reinforcement.policy_training import PolicyTraining
    from dexgrasp.reinforcement.settings import RlSettings
    from dexgrasp_env.objects.load import resolve_targets

    more = {"spread": args.spread} if args.train_command == "ppo" else {}
    settings = RlSettings(
        algorithm=args.train_command, objects=tuple(resolve_targets(args.objects)), steps=args.steps,
        num_envs=args.num_envs, share=args.share, rate=args.rate, threads=args.threads, **more,
    )  # fmt: skip
    return train_each_seed(args, "round", settings, partial(PolicyTraining, clone=args.clone))
