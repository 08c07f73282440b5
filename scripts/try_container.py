"""The Dockerfile without a daemon: its steps in a fresh environment, then what it is for.

    python scripts/try_container.py FOLDER

Commands run in namespaces of their own: as a user without home or name, on a read-only disk, without network, with a
folder of temporary files alone. That takes root and unshare; elsewhere they run as they are, and it is said.
"""

import os
import re
import shlex
import subprocess
import sys
import venv
from pathlib import Path

from dexgrasp.cli.command import Argument, Folder, Script
from dexgrasp.cli.commands import run_script

ROOT = Path(__file__).resolve().parents[1]
INSIDE = "/opt/dexgrasp"
OF_THE_SYSTEM = ("apt-get", "useradd")
VECTOR = (
    "import gymnasium as gym, dexgrasp_env; print(gym.make_vec('DexGrasp/Lift-v2', num_envs=4).reset(seed=0))"
)
COMMANDS = (
    "dexgrasp doctor",
    "dexgrasp demo --no-pictures --out {out}/demo",
    "dexgrasp plan soda --out {out}/soda",
    "dexgrasp evaluate --agents hardcoded --objects sugar_box --trials 1 --out {out}/run",
    f"python -c {shlex.quote(VECTOR)}",
)
"""Beside the entry."""
LOCKED = """
mount --make-rprivate / || exit 77
for place in / {folder}; do mount --bind $place $place && mount -o remount,bind,ro $place || exit 77; done
mount -t tmpfs -o mode=1777 tmpfs {tmp} || exit 77
user="--reuid 10001 --regid 10001 --clear-groups"
setpriv $user env {python} -c "" || user=--bounding-set=-all  # a folder or Python closed to others: root without powers
cd {tmp} && exec setpriv $user env -i {env} sh -c {command}
"""


def instructions(text: str) -> list[tuple[str, str]]:
    """Return the instructions of a Dockerfile: word and rest."""
    lines = re.sub(r"\\\n", " ", text).splitlines()
    return [
        (word, rest)
        for word, _, rest in (line.partition(" ") for line in lines)
        if word and not word.startswith("#")
    ]


def build(folder: Path, steps: list[tuple[str, str]]) -> dict[str, str]:
    """Carry out the steps of a Dockerfile in an environment below `folder`; return the variables that it sets."""
    venv.create(folder / "image", clear=True, with_pip=True)
    known = {"PATH": f"{folder / 'image' / 'bin'}:/usr/bin:/bin"}
    for word, rest in steps:
        there = rest.replace(INSIDE, str(folder / "opt"))
        if word == "ENV":
            known |= dict([there.split("=", 1)])
        elif word == "RUN" and not rest.startswith(OF_THE_SYSTEM):
            print("+", there, flush=True)
            kept = {key: os.environ[key] for key in os.environ if key.startswith("PIP_")}
            subprocess.run(there, shell=True, check=True, cwd=ROOT, env=kept | {"HOME": str(folder)} | known)
    return known


class TryContainer(Script):
    """Builds and tries.

    Attributes:
        folder: an empty one.
    """

    folder: Argument[Folder]

    def run(self) -> int:
        folder = self.folder.resolve()
        folder.mkdir(parents=True, exist_ok=True)
        folder.chmod(0o755)
        steps = instructions((ROOT / "Dockerfile").read_text())
        known, last = build(folder, steps), dict(steps)
        entry = [*_words(last["ENTRYPOINT"]), *_words(last["CMD"])]
        tmp = folder / "tmp"
        tmp.mkdir(exist_ok=True)
        known = {key: str(tmp) if value == "/tmp" else value for key, value in known.items()} | {
            "TMPDIR": str(tmp)
        }
        for command in (shlex.join(entry).replace("/tmp", str(tmp)), *COMMANDS):
            said = self._locked(folder, tmp, command.format(out=tmp), known)
            if "doctor" in command and "beside the code" not in said:
                raise ValueError(f"code compiled in the image is not used:\n{said}")
        return 0

    def _locked(self, folder: Path, tmp: Path, command: str, known: dict[str, str]) -> str:
        """Run a command as a container would; return what it said."""
        print("+", command, flush=True)
        env = " ".join(shlex.quote(f"{key}={value}") for key, value in known.items())
        python = folder / "image" / "bin" / "python"
        script = LOCKED.format(tmp=tmp, folder=folder, env=env, python=python, command=shlex.quote(command))
        done = subprocess.run(
            ["unshare", "-m", "-n", "sh", "-c", script], capture_output=True, text=True, cwd="/", check=False
        )
        if done.returncode == 77 or "unshare" in done.stderr:
            print("no namespaces here: as it is")
            done = subprocess.run(
                command, shell=True, capture_output=True, text=True, env=known, cwd=tmp, check=False
            )
        print(done.stdout[-600:] + done.stderr[-600:], flush=True)
        if done.returncode:
            raise ValueError(f"{command} ended with {done.returncode}")
        return done.stdout


def _words(listed: str) -> list[str]:
    return re.findall(r'"([^"]*)"', listed)


if __name__ == "__main__":
    sys.exit(run_script(TryContainer))
