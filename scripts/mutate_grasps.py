"""Change every field of good grasp files in turn, and see whether `verify` refuses each.

    python scripts/mutate_grasps.py OUT                 plans six grasps into OUT, then changes them
    python scripts/mutate_grasps.py --files a.json ...  changes grasp files that are there

Numbers are changed by +-1 % and +-10 %, set-points by 0.05 rad as well, words and truth values altered, nulls left.
Of long arrays (approach, lift, hull) the first, the last and some random rows are taken (`--rows`). What `verify` lets
pass is listed with the size of the change; changes smaller than what the field can mean (`SMALL`; docs/grasp-file.md
says why) are counted apart. Exit code 1 if a larger one passes.
"""

import copy
import json
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from crowded_clouds import run
from tqdm import tqdm

from dexgrasp.cli.command import Argument, File, Folder, Script
from dexgrasp.cli.commands import run_script
from dexgrasp.grasp.file import read_grasp, record_of
from dexgrasp.grasp.verify.verify import PARTS, verify
from dexgrasp_env.errors import InputError
from dexgrasp_env.valid import Count, Natural

FREE = ("schema", "seed", "version", "versions", "created", "seconds", "planning_seconds", "agent")
"""Fields that say where a file comes from; no physics hangs on them."""
SETPOINTS = ("q", "pregrasp", "grasp", "squeeze", "script.approach.setpoints", "script.lift.setpoints")
SHIFTED = {**dict.fromkeys(SETPOINTS, "rad"), "table_height": "m"}
"""Fields that are changed by 0.05 of their unit as well; shares of 0 are no change."""
SMALL = {
    "q": 2e-4, "grasp": 1e-6, "pregrasp": 1e-6, "squeeze": 1e-6, "script.approach.setpoints": 2.5e-3,
    "script.lift.setpoints": 4e-3, "script.approach.times": 1e-9, "script.lift.times": 1e-9,
    "script.approach.measure": 1e-8, "script.lift.measure": 2e-6, "script.lift_height": 5e-4, "parts": 5e-4,
    "T_world_object": 1e-6, "hull_offset": 2e-6, "centre": 2e-6, "contacts.point": 2e-6, "contacts.normal": 1e-5,
    "contacts.force": 2e-3, "certificate.distances_cm": 2e-4, "certificate.force_ratio_percent": 1e-3,
    "certificate.torque_ratio_percent": 1e-3, "certificate.closure_residual": 1e-6, "certificate.hold_residual": 1e-4,
    "certificate.min_clearance_m": 2e-6, "certificate.max_joint_torque_fraction": 1e-5,
    "certificate.closure_margin": 2e-4, "certificate.load": 5e-3, "certificate.capacity": 1e-2,
}  # fmt: skip
"""Changes up to these, in the field's unit, are below what it can mean or what two ways of computing it agree to."""
OBJECTS = ("pear", "sugar_box", "tomato_soup_can", "tetrahedron", "mustard_bottle", "lego")
_NEAR = {
    "script": ("approach", "lift"), "parts": ("object", "contacts"), "certificate": (
        "object", "contacts", "limits", "clearance", "closure", "forces", "strength"),
    "contacts": ("contacts", "forces", "setpoints"), "thresholds": ("conventions",),
    "q": ("contacts", "limits", "setpoints"),
}  # fmt: skip
"""Where a field is most likely to be missed first: the other parts are asked only if these let it pass."""


class Mutation(NamedTuple):
    """One change: its path, what kind of change, its size in the field's unit (0 for words), and the field's name."""

    path: tuple[str | int, ...]
    kind: str
    size: float
    value: Any
    field: str


def mutations(content: dict[str, Any], rows: int, rng: np.random.Generator) -> Iterator[Mutation]:
    """Yield every change of a file, of `rows` random rows of each long array."""
    for key, value in content.items():
        if key not in FREE:
            yield from _inside(value, (key,), key, rows, rng)


def _inside(
    value: Any, path: tuple[str | int, ...], field: str, rows: int, rng: np.random.Generator
) -> Iterator[Mutation]:
    """Changes of a value and all that it holds; `field` is its path without indices, phases by their names."""
    if isinstance(value, dict):
        name = f".{value['name']}" if "setpoints" in value else ""
        field = field.removesuffix(".phases") + name
        for key, item in value.items():
            yield from _inside(item, (*path, key), f"{field}.{key}", rows, rng)
    elif isinstance(value, list):
        for index in _chosen(len(value), path, rows, rng):
            yield from _inside(value[index], (*path, index), field, rows, rng)
    elif value is not None:
        yield from _changes(path, field, value)


def _chosen(count: int, path: tuple[str | int, ...], rows: int, rng: np.random.Generator) -> list[int]:
    if path[-1] in ("setpoints", "times") or (path[0] == "parts" and len(path) == 2):
        return sorted({0, count - 1, *rng.choice(count, min(rows, count), replace=False).tolist()})
    return list(range(count))


def _changes(path: tuple[str | int, ...], field: str, value: Any) -> Iterator[Mutation]:
    if isinstance(value, bool):
        yield Mutation(path, "not", 0.0, not value, field)
    elif isinstance(value, str):
        yield Mutation(path, "word", 0.0, value + "x", field)
    else:
        for share in (0.01, -0.01, 0.1, -0.1):
            changed = value * (1.0 + share)
            if changed != value:
                yield Mutation(path, f"{100 * share:+.0f} %", abs(changed - value), changed, field)
        if field in SHIFTED:
            for shift in (0.05, -0.05):
                yield Mutation(path, f"{shift:+} {SHIFTED[field]}", 0.05, value + shift, field)


def passes(content: dict[str, Any], mutation: Mutation) -> bool:
    """Whether `verify` accepts a file with one change."""
    changed = copy.deepcopy(content)
    target: Any = changed
    for key in mutation.path[:-1]:
        target = target[key]
    target[mutation.path[-1]] = mutation.value
    near = _NEAR.get(str(mutation.path[0]), ())
    try:
        record = record_of(changed)
        return all(c.holds for c in verify(record, near)) and all(
            c.holds for c in verify(record, [part for part in PARTS if part not in near])
        )
    except InputError:
        return False


def missed(
    content: dict[str, Any], rows: int, rng: np.random.Generator
) -> tuple[Counter[str], list[Mutation]]:
    """Return how many changes there were, refused and passed, and those that passed."""
    counts, through = Counter[str](), []
    for mutation in tqdm(list(mutations(content, rows, rng)), unit="change", leave=False):
        accepted = passes(content, mutation)
        counts["changes"] += 1
        counts["refused"] += not accepted
        if accepted:
            through.append(mutation)
    return counts, through


def matters(mutation: Mutation) -> bool:
    """Whether a change is larger than what its field can mean."""
    return mutation.size == 0.0 or mutation.size > SMALL.get(mutation.field, 0.0)


def _planned(out: Path) -> list[Path]:
    for seed, name in enumerate(OBJECTS):
        run(["plan", name, "--seed", str(seed), "--out", str(out / name)])
    return sorted(out.glob("*/grasp.json"))


class Mutate(Script):
    """Changes files, prints what passes, returns 1 if any of that matters.

    Attributes:
        out: folder for six new grasps and what passed.
        files: grasp files instead.
        rows: random rows of each long array.
    """

    out: Argument[Folder | None] = None
    files: tuple[File, ...] = ()
    rows: Count = 3
    seed: Natural = 0

    def run(self) -> int:
        if not self.files and self.out is None:
            raise InputError("name a folder, or --files")
        rng, total, bad = np.random.default_rng(self.seed), Counter[str](), 0
        for path in self.files or _planned(self.out):
            read_grasp(path)  # says what is wrong with a file that is none
            counts, through = missed(json.loads(path.read_text()), self.rows, rng)
            total += counts
            large = [m for m in through if matters(m)]
            bad += len(large)
            print(
                f"{path}: {dict(counts)}, too small to matter {len(through) - len(large)}, missed {len(large)}"
            )
            for m in large:
                print(f"  MISSED {'.'.join(map(str, m.path))} {m.kind}: {m.size:.3g}")
            small = Counter(m.field for m in through if not matters(m))
            print("  too small: " + ", ".join(f"{field} {count}" for field, count in small.most_common()))
        print(f"all: {dict(total)}, missed {bad}")
        return int(bad > 0)


if __name__ == "__main__":
    sys.exit(run_script(Mutate))
