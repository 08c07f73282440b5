"""Grasp files: written whole, and read into a record (`docs/grasp-file.md`)."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from dexgrasp.grasp.record import SCHEMA, GraspRecord
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import expand, read_json_object, write_json
from dexgrasp_env.robot.cell import Cell, default_cell
from dexgrasp_env.valid import checked, read


@checked
def write_grasp(path: str | Path, content: Fields) -> None:
    """Write a grasp file, whole or not at all."""
    write_json(expand(path), content)


def read_grasp(path: str | Path, cell: Cell | None = None) -> GraspRecord:
    """Read a grasp file.

    Args:
        path: of the file.
        cell: in which the grasp is to be; the simulated one by default. `GraspRecord.check_cell` tells whether it is.

    Raises:
        InputError: if it is missing, not JSON, of another schema, or a field is missing or malformed.
    """
    return record_of(read_json_object(expand(path), "it is no grasp file"), str(path), cell)


def record_of(content: Any, source: str = "this object", cell: Cell | None = None) -> GraspRecord:
    """Return the grasp of a JSON object, as `grasp_json` or `plan --json` make it; errors as in `read_grasp`."""
    if isinstance(content, dict) and isinstance(content.get("grasp"), dict):
        content = content["grasp"]  # the output of `plan --json`
    schema = content.get("schema") if isinstance(content, dict) else None
    if type(schema) is not int or schema != SCHEMA:
        older = " (schema 2 is read by dexgrasp 0.3.0: plan the grasp again)" if schema == 2 else ""
        raise InputError(
            f"{source} is not a grasp of schema {SCHEMA}, as `dexgrasp plan --out` writes it{older}"
        )
    try:
        here = (cell or default_cell()).mounted(content["mount"])
        here = here.grasping(tuple(contact["finger"] for contact in content["contacts"]))
        record = read(GraspRecord, content | {"here": here}, more=True)
    except KeyError as error:
        raise InputError(f"{source} is not a usable grasp: {error} is missing") from None
    except (TypeError, ValueError, AttributeError, RecursionError) as error:
        text = " ".join(str(error).split())[:300]
        raise InputError(f"{source} is not a usable grasp: {text}") from None
    record = replace(record, here=here.seeing(record.table))
    return record.placed(record.stated_cell.T_world_base)
