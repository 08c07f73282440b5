"""`dexgrasp train bc`: policies cloned from demonstrations."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from agents import interrupt
from agents.cli.options import add_json, natural_int, positive_float, positive_int

if TYPE_CHECKING:
    from agents.imitation.settings import BcSettings
    from agents.imitation.trials import Trials

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
    parser = commands.add_parser("bc", help="a policy cloned from demonstrations", epilog=_EPILOG)
    parser.add_argument(
        "--data", type=Path, nargs="+", required=True, metavar="DIR", help="of `dexgrasp demos generate`"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the policy")
    parser.add_argument(
        "--view",
        choices=("state", "cloud"),
        help="what the policy sees (default: what the demonstrations do)",
    )
    length = parser.add_mutually_exclusive_group()
    length.add_argument("--epochs", type=positive_int, metavar="N", help="of 200 steps each (default 20)")
    length.add_argument(
        "--minutes", type=positive_float, metavar="M", help="as many epochs as fit, by measured speed"
    )
    parser.add_argument(
        "--seed", type=natural_int, nargs="+", default=[0], metavar="S", help="one or several (default 0)"
    )
    parser.add_argument("--device", choices=("auto", "cpu", "cuda"), default="cpu", help="(default cpu)")
    parser.add_argument(
        "--threads", type=positive_int, default=1, metavar="N", help="of torch on the CPU (default 1)"
    )
    parser.add_argument("--hidden", type=positive_int, default=512, metavar="N", help="width (default 512)")
    parser.add_argument(
        "--chunk", type=positive_int, default=8, metavar="N", help="set-points predicted (default 8)"
    )
    parser.add_argument(
        "--execute", type=positive_int, default=4, metavar="N", help="of them carried out (default 4)"
    )
    trials = parser.add_argument_group("trials while it learns (seeds of their own: 0 to 99 are for tuning)")
    trials.add_argument("--try-on", nargs="+", metavar="OBJECT", help="objects or sets (default: no trials)")
    trials.add_argument("--trials", type=positive_int, default=1, metavar="N", help="on each (default 1)")
    trials.add_argument("--every", type=positive_int, default=5, metavar="N", help="epochs (default 5)")
    add_json(parser)


def run_bc(args: argparse.Namespace) -> int:
    """Train a policy for each seed, print losses and successes."""
    from agents.cli.output import note, print_json
    from agents.imitation.settings import BcSettings, CloneNetwork
    from dexgrasp_env.errors import InputError

    if args.execute > args.chunk:
        raise InputError(f"--execute {args.execute}: valid are 1 to {args.chunk}, the --chunk")
    settings = BcSettings(
        view=args.view or _view(args.data[0]), epochs=args.epochs or BcSettings.epochs, execute=args.execute,
        threads=args.threads, network=CloneNetwork(hidden=args.hidden, chunk=args.chunk),
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


def _view(folder: Path) -> str:
    from agents.demos.generate import read_about
    from agents.imitation.features import view_of

    return view_of(str(read_about(folder)["settings"].get("obs_mode")))


def _trials(args: argparse.Namespace) -> "Trials | None":
    from agents.imitation.trials import Trials
    from dexgrasp_env.objects.load import resolve_targets

    if not args.try_on:
        return None
    return Trials(tuple(resolve_targets(args.try_on)), args.trials, every=args.every)


def _train(
    args: argparse.Namespace, settings: "BcSettings", seed: int, out: Path, trials: "Trials | None"
) -> dict[str, Any]:
    import dataclasses

    from tqdm import tqdm

    from agents.imitation.curves import draw
    from agents.imitation.training import BcProgress, train_bc

    with tqdm(unit="epoch", desc=f"bc, seed {seed}") as bar:

        def show(state: BcProgress) -> None:
            bar.total = state.epochs
            bar.update(state.epoch - bar.n)
            last = {key: value for key, value in state.curve[-1].items() if value is not None}
            bar.set_postfix({key: f"{value:.4g}" for key, value in last.items() if key != "epoch"})

        state = train_bc(
            args.data, out, dataclasses.replace(settings, seed=seed), minutes=args.minutes, device=args.device,
            trials=trials, progress=show,
        )  # fmt: skip
    draw(state.curve, out / "curves.png")
    return {"policy": str(out), **state.curve[-1], "seconds": state.seconds}


def _shown(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
