"""`dexgrasp train ppo | sac`: policies by reinforcement, from nothing or from a clone."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from agents import interrupt
from agents.cli.options import add_json, natural_int, positive_float, positive_int, share

if TYPE_CHECKING:
    from agents.imitation.trials import Trials
    from agents.reinforcement.settings import RlSettings

_EPILOG = """examples:
  dexgrasp train ppo --objects sugar_box --steps 2000000 --out runs/ppo
  dexgrasp train ppo --objects varied-0..29 --from runs/bc --steps 500000 --out runs/ppo_bc --try-on seen
  dexgrasp train sac --objects seen --from runs/bc --share 0.1 --out runs/sac_bc --seed 0 1 2
  dexgrasp evaluate --agents runs/ppo_bc runs/bc --objects all20 --protocol lift pushed slippery

Stable-Baselines3's algorithms on the native vector environment, dense reward. With --from, a cloned policy acts and a
share of the network's action is added to its own: what it can do already is the start. --out is an agent by its path
(JSON and safetensors). A run that was interrupted goes on when the same command is given again; rounds (one episode of
every environment) have seeds of their own, so that on a CPU it goes on to the same bits."""


def add_rl_parsers(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add `train ppo` and `train sac`."""
    for name in ("ppo", "sac"):
        parser = commands.add_parser(name, help=f"a policy by reinforcement ({name.upper()})", epilog=_EPILOG)
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
                "--spread", type=_number, default=-1.0, metavar="L",
                help="logarithm of the standard deviation of exploration at first (default -1)",
            )  # fmt: skip
        parser.add_argument(
            "--seed", type=natural_int, nargs="+", default=[0], metavar="S", help="one or several (default 0)"
        )
        parser.add_argument("--device", choices=("auto", "cpu", "cuda"), default="cpu", help="(default cpu)")
        parser.add_argument(
            "--threads", type=positive_int, default=1, metavar="N", help="of torch on the CPU (default 1)"
        )
        trials = parser.add_argument_group("trials while it learns")
        trials.add_argument("--try-on", nargs="+", metavar="OBJECT", help="objects or sets (default: none)")
        trials.add_argument("--trials", type=positive_int, default=1, metavar="N", help="on each (default 1)")
        trials.add_argument("--every", type=positive_int, default=20, metavar="N", help="rounds (default 20)")
        add_json(parser)


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not -5.0 <= value <= 2.0:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number from -5 to 2")
    return value


def run_rl(args: argparse.Namespace) -> int:
    """Train a policy for each seed, print returns and successes."""
    from agents.cli.output import note, print_json
    from agents.reinforcement.settings import RlSettings
    from dexgrasp_env.objects.load import resolve_targets

    more = {"spread": args.spread} if args.train_command == "ppo" else {}
    settings = RlSettings(
        algorithm=args.train_command, objects=tuple(resolve_targets(args.objects)), steps=args.steps,
        num_envs=args.num_envs, share=args.share, rate=args.rate, threads=args.threads, **more,
    )  # fmt: skip
    trials, results = _trials(args), []
    for seed in dict.fromkeys(args.seed):
        out = args.out if len(set(args.seed)) == 1 else args.out / f"seed-{seed}"
        try:
            results.append(_train(args, settings, seed, out, trials))
        except KeyboardInterrupt:
            interrupt.acknowledge()
            note(
                f"dexgrasp train: interrupted; the last checkpoint is kept in {out}: the same command goes on"
            )
            return 3
    if args.json:
        print_json({"schema": 1, "policies": results})
        return 0
    for figures in results:
        print("; ".join(f"{key.replace('_', ' ')} {_shown(value)}" for key, value in figures.items()))
    return 0


def _trials(args: argparse.Namespace) -> "Trials | None":
    from agents.imitation.trials import Trials
    from dexgrasp_env.objects.load import resolve_targets

    if not args.try_on:
        return None
    return Trials(tuple(resolve_targets(args.try_on)), args.trials, every=args.every)


def _train(
    args: argparse.Namespace, settings: "RlSettings", seed: int, out: Path, trials: "Trials | None"
) -> dict[str, Any]:
    import dataclasses

    from tqdm import tqdm

    from agents.imitation.curves import draw
    from agents.reinforcement.training import RlProgress, train_rl

    with tqdm(unit="round", desc=f"{settings.algorithm}, seed {seed}") as bar:

        def show(state: RlProgress) -> None:
            bar.total = state.rounds
            bar.update(state.round - bar.n)
            bar.set_postfix({key: _shown(value) for key, value in state.curve[-1].items() if key != "epoch"})

        state = train_rl(
            out, dataclasses.replace(settings, seed=seed), clone=args.clone, device=args.device, trials=trials,
            progress=show,
        )  # fmt: skip
    draw(state.curve, out / "curves.png")
    return {"policy": str(out), **state.curve[-1], "seconds": state.seconds}


def _shown(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
