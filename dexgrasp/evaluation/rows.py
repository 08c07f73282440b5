"""A line of trials.jsonl: what it must hold to be counted, and what its files are called."""

import hashlib
import re
from collections.abc import Mapping
from typing import Any

Key = tuple[str, str, str, int]
"""Protocol, agent, object, trial."""

_NUMBER = (int, float)
_FIELDS: dict[str, tuple[type, ...]] = {
    "agent": (str,), "object": (str,), "trial": (int,), "success": (bool,), "stable": (bool,),
    "reason": (str, type(None)), "planning_seconds": (*_NUMBER, type(None)), "details": (dict,),
}  # fmt: skip
_OPTIONAL: dict[str, tuple[type, ...]] = {
    "protocol": (str,), "scene_seed": (int,), "agent_seed": (int,), "error": (str, type(None)),
    "grasp": (str,), "env": (dict,), "stage": (str,), "steps": (int,), "warnings": (list,),
    "height": (*_NUMBER, type(None)), "slip": (*_NUMBER, type(None)), "tilt": (*_NUMBER, type(None)),
    "total_reward": (*_NUMBER, type(None)), "seconds": (*_NUMBER, type(None)),
}  # fmt: skip
_LARGEST_SEED = 2**32


def row_fault(row: object) -> str | None:
    """Return what is wrong with a line as it was parsed, or None; numbers are known to be finite."""
    if not isinstance(row, dict):
        return "not an object"
    for name, kinds in (_FIELDS | _OPTIONAL).items():
        if name not in row:
            if name in _FIELDS:
                return f"no {name}"
        elif not _is(row[name], kinds):
            return f"{name} is a {type(row[name]).__name__}"
    if row["trial"] < 0:
        return "trial is negative"
    if not all(0 <= row.get(name, 0) < _LARGEST_SEED for name in ("scene_seed", "agent_seed")):
        return "a seed is out of range"
    return _details_fault(row["details"])


def _is(value: object, kinds: tuple[type, ...]) -> bool:
    return isinstance(value, kinds) and (bool in kinds or not isinstance(value, bool))


def _details_fault(details: Mapping[str, Any]) -> str | None:
    """Check what summaries read of an agent's report; the rest is the agent's own."""
    for name in ("stage_seconds", "stage_repeats"):
        stages = details.get(name) or {}
        if not isinstance(stages, dict) or not all(_is(v, (*_NUMBER, type(None))) for v in stages.values()):
            return f"{name} are no numbers by stage"
    certificate = details.get("certificate") or {}
    if not isinstance(certificate, dict):
        return "the certificate is no object"
    distances = certificate.get("distances_cm") or []
    if not isinstance(distances, list) or not all(_is(d, (*_NUMBER, type(None))) for d in distances):
        return "distances_cm of the certificate are no numbers"
    for name, value in certificate.items():
        if name.endswith(("_percent", "_margin", "_m", "_rad", "_fraction")) and not _is(
            value, (*_NUMBER, type(None))
        ):
            return f"{name} of the certificate is no number"
    return None


def row_key(row: Mapping[str, Any]) -> Key:
    """Return what tells a trial from the others of its evaluation."""
    return row.get("protocol") or "", row["agent"], row["object"], row["trial"]


def trial_name(row: Mapping[str, Any]) -> str:
    """Return the stem of the files of a trial: its protocol, agent, object and number, as any file system takes it."""
    whole = "-".join([*filter(None, [row.get("protocol")]), row["agent"], row["object"], str(row["trial"])])
    plain = re.sub(r"[^\w.@+-]", ".", whole)
    if plain == whole and len(plain) <= 120:
        return plain
    return f"{plain[-100:]}-{hashlib.sha256(whole.encode(errors='replace')).hexdigest()[:6]}"
