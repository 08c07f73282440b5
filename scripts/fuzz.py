"""Damaged input of every kind through every command: exit codes 0 to 3, no traceback, no unphysical object.

    python scripts/fuzz.py [--count 10000] [--seed 0] [--kinds cloud mesh] [--log out/fuzz.jsonl]

Every case follows from --seed, --kinds and its number alone; a run that was interrupted goes on, and tries again what
failed. Cases go through `main(argv)` in a process that lives on from case to case. A mesh that is accepted must have a
physical inertia, and extents within 5 % of its file's or a note that says why not. Files of cases that failed are kept
beside the log. Exits with 1 if anything failed.
"""

import contextlib
import io
import json
import multiprocessing
import os
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import fuzz_inputs as inputs
import numpy as np
from fuzz_clouds import odd_cloud, odd_pointing
from numpy.random import Generator
from tqdm import tqdm

from dexgrasp.cli.command import File, Script
from dexgrasp.cli.commands import run_script
from dexgrasp.runs.lines import Lines
from dexgrasp_env.assets import asset_path
from dexgrasp_env.errors import InputError
from dexgrasp_env.valid import Count, Natural, one_of

LONGEST = 300.0  # s a case may take on a busy machine: more is a hang
ALLOWED = (0, 1, 2, 3)
EVALUATE = ["evaluate", "--agents", "random", "hardcoded", "--objects", "sugar_box", "--trials", "2", "--out"]


class Case(NamedTuple):
    """Arguments of a command; the mesh that it accepts or refuses; a seed by which the cache is damaged, then again."""

    argv: list[str]
    mesh: Path | None = None
    scale: float = 1.0
    cache_seed: int | None = None


def prepare(folder: Path) -> None:
    """Make the good inputs that cases are damaged from: a grasp, an evaluation, a dataset, a checkpoint."""
    from dexgrasp.cli.main import main

    dataset = [
        "dataset",
        "generate",
        "--objects",
        "tomato_soup_can",
        "--grasps-per-pose",
        "4",
        "--chunk",
        "2",
        "--out",
    ]
    steps = {
        "grasp/grasp.json": [*["plan", "pear", "--seed", "1", "--out"], str(folder / "grasp")],
        "run/summary.json": [*EVALUATE, str(folder / "run")],
        "data/manifest.json": [*dataset, str(folder / "data")],
    }
    for made, argv in steps.items():
        if not (folder / made).exists() and main(argv) != 0:
            raise InputError(f"cannot prepare {made}")
    if not (folder / "ppo.zip").exists():
        _save_checkpoint(folder / "ppo.zip")


def _save_checkpoint(path: Path) -> None:
    import gymnasium as gym
    from stable_baselines3 import PPO

    import dexgrasp_env  # noqa: F401

    env = gym.make("DexGrasp/Lift-v2", objects="sugar_box", obs_mode="state", control_mode="joint_delta")
    PPO("MultiInputPolicy", env, n_steps=8, batch_size=8, device="cpu").save(path)


def _arguments(rng: Generator, good: Path, here: Path) -> Case:
    return Case(inputs.arguments(rng))


def _mesh(rng: Generator, good: Path, here: Path) -> Case:
    path, scale = inputs.mesh_file(here / "thing", rng)
    options = ["--mesh-scale", repr(scale)] if scale != 1.0 else []
    if rng.random() < 0.04:
        return Case(["plan", str(path), *options, "--json"])
    return Case(["doctor", str(path), *options], path, scale)


def _cache(rng: Generator, good: Path, here: Path) -> Case:
    """A mesh that has been seen, and files of the cache damaged since."""
    inputs.block(rng).export(here / "thing.stl")
    return Case(["doctor", str(here / "thing.stl")], here / "thing.stl", cache_seed=int(rng.integers(2**31)))


def _cloud(rng: Generator, good: Path, here: Path) -> Case:
    points, listed = odd_cloud(rng), ["--objects"] if rng.random() < 0.5 else []
    np.save(here / "cloud.npy", points)
    pointed = odd_pointing(points, rng, here)
    return Case(["plan", "--cloud", str(here / "cloud.npy"), *pointed, *listed, "--json"])


def _grasp(rng: Generator, good: Path, here: Path) -> Case:
    content = json.loads((good / "grasp" / "grasp.json").read_text())
    (here / "grasp.json").write_bytes(inputs.change_json(content, rng))
    return Case(["verify", str(here / "grasp.json"), *(["--json"] if rng.random() < 0.5 else [])])


def _run(rng: Generator, good: Path, here: Path) -> Case:
    folder = here / "run"
    shutil.copytree(good / "run", folder)
    path = folder / str(
        rng.choice(["trials.jsonl", "trials.jsonl", "trials.jsonl", "run.json", "summary.json"])
    )
    if rng.random() < 0.1:
        path.unlink()
    elif path.suffix == ".jsonl" and rng.random() < 0.8:
        lines = path.read_bytes().splitlines()
        at = int(rng.integers(len(lines)))
        lines[at] = inputs.change_json(json.loads(lines[at]), rng)
        path.write_bytes(b"\n".join(lines) + b"\n")
    else:
        path.write_bytes(inputs.change_file(path, rng))
    replay = ["replay", str(folder), *["--agent", "random", "--object", "sugar_box", "--trial", "0"]]
    compare, again = ["compare", str(folder), "random", "hardcoded"], [*EVALUATE, str(folder)]
    return Case(
        [compare, ["report", str(folder)], again, replay][int(rng.choice(4, p=[0.6, 0.15, 0.15, 0.1]))]
    )


def _dataset(rng: Generator, good: Path, here: Path) -> Case:
    folder = here / "data"
    shutil.copytree(good / "data", folder)
    files = sorted(path for path in folder.rglob("*") if path.suffix in (".npz", ".json"))
    path = files[int(rng.integers(len(files)))] if rng.random() < 0.6 else folder / "manifest.json"
    path.write_bytes(inputs.change_file(path, rng))
    return Case(["dataset", "info", str(folder), "--picture", str(here / "p.png")])


def _checkpoint(rng: Generator, good: Path, here: Path) -> Case:
    shutil.copy(good / "ppo.zip", here)
    if rng.random() < 0.9:
        (here / "ppo.zip").write_bytes(inputs.change_zip((here / "ppo.zip").read_bytes(), rng))
    if rng.random() < 0.3:
        note = {"obs_mode": "state", "control_mode": "joint_delta"}
        (here / "ppo.json").write_bytes(inputs.change_json(note, rng))
    name = ("ppo:" if rng.random() < 0.5 else "") + str(here / "ppo.zip")
    return Case(
        ["evaluate", "--agents", name, "--objects", "sugar_box", "--trials", "1", "--out", str(here / "o")]
    )


def _robot(rng: Generator, good: Path, here: Path) -> Case:
    """Files of a robot, or the MJCF of a hand or an arm, one of them damaged."""
    shutil.copytree(asset_path("robot"), here, dirs_exist_ok=True)
    names = ["panda_allegro.yaml", "allegro.yaml", "panda.yaml", "allegro.xml", "panda.xml"]
    damaged = here / str(rng.choice(names))
    damaged.write_bytes(inputs.change_file(damaged, rng))
    robot = str(here / names[0])
    make = ["robot", "make", "--hand", str(here / "allegro.xml"), "--out", str(here / "made.yaml")]
    check, plan = ["robot", "check", robot], ["plan", "pear", "--robot", robot, "--json"]
    return Case([check, plan, make][int(rng.choice(3, p=[0.6, 0.25, 0.15]))])


KINDS = {
    "arguments": (38, _arguments), "mesh": (14, _mesh), "grasp": (18, _grasp), "run": (12, _run), "cloud": (6, _cloud),
    "cache": (4, _cache), "dataset": (5, _dataset), "checkpoint": (3, _checkpoint),
    "robot": (8, _robot),
}  # fmt: skip
"""Kind -> share of the cases, and what writes a case's files: from the good ones, to a folder of its own."""


def run_case(case: Case) -> tuple[int, str]:
    """Run a case; return its exit code, negative for a fault, and the end of what it said."""
    from dexgrasp.cli.main import main

    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        try:
            code = main(case.argv)
            if case.mesh and case.cache_seed is not None:
                _damage_cache(case.cache_seed)
                code = main(["doctor", str(shutil.copy(case.mesh, case.mesh.with_name("again.stl")))])
            fault = unphysical(case.mesh, case.scale) if case.mesh and code == 0 else None
        except BaseException as error:
            return -1, f"{said.getvalue()[-1500:]}escaped: {type(error).__name__}: {error}"
    return (-2, fault) if fault else (code, said.getvalue()[-1500:])


def _damage_cache(seed: int) -> None:
    from dexgrasp_env.files import cache_dir

    rng = np.random.default_rng(seed)
    files = sorted(
        (path for path in cache_dir().rglob("*") if path.is_file()), key=lambda p: p.stat().st_mtime
    )
    for path in files[-3:]:
        path.write_bytes(inputs.change_bytes(path.read_bytes(), rng))


def unphysical(path: Path, scale: float) -> str | None:
    """Return what is impossible of a mesh that was accepted."""
    from dexgrasp_env.objects.load import load_object
    from dexgrasp_env.objects.user_mesh import read_mesh

    model = load_object(path, scale=scale)
    hull, moments = model.mesh.convex_hull, np.linalg.eigvalsh(model.inertia)
    if not moments[0] > 0 or moments[0] + moments[1] < moments[2] * (1 - 1e-6):
        return f"inertia {moments.tolist()} is not that of a body"
    if not 0 < model.mesh.volume <= 1.001 * hull.volume:
        return f"volume {model.mesh.volume:.3g} m3 is not within the hull's"
    if not hull.contains([[0.0, 0.0, 0.0]])[0]:
        return "the centre of mass is outside the hull"
    raw = read_mesh(path)
    off = np.abs(model.extents / (scale * np.ptp(raw.vertices[np.unique(raw.faces)], axis=0)) - 1.0).max()
    told = [note for note in model.notes if not note.startswith(("mass", "split", "turned"))]
    return f"extents are off by {off:.0%} without a note" if off > 0.05 and not told else None


class Worker:
    """A process that runs one case after the other, started again when it dies or hangs."""

    pool: ProcessPoolExecutor | None = None

    def run(self, case: Case, folder: str) -> tuple[int, str]:
        """Return exit code and the end of what was said; negative for what `run_case` says, a crash or a hang."""
        pool = self.pool = self.pool or ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), begin)
        try:
            return pool.submit(answer, case, folder).result(LONGEST)
        except TimeoutError:
            fault = f"no answer after {LONGEST:.0f} s"
        except BrokenProcessPool:
            fault = "the process died"
        for process in [*pool._processes.values()]:
            process.kill()
        self.pool = None
        return -9, fault

    @property
    def memory_mb(self) -> int:
        """Resident memory of the process: cases that leak show in a long run."""
        pids = list(self.pool._processes) if self.pool else []
        pages = sum(int(Path(f"/proc/{pid}/statm").read_text().split()[1]) for pid in pids)
        return pages * os.sysconf("SC_PAGE_SIZE") >> 20


def begin() -> None:
    """Leave out of answers what is the same every time, and slow, and what native code prints."""
    from dexgrasp.cli import doctor

    for name in ("check_versions", "check_rendering", "check_machine"):
        setattr(doctor, name, list)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)


def answer(case: Case, folder: str) -> tuple[int, str]:
    """Run a case in its folder."""
    os.chdir(folder)
    return run_case(case)


def make_case(kind: str, rng: Generator, good: Path, here: Path) -> Case:
    """Write a case's files to `here` and return it."""
    return KINDS[kind][1](rng, good, here)


def fuzz(numbers: list[int], kinds: Sequence[str], seed: int, good: Path, worker: Worker) -> Any:
    """Yield a row for each case."""
    shares = np.array([KINDS[kind][0] for kind in kinds], dtype=float)
    for k in numbers:
        kind = str(np.random.default_rng([seed, k, 1]).choice(kinds, p=shares / shares.sum()))
        with tempfile.TemporaryDirectory() as folder:
            case = make_case(kind, np.random.default_rng([seed, k]), good, Path(folder))
            began = time.perf_counter()
            code, said = worker.run(case, folder)
            seconds = round(time.perf_counter() - began, 2)
            if code not in ALLOWED:
                kept = good.parent / "failed" / f"{kind}-{seed}-{k}"
                shutil.copytree(folder, kept, ignore_dangling_symlinks=True, dirs_exist_ok=True)
        yield {
            "case": k,
            "kind": kind,
            "argv": case.argv,
            "code": code,
            "seconds": seconds,
            "memory_mb": worker.memory_mb,
            "said": said[-1500:],
        }


class Fuzz(Script):
    """Prepares, runs, reports."""

    count: Count = 10_000
    seed: Natural = 0
    kinds: tuple[Annotated[str, one_of(KINDS)], ...] = tuple(KINDS)
    log: File = Path("out/fuzz.jsonl")

    def run(self) -> int:
        good = self.log.resolve().parent / "good"
        good.mkdir(parents=True, exist_ok=True)
        os.environ["DEXGRASP_CACHE"] = str(good / "cache")  # cases damage it
        prepare(good)
        log, own = Lines(self.log, "case", lambda row: None), {"seed": self.seed, "kinds": list(self.kinds)}

        def rows() -> list[dict[str, Any]]:
            """Return what is known of these cases so far."""
            return [row for row in log.rows if own.items() <= row.items() and row["case"] < self.count]

        done = {row["case"] for row in rows() if row["code"] in ALLOWED}
        left = [k for k in range(self.count) if k not in done]
        for row in tqdm(fuzz(left, self.kinds, self.seed, good, Worker()), total=len(left), unit="case"):
            log.append(row | own)
        last = {row["case"]: row for row in rows()}.values()
        for name, number in sorted(Counter(f"{row['kind']} {row['code']}" for row in last).items()):
            print(f"{name:<16} {number}")
        failed = sum(row["code"] not in ALLOWED for row in last)
        print(f"{len(last)} cases, {failed} failed")
        return int(failed > 0)


if __name__ == "__main__":
    sys.exit(run_script(Fuzz))
