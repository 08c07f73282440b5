"""What reason codes mean, in one table for `plan`, the tables of `evaluate` and the report."""

from collections import Counter
from collections.abc import Mapping
from typing import NamedTuple


class Reason(NamedTuple):
    """A reason in words.

    Attributes:
        sentence: what went wrong.
        hint: what to try, or nothing.
        unit: of the violation: "m", or nothing where a number says nothing to people.
    """

    sentence: str
    hint: str = ""
    unit: str = ""


_SIZE = "the hand spans 1 to 12 cm: check the size with `dexgrasp doctor`, and --mesh-scale"
_SEED = "try another --seed: the object then lies elsewhere"

REASONS: dict[str, Reason] = {
    # seeing
    "empty_cloud": Reason("the cameras see no point of the object", _SEED),
    "no_cloud": Reason("the cameras see too few points of the object", _SEED),
    "object_out_of_view": Reason("the object is out of the cameras' view", _SEED),
    "too_few_points": Reason("the cameras see too few points of the object", "it may be too flat or too small"),
    "plane_not_found": Reason("the table is not found in the depth images"),
    "cloud_has_no_volume": Reason("what is seen of the object is flat", "it may be too flat to be grasped"),
    # proposing
    "no_surface_above_table": Reason("no surface is high enough above the table for a fingertip", "it may be too flat"),
    "no_closure_triple": Reason("no three points of the seen surface hold the object", _SIZE),
    "no_closure_proposal": Reason("none of the learned proposals holds the object", "try --agent bilevel"),
    "no_latent_reachable": Reason("the fingers reach none of the learned proposals", _SIZE),
    "ik_not_converged": Reason("inverse kinematics does not bring the fingertips to the proposed points", _SIZE),
    "no_reachable_posture": Reason("no posture of the hand reaches the proposed points", _SIZE),
    # refining
    "distance_min": Reason("a fingertip would be pressed in deeper than it may", _SIZE, "m"),
    "distance_max": Reason("a fingertip does not reach the surface", _SIZE, "m"),
    "fingertip_axis": Reason("a fingertip would touch with its side or its nail"),
    "fingertip_pad": Reason("a fingertip would touch beside its pad"),
    "closure_margin": Reason("the contacts are too near the edge of force closure"),
    "clearance_hand_object": Reason("a link of the hand would be in the object", _SIZE, "m"),
    "clearance_hand_table": Reason("the hand would touch the table", "low objects leave no room for fingers", "m"),
    "clearance_self": Reason("parts of the robot would touch each other", _SIZE, "m"),
    "holding_forces": Reason(
        "no forces within friction and joint torques hold the assumed weight", "it may be too large, hence too heavy"
    ),
    "pregrasp_clearance": Reason("the fingers cannot open around the object", _SIZE),
    "time_budget": Reason("the time for planning was over"),
    # moving
    "approach_blocked": Reason("there is no way to the grasp that touches nothing", _SEED),
    "approach_bends": Reason("the way to the grasp is not smooth", _SEED),
    "lift_out_of_reach": Reason("the arm cannot lift from there", _SEED),
    "lift_blocked": Reason("the hand would meet itself or the table on the way up", _SEED),
    "surface_out_of_reach": Reason("a finger ends before the surface", _SEED),
    "out_of_reach": Reason("the arm does not reach the object", _SEED),
    # trials
    "no_grasp": Reason("no grasp was found"),
    "failed_pushed@0.5": Reason("the object was lost under pushes half as hard, in the same scene"),
    "not_touched": Reason("the object was not touched"),
    "not_lifted": Reason("the object was touched and not lifted"),
    "not_held_3s": Reason("the object was lifted and not held for 3 s"),
    "not_at_goal": Reason("the object was touched and not brought to its goal for 1 s"),
    "dropped": Reason("the object was dropped"),
    "object_lost": Reason("the object left the table"),
    "simulation_diverged": Reason("the simulation went wrong"),
    "invalid_action": Reason("the agent gave no valid action"),
    "agent_error": Reason("the agent raised an exception"),
}  # fmt: skip


def sentence(code: str) -> str:
    """Return a reason in words; what the table does not know stays as it is."""
    head, _, rest = code.partition(":")
    if head == "no_grasp" and rest and rest != "None":
        return f"no grasp: {sentence(rest.strip())}"
    if head not in REASONS:
        return code
    detail = rest.strip()
    return REASONS[head].sentence + (f" ({detail})" if detail else "")


def explain(reason: str, blocked: Mapping[str, int], violations: Mapping[str, float]) -> str:
    """Return why there is no grasp, as people read it: what blocked, how often, by how much at least, what to try.

    Args:
        reason: the code of a report.
        blocked: reason -> postures that it stopped.
        violations: reason -> the smallest violation, SI units.
    """
    counts: Counter[str] = Counter()
    least: dict[str, float] = {}
    for code, count in blocked.items():
        head = code.split(":")[0]
        counts[head] += count
        if code in violations:
            least[head] = min(least.get(head, float("inf")), violations[code])
    lines = [sentence(reason)]
    if counts:
        lines.append(f"of {sum(counts.values())} postures that were looked at:")
    lines += [
        f"  {count:>5}  {sentence(head)}{_amount(head, least.get(head))}"
        for head, count in counts.most_common()
    ]
    hint = next((REASONS[code].hint for code in _codes(reason, counts) if REASONS[code].hint), "")
    return "\n  ".join([*lines, *([f"hint: {hint}"] if hint else [])])


def _codes(reason: str, counts: Counter[str]) -> list[str]:
    """The reason's own code first, then those that blocked, the commonest first."""
    own = reason.removeprefix("no_grasp:").split(":")[0]
    return [code for code in (own, *(head for head, _ in counts.most_common())) if code in REASONS]


def _amount(head: str, least: float | None) -> str:
    known = REASONS.get(head)
    if known is None or known.unit != "m" or not least:
        return ""
    return f", by {1000 * least:.1f} mm at least"
