"""A long job killed again and again: started anew it goes on, and ends in the same bits as one that nobody killed.

    python scripts/kills.py --kills 20 --work /tmp/kills -- demos generate --objects soda lego --episodes 6
    python scripts/kills.py --kills 20 --work /tmp/kills -- train bc --data DEMOS --epochs 6

Runs `dexgrasp ARGUMENTS --out WORK/whole` once and `--out WORK/killed-0` with SIGKILL at random times, to all of its
processes, until it ends; then `killed-1` and so on, until there were kills enough. Exits with 1 if a start that was not
killed ended in anything but 0, if a file of arrays differs or is missing, or if something is there that the whole run
has not.
"""

import itertools
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.random import Generator
from safetensors.numpy import load_file

from dexgrasp.cli.command import Argument, Folder, Script
from dexgrasp.cli.commands import run_script
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import content_hash, file_hash
from dexgrasp_env.valid import Count, Natural

_ARRAYS = (".safetensors", ".npz", ".hdf5", ".parquet", ".npy")


def start(arguments: Sequence[str], out: Path) -> subprocess.Popen[bytes]:
    """Start the command in a group of its own, what it says in a log beside its folder."""
    with open(out.with_suffix(".log"), "ab") as log:
        return subprocess.Popen(
            [sys.executable, "-m", "dexgrasp_env", *arguments, "--out", str(out)],
            stdout=log, stderr=log, start_new_session=True,
        )  # fmt: skip


def killed(arguments: Sequence[str], out: Path, kills: int, most: float, rng: Generator) -> tuple[int, int]:
    """Run to the end, killed on the way; return how often that was, and how often a start ended by itself badly."""
    done, bad = 0, 0
    while True:
        process = start(arguments, out)
        try:
            code = process.wait(rng.uniform(0.0, most) if done < kills else None)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            done += 1
            continue
        bad += code != 0
        if code == 0 or bad > kills:
            return done, bad


def contents(folder: Path) -> dict[str, str]:
    """Return the files of a folder: of arrays their hashes, of others that they are there."""
    files = [path for path in folder.rglob("*") if path.is_file() and "events.out" not in path.name]
    return {str(path.relative_to(folder)): _hash(path) if path.suffix in _ARRAYS else "" for path in files}


def _hash(path: Path) -> str:
    """Of weights the arrays alone: the note beside them says how long it took."""
    if path.suffix != ".safetensors":
        return file_hash(path)
    arrays = load_file(path)
    return content_hash(*(part for name in sorted(arrays) for part in (name, arrays[name])))


class Kills(Script):
    """Runs, kills, compares.

    Attributes:
        work: an empty folder.
        arguments: of dexgrasp, without --out.
    """

    kills: Count = 20
    seed: Natural = 0
    work: Folder
    arguments: Argument[tuple[str, ...]]

    def run(self) -> int:
        self.work.mkdir(parents=True, exist_ok=True)
        whole, rng = self.work / "whole", np.random.default_rng(self.seed)
        began = time.monotonic()
        if start(self.arguments, whole).wait() != 0:
            raise InputError(f"the command fails by itself: see {whole.with_suffix('.log')}")
        most, expected, kills, bad, other = time.monotonic() - began, contents(whole), 0, 0, set[str]()
        for run in itertools.count():
            if kills >= self.kills or bad:
                break
            part = self.work / f"killed-{run}"
            more, failed = killed(self.arguments, part, self.kills - kills, most, rng)
            kills, bad, found = kills + more, bad + failed, contents(part)
            other |= {
                name for name in expected.keys() | found.keys() if expected.get(name) != found.get(name)
            }
        print(
            f"killed {kills} times, {run} runs, {bad} starts ended badly, {len(other)} of {len(expected)} files differ"
        )
        print(*sorted(other), sep="\n")
        return int(bool(other or bad))


if __name__ == "__main__":
    sys.exit(run_script(Kills))
