"""Files of schema 2 (0.2.0), as schema 3 would hold them."""

from itertools import accumulate, pairwise
from typing import Any

from dexgrasp.grasp.conventions import RobotName, conventions
from dexgrasp.grasp.record import APPROACH, LIFT
from dexgrasp_env.arrays import Fields
from dexgrasp_env.robot.cell import SIMULATED, Cell

_CONTACT = ("finger", "point", "normal", "force")


def of_schema_2(old: Fields, cell: Cell) -> Fields:
    """Return the content of a file of schema 2 in schema 3, for a grasp in a cell.

    A file without a cell, or its table, was written before there were others. One for the simulated cell states no
    hash: that of today's robot is taken. Hashes of other cells covered more than the robot, and fit none of today's.

    Raises:
        KeyError, TypeError, ValueError, AttributeError: with what is missing or malformed.
    """
    name, _, version = old.get("cell", SIMULATED).rpartition("-")
    rows = zip(old["finger_order"], old["contacts"], old["normals"], old["forces"], strict=True)
    return old | {
        "cell": name or version,
        "robot": RobotName(name, version) if name else conventions(cell)["robot"],
        "table_height": old.get("table_height", 0.0),
        "parts": _parts(old["hull_vertices"], old.get("part_sizes")),
        "contacts": [dict(zip(_CONTACT, row, strict=True)) for row in rows],
        "neighbours": [],
        "script": None if old["lift"] is None else _script(old["approach"], old["lift"]),
        "holds_probability": None,
    }


def _script(approach: Fields, lift: Fields) -> Fields:
    phases = [
        approach | {"name": APPROACH, "measure": approach["bend"]},
        lift | {"name": LIFT, "measure": lift["stray"]},
    ]
    return {"lift_height": lift["height"], "phases": phases}


def _parts(vertices: list[Any], sizes: list[int] | None) -> list[Any]:
    """The parts' vertices were one after the other; without sizes they were those of one hull."""
    if sizes is None:
        return [vertices]
    if sum(sizes) != len(vertices):
        raise ValueError("part_sizes must be those of hull_vertices, in all")
    return [vertices[a:b] for a, b in pairwise([0, *accumulate(sizes)])]
