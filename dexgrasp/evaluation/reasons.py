"""Reason codes in words, for `plan`, the tables of `evaluate` and the report."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from dexgrasp_env.yaml_file import read_yaml


class Reason(NamedTuple):
    """A reason in words.

    Attributes:
        sentence: what went wrong.
        hint: what to try, or empty; a mapping with `cloud` and `target` where it differs between a cloud and a mesh.
        unit: of the violation: "m", or empty where the number is of no use to people.
    """

    sentence: str
    hint: str | dict[str, str] = ""
    unit: str = ""


REASONS: dict[str, Reason] = {
    code: Reason(**words)
    for code, words in read_yaml(Path(__file__).with_name("reasons.yaml"))["reasons"].items()
}
"""Reasons by code, from reasons.yaml."""


def sentence(code: str) -> str:
    """Return a reason code in words; an unknown code stays as it is."""
    head, _, rest = code.partition(":")
    if head == "no_grasp" and rest and rest != "None":
        return f"no grasp: {sentence(rest.strip())}"
    if head not in REASONS:
        return code
    detail = rest.strip()
    return REASONS[head].sentence + (f" ({detail})" if detail else "")


def explain(
    reason: str, blocked: Mapping[str, int], violations: Mapping[str, float], of: str = "target"
) -> str:
    """Return why there is no grasp, in words: each cause with its count and smallest violation, and a hint.

    Args:
        reason: the code of a report.
        blocked: reason -> number of postures that it ruled out.
        violations: reason -> the smallest violation, SI units.
        of: kind of input, `target` or `cloud`.
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
    # The reason's own code first, then those that blocked, the commonest first.
    codes = reason.removeprefix("no_grasp:").split(":")[0], *(head for head, _ in counts.most_common())
    hint = next((REASONS[code].hint for code in codes if code in REASONS and REASONS[code].hint), "")
    if hint:
        lines.append(f"hint: {hint if isinstance(hint, str) else hint[of]}")
    return "\n  ".join(lines)


def _amount(head: str, least: float | None) -> str:
    if not least or head not in REASONS or REASONS[head].unit != "m":
        return ""
    return f", by {1000 * least:.1f} mm at least"
