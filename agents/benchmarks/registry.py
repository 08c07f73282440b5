"""The benchmarks by name; each module has `run(quick: bool) -> dict`."""

import importlib
import importlib.util
from typing import Any

from dexgrasp_env.errors import unknown_name

_DESCRIPTIONS = {
    "stepping": "environment steps a second against a raw mj_step loop with the same controls and contacts",
    "distance": "signed distances against trimesh, accuracy and time",
    "wrench": "the wrench programme against general QP solvers",
    "closure": "the closure decision against a linear programme",
    "perception": "depth to segmented cloud, time and accuracy",
    "kinematics": "kinematics and clearances against MuJoCo",
    "planning": "seconds to a certified grasp",
    "proposals": "learned, exhaustive and uniform proposals: tries and seconds to a verified grasp",
    "batch": "many environments at once against one",
}

BENCHMARKS: dict[str, str] = {name: f"agents.benchmarks.{name}" for name in _DESCRIPTIONS}
"""Name -> module."""


def available() -> dict[str, str]:
    """Return the benchmarks that are there, with one line each."""
    return {
        name: _DESCRIPTIONS[name] for name, module in BENCHMARKS.items() if importlib.util.find_spec(module)
    }


def run_benchmark(name: str, *, quick: bool = False) -> dict[str, Any]:
    """Run a benchmark and return its figures.

    Raises:
        InputError: for an unknown name.
    """
    if name not in available():
        raise unknown_name("benchmark", name, available())
    return dict(importlib.import_module(BENCHMARKS[name]).run(quick=quick))
