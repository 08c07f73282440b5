"""Findings of `dexgrasp doctor` about a machine or a mesh."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """One thing that was found.

    Attributes:
        level: "error" (cannot be used, has to be mended), "warning" (used, but look at it) or "info".
        problem: what is the matter.
        remedy: what to do, or what was done.
    """

    level: str
    problem: str
    remedy: str = ""
