"""Training of one network by steps of Adam."""

import time
from abc import abstractmethod
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from dexgrasp.learning.training.checkpoint import Parts
from dexgrasp.learning.training.training import Training
from dexgrasp_env.arrays import Fields
from dexgrasp_env.extras import from_extra

with from_extra():
    import torch

_LAST_RATE = 0.02
_MEASURED = 20  # steps that tell how many epochs fit into the minutes


def perceptron(
    widths: Sequence[int], activation: type[torch.nn.Module] = torch.nn.ReLU
) -> torch.nn.Sequential:
    """Return linear layers with an activation between them."""
    layers = list[torch.nn.Module]()
    for a, b in pairwise(widths):
        layers += [activation(), torch.nn.Linear(a, b)]
    return torch.nn.Sequential(*layers[1:])


class StepTraining(Training):
    """Epochs of steps of Adam, each on a batch that depends on the seed and the step alone."""

    steps: int
    """Of an epoch."""
    clip: float
    """Norm that gradients are cut off at."""
    net: Any
    """What learns."""

    @abstractmethod
    def network(self) -> torch.nn.Module:
        """Make the network."""

    @abstractmethod
    def fall(self, done: float) -> float:
        """Return the share of its first rate that Adam has when a share of all steps is done, `_LAST_RATE` at least."""

    @abstractmethod
    def losses(self, step: int, done: float) -> Sequence[torch.Tensor]:
        """Return the loss of a step, and parts of it that are reported."""

    def build(self) -> None:
        """Make network and optimiser."""
        torch.manual_seed(self.settings.seed)
        self.net = self.network().to(self.place)
        self.adam = torch.optim.Adam(self.net.parameters(), lr=self.settings.learning_rate)

    def parts(self) -> Parts:
        """Return network and optimiser."""
        return {"net": self.net, "adam": self.adam}

    def begin(self) -> Fields | None:
        """As every training; one that is told in minutes has as many epochs as fit, by the speed of some steps.

        What these steps learn is dropped.
        """
        note = super().begin()
        if note is None and self.course.minutes is not None:
            self._step(0)
            began = time.perf_counter()
            for number in range(_MEASURED):
                self._step(number)
            each = (time.perf_counter() - began) / _MEASURED
            self.state.epochs = max(1, int(60.0 * self.course.minutes / (1.05 * each * self.steps)))
            self.build()
        return note

    def epoch_losses(self) -> list[float]:
        """Do the steps of an epoch; return the means of their losses."""
        self.net.train()
        first = self.state.epoch * self.steps
        rows = [self._step(number) for number in range(first, first + self.steps)]
        return [float(np.mean(column)) for column in zip(*rows, strict=True)]

    def _step(self, number: int) -> list[float]:
        done = number / (self.state.epochs * self.steps)
        for group in self.adam.param_groups:
            group["lr"] = float(self.settings.learning_rate * max(_LAST_RATE, self.fall(done)))
        losses = self.losses(number, done)
        self.adam.zero_grad(set_to_none=True)
        losses[0].backward()
        torch.nn.utils.clip_grad_norm_(self.net.parameters(), self.clip)
        self.adam.step()
        return [float(loss.detach()) for loss in losses]
