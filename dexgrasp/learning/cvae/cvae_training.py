"""Training of the CVAE on a dataset of grasps."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from dexgrasp.data.dataset.dataset import read_dataset, read_manifest
from dexgrasp.data.dataset.settings import MU
from dexgrasp.learning.cvae.cvae_network import Cvae, Losses, losses
from dexgrasp.learning.cvae.grasp_batches import Batch, split, test_batches, training_batch
from dexgrasp.learning.cvae.settings import TrainingSettings
from dexgrasp.learning.training.checkpoint import write_tensors
from dexgrasp.learning.training.gradient_training import GradientTraining
from dexgrasp.learning.training.loop import CHECKPOINT, RunOptions
from dexgrasp.planning.decoder import PALM, SCALE, SCHEMA
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.extras import from_extra

with from_extra():
    import torch

WEIGHTS = "cvae.safetensors"


class CvaeTraining(GradientTraining):
    """Training of the CVAE on a dataset; the weights of the least test loss are kept in `WEIGHTS`."""

    about, steps, clip = "run.json", 50, 5.0

    def __init__(
        self, data: Path, settings: TrainingSettings, out: Path, options: RunOptions = RunOptions()
    ) -> None:
        """Read the dataset.

        Args:
            data: its folder.
            settings: of the training.
            out: folder of the training.
            options: where it runs.

        Raises:
            InputError: no usable dataset, or no such device.
        """
        super().__init__(settings, out, options)
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
        return Cvae(self.settings.network, self._poses[0].tips.shape[1])

    def rate_factor(self, done: float) -> float:
        """Return 1 for the first half, then a linear decay."""
        return min(1.0, 2.0 * (1.0 - done))

    def losses(self, step: int, done: float) -> Losses:
        """Return the losses of a step."""
        batch = training_batch(self._poses, step, self.settings)
        return self._losses(batch, self.settings.kl_weight * min(1.0, done / self.settings.kl_warm_up))

    def _losses(self, batch: Batch, kl_weight: float) -> Losses:
        cloud, grasp, noise = self.tensors(batch)
        output = self.net(cloud, grasp, noise)
        found = losses(output, grasp, kl_weight)
        if not self.settings.wrench_layer:
            return found
        some = output.grasp[:, :16]  # of each cloud: their forces are solved for
        return found._replace(total=found.total + self.settings.wrench_weight * wrench_residual(some, cloud))

    def figures(self, losses: Sequence[float]) -> Fields:
        """Return the losses of every split: training means, test losses of the present weights."""
        trained = dict(zip(Losses._fields, losses, strict=True))
        return {"train": trained, **{name: self._test(batches) for name, batches in self._tests.items()}}

    @torch.no_grad()
    def _test(self, batches: list[Batch]) -> dict[str, float]:
        """Return the losses, means over rest poses, of grasps decoded from the posterior's mean."""
        self.net.eval()
        rows = [[float(v) for v in self._losses(batch, self.settings.kl_weight)] for batch in batches]
        return dict(zip(Losses._fields, np.mean(rows, axis=0).tolist(), strict=True)) if rows else {}

    @property
    def best(self) -> int:
        """Epoch of the least test loss after the first fifth of all epochs; 0 before."""
        late = [row for row in self.state.curve if 5 * row["epoch"] >= self.state.epochs]
        return int(min(late, key=lambda row: row["test"]["total"])["epoch"]) if late else 0

    def write(self) -> None:
        """Write the weights if they are the best so far."""
        if self.best == self.state.epoch:
            row = dict(self.state.curve[-1])
            about = {
                "schema": SCHEMA, "network": asdict(self.settings.network), "epoch": row.pop("epoch"),
                "dataset": self._dataset, "hand": self._hand, "seed": self.settings.seed, "losses": row,
            }  # fmt: skip
            write_tensors(self.out / WEIGHTS, self.net.state_dict(), about)

    def restore(self, note: Fields) -> None:
        """Refuse to resume where the file of the best weights is missing.

        Raises:
            InputError: in that case.
        """
        if self.best and not (self.out / WEIGHTS).is_file():
            raise InputError(
                f"the weights of epoch {self.best} are gone from {self.out} ({WEIGHTS}): remove {CHECKPOINT} to "
                "train from the start, or choose another --out"
            )


def wrench_residual(grasp: torch.Tensor, cloud: torch.Tensor) -> torch.Tensor:
    """Return the mean residual of Eq. 4 at decoded fingertips, with the normals of the nearest points.

    Args:
        grasp: (C, G, 3 n + 9), network units.
        cloud: (C, N, 6) points (network units) and unit normals.
    """
    tips = grasp[..., :-PALM].unflatten(-1, (-1, 3))
    nearest = torch.cdist(tips.detach().flatten(1, 2), cloud[..., :3]).argmin(-1)
    normals = torch.take_along_dim(cloud[..., 3:], nearest[..., None], 1).reshape(-1, *tips.shape[-2:])
    points = (tips / SCALE).flatten(0, 1).cpu()
    from dexgrasp.learning.cvae.wrench_layer import wrench_layer  # needs the extra planner

    _, residual = wrench_layer(points, torch.nn.functional.normalize(normals.cpu(), dim=-1), MU)
    return residual.mean().to(grasp)
