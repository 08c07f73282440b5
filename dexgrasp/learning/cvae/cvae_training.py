"""Training of the CVAE."""

from dataclasses import asdict
from pathlib import Path

import numpy as np

from dexgrasp.data.dataset.dataset import read_dataset, read_manifest
from dexgrasp.learning.cvae.cvae_network import Cvae, Losses, losses
from dexgrasp.learning.cvae.grasp_batches import Batch, split, test_batches, training_batch
from dexgrasp.learning.cvae.settings import TrainingSettings
from dexgrasp.learning.training.checkpoint import write_tensors
from dexgrasp.learning.training.step_training import StepTraining
from dexgrasp.learning.training.training import CHECKPOINT, RunOptions
from dexgrasp.planning.decoder import SCHEMA
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.extras import from_extra

with from_extra():
    import torch

WEIGHTS = "cvae.safetensors"


class CvaeTraining(StepTraining):
    """Training on a dataset; the weights of the least test loss are kept in `WEIGHTS`."""

    about, steps, clip = "run.json", 50, 5.0

    def __init__(
        self, data: Path, out: Path, settings: TrainingSettings, course: RunOptions = RunOptions()
    ) -> None:
        """Read the dataset.

        Args:
            data: its folder.
            out: folder of the training.
            settings: of the training.
            course: where it runs.

        Raises:
            InputError: no usable dataset, no such device.
        """
        super().__init__(out, settings, settings.epochs, course)
        manifest = read_manifest(data)
        self._dataset, self._hand = str(manifest["key"]), manifest.get("hand")
        parts = split(read_dataset(data), settings)
        self._poses = parts.pop("train")
        self._tests = {name: test_batches(poses, settings) for name, poses in parts.items()}

    def identity(self) -> Fields:
        """Return the dataset's key."""
        return {"dataset": self._dataset}

    def network(self) -> Cvae:
        """Make the network."""
        return Cvae(self.settings.network)

    def fall(self, done: float) -> float:
        """Return 1 for the first half, then a straight line."""
        return min(1.0, 2.0 * (1.0 - done))

    def losses(self, step: int, done: float) -> Losses:
        """Return the losses of a step."""
        batch = training_batch(self._poses, step, self.settings)
        return self._losses(batch, self.settings.kl_weight * min(1.0, done / self.settings.warm_up))

    def _losses(self, batch: Batch, kl_weight: float) -> Losses:
        cloud, grasp, noise = (torch.from_numpy(array).to(self.place) for array in batch)
        return losses(self.net(cloud, grasp, noise), grasp, kl_weight)

    def learn(self) -> Fields:
        """Do an epoch; return the losses of every split."""
        trained = dict(zip(Losses._fields, self.epoch_losses(), strict=True))
        return {"train": trained, **{name: self._test(batches) for name, batches in self._tests.items()}}

    @torch.no_grad()
    def _test(self, batches: list[Batch]) -> dict[str, float]:
        """Return the losses, means over rest poses, of grasps decoded from the posterior's mean."""
        self.net.eval()
        rows = [[float(v) for v in self._losses(batch, self.settings.kl_weight)] for batch in batches]
        return dict(zip(Losses._fields, np.mean(rows, axis=0).tolist(), strict=True)) if rows else {}

    @property
    def best(self) -> int:
        """The epoch of the least test loss, the first fifth of all epochs apart; 0 before."""
        late = [row for row in self.state.curve if 5 * row["epoch"] >= self.state.epochs]
        return int(min(late, key=lambda row: row["test"]["total"])["epoch"]) if late else 0

    def write(self) -> None:
        """Write the weights, where they are the best so far."""
        if self.best == self.state.epoch:
            row = dict(self.state.curve[-1])
            about = {
                "schema": SCHEMA, "network": asdict(self.settings.network), "epoch": row.pop("epoch"),
                "dataset": self._dataset, "hand": self._hand, "seed": self.settings.seed, "losses": row,
            }  # fmt: skip
            write_tensors(self.out / WEIGHTS, self.net.state_dict(), about)

    def begin(self) -> Fields | None:
        """As every training.

        Raises:
            InputError: damaged, or its best weights are gone, which no further epoch can bring back.
        """
        note = super().begin()
        if self.best and not (self.out / WEIGHTS).is_file():
            raise InputError(
                f"the weights of epoch {self.best} are gone from {self.out} ({WEIGHTS}): remove {CHECKPOINT} to train "
                "from the start, or choose another --out"
            )
        return note
