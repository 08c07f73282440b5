"""Training in a folder, an epoch at a time; stopped, it goes on to the same bits on a CPU."""

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
    """Where a training stands; `curve` has a row an epoch."""

    epoch: int = 0
    epochs: int = 0
    seconds: float = 0.0
    curve: list[Fields] = field(default_factory=list)


@dataclass(frozen=True)
class Tester(ABC):
    """Tries what is learned while it learns."""

    @abstractmethod
    def after(self, folder: Path, state: Progress) -> Fields:
        """Return figures that join the row of the epoch that ended, or none."""


@dataclass(frozen=True)
class RunOptions:
    """Where a training runs, and what it is not told by its settings.

    Attributes:
        device: cpu, cuda or auto.
        minutes: as many epochs as fit into these, by the first steps' speed; None for those of the settings.
        tester: what tries it while it learns; None for nothing.
    """

    device: str = "cpu"
    minutes: float | None = None
    tester: Tester | None = None


class Training(ABC):
    """A training: who inherits says what is trained on what, and does an epoch of it.

    An epoch depends on what learns and on the epoch's number alone.
    """

    about = "training.json"
    """File that says what is trained on what."""

    def __init__(self, out: Path, settings: Any, epochs: int, course: RunOptions) -> None:
        """Prepare.

        Args:
            out: folder of the training.
            settings: a dataclass; a folder of others is refused. Has `threads`, of torch on the CPU: results differ in
                the last bits with it.
            epochs: how many.
            course: where it runs.

        Raises:
            InputError: for a device that is not there.
        """
        self.out, self.settings, self.course = out, settings, course
        there = torch.cuda.is_available()
        if check("device", course.device, _DEVICES) == "cuda" and not there:
            raise InputError("device 'cuda': there is none that torch can use; valid are auto, cpu")
        self.place = torch.device("cuda" if course.device != "cpu" and there else "cpu")
        """Where torch computes."""
        self.state = Progress(epochs=epochs)
        self.open = ExitStack()
        """Closes what is open when the training ends."""

    @abstractmethod
    def identity(self) -> Fields:
        """Return what it is trained on; the settings are added."""

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
        """Write what is worth keeping of the epoch that ended, the last of `state.curve`."""

    @property
    def best(self) -> int:
        """The epoch that is kept where it is not the last, else 0."""
        return 0

    def note(self) -> Fields:
        """Return what a checkpoint holds beside the parts."""
        return {}

    def origin(self, *packages: str, **own: Any) -> Fields:
        """Return what a policy says of its training: `own`, the last row of the curve, and versions.

        Those of `packages` stand behind ours, numpy's and torch's.
        """
        packages = ("dexgrasp", "numpy", "torch", *packages)
        return own | self.state.curve[-1] | {"versions": package_versions(packages)}

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
        run = {
            "schema": 1,
            **self.identity(),
            "settings": asdict(self.settings),
            "minutes": self.course.minutes,
            "trials": self.course.tester and asdict(self.course.tester),
        }
        with RunFolder(self.out, self.about, "training").claim(run), self.open:
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
        except (LookupError, TypeError, ValueError):
            raise damaged(path) from None
        return note

    def _go_on(self, progress: Callable[[Progress], object] | None, stop_after: int | None) -> None:
        board, calls, state = TensorBoardWriter(self.out / "tensorboard"), 0, self.state
        while state.epoch < state.epochs and calls != stop_after:
            began = time.perf_counter()
            row = {"epoch": state.epoch + 1} | self.learn()
            state.seconds += time.perf_counter() - began
            state.epoch, calls = state.epoch + 1, calls + 1
            state.curve.append(row)
            # What is kept is there before the checkpoint: a kill in between repeats an epoch, to the same bits.
            with held():
                self.write()
            if self.course.tester:
                row |= self.course.tester.after(self.out, state)
            with held():
                write_state(self.out / CHECKPOINT, self.parts(), {"progress": asdict(state), **self.note()})
                write_atomically(
                    self.out / CURVE, "".join(json.dumps(row) + "\n" for row in state.curve).encode()
                )
            board.add(row, row.get("steps", state.epoch))
            if progress:
                progress(state)
        board.close()
