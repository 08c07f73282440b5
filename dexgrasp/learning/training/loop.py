"""Training in a folder, epoch by epoch; an interrupted one resumes to the same bits on a CPU."""

import json
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from dexgrasp.learning.training.checkpoint import Trainables, damaged, read_state, write_state
from dexgrasp.learning.training.curves import scalars
from dexgrasp.learning.training.trials import PeriodicTrials
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
    from torch.utils.tensorboard import SummaryWriter

CHECKPOINT, CURVE = "checkpoint.safetensors", "curve.jsonl"


@dataclass
class TrainingState:
    """Progress of a training; `curve` has a row for each epoch."""

    epoch: int = 0
    epochs: int = 0
    seconds: float = 0.0
    curve: list[Fields] = field(default_factory=list)

    def origin(self, *packages: str, **own: Any) -> Fields:
        """Return the record of the training for a policy: `own`, the last row of the curve, and versions."""
        versions = package_versions(("dexgrasp", "numpy", "torch", *packages))
        return own | self.curve[-1] | {"versions": versions}


@dataclass(frozen=True)
class RunOptions:
    """Options of a training beside its settings.

    Attributes:
        device: cpu, cuda or auto.
        minutes: limit that sets the number of epochs, by measured speed; None for that of the settings.
        trials: of the policy during training, or None.
    """

    device: str = "cpu"
    minutes: float | None = None
    trials: PeriodicTrials | None = None


class Training(ABC):
    """Base of trainings: a loop of epochs that restores, learns, writes, checkpoints and logs.

    An epoch depends on the trainable state and its number only.

    Attributes:
        about: name of the file that identifies the training.
    """

    about = "training.json"

    def __init__(self, settings: Any, epochs: int, out: Path, options: RunOptions = RunOptions()) -> None:
        """Prepare.

        Args:
            settings: a dataclass; a folder of others is refused. Has `seed`, and `threads`, of torch on the CPU.
            epochs: number of epochs.
            out: folder of the training.
            options: where it runs.

        Raises:
            InputError: for a device that is not there.
        """
        self.settings, self.out, self.options = settings, out, options
        there = torch.cuda.is_available()
        if check("device", options.device, one_of(("auto", "cpu", "cuda"))) == "cuda" and not there:
            raise InputError("device 'cuda': there is none that torch can use; valid are auto, cpu")
        self.device = torch.device("cuda" if options.device != "cpu" and there else "cpu")
        self.state = TrainingState(epochs=epochs)

    @abstractmethod
    def build(self) -> None:
        """Make the trainable parts, initialised."""

    @abstractmethod
    def parts(self) -> Trainables:
        """Return the trainable parts by name."""

    @abstractmethod
    def learn(self) -> Fields:
        """Run an epoch; return its row of the curve."""

    @abstractmethod
    def write(self) -> None:
        """Write the result after an epoch, the last of `state.curve`."""

    @property
    def best(self) -> int:
        """Epoch whose weights are kept, if that is not the last one, else 0."""
        return 0

    def identity(self) -> Fields:
        """Return the identity of the training data; the settings are added."""
        return {}

    def note(self) -> Fields:
        """Return further content of a checkpoint, as JSON."""
        return {}

    def restore(self, note: Fields) -> None:  # noqa: B027  (most keep the parts alone)
        """Restore the state of `note`.

        Raises:
            LookupError, TypeError: if it is damaged.
            InputError: if the training cannot resume from it.
        """

    def close(self) -> None:  # noqa: B027  (most have nothing open)
        """Release resources when the training ends."""

    def run(self, progress: Callable[[TrainingState], object] | None = None) -> TrainingState:
        """Train to the end, resuming from the folder's checkpoint if there is one.

        Args:
            progress: called after every epoch, once that is kept.

        Raises:
            InputError: for other settings or another process in the folder, or a damaged checkpoint.
        """
        torch.set_num_threads(self.settings.threads)
        options = self.options
        run = {
            "schema": 1,
            **self.identity(),
            "settings": asdict(self.settings),
            "minutes": options.minutes,
            "trials": options.trials and asdict(options.trials),
        }
        with RunFolder(self.out, self.about, "training").claim(run):
            try:
                self.begin()
                if self.state.epoch < self.state.epochs:
                    self._go_on(progress)
            finally:
                self.close()
        return self.state

    def begin(self) -> None:
        """Make the trainable parts, and restore them from the checkpoint if there is one.

        Raises:
            InputError: if it is damaged.
        """
        self.build()
        path = self.out / CHECKPOINT
        note = read_state(path, self.parts())
        if note is None:
            return
        try:
            self.state = state = TrainingState(**note["progress"])
            whole = [row["epoch"] for row in state.curve] == list(range(1, state.epoch + 1))
            if not (whole and state.epoch <= state.epochs and state.seconds >= 0.0):
                raise ValueError
            self.restore(note)
        except InputError:
            raise
        except (LookupError, TypeError, ValueError):
            raise damaged(path) from None

    def _go_on(self, progress: Callable[[TrainingState], object] | None) -> None:
        state = self.state
        with SummaryWriter(str(self.out / "tensorboard")) as writer:
            while state.epoch < state.epochs:
                began = time.perf_counter()
                row = {"epoch": state.epoch + 1} | self.learn()
                state.seconds += time.perf_counter() - began
                state.epoch += 1
                state.curve.append(row)
                # The result is there before the checkpoint: a kill in between repeats an epoch, to the same bits.
                with held():
                    self.write()
                if self.options.trials:
                    row |= self.options.trials.after(self.out, state.epoch, state.epochs)
                with held():
                    write_state(
                        self.out / CHECKPOINT, self.parts(), {"progress": asdict(state), **self.note()}
                    )
                    lines = "".join(json.dumps(row) + "\n" for row in state.curve)
                    write_atomically(self.out / CURVE, lines.encode())
                for name, split, number in scalars(row):
                    writer.add_scalar(f"{name}/{split}".rstrip("/"), number, row.get("steps", state.epoch))
                if progress:
                    progress(state)
