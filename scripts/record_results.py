"""Results of record: small JSON from evaluations, and the tables that README and docs show of them.

    python scripts/record_results.py runs/robust runs/scans --out docs/results/robust.json --title "..." --note "..."
    python scripts/record_results.py --write         put the tables of every docs/results/*.json where they are shown

A page shows results between `<!-- results:NAME -->` and `<!-- /results:NAME -->`, NAME being the JSON's stem or
SEASON/ENTRY of a published season (`scripts/season.py`), or some of its rows, `<!-- results:NAME ROW ... -->`; a figure
within a sentence stands between `<!-- rate:NAME AGENT ROW -->` and `<!-- /rate -->`. A test holds every page against
what was recorded.
"""

import json
import re
import sys
import tempfile
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from season import Season, read_season, unpack

from dexgrasp.cli.command import Argument, File, Folder, Script
from dexgrasp.cli.commands import run_script
from dexgrasp.evaluation.report.build import read_agents
from dexgrasp.evaluation.report.origin import commands, describe_run
from dexgrasp.evaluation.report.tables import rate_words
from dexgrasp_env.errors import InputError

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "docs" / "results"
SEASONS = ROOT / "seasons"
PAGES = ("README.md", "docs/*.md")
_MARKS = re.compile(
    r"<!-- results:(?P<name>[\w/-]+)(?P<rows>[^>]*) -->\n(?P<text>.*?)<!-- /results:(?P=name) -->", re.DOTALL
)
_RATES = re.compile(
    r"<!-- rate:(?P<name>[\w/-]+) (?P<agent>\S+) (?P<row>\S+) -->.*?<!-- /rate -->", re.DOTALL
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
    for name, found in agent["clutter"].items():
        cells |= {f"{name}:{what}": {key: found[what][key] for key in _CELLS} for what in ("clean", "hit")}
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
        seed = "".join(command.partition("--seed ")[2].split()[:1])
        same = re.sub(rf"(?<!\d){seed}(?!\d)", "S", command) if seed else command
        alike.setdefault(same, []).append((seed, command))
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


def rewritten(text: str, results: Path = RESULTS, seasons: Path = SEASONS) -> str:
    """Return a page with its results as they were recorded."""

    def table(found: re.Match[str]) -> str:
        """Return a table anew, between its marks."""
        name = found["name"]
        shown = render(recorded(name, results, seasons), found["rows"].split())
        return f"<!-- results:{name}{found['rows']} -->\n{shown}<!-- /results:{name} -->"

    def rate(found: re.Match[str]) -> str:
        """Return a rate anew, between its marks."""
        name, agent, row = found["name"], found["agent"], found["row"]
        own = recorded(name, results, seasons)["agents"][agent]
        cell = {**own["by_set"], **own["by_protocol"]}[row]
        words = f"{cell['successes']:,} of {cell['trials']:,}, {rate_words(cell)}"
        return f"<!-- rate:{name} {agent} {row} -->{words}<!-- /rate -->"

    return _RATES.sub(rate, _MARKS.sub(table, text))


def recorded(name: str, results: Path, seasons: Path) -> dict[str, Any]:
    """Return a result by its name: what a JSON file holds, or what follows from an entry's published trials."""
    season, _, entry = name.rpartition("/")
    if not season:
        content: dict[str, Any] = json.loads((results / f"{name}.json").read_text())
        return content
    path = seasons / f"{season}.json"
    scored = read_season(path)
    folders, words = published(results / season, scored, entry), scored.entries[entry]
    with tempfile.TemporaryDirectory() as folder:
        runs = [unpack(run, Path(folder)) for run in folders]
        content = record(runs, words.get("title", entry), words.get("note", ""))
    return content | {"commands": [f"python scripts/season.py run {path.relative_to(seasons.parent)}"]}


def published(folder: Path, season: Season, entry: str) -> list[Path]:
    """Return the evaluations that a season published of an entry, in the order of their seeds.

    Raises:
        InputError: for an entry that there is not, or one that is not there with all its seeds; where the folder holds
            what the season does not name, as an older scoring leaves it.
    """
    own, known = season.folders(entry), {name for each in season.entries for name in season.folders(each)}
    there = {path.parent.name for path in folder.glob("*/run.json")}
    if stale := sorted(there - known):
        raise InputError(f"{folder / stale[0]} is no evaluation of season {season.name}: remove it")
    if missing := [name for name in own if name not in there]:
        raise InputError(f"{folder / missing[0]} is not there: score season {season.name} first")
    return [folder / name for name in own]


class Results(Script):
    """Records evaluations, or writes the pages.

    Attributes:
        folders: of evaluations.
        out: JSON file, e.g. docs/results/robust.json.
        note: what a reader must know: the machine's load, what is meant.
        write: put the tables into the pages.
    """

    folders: Argument[tuple[Folder, ...]] = ()
    out: File | None = None
    title: str = ""
    note: str = ""
    write: bool = False

    def run(self) -> int:
        if self.folders:
            if self.out is None:
                raise InputError("name the JSON file with --out")
            self.out.parent.mkdir(parents=True, exist_ok=True)
            self.out.write_text(json.dumps(record(self.folders, self.title, self.note), indent=1) + "\n")
        if self.write:
            for path in pages():
                path.write_text(rewritten(path.read_text()))
        return 0


if __name__ == "__main__":
    sys.exit(run_script(Results))
