"""Fuzz the commands with damaged arguments, meshes, clouds, grasp files and runs: exit codes 0 to 3, physical objects.

    python scripts/fuzz.py [--count 10000] [--seed 0] [--kinds cloud mesh] [--out out/fuzz]

Hypothesis draws the cases from --seed, shrinks what fails, and keeps it under OUT: the next run begins with it. Cases
go through `main(argv)` in this process; one that ends it or hangs is in OUT/case. A mesh that is accepted must have the
inertia and the volume of a body. Exits with 1 if anything failed.
"""

import contextlib
import copy
import faulthandler
import json
import os
import shutil
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random
from typing import Annotated, Any

import hypothesis
import numpy as np
import trimesh
import yaml
from clouds import run
from hypothesis import HealthCheck, strategies
from hypothesis.database import DirectoryBasedExampleDatabase

from dexgrasp.cli.command import Folder, Script
from dexgrasp.cli.commands import run_script
from dexgrasp.cli.main import main
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.objects.load import load_object
from dexgrasp_env.valid import Count, Natural, one_of

LONGEST = 300.0  # s a case may take on a busy machine: more is a hang
ALLOWED = (0, 1, 2, 3)
EVALUATE = "evaluate --agents random hardcoded --objects sugar_box --trials 2 --out"
COMPARE, REPLAY = "compare run random hardcoded", "replay run --agent random --object sugar_box --trial 0"
_WORDS = yaml.safe_load(Path(__file__).with_name("fuzz.yaml").read_text())


def damaged(draw: Random, data: bytes) -> bytes:
    """Return bytes with pieces left out, repeated or overwritten, short ones mostly."""
    raw = bytearray(data)
    for _ in range(draw.randint(1, 4)):
        at, size = draw.randint(0, len(raw)), draw.choice((1, 4, 30, 300))
        piece, noise = bytes(raw[at : at + size]), draw.randbytes(size)
        raw[at : at + size] = draw.choice(
            (b"", piece * 2, noise, b"\xff" * 4, b"\0" * 4, b"nan ", b"1e99", b"-1 \n")
        )
    return bytes(raw)


def damaged_json(draw: Random, text: bytes) -> bytes:
    """Return JSON with some values changed, or its text."""
    if draw.randint(0, 4) == 0:
        return damaged(draw, text)
    content = json.loads(text)
    for _ in range(draw.randint(1, 3)):
        holder, key = draw.choice([({0: content}, 0), *_places(content)])
        if type(holder[key]) in (int, float) and draw.randint(0, 1):
            holder[key] *= draw.choice((0.0, -1.0, 1.01, 1e3, 1e-9, 1e200))
        elif draw.randint(0, 3) == 0:
            del holder[key]
        else:
            holder[key] = copy.deepcopy(draw.choice(_WORDS["strange"]))
    return json.dumps(content).encode()


def _places(content: Any) -> Iterator[tuple[Any, Any]]:
    """Yield every (container, key) of a tree."""
    for key, value in enumerate(content) if isinstance(content, list) else getattr(content, "items", tuple)():
        yield content, key
        yield from _places(value)


# -- cases: each writes its files, from the good ones, to the current folder, and returns arguments ------------------


def _arguments(draw: Random, good: Path) -> list[str]:
    words = draw.choice(_WORDS["commands"]).split() or [""]
    for _ in range(draw.randint(1, 3)):
        at = draw.randint(1, len(words))
        words[at : at + draw.randint(0, 1)] = [draw.choice([*_WORDS["words"], "9" * 5000])]
    return words


MOVES: tuple[Callable[[Array, np.random.Generator], Array], ...] = (
    lambda points, rng: np.where(
        rng.random(points.shape) < 0.01, rng.choice([np.nan, np.inf, 1e300]), points
    ),
    lambda points, rng: points + rng.normal(0.0, 10 ** rng.uniform(-5.0, -1.5), points.shape),
    lambda points, rng: points * rng.choice([1e-6, 0.01, 1e3, 1e6]),
    lambda points, rng: points * rng.choice([-1.0, 0.0, 1.0], 3) + rng.uniform(-1.0, 1.0, 3),
    lambda points, rng: points[rng.random(len(points)) < rng.uniform()],
    lambda points, rng: np.concatenate([points, points[: rng.integers(len(points) + 1)][..., ::-1]]),
)
"""What happens to points (N, 3) and triangles (N, 3, 3): not finite, noisy, of another unit, flat, few, doubled."""


def _moved(draw: Random, points: Array) -> Array:
    rng = np.random.default_rng(draw.getrandbits(32))
    for _ in range(draw.randint(0, 3)):
        points = draw.choice(MOVES)(points, rng)
    return points


def _mesh(draw: Random, good: Path) -> list[str]:
    solid = draw.choice((trimesh.creation.box((0.06, 0.08, 0.1)), trimesh.creation.torus(0.05, 0.015, 16, 8)))
    triangles = _moved(draw, solid.triangles)
    path = Path(f"thing.{draw.choice(('obj', 'stl', 'ply', 'glb', 'off', '3mf'))}")
    try:
        trimesh.Trimesh(**trimesh.triangles.to_kwargs(triangles), process=False).export(path)
    except Exception:  # what cannot be written is a fault of the input, not of the reader
        path.write_bytes(b"")
    if draw.randint(0, 3) == 0:
        path.write_bytes(damaged(draw, path.read_bytes()))
    return ["plan" if draw.randint(0, 24) == 0 else "doctor", str(path)]


def _cloud(draw: Random, good: Path) -> list[str]:
    rng = np.random.default_rng(draw.getrandbits(32))
    table = rng.uniform([0.25, -0.45, -0.002], [0.80, 0.45, 0.002], (6000, 3))
    solid = trimesh.creation.box(rng.uniform(0.02, 0.15, 3)).sample(2000, seed=0)
    points = _moved(draw, np.concatenate([table, solid - [-0.5, 0.0, solid[:, 2].min()]]))
    np.save("cloud.npy", points)
    count = len(points)
    masks = (rng.integers(-1, 4, count), np.zeros(count, bool), np.ones(3, bool), np.array("mask"))
    np.save("mask.npy", draw.choice(masks))
    at = draw.choice(("0.5 0 0.05", "9 0 nan"))
    ways = (
        "", "--objects", f"--object-near {at}", f"--box {at} 0.6 0.1 0.15",
        f"--mask mask.npy --label {draw.randint(-1, 4)}",
    )  # fmt: skip
    return f"plan --cloud cloud.npy {draw.choice(ways)} --json".split()


def _grasp(draw: Random, good: Path) -> list[str]:
    Path("grasp.json").write_bytes(damaged_json(draw, (good / "grasp" / "grasp.json").read_bytes()))
    return ["verify", "grasp.json"]


def _run(draw: Random, good: Path) -> list[str]:
    folder = shutil.copytree(good / "run", Path("run"))
    path = folder / draw.choice(("trials.jsonl", "trials.jsonl", "trials.jsonl", "run.json", "summary.json"))
    if path.suffix == ".jsonl" and draw.randint(0, 4):
        lines = path.read_bytes().splitlines()
        at = draw.randint(0, len(lines) - 1)
        lines[at] = damaged_json(draw, lines[at])
        path.write_bytes(b"\n".join(lines) + b"\n")
    else:
        path.write_bytes(damaged(draw, path.read_bytes()))
    return draw.choice((COMPARE, COMPARE, COMPARE, "report run", f"{EVALUATE} run", REPLAY)).split()


KINDS = {
    "arguments": (40, _arguments), "mesh": (15, _mesh), "grasp": (20, _grasp), "run": (15, _run), "cloud": (10, _cloud),
}  # fmt: skip
"""Kind -> share of the cases, and what writes a case."""


def unphysical(path: str) -> str | None:
    """Return what is impossible of a mesh that was accepted."""
    model = load_object(path)
    moments = np.linalg.eigvalsh(model.inertia)
    if not moments[0] > 0 or moments[0] + moments[1] < moments[2] * (1 - 1e-6):
        return f"inertia {moments.tolist()} is not that of a body"
    inside = 0 < model.mesh.volume <= 1.001 * model.mesh.convex_hull.volume
    return None if inside else f"volume {model.mesh.volume:.3g} m3 is not within the hull's"


def prepare(good: Path) -> None:
    """Make the good inputs that cases are damaged from: a grasp and an evaluation."""
    steps = {"grasp/grasp.json": "plan pear --seed 1 --out", "run/summary.json": EVALUATE}
    for made, words in steps.items():
        if not (good / made).exists() and main([*words.split(), str((good / made).parent)]) != 0:
            raise InputError(f"cannot prepare {made}")


def fuzz(kind: str, count: int, seed: int, good: Path, out: Path, codes: Counter[str]) -> None:
    """Try cases of a kind; raise what the simplest says of those that failed."""
    here, examples = out / "case", DirectoryBasedExampleDatabase(out / "examples")

    @hypothesis.seed(seed)
    @hypothesis.settings(
        max_examples=count, deadline=None, database=examples, suppress_health_check=list(HealthCheck)
    )
    @hypothesis.given(strategies.randoms(use_true_random=False))
    def case(draw: Random) -> None:
        shutil.rmtree(here, ignore_errors=True)
        here.mkdir(parents=True)
        with contextlib.chdir(here):
            argv = KINDS[kind][1](draw, good)
            faulthandler.dump_traceback_later(LONGEST, exit=True)
            code, said = run(*argv)
            faulthandler.cancel_dump_traceback_later()
            fault = unphysical(argv[1]) if argv[0] == "doctor" and kind == "mesh" and code == 0 else None
        codes[f"{kind} {code}"] += 1
        if code not in ALLOWED or fault:
            raise AssertionError(f"{argv}: {code}: {fault or said[-1500:]}")

    case()


class Fuzz(Script):
    """Fuzz each kind of input; exit code 1 if a case failed."""

    count: Count = 10_000
    seed: Natural = 0
    kinds: tuple[Annotated[str, one_of(KINDS)], ...] = tuple(KINDS)
    out: Folder = Path("out/fuzz")

    def run(self) -> int:
        out = self.out.resolve()
        os.environ["DEXGRASP_CACHE"] = str(out / "cache")  # cases damage it
        prepare(out / "good")
        codes, failed, whole = Counter[str](), 0, sum(KINDS[kind][0] for kind in self.kinds)
        for kind in self.kinds:
            try:
                fuzz(kind, -(-self.count * KINDS[kind][0] // whole), self.seed, out / "good", out, codes)
            except Exception as fault:
                failed += 1
                print(f"FAILED {kind}: {fault}", file=sys.stderr)
        print("\n".join(f"{name:<16} {number}" for name, number in sorted(codes.items())))
        return int(failed > 0)


if __name__ == "__main__":
    sys.exit(run_script(Fuzz))
