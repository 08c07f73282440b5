"""Training of the CVAE: resumable to the bit on a CPU, as every batch depends on seed and step alone."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp.cvae.batches import Batch, PoseSplit, split, test_batches, training_batch
from dexgrasp.cvae.network import Cvae, Losses, losses
from dexgrasp.cvae.weights import read_state, write_state, write_weights
from dexgrasp.dataset.dataset import read_dataset
from dexgrasp.dataset.shards import read_manifest
from dexgrasp.planning.decoder import NetworkSettings
from dexgrasp.runs.device import torch_device
from dexgrasp.runs.epochs import Progress, fitting_epochs, run_epochs
from dexgrasp.runs.folder import RunFolder
from dexgrasp_env.errors import InputError
from dexgrasp_env.extras import from_extra

with from_extra():
    import torch

STEPS_PER_EPOCH = 50
_NAMES = Losses._fields
WEIGHTS = "cvae.safetensors"


@dataclass(frozen=True)
class TrainingSettings:
    """How the CVAE is trained.

    Attributes:
        epochs: of 50 steps each.
        seed: of weights, batches and splits.
        clouds: a step.
        grasps: on each cloud.
        rate: of Adam at first; constant for the first half, then down to 2 % in a straight line.
        kl_weight: reached after `warm_up` of the steps.
        warm_up: share of the steps.
        held_out_object: kept apart, None for none.
        held_out_poses: whether a rest pose of every other object is kept apart.
        threads: of torch on the CPU; results differ in the last bits with it.
        network: sizes.
    """

    epochs: int = 150
    seed: int = 0
    clouds: int = 8
    grasps: int = 128
    rate: float = 1e-3
    kl_weight: float = 0.05
    warm_up: float = 0.2
    held_out_object: str | None = None
    held_out_poses: bool = True
    threads: int = 1
    network: NetworkSettings = field(default_factory=NetworkSettings)


@dataclass
class CvaeProgress(Progress):
    """Where a training stands; `curve` has a row an epoch."""

    best: float = float("inf")
    best_epoch: int = 0


def train(
    data: Path, out: Path, settings: TrainingSettings, *, minutes: float | None = None, device: str = "auto",
    progress: Callable[[CvaeProgress], None] | None = None, stop_after: int | None = None,
) -> CvaeProgress:  # fmt: skip
    """Train, or go on with what `out` holds.

    Args:
        data: folder of a dataset.
        out: folder of checkpoints, weights, curves.
        settings: of the training; `out` of other settings is refused.
        minutes: choose `epochs` so that it takes about so long, from the first steps' speed.
        device: cpu, cuda or auto.
        progress: called after every epoch.
        stop_after: epochs of this call, for tests of resuming.

    Raises:
        InputError: no usable dataset, other settings or another process in `out`, no such device.
    """
    place = torch_device(device)
    torch.set_num_threads(settings.threads)
    parts = split(read_dataset(data), settings.held_out_object, settings.held_out_poses, seed=settings.seed)
    key = str(read_manifest(data)["key"])
    run = {"schema": 1, "dataset": key, "minutes": minutes, "settings": asdict(settings)}
    with RunFolder(out, "run.json", "training").claim(run):
        return _train(parts, out, settings, key, minutes, place, progress, stop_after)


def _train(
    parts: dict[str, list[PoseSplit]], out: Path, settings: TrainingSettings, key: str, minutes: float | None,
    place: torch.device, progress: Callable[[CvaeProgress], None] | None, stop_after: int | None,
) -> CvaeProgress:  # fmt: skip
    torch.manual_seed(settings.seed)
    model = Cvae(settings.network).to(place)
    optimiser = torch.optim.Adam(model.parameters(), lr=settings.rate)
    state = _resume(out, model, optimiser) or CvaeProgress(epochs=settings.epochs)
    tests = {
        name: test_batches(p, settings.seed, settings.network.points, settings.network.latent)
        for name, p in parts.items()
    }
    if minutes is not None and state.epoch == 0:
        state.epochs = _fitting(parts["train"], settings, minutes, place)

    def learn() -> dict[str, Any]:
        trained = _epoch(model, optimiser, parts["train"], state, settings, place)
        return {"train": trained} | {
            name: evaluate(model, batches, settings.kl_weight, place)
            for name, batches in tests.items()
            if name != "train"
        }

    keep = partial(_keep, out, model, optimiser, state, settings, key)
    run_epochs(state, out, learn, keep, progress, stop_after)
    return state


def _epoch(
    model: Cvae, optimiser: torch.optim.Optimizer, poses: list[PoseSplit], state: CvaeProgress,
    settings: TrainingSettings, place: torch.device,
) -> dict[str, float]:  # fmt: skip
    model.train()
    sums = np.zeros(len(_NAMES))
    for step in range(state.epoch * STEPS_PER_EPOCH, (state.epoch + 1) * STEPS_PER_EPOCH):
        done = step / (state.epochs * STEPS_PER_EPOCH)
        for group in optimiser.param_groups:
            group["lr"] = settings.rate * max(0.02, min(1.0, 2.0 * (1.0 - done)))
        sums += _step(
            model,
            optimiser,
            poses,
            step,
            settings,
            settings.kl_weight * min(1.0, done / settings.warm_up),
            place,
        )
    return dict(zip(_NAMES, (sums / STEPS_PER_EPOCH).tolist(), strict=True))


def _step(
    model: Cvae, optimiser: torch.optim.Optimizer, poses: list[PoseSplit], step: int, settings: TrainingSettings,
    kl_weight: float, place: torch.device,
) -> np.ndarray:  # fmt: skip
    net = settings.network
    batch = training_batch(
        poses, step, settings.seed, settings.clouds, settings.grasps, net.points, net.latent
    )
    cloud, grasp, noise = _tensors(batch, place)
    found = losses(model(cloud, grasp, noise), grasp, kl_weight)
    optimiser.zero_grad(set_to_none=True)
    found.total.backward()
    torch.nn.utils.clip_grad_norm_(model.parameters(), 5.0)
    optimiser.step()
    return np.array([float(v.detach()) for v in found])


@torch.no_grad()
def evaluate(model: Cvae, batches: list[Batch], kl_weight: float, place: torch.device) -> dict[str, float]:
    """Return the losses, means over rest poses, of grasps decoded from the posterior's mean."""
    model.eval()
    rows = []
    for batch in batches:
        cloud, grasp, noise = _tensors(batch, place)
        rows.append([float(v) for v in losses(model(cloud, grasp, noise), grasp, kl_weight)])
    return dict(zip(_NAMES, np.mean(rows, axis=0).tolist(), strict=True)) if rows else {}


def _tensors(batch: Batch, place: torch.device) -> list[torch.Tensor]:
    return [torch.from_numpy(array).to(place) for array in batch]


def _fitting(poses: list[PoseSplit], settings: TrainingSettings, minutes: float, place: torch.device) -> int:
    """Return the epochs that fit into some minutes, measured on a network thrown away."""
    model = Cvae(settings.network).to(place)
    optimiser = torch.optim.Adam(model.parameters(), lr=settings.rate)
    return fitting_epochs(
        minutes, STEPS_PER_EPOCH, lambda step: _step(model, optimiser, poses, step, settings, 0.0, place)
    )


def _resume(out: Path, model: Cvae, optimiser: torch.optim.Adam) -> CvaeProgress | None:
    """Fill model and optimiser from the checkpoint in `out`; None where there is none.

    Raises:
        InputError: damaged, or its best weights are gone, which no further epoch can bring back.
    """
    path = out / "checkpoint.safetensors"
    loaded = read_state(path, model, optimiser)
    if loaded is None:
        return None
    state = _progress(loaded)
    if state is None:
        raise InputError(f"{path} is damaged: remove it to train from the start, or choose another --out")
    if state.best_epoch and not (out / WEIGHTS).is_file():
        raise InputError(
            f"the weights of epoch {state.best_epoch} are gone from {out} ({WEIGHTS}): remove {path.name} to train "
            "from the start, or choose another --out"
        )
    return state


def _progress(loaded: object) -> CvaeProgress | None:
    """Return a checkpoint's progress, None where it cannot be one."""
    try:
        state = CvaeProgress(**loaded)  # type: ignore[arg-type]
        whole = all(isinstance(row, dict) and isinstance(row["test"]["total"], float) for row in state.curve)
        fits = len(state.curve) == state.epoch <= state.epochs and 0 <= state.best_epoch <= state.epoch
        return state if whole and fits and float(state.best) == state.best and state.seconds >= 0 else None
    except (TypeError, KeyError, ValueError):
        return None


def _keep(
    out: Path,
    model: Cvae,
    optimiser: torch.optim.Adam,
    state: CvaeProgress,
    settings: TrainingSettings,
    key: str,
) -> None:
    """Write the best weights before the checkpoint: a kill in between repeats an epoch and writes the same again."""
    tested = state.curve[-1]["test"]["total"]
    if (tested < state.best and state.epoch * 5 >= state.epochs) or (
        state.epoch == state.epochs and not state.best_epoch
    ):
        state.best, state.best_epoch = tested, state.epoch
        row = {k: v for k, v in state.curve[-1].items() if k != "epoch"}
        about = {"epoch": state.epoch, "dataset": key, "seed": settings.seed, "losses": row}
        write_weights(out / WEIGHTS, model, about)
    write_state(out / "checkpoint.safetensors", model, optimiser, asdict(state))
