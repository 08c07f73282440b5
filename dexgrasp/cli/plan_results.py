"""Results of `dexgrasp plan` as files and as text."""

from pathlib import Path
from typing import TYPE_CHECKING

from dexgrasp.cli.output import coloured, columns, record_table
from dexgrasp.evaluation.reasons import explain
from dexgrasp.grasp.certificate import figures_of
from dexgrasp_env.arrays import Fields

if TYPE_CHECKING:
    from dexgrasp.planning.result import PlanResult

_SET = {
    "load": "{load:.2f}",
    "capacity": "{capacity:.2f}",
    "margin": "{closure_margin:.2f}",
    "torque": "{max_joint_torque_fraction:.2f}",
    "clear, mm": "{clearance_mm:.1f}",
}


def write_results(folder: Path, found: "PlanResult", content: Fields, pictures: bool = True) -> str:
    """Write grasp.json and, with `pictures`, grasp.png, or the files of a set; return a line that names them."""
    from dexgrasp.grasp.file import write_grasp
    from dexgrasp.grasp.picture import grasp_picture

    if found.asked is None:
        write_grasp(folder / "grasp.json", content["grasp"])
        if pictures and found.grasp is not None and found.target is not None:
            title = f"{content['object']}: planned from what was seen"
            grasp_picture(folder / "grasp.png", found.grasp, found.target, title)
        return f"wrote {folder / 'grasp.json'} and {folder / 'grasp.png'}"
    names = [f"grasp_{k:03d}.json" for k in range(len(content["grasps"]))]
    for name, grasp in zip(names, content["grasps"], strict=True):
        write_grasp(folder / name, grasp)
    older = len({path.name for path in folder.glob("grasp_*.json")} - set(names))
    line = f"wrote {len(names)} grasps: {folder / names[0]} to {names[-1]}" if names else "no grasp to write"
    return line + (f"; {older} grasp files there are of an earlier run" if older else "")


def describe(result: Fields, unseen: str = "") -> str:
    """Return the result as text; `unseen` says why no object was perceived, if none was."""
    if "asked" in result:
        return _describe_set(result)
    name = result["object"]
    if unseen:
        return f"{name}: no object [{result['reason']}]\n  {unseen}"
    seconds = f"{1000 * (result['planning_seconds'] or 0.0):.0f} ms"
    if not result["success"]:
        return f"{name}: {coloured('no grasp', 'bad')} after {seconds} [{result['reason']}]\n  {_why(result)}"
    found = coloured("grasp found", "good")
    if not result["certificate"]["holds"]:
        found = coloured("grasp found that does not bear the assumed weight", "look")
    if "time_budget" in result["blocked"]:
        found += " before the time for planning was over,"
    figures = figures_of(result["certificate"])
    if (goal := result["grasp"].get("request", {}).get("goal")) is not None:
        figures["set down at, m"] = " ".join(f"{x:.3f}" for x in goal["place"])
    if (known := result["grasp"]["holds_probability"]) is not None:
        given = ", if its unseen side is as guessed" * ("hidden_side" in result)
        figures[f"probability to be lifted and held{given}"] = _chance(known["lifted"])
        if not known["guessed"]:  # with a side that no camera saw it is not calibrated
            figures["probability to be pushed by its weight as well"] = _chance(known["pushed"])
    beside = [result[key] for key in ("hidden_side", "relaxation") if key in result]
    return "\n  ".join([f"{name}: {found} in {seconds}", *columns(figures), *beside])


def _describe_set(result: Fields) -> str:
    """Return the result of `--count` as text: a line, a table, and why there are fewer than asked."""
    asked, count, seconds = result["asked"], result["count"], result["planning_seconds"] or 0.0
    found = coloured(f"{count} of {asked} grasps", "good" if count == asked else "bad")
    speed = f"{result['grasps_per_cpu_second']:.0f} a second of one core"
    lines = [f"{result['object']}: {found} in {seconds:.2f} s, {speed}"]
    if result["grasps"]:
        rows = []
        for k, grasp in enumerate(result["grasps"]):
            rows.append({"grasp": f"{k:03d}", **figures_of(grasp["certificate"], _SET)})
            if (known := grasp["holds_probability"]) is not None:
                rows[-1]["holds"] = _chance(known["lifted"])
        lines += [
            record_table(rows),
            f"each bears the {1000 * result['certificate']['mass']:.0f} g that the object is assumed to weigh",
        ]
    if result["diversity"]:
        lines.append(f"variance in the first component: {result['diversity'][0]:.0%} (lower is more varied)")
    if "hidden_side" in result:
        lines.append(result["hidden_side"])
    if count < asked:
        lines.append(f"no more were found [{result['reason']}]\n  {_why(result)}")
    return "\n".join(lines)


def _chance(chance: dict[str, float]) -> str:
    return f"{chance['value']:.2f} [{chance['low']:.2f}, {chance['high']:.2f}]"


def _why(result: Fields) -> str:
    why = explain(
        result["reason"], result["blocked"], result["violations"], "cloud" if "seen" in result else "target"
    )
    relaxed = [result["relaxation"]] if "relaxation" in result else []
    return "\n  ".join([why, *relaxed, *result.get("in_the_way", ())])
