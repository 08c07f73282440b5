"""Train networks: the learned half of the paper, policies cloned from demonstrations or reinforced.

examples:
  dexgrasp train cvae --data runs/ycb6 --out runs/cvae --minutes 25
  dexgrasp train bc --data runs/demos --out runs/bc --minutes 10
  dexgrasp train grip --objects varied-0..59 --from runs/bc --out runs/grip
  dexgrasp train ppo --objects varied-0..29 --from runs/bc --out runs/ppo
  dexgrasp evaluate --agents runs/bc runs/ppo hardcoded --objects seen

A run that was interrupted goes on when the same command is given again, on a CPU to the same bits. The folder of a
policy is an agent by its path (JSON and safetensors); with several seeds it has a folder seed-S for each.
"""

from functools import partial
from typing import TYPE_CHECKING, Annotated

from dexgrasp.cli.command import Answer, Folder
from dexgrasp.cli.train_policy import Bc, Grip, Ppo, Sac
from dexgrasp.cli.training import Device, TrainingCommand, run_training
from dexgrasp.cvae.settings import TrainingSettings
from dexgrasp_env.extras import require_extra
from dexgrasp_env.valid import Positive

if TYPE_CHECKING:
    from dexgrasp.runs.training import Progress

_OPTIONS = ("epochs", "seed", "threads", "latent", "kl_weight", "held_out_object")


class Cvae(TrainingCommand):
    """Train the autoencoder that proposes fingertips.

    examples:
      dexgrasp train cvae --data runs/ycb6 --out runs/cvae --minutes 25
      dexgrasp train cvae --data runs/ycb6 --out runs/cvae --epochs 300 --held-out-object potted_meat_can --device cuda

    A run that was interrupted goes on when the same command is given again, on a CPU to the same bits. The folder of
    --out holds cvae.safetensors (the weights of the least test loss), checkpoint.safetensors, run.json, curve.jsonl,
    curves.png and tensorboard/. Weights are read by `dexgrasp.planning.cvae_source.CvaeProposals`.

    Attributes:
        data: of `dexgrasp dataset generate`.
        minutes: as many epochs as fit, by measured speed.
        device: where it is computed.
    """

    data: Folder
    settings: Annotated[TrainingSettings, _OPTIONS] = TrainingSettings()
    minutes: Annotated[Positive | None, "M", {"instead_of": "settings.epochs"}] = None
    device: Device = "auto"

    def run(self) -> Answer:
        """Train, return the losses."""
        require_extra("learning", "training")
        from dexgrasp.cvae.cvae_training import WEIGHTS, CvaeTraining
        from dexgrasp.runs.training import Course

        make = partial(CvaeTraining, self.data, self.out, self.settings, Course(self.device, self.minutes))
        training = run_training(make, self.out, "epoch", "cvae", _losses)
        state, losses = training.state, training.state.curve[training.best - 1]
        figures = {
            "epochs": state.epochs, "best_epoch": training.best, "seconds": state.seconds, "losses": losses,
            "weights": self.out / WEIGHTS, "curves": self.out / "curves.png",
        }  # fmt: skip
        lines = [
            f"{split}: loss {values['total']:.4f}, fingertips {values['fingertip_cm']:.2f} cm, KL {values['kl']:.2f}"
            for split, values in losses.items()
            if isinstance(values, dict) and values
        ]
        epoch = f"epoch {training.best} of {state.epochs}, {state.seconds:.0f} s"
        return Answer(figures, "\n".join([*lines, f"{epoch}; weights in {figures['weights']}"]))


def _losses(state: "Progress") -> dict[str, float]:
    last = state.curve[-1]
    return {"train": last["train"]["total"], "test_cm": last["test"]["fingertip_cm"]}


COMMAND = {"cvae": Cvae, "bc": Bc, "grip": Grip, "ppo": Ppo, "sac": Sac}
