"""`dexgrasp benchmark`: speed as ratios measured side by side in one run."""

import argparse
from collections.abc import Mapping
from typing import Any

from dexgrasp.cli.options import add_json


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command; its help lists the benchmarks."""
    from dexgrasp.benchmarks.registry import available

    listed = "\n".join(f"  {name:<12} {line}" for name, line in available().items())
    parser = subparsers.add_parser(
        "benchmark", help="speed as ratios measured side by side",
        description="Measure speed as ratios against a reference in the same run: they carry over to other machines.",
        epilog=f"benchmarks:\n{listed}\n\nexample:\n  dexgrasp benchmark stepping --quick",
    )  # fmt: skip
    parser.add_argument("name", metavar="NAME", choices=tuple(available()), help="which one: see below")
    parser.add_argument("--quick", action="store_true", help="a rough figure in less time")
    parser.add_argument(
        "--accuracy",
        action="store_true",
        help="perception alone: distances to the true surface instead of time",
    )
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Run a benchmark and print its figures."""
    from dexgrasp.benchmarks.registry import run_benchmark
    from dexgrasp.cli.output import note, print_json
    from dexgrasp_env.files import jsonable

    note(f"benchmark {args.name}: this takes a while; close what else is busy")
    if args.accuracy:
        figures = _accuracy(args.name, args.quick)
    else:
        figures = run_benchmark(args.name, quick=args.quick)
    if args.json:
        print_json({"schema": 1, "benchmark": args.name, "quick": args.quick, "figures": jsonable(figures)})
    else:
        print(render(figures))
    return 0


def _accuracy(name: str, quick: bool) -> dict[str, Any]:
    from dexgrasp.benchmarks.perception import accuracy
    from dexgrasp_env.errors import InputError

    if name != "perception":
        raise InputError(f"--accuracy goes with the benchmark perception, not with {name}")
    figures = accuracy(poses=1 if quick else 5)
    return {**figures["by_object"], "all": figures["all"]}


def render(figures: Mapping[str, Any]) -> str:
    """Return nested figures as tables: cases down, quantities across; cases that measure the same share a table."""
    from dexgrasp.runs.text import text_table

    figures = _unlisted(figures)
    cases = {name: _flat(value) for name, value in figures.items() if isinstance(value, Mapping) and value}
    loose = [f"{name}: {shown(value)}" for name, value in figures.items() if not isinstance(value, Mapping)]
    groups: dict[tuple[str, ...], list[list[str]]] = {}
    for name, case in cases.items():
        groups.setdefault(tuple(case), []).append([name, *map(shown, case.values())])
    tables = [text_table(["case", *columns], rows) + "\n" for columns, rows in groups.items()]
    return "\n".join([*tables, *loose])


def _unlisted(figures: Mapping[str, Any]) -> dict[str, Any]:
    """Name each case of a list of cases by the list's name and its own: `speed: [{shape: box}]` is `speed box`."""
    found: dict[str, Any] = {}
    for name, value in figures.items():
        if isinstance(value, list) and value and all(isinstance(case, Mapping) for case in value):
            for k, case in enumerate(value):
                key = next((key for key, own in case.items() if isinstance(own, str)), None)
                found[f"{name} {case[key] if key else k}"] = {n: v for n, v in case.items() if n != key}
        else:
            found[name] = value
    return found


def _flat(case: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in case.items():
        if isinstance(value, Mapping):
            flat |= _flat(value, f"{prefix}{key} ")
        else:
            flat[f"{prefix}{key}"] = value
    return flat


def shown(value: Any) -> str:
    """Return a figure in a few digits."""
    if isinstance(value, float):
        return f"{value:.4g}" if abs(value) < 1e5 else f"{value:.0f}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(shown, value)) + "]"
    return "-" if value is None else str(value)
