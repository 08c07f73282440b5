"""`dexgrasp train`: the learned half of the paper, policies cloned from demonstrations or reinforced."""

import argparse
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dexgrasp.cli.options import add_json, add_seed, positive_float, positive_int
from dexgrasp.cli.train_bc import add_bc_parser, run_bc
from dexgrasp.cli.train_grip import add_grip_parser, run_grip
from dexgrasp.cli.train_rl import add_rl_parsers, run_rl
from dexgrasp.cli.training import add_length, add_torch
from dexgrasp_env.extras import require_extra

if TYPE_CHECKING:
    from dexgrasp.runs.training import Progress

_EPILOG = """examples:
  dexgrasp train cvae --data runs/ycb6 --out runs/cvae --minutes 25
  dexgrasp train cvae --data runs/ycb6 --out runs/cvae --epochs 300 --held-out-object potted_meat_can --device cuda
  dexgrasp train bc --data runs/demos --out runs/bc --minutes 10
  dexgrasp train bc --data runs/demos --view cloud --out runs/bc_cloud --seed 0 1 2
  dexgrasp train grip --objects varied-0..59 --from runs/bc --out runs/grip
  dexgrasp train ppo --objects varied-0..29 --from runs/bc --out runs/ppo
  dexgrasp evaluate --agents runs/bc runs/ppo hardcoded --objects seen

A run that was interrupted goes on when the same command is given again, on a CPU to the same bits. The folder of --out
holds cvae.safetensors (the weights of the least test loss), checkpoint.safetensors, run.json, curve.jsonl, curves.png
and tensorboard/. Weights are read by `dexgrasp.planning.cvae_source.CvaeProposals`. The folder of a policy is an agent
by its path; with several seeds it has a folder seed-S for each."""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "train", help="train networks; resumable", epilog=_EPILOG, description="Train networks."
    )
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", dest="train_command", required=True)
    cvae = commands.add_parser(
        "cvae", help="the autoencoder that proposes fingertips", epilog=_EPILOG,
        description="Train the autoencoder that proposes fingertips.",
    )  # fmt: skip
    cvae.add_argument(
        "--data", type=Path, required=True, metavar="DIR", help="of `dexgrasp dataset generate`"
    )
    cvae.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the training")
    add_length(cvae, steps=50, epochs=150)
    add_seed(cvae)
    add_torch(cvae, device="auto")
    cvae.add_argument(
        "--latent", type=positive_int, default=6, metavar="N", help="size of the latent (default 6)"
    )
    cvae.add_argument(
        "--kl-weight", type=positive_float, default=0.05, metavar="W", help="of the KL term (default 0.05)"
    )
    cvae.add_argument(
        "--held-out-object", metavar="NAME", help="an object that is tested on and not trained on"
    )
    add_json(cvae)
    add_bc_parser(commands)
    add_grip_parser(commands)
    add_rl_parsers(commands)


def run(args: argparse.Namespace) -> int:
    """Train, draw curves, print the losses."""
    require_extra("learning", "training")
    run_policy = {"bc": run_bc, "grip": run_grip, "ppo": run_rl, "sac": run_rl}
    return {"cvae": _cvae, **run_policy}[args.train_command](args)


def _cvae(args: argparse.Namespace) -> int:
    from dexgrasp.cli.training import run_training
    from dexgrasp.cvae.cvae_training import WEIGHTS, CvaeTraining
    from dexgrasp.cvae.settings import TrainingSettings
    from dexgrasp.planning.decoder import NetworkSettings
    from dexgrasp.runs.training import Course

    settings = TrainingSettings(
        seed=args.seed, threads=args.threads, held_out_object=args.held_out_object, kl_weight=args.kl_weight,
        network=NetworkSettings(latent=args.latent), epochs=args.epochs or TrainingSettings.epochs,
    )  # fmt: skip
    make = partial(CvaeTraining, args.data, args.out, settings, Course(args.device, args.minutes))
    training = run_training(make, args.out, "epoch", "cvae", _losses)
    state = training.state
    return _print(args, {
        "schema": 1, "epochs": state.epochs, "best_epoch": training.best, "seconds": state.seconds,
        "losses": state.curve[training.best - 1], "weights": str(args.out / WEIGHTS),
        "curves": str(args.out / "curves.png"),
    })  # fmt: skip


def _losses(state: "Progress") -> dict[str, str]:
    last = state.curve[-1]
    return {"train": f"{last['train']['total']:.3f}", "test_cm": f"{last['test']['fingertip_cm']:.2f}"}


def _print(args: argparse.Namespace, figures: dict[str, Any]) -> int:
    from dexgrasp.cli.output import print_json

    if args.json:
        print_json(figures)
        return 0
    for split, values in figures["losses"].items():
        if isinstance(values, dict) and values:
            print(
                f"{split}: loss {values['total']:.4f}, fingertips {values['fingertip_cm']:.2f} cm, "
                f"KL {values['kl']:.2f}"
            )
    epoch = f"epoch {figures['best_epoch']} of {figures['epochs']}, {figures['seconds']:.0f} s"
    print(f"{epoch}; weights in {figures['weights']}")
    return 0
