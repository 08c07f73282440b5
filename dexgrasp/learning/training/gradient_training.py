"""Training of a network by gradient steps of Adam."""

import timeit
from abc import abstractmethod
from collections.abc import Iterable, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp.learning.training.checkpoint import Trainables
from dexgrasp.learning.training.loop import CHECKPOINT, RunOptions, Training
from dexgrasp_env.arrays import AnyArray, Fields
from dexgrasp_env.extras import from_extra

with from_extra():
    import torch


class GradientTraining(Training):
    """Base of trainings whose epochs are gradient steps of Adam on batches.

    Attributes:
        steps: number of steps in an epoch.
        clip: norm that gradients are clipped at.
        net: the network.
    """

    steps: int
    clip: float
    net: Any

    def __init__(self, settings: Any, out: Path, options: RunOptions = RunOptions()) -> None:
        """Prepare; see `Training`. The settings have `epochs` and `learning_rate` as well."""
        super().__init__(settings, settings.epochs, out, options)

    @abstractmethod
    def network(self) -> torch.nn.Module:
        """Make the network."""

    @abstractmethod
    def rate_factor(self, done: float) -> float:
        """Return the factor on the learning rate after a share of all steps; it is clipped from below at 0.02."""

    @abstractmethod
    def losses(self, step: int, done: float) -> Sequence[torch.Tensor]:
        """Return the loss of a step, and parts of it to report; its batch depends on seed and step only."""

    @abstractmethod
    def figures(self, losses: Sequence[float]) -> Fields:
        """Return the row of an epoch from its mean losses."""

    def build(self) -> None:
        """Make network and optimiser."""
        torch.manual_seed(self.settings.seed)
        self.net = self.network().to(self.device)
        self._adam = torch.optim.Adam(self.net.parameters(), lr=self.settings.learning_rate)

    def parts(self) -> Trainables:
        """Return network and optimiser."""
        return {"net": self.net, "adam": self._adam}

    def begin(self) -> None:
        """Build or restore; set the epochs of a new training with a limit of minutes by the measured speed of steps."""
        new = not (self.out / CHECKPOINT).is_file()
        super().begin()
        if new and self.options.minutes is not None:
            self._step(0)
            timed = 20
            each = timeit.timeit(partial(self._step, 0), number=timed) / timed
            self.state.epochs = max(1, int(60.0 * self.options.minutes / (1.05 * each * self.steps)))
            self.build()  # discards what the timed steps learned

    def learn(self) -> Fields:
        """Do the steps of an epoch."""
        self.net.train()
        first = self.state.epoch * self.steps
        rows = [self._step(number) for number in range(first, first + self.steps)]
        return self.figures([float(np.mean(column)) for column in zip(*rows, strict=True)])

    def _step(self, number: int) -> list[float]:
        done = number / (self.state.epochs * self.steps)
        for group in self._adam.param_groups:
            group["lr"] = float(self.settings.learning_rate * max(0.02, self.rate_factor(done)))
        losses = self.losses(number, done)
        self._adam.zero_grad(set_to_none=True)
        losses[0].backward()
        torch.nn.utils.clip_grad_norm_(self.net.parameters(), self.clip)
        self._adam.step()
        return [float(loss.detach()) for loss in losses]

    def tensors(self, arrays: Iterable[AnyArray]) -> list[torch.Tensor]:
        """Return arrays as tensors on the network's device."""
        return [torch.from_numpy(array).to(self.device) for array in arrays]


def perceptron(
    widths: Sequence[int], activation: type[torch.nn.Module] = torch.nn.ReLU
) -> torch.nn.Sequential:
    """Return linear layers with an activation between them."""
    layers = list[torch.nn.Module]()
    for a, b in pairwise(widths):
        layers += [activation(), torch.nn.Linear(a, b)]
    return torch.nn.Sequential(*layers[1:])
