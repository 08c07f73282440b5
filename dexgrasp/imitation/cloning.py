"""Cloning of a policy from demonstrations."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dexgrasp.imitation.clone import Clone
from dexgrasp.imitation.clone_net import CloneNet
from dexgrasp.imitation.data import Batch, read_rows
from dexgrasp.imitation.settings import BcSettings
from dexgrasp.runs.policy_folder import write_policy
from dexgrasp.runs.step_training import StepTraining
from dexgrasp.runs.training import Course, Row
from dexgrasp.runs.versions import package_versions
from dexgrasp_env.extras import from_extra
from dexgrasp_env.robot.cell import default_cell

with from_extra():
    import torch

_TESTED = 16  # rows of each held-out episode
_BEND = 0.1
"""Of the loss: beyond it a row counts by its distance, so that of two ways to do it one is learned."""
_LAST_RATE = 0.02
_LEAST_UNIT = 0.005  # rad: joints that hardly move need not be predicted better
_PACKAGES = ("dexgrasp", "numpy", "torch")


class Cloning(StepTraining):
    """Training on demonstrations; its folder is an agent by its path."""

    steps, clip = 200, 1.0

    def __init__(
        self, data: Sequence[Path], out: Path, settings: BcSettings, course: Course = Course()
    ) -> None:
        """Read the demonstrations.

        Args:
            data: folders of them.
            out: folder of the policy.
            settings: of the training.
            course: where it runs.

        Raises:
            InputError: no usable demonstrations, no such device.
        """
        super().__init__(out, settings, settings.epochs, course)
        self._rows, modes = read_rows(data, settings.view)
        self._env = _env(modes, settings.view)
        order = np.random.default_rng([settings.seed, 0]).permutation(len(self._rows.steps))
        tested = int(np.ceil(settings.held_out * len(order))) if len(order) > 1 else 0
        self._held_out, self._trained = np.sort(order[:tested]), np.sort(order[tested:])
        self._unit = self._spread().to(self.place)

    def _spread(self) -> torch.Tensor:
        """Spread (chunk * 23,) rad of what is predicted, at least `_LEAST_UNIT`."""
        rng = np.random.default_rng([self.settings.seed, 1])
        drawn = self._rows.draw(rng, self._trained, 256, 32, self.settings.network.chunk).chunks
        unit = np.sqrt((drawn**2).mean(axis=(0, 1))).ravel()
        return torch.from_numpy(np.maximum(unit, _LEAST_UNIT).astype(np.float32))

    def identity(self) -> Row:
        """Return what the demonstrations are."""
        return {"data": self._rows.key}

    def network(self) -> CloneNet:
        """Make the network."""
        looks = self._rows.looks
        mean, scale = looks.mean(axis=0), np.maximum(looks.std(axis=0), 1e-3)
        return CloneNet(self.settings.network, mean, scale, self.settings.view == "cloud")

    def rate(self, done: float) -> float:
        """Return Adam's rate."""
        return float(self.settings.rate * max(_LAST_RATE, 0.5 * (1.0 + np.cos(np.pi * done))))

    def losses(self, step: int, done: float) -> Sequence[torch.Tensor]:
        """Return the loss of a step."""
        s, rng = self.settings, np.random.default_rng([self.settings.seed, 2, step])
        return (self._loss(self._rows.draw(rng, self._trained, s.episodes, s.rows, s.network.chunk)),)

    def _loss(self, batch: Batch) -> torch.Tensor:
        looks, points, chunks = (torch.from_numpy(array).to(self.place) for array in batch)
        wanted = chunks.flatten(start_dim=2) / self._unit
        return torch.nn.functional.smooth_l1_loss(self.net(looks, points), wanted, beta=_BEND)

    def learn(self) -> Row:
        """Do an epoch; return its loss, and that on demonstrations that were kept apart, where there are any."""
        (loss,) = self.epoch_losses()
        return {"loss": loss, "test_loss": self._test()}

    @torch.no_grad()
    def _test(self) -> float | None:
        if not len(self._held_out):
            return None
        self.net.eval()
        steps = self._rows.steps[self._held_out]
        at = (np.linspace(0.0, 1.0, _TESTED, endpoint=False) * steps[:, None]).astype(int)
        return float(self._loss(self._rows.batch(self._held_out, at, self.settings.network.chunk)))

    def write(self) -> None:
        """Write the policy."""
        arrays = self.net.arrays() | {"unit": self._unit.cpu().numpy()}
        about = {
            "kind": Clone.kind, "view": self.settings.view, "chunk": self.settings.network.chunk,
            "execute": self.settings.execute, "env": self._env, "robot": default_cell().robot.stamp,
            "training": {
                "seed": self.settings.seed, "demonstrations": len(self._trained), "steps": len(self._rows.looks),
                **self.state.curve[-1], "versions": package_versions(_PACKAGES),
            },
        }  # fmt: skip
        write_policy(self.out, about, arrays)


def _env(modes: dict[str, str], view: str) -> dict[str, str]:
    """Return the settings of `gym.make` that the policy needs; it commands set-points."""
    joints = modes["control_mode"] if modes["control_mode"].startswith("joint") else "joint_position"
    seen = {"obs_mode": "state"} if view == "state" else {"obs_mode": "pointcloud", "observe": "reset"}
    return {**seen, "control_mode": joints}
