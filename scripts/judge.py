"""Try the judge: grasp files that `verify` must refuse, and good ones that it must accept.

    python scripts/judge.py mutate OUT              plans six grasps, then changes every field in turn (--files: those)
    python scripts/judge.py relabel GRASP.json ...  calls each object by every other's name, as a cheat would
    python scripts/judge.py honest OUT              grasps of full clouds, one view, whole scans: 99 of 100 must pass

`mutate` changes numbers by 1 % and 10 %, set-points by 0.05 rad as well, words and truth values; of long arrays the
first, the last and some random rows. Changes smaller than what the field can mean (`SMALL`; docs/grasp-file.md says
why) are counted apart. `relabel` states name, source, hash and hull offset of the other object truly, with `pose` as it
was (kept) or moved until the object stands on the table under the planned hull's centre (standing). `honest` goes on
where it stopped. Each exits with 1 where the judge is wrong.
"""

import copy
import json
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import gymnasium as gym
import numpy as np
import trimesh
from crowded_clouds import run
from tqdm import tqdm

import dexgrasp_env  # noqa: F401  (registers the environment)
from dexgrasp.cli.command import Argument, File, Folder, Script
from dexgrasp.cli.commands import run_script
from dexgrasp.evaluation.evaluate import evaluate
from dexgrasp.evaluation.settings import EvaluationSettings
from dexgrasp.grasp.file import read_grasp, record_of, write_grasp
from dexgrasp.grasp.identity import ObjectIdentity
from dexgrasp.grasp.planned_record import grasp_json
from dexgrasp.grasp.record import GraspRecord
from dexgrasp.grasp.verify.check import Check
from dexgrasp.grasp.verify.verify import PARTS, UNEXECUTED, verify
from dexgrasp.planning.scene_setup import Subject, subject_of
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.objects.load import load_object, resolve_targets
from dexgrasp_env.objects.model import ObjectModel
from dexgrasp_env.perception.cloud import gather
from dexgrasp_env.robot.camera import Camera, CameraIntrinsics
from dexgrasp_env.valid import Count, Natural, one_of

FREE = ("schema", "seed", "version", "versions", "created", "seconds", "planning_seconds", "agent")
"""Fields that say where a file comes from; no physics hangs on them."""
SETPOINTS = (
    "q",
    "pregrasp",
    "grasp",
    "squeeze",
    "script.approach.setpoints",
    "script.lift.setpoints",
    "table_height",
)
"""Fields that are changed by 0.05 rad or m as well; shares of 0 are no change."""
SMALL = {
    "q": 2e-4, "grasp": 1e-6, "pregrasp": 1e-6, "squeeze": 1e-6, "script.approach.setpoints": 2.5e-3,
    "script.lift.setpoints": 4e-3, "script.approach.times": 1e-9, "script.lift.times": 1e-9,
    "script.approach.measure": 1e-8, "script.lift.measure": 2e-6, "script.lift_height": 5e-4, "parts": 5e-4,
    "T_world_object": 1e-6, "hull_offset": 2e-6, "centre": 2e-6, "contacts.point": 2e-6, "contacts.normal": 1e-5,
    "contacts.force": 2e-3, "certificate.distances_cm": 2e-4, "certificate.force_ratio_percent": 1e-3,
    "certificate.torque_ratio_percent": 1e-3, "certificate.closure_residual": 1e-6, "certificate.hold_residual": 1e-4,
    "certificate.min_clearance_m": 8e-3, "certificate.max_joint_torque_fraction": 1e-5,
    "certificate.closure_margin": 2e-4, "certificate.load": 5e-3, "certificate.capacity": 1e-2,
}  # fmt: skip
"""Changes up to these, in the field's unit, are below what it can mean or what two ways of computing it agree to."""
PLANNED = ("pear", "sugar_box", "tomato_soup_can", "tetrahedron", "mustard_bottle", "lego")
OBJECTS = ("all20", "varied-0..19")
EXECUTED = [part for part in PARTS if part not in UNEXECUTED]  # dear: asked only of what the others pass


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
        if field in SETPOINTS:
            for shift in (0.05, -0.05):
                yield Mutation(path, f"{shift:+}", 0.05, value + shift, field)


def is_accepted(content: dict[str, Any], mutation: Mutation) -> bool:
    """Return the judge's answer to a file with one change."""
    changed = copy.deepcopy(content)
    target: Any = changed
    for key in mutation.path[:-1]:
        target = target[key]
    target[mutation.path[-1]] = mutation.value
    try:
        record = record_of(changed)
        return not any(failing(verify(record, parts)) for parts in (UNEXECUTED, EXECUTED))
    except InputError:
        return False


def failing(checks: Any) -> list[str]:
    """Return the names of the checks that do not hold."""
    return [check.name for check in checks if not check.holds]


def matters(mutation: Mutation) -> bool:
    """Return True for a change larger than the tolerance of its field."""
    return mutation.size == 0.0 or mutation.size > SMALL.get(mutation.field, 0.0)


class Mutate(Script):
    """Changes files, prints what passes.

    Attributes:
        out: folder for six new grasps.
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
        rng, bad = np.random.default_rng(self.seed), 0
        for path in self.files or list(_planned(self.out)):
            read_grasp(path)  # says what is wrong with a file that is none
            content = json.loads(path.read_text())
            changes = list(mutations(content, self.rows, rng))
            through = [m for m in tqdm(changes, unit="change", leave=False) if is_accepted(content, m)]
            large = [m for m in through if matters(m)]
            bad += len(large)
            print(f"{path}: {len(changes)} changes, {len(through)} pass, missed {len(large)}")
            for m in large:
                print(f"  MISSED {'.'.join(map(str, m.path))} {m.kind}: {m.size:.3g}")
            small = Counter(m.field for m in through if not matters(m))
            print("  too small: " + ", ".join(f"{field} {count}" for field, count in small.most_common()))
        return int(bad > 0)


def _planned(out: Path) -> Iterator[Path]:
    for seed, name in enumerate(PLANNED):
        run(["plan", name, "--seed", str(seed), "--out", str(out / name)])
        yield out / name / "grasp.json"


def named(record: GraspRecord, model: ObjectModel, source: str, T_world_object: Array) -> GraspRecord:
    """Return a grasp that is said to be of an object that lies at `T_world_object` (4, 4)."""
    told = {"known_mass": record.object.known_mass, "known_centre": record.object.known_centre}
    true = T_world_object[:3, :3] @ model.solid.hull_centre + T_world_object[:3, 3]
    return replace(
        record,
        object=replace(ObjectIdentity.of(model, source), **told),
        T_world_object=T_world_object,
        hull_offset=_hull(record).center_mass - true,
    )


def _hull(record: GraspRecord) -> Any:
    return trimesh.Trimesh(np.concatenate(record.parts), process=False).convex_hull


def standing(record: GraspRecord, model: ObjectModel) -> Array:
    """Return the pose (4, 4), turned as it is, on the table, the hull's centre under the planned one's."""
    assert record.T_world_object is not None
    T = record.T_world_object.copy()
    T[:2, 3] = (_hull(record).center_mass - T[:3, :3] @ model.solid.hull_centre)[:2]
    T[2, 3] = -(model.solid.vertices @ T[2, :3]).min()
    return T


def relabelled(record: GraspRecord, source: str, pose: str) -> dict[str, Check]:
    """Return the checks of the object, by name, where a grasp is called one of `source`."""
    model = load_object(source)
    T = record.T_world_object if pose == "kept" else standing(record, model)
    assert T is not None
    return {c.name: c for c in verify(named(record, model, source, T), ["object"])}


class Relabel(Script):
    """Relabels, and prints what passes; one grasp file an object is wanted."""

    files: Argument[tuple[File, ...]]
    objects: tuple[str, ...] = ("all20",)
    pose: Annotated[str, one_of(("kept", "standing"))] = "kept"

    def run(self) -> int:
        why, passed, count = Counter[str](), 0, 0
        for file in tqdm(self.files):
            record = read_grasp(file)
            if failing(verify(record)):
                print(f"{file.name} is refused as it is")
                continue
            for name in resolve_targets(self.objects):
                if name != record.object.source:
                    failed = failing(
                        relabelled(record, name, self.pose).values()
                    )  # other checks see no object
                    count += 1
                    why.update([*failed, *(f"{name} alone" for name in failed if len(failed) == 1)])
                    if not failed:
                        passed += 1
                        print(f"  PASSED {record.object.name} as {name}")
        by = ", ".join(f"{k} {n}" for k, n in why.most_common())
        print(f"{count} relabelled, {count - passed} refused; by {by}")
        return int(passed > 0)


def scan(target: str, seed: int) -> tuple[Array, Subject]:
    """Return what all cameras measure of a scene, (N, 3) m in the frame of the robot's base, and what stands there."""
    env = gym.make("DexGrasp/Lift-v2", objects=target, obs_mode="depth")
    seen, info = env.reset(seed=seed)
    subject = subject_of(env)
    env.close()
    _, height, width = seen["depth"].shape
    poses = zip(info["perception_T_world_camera"], info["perception_intrinsics"], strict=True)
    cameras = tuple(Camera("", T, CameraIntrinsics(width, height, *lens)) for T, lens in poses)
    return gather(seen["depth"], cameras).points, subject


def plan_scans(folder: Path, count: int, seed: int) -> None:
    """Scan every object `count` times and plan on each scan."""
    for target in tqdm(resolve_targets(OBJECTS), desc="scans"):
        for k in range(count):
            out = folder / f"{target}-{k}"
            if not (out / "answer.json").exists():
                out.mkdir(parents=True, exist_ok=True)
                points, subject = scan(target, seed + k)
                np.save(out / "scan.npy", points)
                _, said = run(
                    ["plan", "--cloud", str(out / "scan.npy"), "--out", str(out), "--seed", str(k), "--json"]
                )
                if (file := out / "grasp.json").exists():
                    model, pose = load_object(target), subject.pose.T_world_object
                    write_grasp(file, grasp_json(named(read_grasp(file), model, target, pose)))
                (out / "answer.json").write_text(said)


class Honest(Script):
    """Plans and verifies.

    Attributes:
        scans: of each object.
    """

    out: Argument[Folder]
    trials: Count = 3
    scans: Count = 2
    seed: Natural = 11

    def run(self) -> int:
        folder, scans, found = self.out / "run", self.out / "scans", {}
        protocols = ("lift", "one_view")
        evaluate(
            EvaluationSettings.of(
                ["bilevel"], OBJECTS, trials=self.trials, seed=self.seed, protocols=protocols
            ),
            folder,
        )
        plan_scans(scans, self.scans, self.seed)
        files = {kind: list(folder.glob(f"grasps/{kind}-*.json")) for kind in protocols}
        for kind, own in (files | {"scans": list(scans.glob("*/grasp.json"))}).items():
            failed = {str(file): failing(verify(read_grasp(file))) for file in tqdm(sorted(own), desc=kind)}
            found[kind] = {
                "grasps": len(own),
                "refused": {file: names for file, names in failed.items() if names},
            }
        print(json.dumps(found, indent=1))
        grasps = [one["grasps"] for one in found.values()]
        return int(100 * sum(len(one["refused"]) for one in found.values()) > sum(grasps) or min(grasps) == 0)


if __name__ == "__main__":
    sys.exit(run_script({"mutate": Mutate, "relabel": Relabel, "honest": Honest}))
