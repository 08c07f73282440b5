"""Results of record: small JSON from evaluations, and the tables that README and docs show of them.

    python scripts/record_results.py runs/robust runs/scans --out docs/results/robust.json --title "..." --note "..."
    python scripts/record_results.py --write         put the tables of every docs/results/*.json where they are shown

A page shows results between `<!-- results:NAME -->` and `<!-- /results:NAME -->`, NAME being the JSON's stem, or some
of its rows, `<!-- results:NAME ROW ... -->`; a test holds every page against its JSON.
"""

import argparse
import json
import re
import sys
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dexgrasp.evaluation.report.build import read_agents
from dexgrasp.evaluation.report.origin import commands, describe_run
from dexgrasp.evaluation.report.tables import rate_words

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "docs" / "results"
PAGES = ("README.md", "docs/*.md")
_MARKS = re.compile(
    r"<!-- results:(?P<name>[\w-]+)(?P<rows>[^>]*) -->\n(?P<text>.*?)<!-- /results:(?P=name) -->", re.DOTALL
)
_WIDTH = 116  # characters of a line of a page
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


def render(content: Mapping[str, Any], only: Sequence[str] = ()) -> str:
    """Return the markdown that a page shows of a result: all rows of it, or those named."""
    agents = content["agents"]
    names = list(dict.fromkeys(name for agent in agents.values() for name in agent["by_protocol"]))
    kind, key = ("protocol", "by_protocol") if len(names) > 1 else ("set", "by_set")
    rows = list(dict.fromkeys(name for agent in agents.values() for name in agent[key]))
    body = [
        [row, _trials(cells), *(_cell(cell) for cell in cells)]
        for row in (only or rows)
        for cells in [[agent[key].get(row) for agent in agents.values()]]
    ]
    header = [kind, "trials", *(f"`{name}`, %" for name in agents)]
    ruler = ["---", *["---:"] * (len(header) - 1)]
    table = "\n".join("| " + " | ".join(cells) + " |" for cells in [header, ruler, *body])
    words = textwrap.fill(f"**{content['title']}** {content['note']}", _WIDTH, break_on_hyphens=False)
    made = "\n".join(_broken(line) for line in _together(content["commands"]))
    return f"{words}\n\n{table}\n\n```bash\n{made}\n```\n"


def _together(commands: Sequence[str]) -> list[str]:
    """Return commands as pages show them; those that differ in the seed alone are one, with S for it."""
    alike: dict[str, list[tuple[str, str]]] = {}
    for command in commands:
        seed = command.partition("--seed ")[2].split()[0]
        alike.setdefault(re.sub(rf"(?<!\d){seed}(?!\d)", "S", command), []).append((seed, command))
    shown: list[str] = []
    for words, own in alike.items():
        note = [f"# S = {', '.join(seed for seed, _ in own)}"] if len(own) > 1 else []
        shown += [*(line for line in note if line not in shown), words if note else own[0][1]]
    return shown


def _broken(command: str) -> str:
    return command if len(command) <= _WIDTH else command.replace(" --out", " \\\n  --out")


def _cell(cell: Mapping[str, Any] | None) -> str:
    return rate_words(cell).replace(" %", "")


def _trials(cells: Sequence[Mapping[str, Any] | None]) -> str:
    return " / ".join(dict.fromkeys(str(cell["trials"]) for cell in cells if cell))


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
        text = render(content, found["rows"].split())
        return f"<!-- results:{name}{found['rows']} -->\n{text}<!-- /results:{name} -->"

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
