"""Training of one network by gradient steps of Adam."""

import time
from abc import abstractmethod
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dexgrasp.learning.training.checkpoint import Parts
from dexgrasp.learning.training.loop import Progress, RunOptions, Task, Training
from dexgrasp_env.arrays import Fields
from dexgrasp_env.extras import from_extra

with from_extra():
    import torch

_LAST_RATE = 0.02
_TIMED_STEPS = 20


class GradientTask(Task):
    """A network, its data and its loss.

    Attributes:
        steps: of an epoch.
        clip: norm that gradients are cut off at.
    """

    steps: int
    clip: float

    @abstractmethod
    def network(self) -> torch.nn.Module:
        """Make the network."""

    @abstractmethod
    def rate_factor(self, done: float) -> float:
        """Return the factor on the learning rate when a share of all steps is done; it is held above `_LAST_RATE`."""

    @abstractmethod
    def losses(self, net: Any, step: int, done: float) -> Sequence[torch.Tensor]:
        """Return the loss of a step, and parts of it that are reported; its batch follows from seed and step alone."""

    @abstractmethod
    def figures(self, net: Any, losses: Sequence[float]) -> Fields:
        """Return the row of an epoch whose mean losses are given."""

    @abstractmethod
    def write(self, out: Path, net: Any, state: Progress) -> None:
        """Write the network of the epoch that ended."""


class GradientTraining(Training):
    """The loop of gradient steps: epochs of steps of Adam on the batches of a `GradientTask`."""

    net: torch.nn.Module

    def __init__(self, task: GradientTask, out: Path, options: RunOptions = RunOptions()) -> None:
        """Prepare.

        Args:
            task: what is trained.
            out: folder of the training.
            options: where it runs.

        Raises:
            InputError: for a device that is not there.
        """
        super().__init__(task, out, task.settings.epochs, options)

    def build(self) -> None:
        """Make network and optimiser."""
        torch.manual_seed(self.settings.seed)
        self.net = self.task.network().to(self.place)
        self.adam = torch.optim.Adam(self.net.parameters(), lr=self.settings.learning_rate)

    def parts(self) -> Parts:
        """Return network and optimiser."""
        return {"net": self.net, "adam": self.adam}

    def begin(self) -> Fields | None:
        """Build or restore; a new training that is given minutes takes as many epochs as fit, by the speed of steps."""
        note, minutes = super().begin(), self.options.minutes
        if note is None and minutes is not None:
            self._step(0)
            began = time.perf_counter()
            for number in range(_TIMED_STEPS):
                self._step(number)
            each = (time.perf_counter() - began) / _TIMED_STEPS
            self.state.epochs = max(1, int(60.0 * minutes / (1.05 * each * self.task.steps)))
            self.build()  # what these steps learned is dropped
        return note

    def learn(self) -> Fields:
        """Do the steps of an epoch."""
        self.net.train()
        first = self.state.epoch * self.task.steps
        rows = [self._step(number) for number in range(first, first + self.task.steps)]
        return self.task.figures(self.net, [float(np.mean(column)) for column in zip(*rows, strict=True)])

    def write(self) -> None:
        """Write the network."""
        self.task.write(self.out, self.net, self.state)

    def _step(self, number: int) -> list[float]:
        done = number / (self.state.epochs * self.task.steps)
        for group in self.adam.param_groups:
            group["lr"] = float(self.settings.learning_rate * max(_LAST_RATE, self.task.rate_factor(done)))
        losses = self.task.losses(self.net, number, done)
        self.adam.zero_grad(set_to_none=True)
        losses[0].backward()
        torch.nn.utils.clip_grad_norm_(self.net.parameters(), self.task.clip)
        self.adam.step()
        return [float(loss.detach()) for loss in losses]


def tensors_for(net: torch.nn.Module, arrays: Iterable[NDArray[Any]]) -> list[torch.Tensor]:
    """Return arrays as tensors on the device of a network."""
    place = next(net.parameters()).device
    return [torch.from_numpy(array).to(place) for array in arrays]


def perceptron(
    widths: Sequence[int], activation: type[torch.nn.Module] = torch.nn.ReLU
) -> torch.nn.Sequential:
    """Return linear layers with an activation between them."""
    layers = list[torch.nn.Module]()
    for a, b in pairwise(widths):
        layers += [activation(), torch.nn.Linear(a, b)]
    return torch.nn.Sequential(*layers[1:])
