"""What single constants are worth: the same scenes with one of them halved, and doubled.

    python scripts/vary_constants.py --rooms planning shape motion --objects all20 --trials 2 --out runs/plans.json
    python scripts/vary_constants.py --rooms perception --protocol clutter_dense --out runs/looks.json

Of each constant of `docs/constants.md` in the rooms named: in how many scenes a grasp is found that is certified and
can be carried out, what its load has changed by (weights, at most 6, 0 without a grasp; 95 % interval over the scenes),
how many postures were tried and how much CPU time it took, both as ratios. Of perception, where a point on the object
is named: in how many scenes it is found as `close_objects.py` has it (purity and what is kept above 0.9), and what the
lesser of the two has changed by. What is halved and doubled of a pair is each of its numbers. Constants that compiled
code has built in, and what is made once and kept on disk, are left out. With --carry the grasps are carried out, and
what is lifted and held is counted. A run that was interrupted goes on when the same command is given again, and so
does one that other constants are asked of.
"""

import functools
import importlib
import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Annotated, Any

import numpy as np
from numba.core.registry import CPUDispatcher
from tqdm import tqdm
from varied_scenes import Look, Outcome, Scenes, plans

from dexgrasp.cli.command import File, Script
from dexgrasp.cli.commands import run_script
from dexgrasp.evaluation.protocol import PROTOCOLS
from dexgrasp.planning.settings import PlannerSettings
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import read_json_object, write_json
from dexgrasp_env.objects.catalogue import OBJECT_SETS
from dexgrasp_env.objects.load import Objects
from dexgrasp_env.valid import Count, Natural, one_of

ROOMS = {"planning": "dexgrasp", "shape": "dexgrasp", "motion": "dexgrasp", "perception": "dexgrasp_env"}
"""And the packages they are in."""
SETTINGS = "dexgrasp/planning/settings.py"
FACTORS = (0.5, 2.0)
TABLE = Path(__file__).resolve().parents[1] / "docs" / "constants.md"
KEPT = ("dexgrasp/planning/atlas.py",)
"""Files of what is made once and kept on disk."""


def table(rooms: tuple[str, ...], constants: tuple[str, ...] = ()) -> list[tuple[str, str]]:
    """Return file and name of the constants that `docs/constants.md` has of some rooms, of those named if any are.

    Raises:
        InputError: for a name that is none of theirs.
    """
    found, file = [], ""
    for line in TABLE.read_text().splitlines():
        if line.startswith("## "):
            file = line.strip("# `")
        elif line.startswith("| `") and file.startswith(tuple(f"{ROOMS[room]}/{room}/" for room in rooms)):
            found.append((file, line.split("`")[1]))
    named = [_named(found, each) for each in constants]
    return [each for each in found if any(each in one for one in named)] if named else found


def _named(found: list[tuple[str, str]], constant: str) -> list[tuple[str, str]]:
    """Return those that `FILE`, `NAME` or `FILE.NAME` means, without folder and suffix of the file."""
    file, _, name = constant.rpartition(".")
    meant = [(each, own) for each, own in found if Path(each).stem == file and own == name]
    meant = meant or [(each, own) for each, own in found if constant in {Path(each).stem, own}]
    if not meant:
        raise InputError(
            f"no constant {constant!r} in these rooms: name FILE, NAME or FILE.NAME of {TABLE.name}"
        )
    return meant


def scaled(value: Any, factor: float) -> Any:
    """Return a number, or all of several, times a factor; None for what is none."""
    if isinstance(value, bool):
        return None
    if isinstance(value, int):
        return max(1, round(value * factor))
    if isinstance(value, float):
        return value * factor
    if isinstance(value, np.ndarray) and value.dtype.kind == "f":
        return value * factor
    if isinstance(value, tuple):
        parts = tuple(scaled(part, factor) for part in value)
        return None if None in parts else parts
    return None


@contextmanager
def changed(module: ModuleType, name: str, value: Any) -> Iterator[None]:
    """Have a constant another value: in its module, where it is imported to, and in defaults of arguments."""
    old, places = getattr(module, name), _places(module, name)
    functions = [one for place in places for one in _functions(place)]
    defaults = [(one, one.__defaults__) for one in functions if one.__defaults__]
    try:
        for place in places:
            setattr(place, name, value)
        for one, own in defaults:
            one.__defaults__ = tuple(value if each is old else each for each in own or ())
        _forget(places)
        yield
    finally:
        for place in places:
            setattr(place, name, old)
        for one, own in defaults:
            one.__defaults__ = own
        _forget(places)


def _places(module: ModuleType, name: str) -> list[ModuleType]:
    """Return the modules that have a constant: its own, and where it is imported to."""
    if name.startswith("_"):
        return [module]
    ours = [each for key, each in sys.modules.items() if key.startswith("dexgrasp")]
    return [each for each in ours if vars(each).get(name) is getattr(module, name)]


def _functions(module: ModuleType) -> Iterator[FunctionType]:
    for each in vars(module).values():
        if isinstance(each, FunctionType) and each.__module__ == module.__name__:
            yield each
        elif isinstance(each, type) and each.__module__ == module.__name__:
            yield from (part for part in vars(each).values() if isinstance(part, FunctionType))


def _forget(modules: list[ModuleType]) -> None:
    for module in modules:
        for each in vars(module).values():
            if isinstance(each, functools._lru_cache_wrapper) and each.__module__ == module.__name__:
                each.cache_clear()


def compiled(module: ModuleType, name: str) -> bool:
    """Whether compiled code has a constant built in."""
    values = [value for place in _places(module, name) for value in vars(place).values()]
    kernels = [value for value in values if isinstance(value, CPUDispatcher)]
    return any(name in one.py_func.__code__.co_names for one in kernels)


class Vary(Script):
    """Plans what is missing, and prints.

    Attributes:
        rooms: of the constants.
        constants: these alone, by the names of docs/constants.md: FILE, NAME or FILE.NAME (default: all of the rooms).
        objects: of the scenes.
        trials: scenes of each object.
        seed: of the scenes.
        protocol: that makes the scenes.
        carry: carry the grasps out; without it they are planned alone.
        out: JSON of the outcomes.
    """

    rooms: tuple[Annotated[str, one_of(ROOMS)], ...] = ("planning", "shape", "motion")
    constants: tuple[str, ...] = ()
    objects: Objects = OBJECT_SETS["all20"]
    trials: Count = 2
    seed: Natural = 7000
    protocol: Annotated[str, one_of(PROTOCOLS)] = "lift"
    carry: bool = False
    out: File

    def run(self) -> int:
        wanted: Any = {
            "objects": list(self.objects),
            "trials": self.trials,
            "seed": self.seed,
            "protocol": self.protocol,
            "carry": self.carry,
        }
        kept = read_json_object(self.out, "name another --out") if self.out.is_file() else {}
        if kept and kept["settings"] != wanted:
            print(f"{self.out} is of other scenes: name another --out", file=sys.stderr)
            return 2
        outcomes: dict[str, list[Outcome]] = kept.get("outcomes", {})
        scenes = Scenes(self.objects, self.trials, self.seed, self.protocol)

        def measure(key: str, looks: list[Look], settings: PlannerSettings | None = None) -> None:
            """Measure all scenes, where they have not been."""
            if key not in outcomes:
                outcomes[key] = [look() for look in looks] or plans(scenes, settings, self.carry)
                write_json(self.out, {"settings": wanted, "outcomes": outcomes})

        for file, name in tqdm(table(self.rooms, self.constants), unit="constant"):
            usual = "looks" if "/perception/" in file else "plans"
            keys = [f"{file} {name} x{factor:g}" for factor in FACTORS]
            due = not outcomes.keys() >= {usual, *keys}
            looks = scenes.looks if due and usual == "looks" else []  # made while all is as it is
            measure(usual, looks)
            for key, factor in zip(keys, FACTORS, strict=True):
                self._vary(file, name, factor, functools.partial(measure, key, looks))
            if all(key in outcomes for key in keys):
                compared = {
                    f"x{factor:g}": _compared(outcomes[usual], outcomes[key])
                    for key, factor in zip(keys, FACTORS, strict=True)
                }
                print(json.dumps({"file": file, "name": name, **compared}), flush=True)
        return 0

    @staticmethod
    def _vary(file: str, name: str, factor: float, measure: Callable[..., None]) -> None:
        """Measure with a constant times a factor, if that can be."""
        if file == SETTINGS:
            measure(replace(PlannerSettings(), **{name: scaled(getattr(PlannerSettings(), name), factor)}))
            return
        module = importlib.import_module(file.removesuffix(".py").replace("/", "."))
        value = scaled(getattr(module, name), factor)
        if value is None or file in KEPT or compiled(module, name):
            return
        with changed(module, name, value):
            measure()


def _compared(usual: list[Outcome], varied: list[Outcome]) -> dict[str, Any]:
    """Return what outcomes differ in from the usual ones of the same scenes."""
    a, b = ({key: np.array([one[key] for one in each]) for key in each[0]} for each in (usual, varied))
    gained = b["merit"] - a["merit"]
    away = 1.96 * gained.std(ddof=1) / np.sqrt(len(gained)) if len(gained) > 1 else np.inf
    return {
        "scenes": len(gained),
        "found": int(b["found"].sum()),
        "held": int(b["held"].sum()),
        "usual": [int(a["found"].sum()), int(a["held"].sum())],
        "merit": round(float(gained.mean()), 3),
        "ci95": [round(float(gained.mean() + s), 3) for s in (-away, away)] if np.isfinite(away) else None,
        "tried": round(float(b["tried"].sum() / max(a["tried"].sum(), 1.0)), 2),
        "seconds": round(float(b["seconds"].sum() / a["seconds"].sum()), 2),
        "same": bool(all((a[key] == b[key]).all() for key in ("merit", "tried", "held"))),
    }


if __name__ == "__main__":
    sys.exit(run_script(Vary))
