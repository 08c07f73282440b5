"""Damaged input of every kind through every command: exit codes 0 to 3, no traceback, no unphysical object.

    python scripts/fuzz.py [--count 10000] [--processes 300] [--seed 0] [--log out/fuzz.jsonl]

Every case follows from --seed and its number alone; a run that was interrupted goes on. Cases go through `main(argv)`
in a worker that lives on from case to case, and --processes of them, spread evenly, through the command itself.
Meshes, grasp files, run folders, arguments, caches, datasets and checkpoints take turns. A mesh that is accepted must
have a physical inertia, and extents within 5 % of its file's or a note that says why not. Exits with 1 if anything
failed.
"""

import argparse
import contextlib
import io
import json
import os
import select
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))
import fuzz_inputs as inputs
import numpy as np
from json_log import JsonLog

KINDS = {"arguments": 40, "mesh": 14, "grasp": 20, "run": 12, "cache": 4, "dataset": 6, "checkpoint": 4}
"""Kind -> share of the cases, %."""
PROCESS_KINDS = KINDS | {"arguments": 60, "mesh": 6, "cache": 0, "grasp": 14}
"""The same for those that are processes of their own, which take seconds to start."""
LONGEST = 300.0  # s a case may take on a busy machine: more is a hang
ALLOWED = (0, 1, 2, 3)


def prepare(folder: Path) -> None:
    """Make the good inputs that cases are damaged from: a grasp, an evaluation, a dataset, a checkpoint."""
    from dexgrasp.cli.main import main

    runs = ["evaluate", "--agents", "random", "hardcoded", "--objects", "sugar_box", "--trials", "2"]
    steps = {
        "grasp/grasp.json": ["plan", "pear", "--seed", "1", "--out", str(folder / "grasp")],
        "run/summary.json": [*runs, "--out", str(folder / "run")],
        "data/manifest.json": [
            "dataset", "generate", "--objects", "tomato_soup_can", "--grasps-per-pose", "4", "--chunk", "2",
            "--out", str(folder / "data"),
        ],
    }  # fmt: skip
    for made, argv in steps.items():
        if not (folder / made).exists() and main(argv) != 0:
            raise SystemExit(f"cannot prepare {made}")
    if not (folder / "ppo.zip").exists():
        _checkpoint(folder / "ppo.zip")


def _checkpoint(path: Path) -> None:
    import gymnasium as gym
    from stable_baselines3 import PPO

    import dexgrasp_env  # noqa: F401

    env = gym.make("DexGrasp/Lift-v2", objects="sugar_box", obs_mode="state", control_mode="joint_delta")
    PPO("MultiInputPolicy", env, n_steps=8, batch_size=8, device="cpu").save(path)


def case_argv(
    kind: str, rng: np.random.Generator, good: Path, here: Path
) -> tuple[list[str], dict[str, Any]]:
    """Write a case's files to `here`; return its arguments and what is to be checked of the outcome."""
    return {
        "arguments": _arguments, "mesh": _mesh, "grasp": _grasp, "run": _run, "cache": _cache, "dataset": _dataset,
        "checkpoint": _checkpoint_case,
    }[kind](rng, good, here)  # fmt: skip


Case = tuple[list[str], dict[str, Any]]


def _arguments(rng: np.random.Generator, good: Path, here: Path) -> Case:
    return inputs.arguments(rng), {}


def _mesh(rng: np.random.Generator, good: Path, here: Path) -> Case:
    path, scale = inputs.mesh_file(here / "thing", rng)
    options = ["--mesh-scale", repr(scale)] if scale != 1.0 else []
    if rng.random() < 0.04:
        return ["plan", str(path), *options, "--json"], {}
    return ["doctor", str(path), *options], {"mesh": str(path), "scale": scale}


def _grasp(rng: np.random.Generator, good: Path, here: Path) -> Case:
    content = json.loads((good / "grasp" / "grasp.json").read_text())
    (here / "grasp.json").write_bytes(inputs.change_json(content, rng))
    return ["verify", str(here / "grasp.json"), *(["--json"] if rng.random() < 0.5 else [])], {}


def _run(rng: np.random.Generator, good: Path, here: Path) -> Case:
    folder = here / "run"
    shutil.copytree(good / "run", folder)
    name = str(rng.choice(["trials.jsonl", "trials.jsonl", "trials.jsonl", "run.json", "summary.json"]))
    path = folder / name
    if rng.random() < 0.1:
        path.unlink()
    elif name == "trials.jsonl" and rng.random() < 0.8:
        lines = path.read_bytes().splitlines()
        at = int(rng.integers(len(lines)))
        lines[at] = inputs.change_json(json.loads(lines[at]), rng)
        path.write_bytes(b"\n".join(lines) + b"\n")
    elif name == "trials.jsonl" or rng.random() < 0.5:
        path.write_bytes(inputs.change_bytes(path.read_bytes(), rng))
    else:
        path.write_bytes(inputs.change_json(json.loads(path.read_text()), rng))
    again = [
        "evaluate",
        "--agents",
        "random",
        "hardcoded",
        "--objects",
        "sugar_box",
        "--trials",
        "2",
        "--out",
        str(folder),
    ]
    replay = ["replay", str(folder), "--agent", "random", "--object", "sugar_box", "--trial", "0"]
    choices = [["compare", str(folder), "random", "hardcoded"], ["report", str(folder)], again, replay]
    return choices[int(rng.choice(4, p=[0.6, 0.15, 0.15, 0.1]))], {}


def _cache(rng: np.random.Generator, good: Path, here: Path) -> Case:
    """A mesh that has been seen, and files of the cache damaged since."""
    path = here / "thing.stl"
    inputs.block(rng).export(path)
    return ["doctor", str(path)], {"damage_cache": int(rng.integers(2**31)), "mesh": str(path), "scale": 1.0}


def _dataset(rng: np.random.Generator, good: Path, here: Path) -> Case:
    folder = here / "data"
    shutil.copytree(good / "data", folder)
    files = sorted(path for path in folder.rglob("*") if path.is_file() and path.suffix in (".npz", ".json"))
    path = files[int(rng.integers(len(files)))] if rng.random() < 0.6 else folder / "manifest.json"
    if path.suffix == ".json" and rng.random() < 0.7:
        path.write_bytes(inputs.change_json(json.loads(path.read_text()), rng))
    elif path.suffix == ".npz" and rng.random() < 0.6:
        path.write_bytes(inputs.change_zip(path.read_bytes(), rng))
    else:
        path.write_bytes(inputs.change_bytes(path.read_bytes(), rng))
    return ["dataset", "info", str(folder), "--picture", str(here / "p.png")], {}


def _checkpoint_case(rng: np.random.Generator, good: Path, here: Path) -> Case:
    data = (good / "ppo.zip").read_bytes()
    (here / "ppo.zip").write_bytes(inputs.change_zip(data, rng) if rng.random() < 0.9 else data)
    if rng.random() < 0.3:
        (here / "ppo.json").write_bytes(
            inputs.change_json({"obs_mode": "state", "control_mode": "joint_delta"}, rng)
        )
    name = ("ppo:" if rng.random() < 0.5 else "") + str(here / "ppo.zip")
    return [
        "evaluate",
        "--agents",
        name,
        "--objects",
        "sugar_box",
        "--trials",
        "1",
        "--out",
        str(here / "o"),
    ], {}


def run_here(argv: list[str], checks: dict[str, Any]) -> tuple[int, str]:
    """Run a case through `main` in this process; return its exit code and the end of what it said."""
    from dexgrasp.cli import checks as doctor
    from dexgrasp.cli.main import main

    doctor.check_versions = doctor.check_rendering = doctor.check_machine = (
        lambda: []
    )  # the same every time, and slow
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        try:
            code = main(argv)
            if "damage_cache" in checks:
                _damage_cache(checks["damage_cache"])
                moved = Path(checks["mesh"]).with_name("again.stl")
                shutil.copy(checks["mesh"], moved)
                code = main([argv[0], str(moved)])
        except BaseException as error:
            code = -1
            said.write(f"escaped: {type(error).__name__}: {error}")
    fault = unphysical(checks) if code == 0 and "mesh" in checks else None
    return (-2, fault) if fault else (code, said.getvalue()[-1500:])


def _damage_cache(seed: int) -> None:
    from dexgrasp_env.files import cache_dir

    rng = np.random.default_rng(seed)
    for path in sorted((p for p in cache_dir().rglob("*") if p.is_file()), key=lambda p: p.stat().st_mtime)[
        -3:
    ]:
        path.write_bytes(inputs.change_bytes(path.read_bytes(), rng))


def unphysical(checks: dict[str, Any]) -> str | None:
    """Return what is impossible of a mesh that was accepted."""
    from dexgrasp_env.objects.load import load_object
    from dexgrasp_env.objects.user_mesh import read_mesh

    model = load_object(checks["mesh"], scale=checks["scale"])
    moments = np.linalg.eigvalsh(model.inertia)
    if not moments[0] > 0 or moments[0] + moments[1] < moments[2] * (1 - 1e-6):
        return f"inertia {moments.tolist()} is not that of a body"
    if not 0 < model.mesh.volume <= 1.001 * model.mesh.convex_hull.volume:
        return f"volume {model.mesh.volume:.3g} m3 is not within the hull's"
    if not model.mesh.convex_hull.contains([[0.0, 0.0, 0.0]])[0]:
        return "the centre of mass is outside the hull"
    raw = read_mesh(Path(checks["mesh"]))
    extents = np.ptp(raw.vertices[np.unique(raw.faces)], axis=0) * checks["scale"]
    off = np.abs(model.extents / extents - 1.0).max()
    told = [note for note in model.notes if not note.startswith(("mass", "split", "turned"))]
    return f"extents are off by {off:.0%} without a note" if off > 0.05 and not told else None


class Worker:
    """A process that runs one case after the other, started again when it dies or hangs."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[str] | None = None

    def run(self, argv: list[str], checks: dict[str, Any], cwd: Path) -> tuple[int, str]:
        """Return exit code and the end of what was said; negative for a crash, a hang, or an unphysical object."""
        process = self._process or self._start()
        assert process.stdin
        assert process.stdout
        process.stdin.write(json.dumps({"argv": argv, "checks": checks, "cwd": str(cwd)}) + "\n")
        process.stdin.flush()
        ready, _, _ = select.select([process.stdout], [], [], LONGEST)
        line = process.stdout.readline() if ready else ""
        if line:
            code, said = json.loads(line)
            return code, said
        process.kill()
        self._process = None
        return -9, f"no answer after {LONGEST:.0f} s" if not ready else f"the worker died: {process.wait()}"

    def _start(self) -> "subprocess.Popen[str]":
        self._process = subprocess.Popen(
            [sys.executable, __file__, "--serve"], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip
        return self._process

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()


def serve() -> None:
    """Answer cases from standard input on standard output, until it ends."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what native code prints is no answer
    for line in sys.stdin:
        task = json.loads(line)
        os.chdir(task["cwd"])
        print(json.dumps(run_here(task["argv"], task["checks"])), file=answers, flush=True)


def run_process(argv: list[str], cwd: Path) -> tuple[int, str]:
    """Run a case as a user does."""
    command = [sys.executable, "-m", "dexgrasp.cli.main", *argv]
    try:
        done = subprocess.run(command, capture_output=True, cwd=cwd, timeout=2 * LONGEST, check=False)
    except ValueError as error:  # a zero byte cannot be an argument
        return 2, str(error)
    except subprocess.TimeoutExpired:
        return -9, "no answer"
    return done.returncode, done.stderr.decode(errors="replace")[-1500:]


def fuzz(
    count: int, processes: int, seed: int, log: Path, good: Path, *, progress: bool = True
) -> Counter[str]:
    """Run what is not in the log yet; return how often each exit code came up, by kind."""
    from tqdm import tqdm

    worker, every = Worker(), max(1, count // processes) if processes else count + 1
    with JsonLog(log, "case") as done, tqdm(total=count, disable=not progress, unit="case") as bar:
        for k in range(count):
            if k not in done.rows or done.rows[k]["code"] not in ALLOWED:  # what failed is tried again
                alone = (k + 1) % every == 0
                done.add(_one(k, kind_of(k, seed, alone), seed, None if alone else worker, good))
            bar.update()
    worker.close()
    return Counter(f"{row['kind']} {row['code']}" for row in done.rows.values() if row["case"] < count)


def kind_of(k: int, seed: int, alone: bool) -> str:
    """Return what a case is of."""
    shares = PROCESS_KINDS if alone else KINDS
    weights = np.array(list(shares.values())) / sum(shares.values())
    return str(np.random.default_rng([seed, k, 1]).choice(list(shares), p=weights))


def _one(k: int, kind: str, seed: int, worker: Worker | None, good: Path) -> dict[str, Any]:
    rng = np.random.default_rng([seed, k])
    with tempfile.TemporaryDirectory() as folder:
        argv, checks = case_argv(kind, rng, good, Path(folder))
        began = time.perf_counter()
        code, said = (
            run_process(argv, Path(folder)) if worker is None else worker.run(argv, checks, Path(folder))
        )
        seconds = round(time.perf_counter() - began, 2)
        if code not in ALLOWED:
            _keep(Path(folder), good.parent / "failed" / f"{kind}-{seed}-{k}")
    row = {"case": k, "kind": kind, "process": worker is None, "argv": argv, "code": code, "seconds": seconds}
    return row | {"said": said[-1500:] if code not in ALLOWED else said[-120:]}


def _keep(folder: Path, place: Path) -> None:
    """Keep the files of a case that failed, small as they are."""
    shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(folder, place, ignore_dangling_symlinks=True)


def main() -> int:
    """Prepare, run, report."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--processes", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--log", type=Path, default=Path("out/fuzz.jsonl"))
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.serve:
        serve()
        return 0
    good = args.log.resolve().parent / "good"
    good.mkdir(parents=True, exist_ok=True)
    os.environ["DEXGRASP_CACHE"] = str(good / "cache")  # cases damage it
    prepare(good)
    found = fuzz(args.count, args.processes, args.seed, args.log, good)
    for name, number in sorted(found.items()):
        print(f"{name:<16} {number}")
    failed = sum(number for name, number in found.items() if int(name.split()[1]) not in ALLOWED)
    print(f"{sum(found.values())} cases, {failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
