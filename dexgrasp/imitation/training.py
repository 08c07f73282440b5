"""Cloning: resumable to the bit on a CPU, as every batch depends on seed and step alone."""

from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp.cvae.weights import read_state, write_state
from dexgrasp.imitation.clone import KIND
from dexgrasp.imitation.data import Batch, Rows, read_rows
from dexgrasp.imitation.network import CloneNet
from dexgrasp.imitation.settings import BcSettings
from dexgrasp.imitation.trials import Trials, due_success
from dexgrasp.runs.device import torch_device
from dexgrasp.runs.epochs import Progress, fitting_epochs, progress_of, run_epochs
from dexgrasp.runs.folder import RunFolder
from dexgrasp.runs.policy_folder import ABOUT, write_policy
from dexgrasp.runs.versions import package_versions
from dexgrasp_env.extras import from_extra

with from_extra():
    import torch

STEPS_PER_EPOCH = 200
RUN, CHECKPOINT = "training.json", "checkpoint.safetensors"
_TESTED = 16  # rows of each held-out episode
_BEND = (
    0.1  # of the loss: beyond it a row counts by its distance, so that of two ways to do it one is learned
)
_LAST_RATE = 0.02
_LEAST_UNIT = 0.005  # rad: joints that hardly move need not be predicted better
_PACKAGES = ("dexgrasp", "numpy", "torch")


def train_bc(
    data: Sequence[Path], out: Path, settings: BcSettings, *, minutes: float | None = None, device: str = "cpu",
    trials: Trials | None = None, progress: Callable[[Progress], None] | None = None, stop_after: int | None = None,
) -> Progress:  # fmt: skip
    """Clone a policy from demonstrations, or go on with what `out` holds; `out` is an agent by its path.

    Args:
        data: folders of demonstrations.
        out: folder of policy, checkpoint and curves.
        settings: of the training; `out` of other settings is refused.
        minutes: choose `epochs` so that it takes about so long, from the first steps' speed.
        device: cpu, cuda or auto.
        trials: what the policy is tried on as it learns; None for no trials.
        progress: called after every epoch.
        stop_after: epochs of this call, for tests of resuming.

    Raises:
        InputError: no usable demonstrations, other settings or another process in `out`, no such device.
    """
    place = torch_device(device)
    torch.set_num_threads(settings.threads)
    rows, modes = read_rows(data, settings.view)
    run = _identity(rows, settings, minutes, trials)
    with RunFolder(out, RUN, "training").claim(run):
        return _Training(rows, modes, out, settings, place).run(minutes, trials, progress, stop_after)


class _Training:
    """A training in its folder."""

    def __init__(
        self, rows: Rows, modes: dict[str, str], out: Path, settings: BcSettings, place: torch.device
    ) -> None:
        self.rows, self.out, self.settings, self.place = rows, out, settings, place
        self.env = _env(modes, settings.view)
        order = np.random.default_rng([settings.seed, 0]).permutation(len(rows.steps))
        tested = int(np.ceil(settings.held_out * len(order))) if len(order) > 1 else 0
        self.held_out, self.trained = np.sort(order[:tested]), np.sort(order[tested:])
        self.unit = self._unit()
        self.state = Progress(epochs=settings.epochs)
        self.net, self.optimiser = self._fresh()

    def _unit(self) -> torch.Tensor:
        """Spread (chunk * 23,) rad of what is predicted, at least `_LEAST_UNIT`."""
        n = self.settings.network.chunk
        rng = np.random.default_rng([self.settings.seed, 1])
        drawn = self.rows.draw(rng, self.trained, 256, 32, n).chunks
        unit = np.sqrt((drawn**2).mean(axis=(0, 1))).ravel()
        return torch.from_numpy(np.maximum(unit, _LEAST_UNIT).astype(np.float32)).to(self.place)

    def _fresh(self) -> tuple[CloneNet, torch.optim.Adam]:
        torch.manual_seed(self.settings.seed)
        looks = self.rows.looks
        mean, scale = looks.mean(axis=0), np.maximum(looks.std(axis=0), 1e-3)
        net = CloneNet(self.settings.network, mean, scale, self.settings.view == "cloud").to(self.place)
        return net, torch.optim.Adam(net.parameters(), lr=self.settings.rate)

    def run(
        self, minutes: float | None, trials: Trials | None, progress: Callable[[Progress], None] | None,
        stop_after: int | None,
    ) -> Progress:  # fmt: skip
        self._resume()
        state = self.state
        if minutes is not None and state.epoch == 0:
            state.epochs = fitting_epochs(minutes, STEPS_PER_EPOCH, self._step)
            self.net, self.optimiser = self._fresh()
        judge = partial(due_success, self.out, trials, state)
        run_epochs(state, self.out, self._learn, self._keep, progress, stop_after, judge)
        return state

    def _learn(self) -> dict[str, Any]:
        row = {"loss": self._epoch(), "test_loss": self._test()}
        self._write_policy({"epoch": self.state.epoch + 1} | row)
        return row

    def _epoch(self) -> float:
        self.net.train()
        first = self.state.epoch * STEPS_PER_EPOCH
        losses = [self._step(step) for step in range(first, first + STEPS_PER_EPOCH)]
        return float(np.mean(losses))

    def _step(self, step: int) -> float:
        s = self.settings
        share = step / (self.state.epochs * STEPS_PER_EPOCH)
        for group in self.optimiser.param_groups:
            group["lr"] = s.rate * max(_LAST_RATE, 0.5 * (1.0 + np.cos(np.pi * share)))
        rng = np.random.default_rng([s.seed, 2, step])
        loss = self._loss(self.rows.draw(rng, self.trained, s.episodes, s.rows, s.network.chunk))
        self.optimiser.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.net.parameters(), 1.0)
        self.optimiser.step()
        return float(loss.detach())

    def _loss(self, batch: Batch) -> torch.Tensor:
        looks, points, chunks = (torch.from_numpy(array).to(self.place) for array in batch)
        wanted = chunks.flatten(start_dim=2) / self.unit
        return torch.nn.functional.smooth_l1_loss(self.net(looks, points), wanted, beta=_BEND)

    @torch.no_grad()
    def _test(self) -> float | None:
        """Return the loss on demonstrations that were kept apart, None where there are none."""
        if not len(self.held_out):
            return None
        self.net.eval()
        steps = self.rows.steps[self.held_out]
        at = (np.linspace(0.0, 1.0, _TESTED, endpoint=False) * steps[:, None]).astype(int)
        return float(self._loss(self.rows.batch(self.held_out, at, self.settings.network.chunk)))

    def _write_policy(self, row: dict[str, Any]) -> None:
        arrays = self.net.arrays() | {"unit": self.unit.cpu().numpy()}
        about = {
            "kind": KIND, "view": self.settings.view, "chunk": self.settings.network.chunk,
            "execute": self.settings.execute, "env": self.env,
            "training": {
                "seed": self.settings.seed, "demonstrations": len(self.trained), "steps": len(self.rows.looks), **row,
                "versions": package_versions(_PACKAGES),
            },
        }  # fmt: skip
        write_policy(self.out, about, arrays)

    def _keep(self) -> None:
        write_state(self.out / CHECKPOINT, self.net, self.optimiser, asdict(self.state))

    def _resume(self) -> None:
        """Go on from the checkpoint, where there is one."""
        path = self.out / CHECKPOINT
        found = read_state(path, self.net, self.optimiser)
        if found is not None:
            self.state = progress_of(found, path)


def _env(modes: dict[str, str], view: str) -> dict[str, str]:
    """Return the settings of `gym.make` that the policy needs; it commands set-points."""
    joints = modes["control_mode"] if modes["control_mode"].startswith("joint") else "joint_position"
    seen = {"obs_mode": "state"} if view == "state" else {"obs_mode": "pointcloud", "observe": "reset"}
    return {**seen, "control_mode": joints}


def _identity(
    rows: Rows, settings: BcSettings, minutes: float | None, trials: Trials | None
) -> dict[str, Any]:
    """Return what is trained on what."""
    return {
        "schema": 1, "policy": ABOUT, "data": rows.key, "minutes": minutes, "settings": settings.as_json(),
        "trials": None if trials is None else asdict(trials),
    }  # fmt: skip
