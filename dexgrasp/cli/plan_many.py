"""`dexgrasp plan --count K`: grasps that differ, as files and as a table."""

import argparse
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

_COLUMNS = {
    "load": "load", "capacity": "capacity", "margin": "closure_margin", "torque": "max_joint_torque_fraction",
}  # fmt: skip
"""Column of the table -> field of the certificate."""


def add_count(parser: argparse.ArgumentParser) -> None:
    """Add `--count`."""
    from dexgrasp.cli.options import positive_int

    parser.add_argument(
        "--count", type=positive_int, metavar="K",
        help="K grasps that differ, firmest first; with --out, grasp_000.json and so on (exit code 1 for fewer)",
    )  # fmt: skip


def check_count(args: argparse.Namespace) -> None:
    """Refuse a count that is too large, before anything is done."""
    from dexgrasp.planning import many

    many.check_count(args.count)


def bar() -> AbstractContextManager[Callable[..., None]]:
    """Show how far a set is, once it takes 3 seconds."""
    from dexgrasp.runs.progress import progress_bar

    return progress_bar("step", "grasps", delay=3, leave=False)


def write_set(folder: Path, result: dict[str, Any]) -> str:
    """Write every grasp to a file of its own; return a line that says so."""
    from dexgrasp.grasp.file import write_grasp

    names = [f"grasp_{k:03d}.json" for k in range(len(result["grasps"]))]
    for name, content in zip(names, result["grasps"], strict=True):
        write_grasp(folder / name, content)
    older = {path.name for path in folder.glob("grasp_*.json")} - set(names)
    line = f"wrote {len(names)} grasps: {folder / names[0]} to {names[-1]}" if names else "no grasp to write"
    return line + (f"; {len(older)} grasp files there are of an earlier run" if older else "")


def describe_set(result: dict[str, Any]) -> str:
    """Return the outcome as people read it: a line, a table, and why there are fewer than asked."""
    from dexgrasp.cli.output import coloured
    from dexgrasp.evaluation.reasons import explain
    from dexgrasp.runs.text import text_table

    asked, found = result["asked"], result["count"]
    words = coloured(f"{found} of {asked} grasps", "good" if found == asked else "bad")
    seconds = result["planning_seconds"] or 0.0
    lines = [
        f"{result['object']}: {words} in {seconds:.2f} s, {result['grasps_per_cpu_second']:.0f} a second of one core"
    ]
    if result["grasps"]:
        rows = [_row(k, grasp["certificate"]) for k, grasp in enumerate(result["grasps"])]
        lines.append(text_table(["grasp", *_COLUMNS, "clear, mm"], rows))
        lines.append(
            f"each bears the {1000 * result['certificate']['mass']:.0f} g that the object is assumed to weigh"
        )
    if result["diversity"]:
        lines.append(f"variance in the first component: {result['diversity'][0]:.0%} (lower is more varied)")
    if found < asked:
        why = explain(result["reason"], result["blocked"], result["violations"])
        lines.append(f"no more were found [{result['reason']}]\n  {why}")
    return "\n".join(lines)


def _row(k: int, certificate: dict[str, Any]) -> list[str]:
    figures = [f"{certificate[name]:.2f}" for name in _COLUMNS.values()]
    return [f"{k:03d}", *figures, f"{1000 * certificate['min_clearance_m']:.1f}"]
