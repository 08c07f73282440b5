"""Results of record: small JSON from evaluations, and the tables that README and docs show of them.

    python scripts/record_results.py runs/robust runs/scans --out docs/results/robust.json --title "..." --note "..."
    python scripts/record_results.py --write         put the tables of every docs/results/*.json where they are shown

A page shows results between `<!-- results:NAME -->` and `<!-- /results:NAME -->`, NAME being the JSON's stem; a test
holds every page against its JSON.
"""

import argparse
import json
import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dexgrasp.evaluation.report.build import read_agents
from dexgrasp.evaluation.report.origin import commands, describe_run
from dexgrasp.evaluation.report.tables import rate_words
from dexgrasp.runs.text import markdown_table

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "docs" / "results"
PAGES = ("README.md", "docs/*.md")
_MARKS = re.compile(r"<!-- results:(?P<name>[\w-]+) -->\n(?P<text>.*?)<!-- /results:(?P=name) -->", re.DOTALL)
_CELLS = ("trials", "successes", "rate", "ci95")


def record(folders: Sequence[Path], title: str, note: str) -> dict[str, Any]:
    """Return what is kept of evaluations."""
    agents = read_agents(folders)
    return {
        "schema": 1,
        "title": title,
        "note": note,
        "made": [describe_run(folder) for folder in folders],
        "commands": [commands(folder)[0] for folder in folders],
        "agents": {name: _kept(agent) for name, agent in agents.items()},
    }


def _kept(agent: Mapping[str, Any]) -> dict[str, Any]:
    cells = {name: {key: cell[key] for key in _CELLS} for name, cell in agent["by_protocol"].items()}
    by_set = {name: {key: cell[key] for key in _CELLS} for name, cell in agent["by_set"].items()}
    return {
        **{key: agent[key] for key in _CELLS}, "by_protocol": cells, "by_set": by_set,
        "by_object": agent["by_object"], "failures": agent["failures"], "planning_seconds": agent["planning_seconds"],
    }  # fmt: skip


def render(content: Mapping[str, Any]) -> str:
    """Return the markdown that a page shows of a result."""
    agents = content["agents"]
    names = list(dict.fromkeys(name for agent in agents.values() for name in agent["by_protocol"]))
    several = len(names) > 1
    kind, key = ("protocol", "by_protocol") if several else ("set", "by_set")
    rows = names if several else list(dict.fromkeys(s for agent in agents.values() for s in agent["by_set"]))
    body = [[row, *(_cell(agent[key].get(row)) for agent in agents.values())] for row in rows]
    if not several:
        body.append(["all", *(_cell(agent) for agent in agents.values())])
    table = markdown_table((kind, *(f"`{name}`" for name in agents)), body)
    made = "\n".join(f"{words}  " for words in _together(content["commands"])).rstrip()
    return f"**{content['title']}** {content['note']}\n\n{table}\n\n{made}\n"


def _together(commands: Sequence[str]) -> list[str]:
    """Return commands as pages show them; those that differ in the seed alone are one, with S for it."""
    alike: dict[str, list[tuple[str, str]]] = {}
    for command in commands:
        seed = command.partition("--seed ")[2].split()[0]
        alike.setdefault(re.sub(rf"(?<!\d){seed}(?!\d)", "S", command), []).append((seed, command))
    return [
        f"`{own[0][1]}`" if len(own) == 1 else f"`{words}`, S = {', '.join(seed for seed, _ in own)}"
        for words, own in alike.items()
    ]


def _cell(cell: Mapping[str, Any] | None) -> str:
    return f"{rate_words(cell)} of {cell['trials']}" if cell and cell["trials"] else "-"


def pages() -> list[Path]:
    """Return the pages that may show results."""
    return [path for pattern in PAGES for path in sorted(ROOT.glob(pattern))]


def shown(text: str) -> dict[str, str]:
    """Return the results that a page shows: name -> markdown."""
    return {found["name"]: found["text"] for found in _MARKS.finditer(text)}


def rewritten(text: str, results: Path = RESULTS) -> str:
    """Return a page with its results as they are in the JSON files."""

    def fill(found: re.Match[str]) -> str:
        name = found["name"]
        content = json.loads((results / f"{name}.json").read_text())
        return f"<!-- results:{name} -->\n{render(content)}<!-- /results:{name} -->"

    return _MARKS.sub(fill, text)


def main() -> int:
    """Record evaluations, or write the pages."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", nargs="*", type=Path, metavar="RUN")
    parser.add_argument("--out", type=Path, help="JSON file, e.g. docs/results/robust.json")
    parser.add_argument("--title", default="")
    parser.add_argument(
        "--note", default="", help="what a reader must know: the machine's load, what is meant"
    )
    parser.add_argument("--write", action="store_true", help="put the tables into the pages")
    args = parser.parse_args()
    if args.folders:
        if args.out is None:
            parser.error("name the JSON file with --out")
        args.out.parent.mkdir(parents=True, exist_ok=True)
        args.out.write_text(json.dumps(record(args.folders, args.title, args.note), indent=1) + "\n")
    if args.write:
        for path in pages():
            path.write_text(rewritten(path.read_text()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
