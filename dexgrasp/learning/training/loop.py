"""Training in a folder, epoch by epoch; an interrupted one goes on to the same bits on a CPU."""

import json
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from dexgrasp.learning.training.checkpoint import Parts, damaged, read_state, write_state
from dexgrasp.learning.training.curves import TensorBoardWriter
from dexgrasp.runs.folder import RunFolder
from dexgrasp.runs.interrupt import held
from dexgrasp.runs.versions import package_versions
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.extras import from_extra
from dexgrasp_env.files import write_atomically
from dexgrasp_env.valid import check, one_of

with from_extra():
    import torch

CHECKPOINT, CURVE = "checkpoint.safetensors", "curve.jsonl"
_DEVICES = one_of(("auto", "cpu", "cuda"))


@dataclass
class Progress:
    """State of a training; `curve` has a row an epoch."""

    epoch: int = 0
    epochs: int = 0
    seconds: float = 0.0
    curve: list[Fields] = field(default_factory=list)


@dataclass(frozen=True)
class Tester(ABC):
    """Evaluation of a policy during its training."""

    @abstractmethod
    def after(self, folder: Path, state: Progress) -> Fields:
        """Return figures that join the row of the epoch that ended, or none."""


@dataclass(frozen=True)
class RunOptions:
    """Options of a training beside its settings.

    Attributes:
        device: cpu, cuda or auto.
        minutes: as many epochs as fit into these, by the first steps' speed; None for those of the settings.
        tester: evaluates the policy during training; None for nothing.
    """

    device: str = "cpu"
    minutes: float | None = None
    tester: Tester | None = None


class Task(ABC):
    """A learner and its data; an epoch depends on what is learned so far and on the epoch's number alone.

    Attributes:
        about: name of the file that identifies the training.
        settings: a dataclass; a folder of others is refused. Has `threads`, of torch on the CPU: results differ in the
            last bits with it.
    """

    about = "training.json"
    settings: Any

    @abstractmethod
    def identity(self) -> Fields:
        """Return what it is trained on; the settings are added."""

    def best(self, state: Progress) -> int:
        """Return the epoch that is kept where it is not the last, else 0."""
        return 0

    def fault(self, out: Path, state: Progress) -> str | None:
        """Return why a training cannot go on in a folder, None where it can."""
        return None


class Training(ABC):
    """A loop of epochs over a task: restore, learn, write, checkpoint, log."""

    def __init__(self, task: Any, out: Path, epochs: int, options: RunOptions) -> None:
        """Prepare.

        Raises:
            InputError: for a device that is not there.
        """
        self.task, self.out, self.settings, self.options = task, out, task.settings, options
        there = torch.cuda.is_available()
        if check("device", options.device, _DEVICES) == "cuda" and not there:
            raise InputError("device 'cuda': there is none that torch can use; valid are auto, cpu")
        self.place = torch.device("cuda" if options.device != "cpu" and there else "cpu")
        self.state = Progress(epochs=epochs)
        self.open = ExitStack()
        """Closes what is open when the training ends."""

    @abstractmethod
    def build(self) -> None:
        """Make what learns, with nothing learned."""

    @abstractmethod
    def parts(self) -> Parts:
        """Return what learns."""

    @abstractmethod
    def learn(self) -> Fields:
        """Do an epoch; return its row of the curve."""

    @abstractmethod
    def write(self) -> None:
        """Write the result of the epoch that ended, the last of `state.curve`."""

    def note(self) -> Fields:
        """Return what a checkpoint holds beside the parts."""
        return {}

    def restore(self, note: Fields) -> None:
        """Take up what `note` returned.

        Raises:
            LookupError, TypeError: if it is damaged.
        """
        del note  # there is nothing but the parts

    @property
    def best(self) -> int:
        """The epoch that is kept where it is not the last, else 0."""
        return int(self.task.best(self.state))

    def run(
        self, progress: Callable[[Progress], object] | None = None, stop_after: int | None = None
    ) -> Progress:
        """Train to the end, or go on with what the folder holds.

        Args:
            progress: called after every epoch.
            stop_after: epochs of this call, for tests of resuming.

        Raises:
            InputError: other settings or another process in the folder, a damaged checkpoint.
        """
        torch.set_num_threads(self.settings.threads)
        options = self.options
        run = {
            "schema": 1,
            **self.task.identity(),
            "settings": asdict(self.settings),
            "minutes": options.minutes,
            "trials": options.tester and asdict(options.tester),
        }
        with RunFolder(self.out, self.task.about, "training").claim(run), self.open:
            self.begin()
            self._go_on(progress, stop_after)
        return self.state

    def begin(self) -> Fields | None:
        """Make what learns, and go on from the checkpoint, where there is one; return its note.

        Raises:
            InputError: if it is damaged.
        """
        self.build()
        path = self.out / CHECKPOINT
        note = read_state(path, self.parts())
        if note is None:
            return None
        try:
            self.state = state = Progress(**note["progress"])
            whole = [row["epoch"] for row in state.curve] == list(range(1, state.epoch + 1))
            if not (whole and state.epoch <= state.epochs and state.seconds >= 0.0):
                raise ValueError
            self.restore(note)
        except (LookupError, TypeError, ValueError):
            raise damaged(path) from None
        if fault := self.task.fault(self.out, state):
            raise InputError(fault)
        return note

    def _go_on(self, progress: Callable[[Progress], object] | None, stop_after: int | None) -> None:
        writer, calls, state = TensorBoardWriter(self.out / "tensorboard"), 0, self.state
        while state.epoch < state.epochs and calls != stop_after:
            began = time.perf_counter()
            row = {"epoch": state.epoch + 1} | self.learn()
            state.seconds += time.perf_counter() - began
            state.epoch, calls = state.epoch + 1, calls + 1
            state.curve.append(row)
            # The result is there before the checkpoint: a kill in between repeats an epoch, to the same bits.
            with held():
                self.write()
            if self.options.tester:
                row |= self.options.tester.after(self.out, state)
            with held():
                write_state(self.out / CHECKPOINT, self.parts(), {"progress": asdict(state), **self.note()})
                write_atomically(
                    self.out / CURVE, "".join(json.dumps(row) + "\n" for row in state.curve).encode()
                )
            writer.add(row, row.get("steps", state.epoch))
            if progress:
                progress(state)
        writer.close()


def origin(state: Progress, *packages: str, **own: Any) -> Fields:
    """Return a policy's record of its training: `own`, the last row of the curve, and versions."""
    return own | state.curve[-1] | {"versions": package_versions(("dexgrasp", "numpy", "torch", *packages))}
