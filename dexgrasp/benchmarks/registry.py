"""The benchmarks by name; each module has `run(quick: bool) -> dict`."""

import importlib
from typing import Any

from dexgrasp_env.errors import unknown_name

_DESCRIPTIONS = {
    "stepping": "environment steps a second against a raw mj_step loop with the same controls and contacts",
    "wrench": "the wrench programme against general QP solvers",
    "perception": "depth to segmented cloud, time and accuracy",
    "planning": "seconds to a certified grasp",
    "proposals": "learned, exhaustive and uniform proposals: tries and seconds to a verified grasp",
}

BENCHMARKS: dict[str, str] = {name: f"dexgrasp.benchmarks.{name}" for name in _DESCRIPTIONS}
"""Name -> module."""


def available() -> dict[str, str]:
    """Return the benchmarks with one line each."""
    return dict(_DESCRIPTIONS)


def run_benchmark(name: str, *, quick: bool = False) -> dict[str, Any]:
    """Run a benchmark and return its figures.

    Raises:
        InputError: for an unknown name.
    """
    if name not in BENCHMARKS:
        raise unknown_name("benchmark", name, BENCHMARKS)
    return dict(importlib.import_module(BENCHMARKS[name]).run(quick=quick))
