"""What `dexgrasp plan` found: as files, and as people read it."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from dexgrasp.cli.output import coloured
from dexgrasp.evaluation.reasons import explain
from dexgrasp.runs.text import text_table

if TYPE_CHECKING:
    from dexgrasp.planning.result import PlanResult

_COLUMNS = {
    "load": "load", "capacity": "capacity", "margin": "closure_margin", "torque": "max_joint_torque_fraction",
}  # fmt: skip
"""Column of the table -> field of the certificate."""


def write_results(folder: Path, found: "PlanResult", content: dict[str, Any]) -> str:
    """Write grasp.json and grasp.png, or the files of a set; return a line that says so."""
    from dexgrasp.grasp.file import write_grasp
    from dexgrasp.grasp.picture import grasp_picture

    if found.asked is not None:
        return _write_set(folder, content)
    write_grasp(folder / "grasp.json", content["grasp"])
    if found.grasp is not None and found.target is not None:
        title = f"{content['object']}: planned from what was seen"
        grasp_picture(folder / "grasp.png", found.grasp, found.target, title)
    return f"wrote {folder / 'grasp.json'} and {folder / 'grasp.png'}"


def describe(result: dict[str, Any], unseen: str = "") -> str:
    """Return the outcome as people read it; `unseen` says why no object was."""
    if "asked" in result:
        return _describe_set(result)
    if unseen:
        return f"{result['object']}: no object [{result['reason']}]\n  {unseen}"
    head = f"{result['object']}: "
    seconds = f"{1000 * (result['planning_seconds'] or 0.0):.0f} ms"
    if not result["success"]:
        why = explain(result["reason"], result["blocked"], result["violations"])
        return f"{head}{coloured('no grasp', 'bad')} after {seconds} [{result['reason']}]\n  {why}"
    certificate = result["certificate"]
    found = coloured("grasp found", "good")
    if not certificate["holds"]:
        found = coloured("grasp found that does not bear the assumed weight", "look")
    lines = [f"{head}{found} in {seconds}"]
    rows = {
        "fingertip distances, cm (allowed -0.68 .. -0.32)": " ".join(
            f"{d:.2f}" for d in certificate["distances_cm"]
        ),
        "closure margin (0 edge, 1 best)": f"{certificate['closure_margin']:.2f}",
        "force ratio, %": f"{certificate['force_ratio_percent']:.1e}",
        "torque ratio, %": f"{certificate['torque_ratio_percent']:.1e}",
        "least clearance, mm": f"{1000 * certificate['min_clearance_m']:.1f}",
        "distance to a joint limit, rad": f"{certificate['joint_limit_margin_rad']:.3f}",
        "joint torque over its limit": f"{certificate['max_joint_torque_fraction']:.2f}",
        "load (1: bears its weight, 2: and a push as large)": f"{certificate['load']:.2f}",
        "capacity (the same of any forces within the torques)": f"{certificate['capacity']:.2f}",
        "holds": f"{certificate['holds']} (assumed to weigh {1000 * certificate['mass']:.0f} g)",
    }
    width = max(map(len, rows))
    return "\n".join(lines + [f"  {name:<{width}}  {value}" for name, value in rows.items()])


def _write_set(folder: Path, result: dict[str, Any]) -> str:
    """Write every grasp to a file of its own; return a line that says so."""
    from dexgrasp.grasp.file import write_grasp

    names = [f"grasp_{k:03d}.json" for k in range(len(result["grasps"]))]
    for name, content in zip(names, result["grasps"], strict=True):
        write_grasp(folder / name, content)
    older = {path.name for path in folder.glob("grasp_*.json")} - set(names)
    line = f"wrote {len(names)} grasps: {folder / names[0]} to {names[-1]}" if names else "no grasp to write"
    return line + (f"; {len(older)} grasp files there are of an earlier run" if older else "")


def _describe_set(result: dict[str, Any]) -> str:
    """Return the outcome as people read it: a line, a table, and why there are fewer than asked."""
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
