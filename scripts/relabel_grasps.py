"""Call the object of every grasp file by every other's name, and see whether `verify` refuses each.

    python scripts/relabel_grasps.py GRASP.json ... [--objects all20] [--pose kept|standing]

One grasp file an object is wanted. A file is relabelled as a cheat would do it: with the other object's name, source,
hash and the offset of the hulls, so that all that it says of itself is true, with `pose` as it was (`kept`) or
moved until the object stands on the table and its hull's centre under the planned one's (`standing`). Prints what
passes, and how near the shapes are; exit code 1 if anything does.
"""

import sys
from collections import Counter
from dataclasses import replace
from typing import Annotated, Any

import numpy as np
from tqdm import tqdm

from dexgrasp.cli.command import Argument, File, Script
from dexgrasp.cli.commands import run_script
from dexgrasp.grasp.file import read_grasp
from dexgrasp.grasp.identity import ObjectIdentity
from dexgrasp.grasp.record import GraspRecord
from dexgrasp.grasp.verify.check import Check
from dexgrasp.grasp.verify.verify import verify
from dexgrasp_env.arrays import Array
from dexgrasp_env.objects.load import load_object, resolve_targets
from dexgrasp_env.objects.model import ObjectModel
from dexgrasp_env.valid import one_of


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
    import trimesh

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
    """Relabels, prints, returns 1 if anything passes."""

    files: Argument[tuple[File, ...]]
    objects: tuple[str, ...] = ("all20",)
    pose: Annotated[str, one_of(("kept", "standing"))] = "kept"

    def run(self) -> int:
        names, why, passed, count = resolve_targets(self.objects), Counter[str](), [], 0
        for file in tqdm(self.files):
            record = read_grasp(file)
            if any(not check.holds for check in verify(record)):
                print(f"{file.name} is refused as it is")
                continue
            for name in [name for name in names if name != record.object.source]:
                checks = relabelled(record, name, self.pose)  # the other checks see no object: they hold
                failed = [c.name for c in checks.values() if not c.holds]
                count += 1
                why.update(failed)
                if len(failed) == 1:
                    why[f"{failed[0]} alone"] += 1
                if not failed:
                    passed.append((record.object.name, name, checks))
        by = ", ".join(f"{k} {n}" for k, n in why.most_common())
        print(f"{count} relabelled, {count - len(passed)} refused; by {by}")
        for true, name, checks in passed:
            near = ", ".join(f"{c.name} {c.value:.3g}" for c in checks.values() if c.bound[0] in "<>")
            print(f"  PASSED {true} as {name}: {near}")
        return int(bool(passed))


if __name__ == "__main__":
    sys.exit(run_script(Relabel))
