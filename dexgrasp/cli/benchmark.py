"""`dexgrasp benchmark`: speed as ratios measured side by side in one run."""

from typing import Annotated

from dexgrasp.cli.benchmarks.registry import BENCHMARKS, run_benchmark
from dexgrasp.cli.command import Answer, Argument, Command
from dexgrasp.cli.figures import tables
from dexgrasp.cli.output import note
from dexgrasp_env.valid import one_of


class Benchmark(Command):
    """Measure speed as ratios against a reference in the same run: they carry over to other machines.

    benchmarks:
    {available}

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
        figures = run_benchmark(self.name, quick=self.quick)
        return Answer({"benchmark": self.name, "quick": self.quick, "figures": figures}, tables(figures))


Benchmark.__doc__ = str(Benchmark.__doc__).format(
    available="\n    ".join(f"  {name:<12} {line}" for name, line in BENCHMARKS.items())
)
