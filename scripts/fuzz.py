"""Damaged input of every kind through every command: exit codes 0 to 3, no traceback, no unphysical object.

    python scripts/fuzz.py [--count 10000] [--seed 0] [--kinds cloud mesh] [--out out/fuzz]

Hypothesis draws the cases from --seed, shrinks what fails, and keeps it under OUT: the next run begins with it. Cases
go through `main(argv)` in this process; one that ends it or hangs is in OUT/case. A mesh that is accepted must have a
physical inertia, and extents within 5 % of its file's or a note that says why not. Exits with 1 if anything failed.
"""

import contextlib
import copy
import faulthandler
import io
import json
import os
import re
import shutil
import sys
import zipfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import hypothesis
import numpy as np
import trimesh
import yaml
from fuzz_shapes import Rng, cloud_of, mesh_of, target_options
from hypothesis import HealthCheck, strategies
from hypothesis.database import DirectoryBasedExampleDatabase

from dexgrasp.cli.command import Folder, Script
from dexgrasp.cli.commands import run_script
from dexgrasp.cli.main import main
from dexgrasp_env.assets import asset_path
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import cache_dir
from dexgrasp_env.valid import Count, Natural, one_of

LONGEST = 300.0  # s a case may take on a busy machine: more is a hang
ALLOWED = (0, 1, 2, 3)
EVALUATE = str.split("evaluate --agents random hardcoded --objects sugar_box --trials 2 --out")
STRANGE = [
    None, True, False, 0, -1, 1, 2**31, 2**63, -(2**70), 0.5, -0.0, 1e-300, 1e308, -1e9, float("nan"), float("inf"),
    "", " ", "x", "\x00", "é\u2603", "../../up", "/", "~nosuchuser/x.obj", "a" * 300, "\udcff", [], {}, [[]],
    [1, "2"], {"a": 1},
]  # fmt: skip
WORDS = str.split("""pear sugar_box seen all20 bilevel random hardcoded cvae os:system os:nosuch json:loads
    no.such:Agent ppo:x.zip x.zip a:b:c : :: . - -- -1 0 1 3 1e9 nan inf -inf 1e-300 1e308 0.001 0x10 1_0
    ~nosuchuser/x.obj /dev/null /dev/full /proc/self/mem /nowhere/x x.obj é --json --help --seed --out --mesh-scale
    --mesh-mass --friction --mount palm_normal --trials --video failures --protocol lift --agent --agents --objects
    --object --quick --workers --verify""")
COMMANDS = (
    "list objects", "plan pear", "verify x.json", "doctor x.obj", "report runs", "compare runs a b", "", "nosuch",
    "evaluate --agents random --objects pear --trials 1", "replay runs --agent a --object b --trial 0",
    "benchmark nosuch", "dataset info runs", "train cvae --data runs --out runs/t", "demo --no-video",
)  # fmt: skip


class Draw:
    """Choices that hypothesis makes, and shrinks."""

    def __init__(self, data: Any) -> None:
        """Take what `strategies.data()` gives."""
        self._draw = data.draw

    def upto(self, most: int, least: int = 0) -> int:
        """Return a number of `least` to `most`."""
        return int(self._draw(strategies.integers(least, most)))

    def one(self, things: Any) -> Any:
        """Return one of some things."""
        return things[self.upto(len(things) - 1)]

    def rng(self) -> Rng:
        """Return a generator for what is too large to draw."""
        return np.random.default_rng(self.upto(2**32 - 1))

    def bytes(self, data: bytes) -> bytes:
        """Return bytes with pieces left out, repeated or overwritten, short ones mostly."""
        raw = bytearray(data)
        for _ in range(self.upto(4, 1)):
            at, size = self.upto(len(raw)), self.one((1, 4, 30, 300))
            piece = bytes(raw[at : at + size])
            noise = self._draw(strategies.binary(max_size=size))
            raw[at : at + size] = self.one(
                (b"", piece * 2, noise, b"\xff" * 4, b"\0" * 4, b"nan ", b"1e99", b"-1 \n")
            )
        return bytes(raw)

    def tree(self, content: Any) -> bytes:
        """Return a tree as JSON with some values changed, or its text."""
        content, way = copy.deepcopy(content), self.upto(19)
        if way < 3:
            return self.bytes(json.dumps(content).encode())
        if way == 3:
            return bytes(self.one((b"[" * 100_000, b'{"a":' * 50_000, b"9" * 5000, b'"\xff"', b"")))
        for _ in range(self.upto(3, 1)):
            if not (places := list(_places(content))):
                break
            holder, key = self.one(places)
            value, way = holder[key], self.upto(3)
            if way == 0:
                del holder[key]
            elif way == 1 and type(value) in (int, float):
                holder[key] = value * self.one((0.0, -1.0, 1.01, 2.0, 1e3, 1e-9, 1e200))
            else:
                holder[key] = copy.deepcopy(self.one(STRANGE))
        return json.dumps(content).encode()

    def file(self, path: Path) -> bytes:
        """Return the content of a file, changed as what it is or as bytes."""
        content = path.read_bytes()
        if self.upto(3) == 0:
            return self.bytes(content)
        if path.suffix in (".json", ".yaml"):
            return self.tree(yaml.safe_load(content))  # JSON is YAML
        if path.suffix == ".xml":
            start, end = self.one([found.span(1) for found in re.finditer(rb'"([^"]*)"', content)])
            return content[:start] + str(self.one(STRANGE)).encode("utf-8", "replace") + content[end:]
        return self.archive(content) if path.suffix in (".npz", ".zip") else self.bytes(content)

    def archive(self, content: bytes) -> bytes:
        """Return a zip with an entry changed, empty or left out."""
        out = io.BytesIO()
        with zipfile.ZipFile(io.BytesIO(content)) as old, zipfile.ZipFile(out, "w") as new:
            chosen, way = self.one(old.namelist()), self.upto(3)
            for name in old.namelist():
                if name != chosen or way:
                    entry = old.read(name)
                    new.writestr(name, entry if name != chosen else b"" if way == 1 else self.bytes(entry))
        return out.getvalue()


def _places(content: Any, depth: int = 0) -> Iterator[tuple[Any, Any]]:
    """Yield every (container, key) of a tree, outer ones more often than their share."""
    items = enumerate(content) if isinstance(content, list) else getattr(content, "items", tuple)()
    for key, value in items:
        yield from [(content, key)] * (3 if depth < 2 else 1)
        yield from _places(value, depth + 1)


# -- cases: each writes its files, from the good ones, to a folder of its own, and returns arguments -----------------


def _arguments(draw: Draw, good: Path, here: Path) -> list[str]:
    words = draw.one(COMMANDS).split() or [""]
    for _ in range(draw.upto(3, 1)):
        at = draw.upto(len(words), 1)
        words[at : at + draw.upto(1)] = [draw.one([*WORDS, "", " ", "\n", "9" * 5000, "a" * 300, "\udcff"])]
    return words


def _mesh(draw: Draw, good: Path, here: Path) -> list[str]:
    path, scale = mesh_of(draw, here / "thing")
    plans = draw.upto(24) == 0
    return [
        "plan" if plans else "doctor",
        str(path),
        *(["--mesh-scale", repr(scale)] if scale != 1.0 else []),
    ]


def _cache(draw: Draw, good: Path, here: Path) -> list[str]:
    """A mesh that has been seen, and files of the cache damaged since."""
    first, again = here / "first.stl", here / "again.stl"
    trimesh.creation.box([0.04, 0.05 + 0.01 * draw.upto(11), 0.06]).export(first)
    answered(["doctor", str(first)])
    files = [path for path in cache_dir().rglob("*") if path.is_file()]
    for path in sorted(files, key=lambda path: path.stat().st_mtime)[-3:]:
        path.write_bytes(draw.bytes(path.read_bytes()))
    return ["doctor", str(shutil.copy(first, again))]


def _cloud(draw: Draw, good: Path, here: Path) -> list[str]:
    points = cloud_of(draw)
    np.save(here / "cloud.npy", points)
    listed = ["--objects"] if draw.upto(1) else []
    return [
        "plan",
        "--cloud",
        str(here / "cloud.npy"),
        *target_options(draw, points, here),
        *listed,
        "--json",
    ]


def _grasp(draw: Draw, good: Path, here: Path) -> list[str]:
    (here / "grasp.json").write_bytes(draw.tree(json.loads((good / "grasp" / "grasp.json").read_text())))
    return ["verify", str(here / "grasp.json")]


def _run(draw: Draw, good: Path, here: Path) -> list[str]:
    folder = Path(shutil.copytree(good / "run", here / "run"))
    path = folder / draw.one(("trials.jsonl", "trials.jsonl", "trials.jsonl", "run.json", "summary.json"))
    if path.suffix == ".jsonl" and draw.upto(4):
        lines = path.read_bytes().splitlines()
        at = draw.upto(len(lines) - 1)
        lines[at] = draw.tree(json.loads(lines[at]))
        path.write_bytes(b"\n".join(lines) + b"\n")
    else:
        path.write_bytes(draw.file(path))
    compare, report = ["compare", str(folder), "random", "hardcoded"], ["report", str(folder)]
    replay = ["replay", str(folder), *str.split("--agent random --object sugar_box --trial 0")]
    return list(draw.one((compare, compare, compare, report, [*EVALUATE, str(folder)], replay)))


def _dataset(draw: Draw, good: Path, here: Path) -> list[str]:
    folder = Path(shutil.copytree(good / "data", here / "data"))
    path = draw.one(sorted(path for path in folder.rglob("*") if path.suffix in (".npz", ".json")))
    path.write_bytes(draw.file(path))
    return ["dataset", "info", str(folder)]


def _checkpoint(draw: Draw, good: Path, here: Path) -> list[str]:
    (here / "ppo.zip").write_bytes(draw.file(good / "ppo.zip"))
    if draw.upto(2) == 0:
        (here / "ppo.json").write_bytes(draw.tree({"obs_mode": "state", "control_mode": "joint_delta"}))
    name = draw.one(("ppo:", "")) + str(here / "ppo.zip")
    return [
        "evaluate",
        "--agents",
        name,
        *str.split("--objects sugar_box --trials 1 --out"),
        str(here / "o"),
    ]


def _robot(draw: Draw, good: Path, here: Path) -> list[str]:
    """Files of a robot, or the MJCF of a hand or an arm, one of them damaged."""
    shutil.copytree(asset_path("robot"), here, dirs_exist_ok=True)
    names = ("panda_allegro.yaml", "allegro.yaml", "panda.yaml", "allegro.xml", "panda.xml")
    path = here / draw.one(names)
    path.write_bytes(draw.file(path))
    check, plan = ["robot", "check", str(here / names[0])], ["plan", "pear", "--robot", str(here / names[0])]
    make = ["robot", "make", "--hand", str(here / "allegro.xml"), "--out", str(here / "made.yaml")]
    return list(draw.one((check, check, check, plan, make)))


KINDS = {
    "arguments": (38, _arguments), "mesh": (14, _mesh), "grasp": (18, _grasp), "run": (12, _run), "cloud": (6, _cloud),
    "cache": (4, _cache), "dataset": (5, _dataset), "checkpoint": (3, _checkpoint), "robot": (8, _robot),
}  # fmt: skip
"""Kind -> share of the cases, and what writes a case."""


def answered(argv: list[str]) -> tuple[int, str]:
    """Run a command; return its exit code, -1 if anything escaped, and the end of what it said."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        try:
            code = main(argv)
        except BaseException as error:
            return -1, f"{said.getvalue()[-1500:]}escaped: {type(error).__name__}: {error}"
    return code, said.getvalue()[-1500:]


def unphysical(argv: list[str]) -> str | None:
    """Return what is impossible of a mesh that was accepted."""
    from dexgrasp_env.objects.load import load_object
    from dexgrasp_env.objects.user_mesh import read_mesh

    path, scale = Path(argv[1]), float(argv[3]) if "--mesh-scale" in argv else 1.0
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


def prepare(good: Path) -> None:
    """Make the good inputs that cases are damaged from: a grasp, an evaluation, a dataset, a checkpoint."""
    import gymnasium as gym
    from stable_baselines3 import PPO

    dataset = "dataset generate --objects tomato_soup_can --grasps-per-pose 4 --chunk 2 --out"
    steps = {"grasp/grasp.json": ["plan", "pear", "--seed", "1", "--out"], "run/summary.json": EVALUATE,
             "data/manifest.json": dataset.split()}  # fmt: skip
    for made, argv in steps.items():
        if not (good / made).exists() and main([*argv, str((good / made).parent)]) != 0:
            raise InputError(f"cannot prepare {made}")
    env = gym.make("DexGrasp/Lift-v2", objects="sugar_box", obs_mode="state", control_mode="joint_delta")
    PPO("MultiInputPolicy", env, n_steps=8, batch_size=8, device="cpu").save(good / "ppo.zip")


def fuzz(kind: str, count: int, seed: int, good: Path, out: Path, codes: Counter[str]) -> None:
    """Try cases of a kind; raise what the simplest says of those that failed."""
    here, examples = out / "case", DirectoryBasedExampleDatabase(out / "examples")

    @hypothesis.seed(seed)
    @hypothesis.settings(
        max_examples=count, deadline=None, database=examples, suppress_health_check=list(HealthCheck)
    )
    @hypothesis.given(strategies.data())
    def case(data: Any) -> None:
        shutil.rmtree(here, ignore_errors=True)
        here.mkdir(parents=True)
        argv = KINDS[kind][1](Draw(data), good, here)
        faulthandler.dump_traceback_later(LONGEST, exit=True)
        with contextlib.chdir(here):
            code, said = answered(argv)
        faulthandler.cancel_dump_traceback_later()
        codes[f"{kind} {code}"] += 1
        fault = unphysical(argv) if argv[0] == "doctor" and kind in ("mesh", "cache") and code == 0 else None
        if code not in ALLOWED or fault:
            raise AssertionError(f"{argv}: {code}: {fault or said}")

    case()


class Fuzz(Script):
    """Prepares, runs, reports."""

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
