"""The benchmarks by name; each module has `run(quick: bool) -> dict`."""

import importlib

from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import unknown_name
from dexgrasp_env.files import jsonable

BENCHMARKS = {
    "stepping": "environment steps a second against a raw mj_step loop with the same controls and contacts",
    "perception": "depth to segmented cloud",
    "planning": "seconds to a certified grasp",
}
"""Name, which is that of its module -> what it measures."""


def run_benchmark(name: str, *, quick: bool = False) -> Fields:
    """Run a benchmark and return its figures, as JSON holds them.

    Raises:
        InputError: for an unknown name.
    """
    if name not in BENCHMARKS:
        raise unknown_name("benchmark", name, BENCHMARKS)
    return jsonable(importlib.import_module(f"dexgrasp.cli.benchmarks.{name}").run(quick=quick))
