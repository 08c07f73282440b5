"""Files of schema 2 (0.2.0), as schema 3 would hold them."""

from itertools import accumulate, pairwise
from typing import Any

from dexgrasp.grasp.conventions import conventions
from dexgrasp.grasp.values import items
from dexgrasp_env.robot.cell import SIMULATED

_CONTACT = ("finger", "point", "normal", "force")


def of_schema_2(old: dict[str, Any]) -> dict[str, Any]:
    """Return the content of a file of schema 2 in schema 3.

    A file without a cell, or its table, was written before there were others. One for the simulated cell states no
    hash: that of today's robot is taken. Hashes of other cells covered more than the robot, and fit none of today's.

    Raises:
        KeyError, TypeError, ValueError, AttributeError: with what is missing or malformed.
    """
    stamp = old.get("cell", SIMULATED)
    cell, _, version = ("", "", "") if stamp == SIMULATED else stamp.rpartition("-")
    robot = {"name": cell, "hash": version} if cell else conventions(old["mount"])["robot"]
    rows = zip(old["finger_order"], old["contacts"], old["normals"], old["forces"], strict=True)
    approach, lift = old["approach"], old["lift"]
    phases = None if approach is None else [{"name": "approach"} | approach, {"name": "lift"} | lift]
    return old | {
        "schema": 3,
        "cell": cell or SIMULATED,
        "robot": robot,
        "table_height": old.get("table_height", 0.0),
        "parts": _parts(old["hull_vertices"], old.get("part_sizes")),
        "contacts": [dict(zip(_CONTACT, row, strict=True)) for row in rows],
        "neighbours": [],
        "script": None if phases is None else {"lift_height": lift["height"], "phases": phases},
        "holds_probability": None,
    }


def _parts(vertices: list[Any], sizes: list[int] | None) -> list[Any]:
    """The parts' vertices were one after the other; without sizes they were those of one hull."""
    if sizes is None:
        return [vertices]
    ends = [0, *accumulate(items("part_sizes", sizes, 2, 64))]
    if ends[-1] != len(vertices):
        raise ValueError("part_sizes must be those of hull_vertices, in all")
    return [vertices[a:b] for a, b in pairwise(ends)]
