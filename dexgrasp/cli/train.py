"""`dexgrasp train`: the learned half of the paper, policies cloned from demonstrations or reinforced."""

import argparse
import dataclasses
from pathlib import Path
from typing import Any

from dexgrasp.cli.options import add_json, add_seed, positive_float, positive_int
from dexgrasp.cli.train_bc import add_bc_parser, run_bc
from dexgrasp.cli.train_grip import add_grip_parser, run_grip
from dexgrasp.cli.train_rl import add_rl_parsers, run_rl
from dexgrasp.cli.training import add_length, add_torch
from dexgrasp_env.extras import require_extra

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
    from dexgrasp.cli.output import resumable
    from dexgrasp.cvae.curves import draw_curves, write_curve
    from dexgrasp.cvae.training import CvaeProgress, TrainingSettings, train
    from dexgrasp.planning.decoder import NetworkSettings
    from dexgrasp.runs.progress import progress_bar

    settings = TrainingSettings(
        seed=args.seed, threads=args.threads, held_out_object=args.held_out_object, kl_weight=args.kl_weight,
        network=NetworkSettings(latent=args.latent),
    )  # fmt: skip
    if args.epochs:
        settings = dataclasses.replace(settings, epochs=args.epochs)
    kept = resumable(f"the last checkpoint is kept in {args.out}")
    with kept, progress_bar("epoch", "cvae") as bar:

        def show(state: CvaeProgress) -> None:
            last = state.curve[-1]
            train_loss, test_cm = last["train"]["total"], last["test"]["fingertip_cm"]
            bar(state.epoch, state.epochs, train=f"{train_loss:.3f}", test_cm=f"{test_cm:.2f}")
            if state.epoch % 10 == 0 or state.epoch == state.epochs:
                draw_curves(state.curve, state.best_epoch, args.out / "curves.png")

        state = train(args.data, args.out, settings, minutes=args.minutes, device=args.device, progress=show)
    draw_curves(state.curve, state.best_epoch, args.out / "curves.png")
    write_curve(state.curve, args.out / "curve.jsonl")
    return _print(args, state)


def _print(args: argparse.Namespace, state: Any) -> int:
    from dexgrasp.cli.output import print_json

    best = state.curve[state.best_epoch - 1]
    figures = {
        "schema": 1, "epochs": state.epochs, "best_epoch": state.best_epoch, "seconds": state.seconds, "losses": best,
        "weights": str(args.out / "cvae.safetensors"), "curves": str(args.out / "curves.png"),
    }  # fmt: skip
    if args.json:
        print_json(figures)
        return 0
    for split, values in best.items():
        if isinstance(values, dict) and values:
            print(
                f"{split}: loss {values['total']:.4f}, fingertips {values['fingertip_cm']:.2f} cm, "
                f"KL {values['kl']:.2f}"
            )
    print(
        f"epoch {state.best_epoch} of {state.epochs}, {state.seconds:.0f} s; weights in {figures['weights']}"
    )
    return 0
