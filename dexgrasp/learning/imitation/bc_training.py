"""BcTraining of a policy from demonstrations."""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp.learning.imitation.bc_network import BcNet, GraspNet
from dexgrasp.learning.imitation.bc_policy import BcPolicy
from dexgrasp.learning.imitation.cloud_features import grip_features
from dexgrasp.learning.imitation.cloud_grasp_policy import CloudGraspPolicy
from dexgrasp.learning.imitation.demonstrated_grasp import sizes
from dexgrasp.learning.imitation.demonstration_data import Grips, Rows, read_grips, read_rows
from dexgrasp.learning.imitation.settings import BcSettings
from dexgrasp.learning.training.step_training import StepTraining
from dexgrasp.learning.training.training import RunOptions
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp.runs.policy_folder import write_policy
from dexgrasp_env.arrays import Fields
from dexgrasp_env.extras import from_extra
from dexgrasp_env.robot.cell import default_cell

with from_extra():
    import torch
    from torch import Tensor

_BEND = 0.1
"""Of the loss: beyond it a row counts by its distance, so that of two ways to do it one is learned."""
_LEAST_UNIT = 0.005  # rad: joints that hardly move need not be predicted better
_OFF = 0.15, 0.15, 0.15, 0.15, 0.15, 0.3
"""Network units that tips, palm, its turn, hand closed and opened, and forces are off by before distance counts."""
_WEIGHTS = 1.0, 1.0, 0.5, 0.3, 0.2, 0.3


class BcTraining(StepTraining):
    """Training on demonstrations; its folder is an agent by its path.

    Who inherits says what is read of demonstrations, what learns from it, and by which loss.
    """

    steps, clip = 200, 1.0

    def __init__(
        self, data: Sequence[Path], out: Path, settings: BcSettings, course: RunOptions = RunOptions()
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
        self._rows = self.read(data)
        order = np.random.default_rng([settings.seed, 0]).permutation(len(self._rows))
        tested = int(np.ceil(settings.held_out * len(order))) if len(order) > 1 else 0
        self._held_out, self._trained = np.sort(order[:tested]), np.sort(order[tested:])

    @abstractmethod
    def read(self, folders: Sequence[Path]) -> Any:
        """Return what is learned from: it has a length and a key, and draws batches."""

    @abstractmethod
    def loss(self, *batch: Tensor) -> Tensor:
        """Return the loss of a batch."""

    @abstractmethod
    def policy(self) -> tuple[Fields, Fields]:
        """Return what is said of the policy, and arrays beside the network's."""

    def identity(self) -> Fields:
        """Return what the demonstrations are."""
        return {"data": self._rows.key}

    def fall(self, done: float) -> float:
        """Return a cosine."""
        return float(0.5 * (1.0 + np.cos(np.pi * done)))

    def losses(self, step: int, done: float) -> Sequence[Tensor]:
        """Return the loss of a step."""
        rng = np.random.default_rng([self.settings.seed, 2, step])
        return (self._loss(self._rows.draw(rng, self._trained, self.settings)),)

    def _loss(self, batch: Any) -> Tensor:
        return self.loss(*(torch.from_numpy(array).to(self.place) for array in batch))

    def learn(self) -> Fields:
        """Do an epoch; return its loss, and that on demonstrations that were kept apart, where there are any."""
        (loss,) = self.epoch_losses()
        return {"loss": loss, "test_loss": self._test()}

    @torch.no_grad()
    def _test(self) -> float | None:
        if not len(self._held_out):
            return None
        self.net.eval()
        return float(self._loss(self._rows.tested(self._held_out, self.settings)))

    def write(self) -> None:
        """Write the policy."""
        own, arrays = self.policy()
        about = {
            **own, "view": self.settings.view, "robot": default_cell().robot.stamp,
            "training": self.origin(seed=self.settings.seed, demonstrations=len(self._trained)),
        }  # fmt: skip
        write_policy(self.out, about, self.net.arrays() | arrays)


class StateBcTraining(BcTraining):
    """Of a policy that sees the state, and answers with the next set-points."""

    _rows: Rows
    read = staticmethod(read_rows)

    def build(self) -> None:
        """Make network and optimiser, and measure the spread (chunk * 23,) rad of what is predicted."""
        rng = np.random.default_rng([self.settings.seed, 1])
        drawn = self._rows.draw(rng, self._trained, replace(self.settings, episodes=256, rows=32)).chunks
        unit = np.sqrt((drawn**2).mean(axis=(0, 1))).ravel()
        self._unit = torch.from_numpy(np.maximum(unit, _LEAST_UNIT).astype(np.float32)).to(self.place)
        super().build()

    def network(self) -> BcNet:
        """Make the network."""
        looks = self._rows.looks
        return BcNet(self.settings.network, looks.mean(axis=0), np.maximum(looks.std(axis=0), 1e-3))

    def loss(self, *batch: Tensor) -> Tensor:
        """Return how far set-points are from those that were meant."""
        looks, chunks = batch
        wanted = chunks.flatten(start_dim=2) / self._unit
        return torch.nn.functional.smooth_l1_loss(self.net(looks), wanted, beta=_BEND)

    def policy(self) -> tuple[Fields, Fields]:
        """Return what a `BcPolicy` reads."""
        mode = self._rows.control_mode
        env = {"obs_mode": "state", "control_mode": mode if mode.startswith("joint") else "joint_position"}
        own = {"kind": BcPolicy.kind, "chunk": self.settings.network.chunk, "execute": self.settings.execute}
        return {**own, "env": env}, {"unit": self._unit.cpu().numpy()}


class CloudBcTraining(BcTraining):
    """Of a policy that looks at a cloud once, and answers with a grasp.

    Demonstrations of one scene grip along many lines and in several ways, so a mean of them is none: the network tells
    the line that was taken from others around the object, and along it a mixture of ways.
    """

    _rows: Grips
    read = staticmethod(read_grips)

    def network(self) -> GraspNet:
        """Make the network."""
        seen = zip(self._rows.looks, self._rows.azimuths[:, None], strict=True)
        numbers = np.concatenate([grip_features(look, azimuth)[1] for look, azimuth in seen])
        parts = sizes(robot_tree(default_cell()))
        self._off, self._weights = (
            torch.from_numpy(np.repeat(part, parts).astype(np.float32)).to(self.place)
            for part in (_OFF, _WEIGHTS)
        )
        return GraspNet(self.settings.grasps, numbers, self._rows.rows)

    def loss(self, *batch: Tensor) -> Tensor:
        """Return the mean of -log p(grip, grasp): the first grip of each object is the one that was taken."""
        points, numbers, rows = batch
        merits, grasps = self.net(points, numbers)
        off = (grasps[:, 0] - rows[:, None]) / self._off
        far = torch.nn.functional.smooth_l1_loss(off, torch.zeros_like(off), reduction="none") @ self._weights
        likely = merits.flatten(1).log_softmax(dim=1).unflatten(1, merits.shape[1:])
        return -torch.logsumexp(likely[:, 0] - far, dim=1).mean()

    def policy(self) -> tuple[Fields, Fields]:
        """Return what a `CloudGraspPolicy` reads."""
        env = {"obs_mode": "pointcloud", "control_mode": "joint_position", "observe": "reset"}
        return {"kind": CloudGraspPolicy.kind, "modes": self.settings.grasps.modes, "env": env}, {}


VIEWS: dict[str, type[BcTraining]] = {"state": StateBcTraining, "cloud": CloudBcTraining}
"""Who clones a policy of each view."""
