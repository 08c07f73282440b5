"""`dexgrasp benchmark`: speed as ratios measured side by side in one run."""

from typing import Annotated

from dexgrasp.cli.benchmarks.registry import BENCHMARKS, run_benchmark
from dexgrasp.cli.command import Answer, Argument, Command
from dexgrasp.cli.figures import tables
from dexgrasp.cli.output import note
from dexgrasp_env.errors import InputError
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
        accuracy: perception alone: distances to the true surface instead of time.
    """

    name: Argument[Annotated[str, one_of(BENCHMARKS)]]
    quick: bool = False
    accuracy: bool = False

    def run(self) -> Answer:
        """Measure."""
        note(f"benchmark {self.name}: this takes a while; close what else is busy")
        if self.accuracy:
            from dexgrasp.cli.benchmarks.perception import accuracy

            if self.name != "perception":
                raise InputError(f"--accuracy goes with the benchmark perception, not with {self.name}")
            found = accuracy(poses=1 if self.quick else 5)
            figures = {**found["by_object"], "all": found["all"]}
        else:
            figures = run_benchmark(self.name, quick=self.quick)
        return Answer({"benchmark": self.name, "quick": self.quick, "figures": figures}, tables(figures))


_LINES = (f"  {name:<12} {line}" for name, line in BENCHMARKS.items())
Benchmark.__doc__ = str(Benchmark.__doc__).format(available="\n    ".join(_LINES))
COMMAND = Benchmark
