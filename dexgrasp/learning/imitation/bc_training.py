"""Behaviour cloning: training of a policy on demonstrations; its folder is an agent by its path."""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from dexgrasp.learning.imitation.bc_network import BcNet, GraspNet
from dexgrasp.learning.imitation.bc_policy import BcPolicy
from dexgrasp.learning.imitation.cloud_features import grip_features
from dexgrasp.learning.imitation.cloud_grasp_policy import CloudGraspPolicy
from dexgrasp.learning.imitation.demonstrated_grasp import sizes
from dexgrasp.learning.imitation.demonstration_data import (
    ControlSteps,
    Grips,
    demonstrated_cell,
    read_grips,
    read_steps,
)
from dexgrasp.learning.imitation.settings import BcSettings
from dexgrasp.learning.training.gradient_training import GradientTraining
from dexgrasp.learning.training.loop import RunOptions
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp.runs.weights import write_policy
from dexgrasp_env.arrays import Fields
from dexgrasp_env.extras import from_extra
from dexgrasp_env.files import expand
from dexgrasp_env.valid import Rule, checked, several

with from_extra():
    import torch
    from torch import Tensor
    from torch.nn.functional import smooth_l1_loss


class BcTraining(GradientTraining):
    """Base of trainings on demonstrations."""

    steps, clip = 200, 1.0

    @checked
    def __init__(
        self,
        data: Annotated[Sequence[Path], several(Rule("a folder", expand))],
        settings: BcSettings,
        out: Path,
        options: RunOptions = RunOptions(),
    ) -> None:
        """Read demonstrations, and hold some out for the test loss.

        Args:
            data: folders of `dexgrasp demos generate`.
            settings: of the training.
            out: folder of the policy, an agent by its path.
            options: where it runs.

        Raises:
            InputError: no usable demonstrations, or no such device.
        """
        super().__init__(settings, out, options)
        self.cell = demonstrated_cell(data)
        rows = self._rows = self.read(data)
        order = np.random.default_rng([settings.seed, 0]).permutation(len(rows))
        tested = int(np.ceil(settings.held_out * len(order))) if len(order) > 1 else 0
        self._held_out, self._trained = np.sort(order[:tested]), np.sort(order[tested:])

    @abstractmethod
    def read(self, data: Sequence[Path]) -> Any:
        """Return the training data: it has a length and a `key`, and draws batches."""

    @abstractmethod
    def loss(self, *batch: Tensor) -> Tensor:
        """Return the loss of a batch."""

    @abstractmethod
    def policy(self) -> Fields:
        """Return the policy's own keys of `policy.json`."""

    def identity(self) -> Fields:
        """Return the hash of the demonstrations."""
        return {"data": self._rows.key}

    def rate_factor(self, done: float) -> float:
        """Return the factor of a cosine decay."""
        return float(0.5 * (1.0 + np.cos(np.pi * done)))

    def losses(self, step: int, done: float) -> Sequence[Tensor]:
        """Return the loss of a step."""
        rng = np.random.default_rng([self.settings.seed, 2, step])
        return (self.loss(*self.tensors(self._rows.draw(rng, self._trained, self.settings))),)

    def figures(self, losses: Sequence[float]) -> Fields:
        """Return the loss, and that on held-out demonstrations; None without any."""
        return {"loss": losses[0], "test_loss": self._test()}

    @torch.no_grad()
    def _test(self) -> float | None:
        if not len(self._held_out):
            return None
        self.net.eval()
        return float(self.loss(*self.tensors(self._rows.tested(self._held_out, self.settings))))

    def write(self) -> None:
        """Write the policy."""
        about = {
            **self.policy(), "view": self.settings.view, "robot": self.cell.robot.stamp,
            "training": self.state.origin(seed=self.settings.seed, demonstrations=len(self._trained)),
        }  # fmt: skip
        write_policy(self.out, about, self.net.arrays())


class StateBcTraining(BcTraining):
    """Cloning of a policy from the state to the next set-points."""

    def read(self, data: Sequence[Path]) -> ControlSteps:
        """Return the control steps of demonstrations."""
        return read_steps(data)

    def network(self) -> BcNet:
        """Make the network, with the spread (chunk * joints,) rad of its predictions in the data."""
        rng, inputs = np.random.default_rng([self.settings.seed, 1]), self._rows.features
        drawn = self._rows.draw(rng, self._trained, replace(self.settings, episodes=256, rows=32)).chunks
        # rad: joints that hardly move need not be predicted better
        unit = np.maximum(np.sqrt((drawn**2).mean(axis=(0, 1))).ravel(), 0.005).astype(np.float32)
        spread = np.maximum(inputs.std(axis=0), 1e-3)
        return BcNet(self.settings.network, mean=inputs.mean(axis=0), scale=spread, unit=unit)

    def loss(self, *batch: Tensor) -> Tensor:
        """Return the smooth L1 distance of predicted set-points from the intended ones."""
        inputs, chunks = batch
        # Linear beyond `beta`, so that of two ways to do it one is learned and not their mean.
        return smooth_l1_loss(self.net(inputs), chunks.flatten(start_dim=2) / self.net.unit, beta=0.1)

    def policy(self) -> Fields:
        """Return the keys that `BcPolicy` reads."""
        mode = self._rows.control_mode
        env = {"obs_mode": "state", "control_mode": mode if mode.startswith("joint") else "joint_position"}
        sizes = {"chunk": self.settings.network.chunk, "execute": self.settings.execute}
        return {"kind": BcPolicy.kind, **sizes, "env": env}


class CloudBcTraining(BcTraining):
    """Cloning of a policy from one cloud to a grasp.

    Demonstrations of a scene grip along many lines and in several ways, whose mean is no grasp: the network classifies
    the line that was taken among others around the object, and predicts a mixture of grasps along it.
    """

    def read(self, data: Sequence[Path]) -> Grips:
        """Return observed clouds, and the grasps that demonstrations took."""
        parts = sizes(robot_tree(self.cell))
        # Scales of errors, network units, and weights: tips, palm, its rotation, hand closed and opened, forces.
        off = np.repeat([0.15, 0.15, 0.15, 0.15, 0.15, 0.3], parts).astype(np.float32)
        weights = np.repeat([1.0, 1.0, 0.5, 0.3, 0.2, 0.3], parts).astype(np.float32)
        self._off, self._weights = self.tensors((off, weights))
        return read_grips(data)

    def network(self) -> GraspNet:
        """Make the network."""
        seen = zip(self._rows.clouds, self._rows.azimuths[:, None], strict=True)
        numbers = np.concatenate([grip_features(cloud, azimuth)[1] for cloud, azimuth in seen])
        return GraspNet(self.settings.grasps, numbers, self._rows.rows)

    def loss(self, *batch: Tensor) -> Tensor:
        """Return the mean of -log p(grip, grasp); the first grip of each object is the one that was taken."""
        points, numbers, rows = batch
        logits, grasps = self.net(points, numbers)
        off = (grasps[:, 0] - rows[:, None]) / self._off
        far = smooth_l1_loss(off, torch.zeros_like(off), reduction="none") @ self._weights
        likely = logits.flatten(1).log_softmax(dim=1).unflatten(1, logits.shape[1:])
        return -torch.logsumexp(likely[:, 0] - far, dim=1).mean()

    def policy(self) -> Fields:
        """Return the keys that `CloudGraspPolicy` reads."""
        env = {"obs_mode": "pointcloud", "control_mode": "joint_position", "observe": "reset"}
        return {"kind": CloudGraspPolicy.kind, "modes": self.settings.grasps.modes, "env": env}


VIEWS: dict[str, type[StateBcTraining | CloudBcTraining]] = {
    "state": StateBcTraining,
    "cloud": CloudBcTraining,
}
"""View (`state`, `cloud`) -> its training."""
