"""`dexgrasp benchmark`: speed as ratios measured side by side in one run."""

import importlib
from typing import Annotated

from dexgrasp.cli.command import Answer, Argument, Command
from dexgrasp.cli.output import note, tables
from dexgrasp_env.files import jsonable
from dexgrasp_env.valid import one_of

BENCHMARKS = ("stepping", "perception", "planning")
"""Benchmarks, by the names of their modules."""


class Benchmark(Command):
    """Measure speed as ratios against a reference in the same run, which carry over to other machines.

    benchmarks:
      stepping     environment steps a second against a raw mj_step loop with the same controls and contacts
      perception   depth to segmented cloud
      planning     seconds to a certified grasp

    example:
      dexgrasp benchmark stepping --quick

    Attributes:
        name: which one, see below.
        quick: a rough figure in less time.
    """

    name: Argument[Annotated[str, one_of(BENCHMARKS)]]
    quick: bool = False

    def run(self) -> Answer:
        """Measure."""
        note(f"benchmark {self.name}: this takes a while; close what else is busy")
        benchmark = importlib.import_module(f"dexgrasp.cli.benchmarks.{self.name}")
        figures = jsonable(benchmark.run(quick=self.quick))
        return Answer({"benchmark": self.name, "quick": self.quick, "figures": figures}, tables(figures))
