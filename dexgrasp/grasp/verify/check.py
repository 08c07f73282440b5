"""One check and its result."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, SupportsFloat

import numpy as np

from dexgrasp_env.arrays import Array

if TYPE_CHECKING:
    from dexgrasp.grasp.verify.case import Case

ROUNDING = 1e-9  # what repeated floating-point sums may differ by, in any unit here
LENGTH = 2e-6  # m: what two ways to compute a length may differ by


@dataclass(frozen=True)
class Check:
    """One constraint computed again: its value, the bound, and whether it holds."""

    name: str
    value: float
    bound: str
    holds: bool


def at_most(name: str, value: SupportsFloat, bound: float, unit: str = "", tolerance: float = 0.0) -> Check:
    """Check that a value does not exceed a bound; NaN does."""
    return Check(name, float(value), f"<= {bound:g} {unit}".strip(), float(value) <= bound + tolerance)


def at_least(name: str, value: SupportsFloat, bound: float, unit: str = "", tolerance: float = 0.0) -> Check:
    """Check that a value does not fall below a bound; NaN does."""
    return Check(name, float(value), f">= {bound:g} {unit}".strip(), float(value) >= bound - tolerance)


def same(name: str, off: SupportsFloat, tolerance: float, unit: str = "") -> Check:
    """Check that something is as stated, `off` being how far it is from that."""
    return at_most(f"{name} as stated", off, tolerance, unit)


def flag(name: str, holds: bool, bound: str = "as documented") -> Check:
    """Check that something holds which has no number."""
    return Check(name, float(not holds), bound, holds)


def claim(
    case: "Case",
    key: str,
    value: float | np.floating | Array,
    tolerance: float,
    relative: float = 0.0,
    unit: str = "",
) -> list[Check]:
    """Compare what the certificate says, if it says it, with what was found."""
    claimed = np.asarray(getattr(case.record.certificate, key), dtype=float)
    if np.isnan(claimed).any():
        return []
    bound = float(np.max(tolerance + relative * np.abs(value)))
    return [at_most(f"{key} as claimed", np.abs(claimed - value).max(), bound, unit)]
