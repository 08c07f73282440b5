"""Tables of seasons on pages, from their published trials.

A page shows an entry between `<!-- results:SEASON/ENTRY -->` and `<!-- /results:SEASON/ENTRY -->`, or some of its rows
alone (`results:SEASON/ENTRY ROW ...`); a figure in a sentence stands between `<!-- rate:SEASON/ENTRY AGENT ROW -->` and
`<!-- /rate -->`. A test holds every page against the trials.
"""

import gzip
import re
import shutil
import tempfile
import textwrap
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from season_commitment import Season, read_season

from dexgrasp.evaluation.report.build import read_agents
from dexgrasp.evaluation.report.tables import rate_words
from dexgrasp_env.errors import InputError

ROOT = Path(__file__).resolve().parents[1]
TRIALS = "trials.jsonl"
_MARKS = re.compile(
    r"<!-- results:(?P<name>[\w/-]+)(?P<rows>[^>]*) -->\n(?P<text>.*?)<!-- /results:(?P=name) -->", re.DOTALL
)
_RATES = re.compile(
    r"<!-- rate:(?P<name>[\w/-]+) (?P<agent>\S+) (?P<row>\S+) -->.*?<!-- /rate -->", re.DOTALL
)


def unpack(published: Path, folder: Path) -> Path:
    """Make a published evaluation one that `dexgrasp report` reads; return its folder."""
    out = folder / published.name
    out.mkdir(parents=True, exist_ok=True)
    shutil.copy(published / "run.json", out / "run.json")
    (out / TRIALS).write_bytes(gzip.decompress((published / f"{TRIALS}.gz").read_bytes()))
    return out


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


@cache
def agents_of(name: str, root: Path = ROOT) -> tuple[dict[str, Any], Mapping[str, Any]]:
    """Return the agents' summaries that follow from the published trials of SEASON/ENTRY, and the entry."""
    season, _, entry = name.partition("/")
    scored = read_season(root / "seasons" / f"{season}.json")
    folders = published(root / "docs" / "results" / season, scored, entry)
    with tempfile.TemporaryDirectory() as folder:
        return read_agents([unpack(run, Path(folder)) for run in folders]), scored.entries[entry]


def render(name: str, only: Sequence[str] = (), root: Path = ROOT) -> str:
    """Return the markdown that a page shows of SEASON/ENTRY: all rows of it, or those named."""
    agents, entry = agents_of(name, root)
    several = any(len(_cells(agent, "by_protocol")) > 1 for agent in agents.values())
    kind, key = ("protocol", "by_protocol") if several else ("set", "by_set")
    body = []
    for row in only or dict.fromkeys(row for agent in agents.values() for row in _cells(agent, key)):
        cells = [_cells(agent, key).get(row) for agent in agents.values()]
        trials = " / ".join(dict.fromkeys(str(cell["trials"]) for cell in cells if cell))
        body.append([row, trials, *(rate_words(cell).replace(" %", "") for cell in cells)])
    header = [kind, "trials", *(f"`{agent}`, %" for agent in agents)]
    ruler = ["---", *["---:"] * (len(header) - 1)]
    table = "\n".join("| " + " | ".join(cells) + " |" for cells in [header, ruler, *body])
    words = f"**{entry.get('title', name)}** {entry.get('note', '')}"
    command = f"python scripts/season.py show {name}"
    return f"{textwrap.fill(words, 116, break_on_hyphens=False)}\n\n{table}\n\n```bash\n{command}\n```\n"


def _cells(agent: Mapping[str, Any], key: str) -> dict[str, Any]:
    """Return the rows of a table of an agent; of clutter, clean lifts and hits besides."""
    cells = dict(agent[key])
    if key == "by_protocol":
        cells |= {
            f"{row}:{what}": own[what] for row, own in agent["clutter"].items() for what in ("clean", "hit")
        }
    return cells


def rewritten(text: str, root: Path = ROOT) -> str:
    """Return a page with its results as they were published."""

    def table(found: re.Match[str]) -> str:
        """Return a table anew, between its marks."""
        name, rows = found["name"], found["rows"]
        return f"<!-- results:{name}{rows} -->\n{render(name, rows.split(), root)}<!-- /results:{name} -->"

    def rate(found: re.Match[str]) -> str:
        """Return a rate anew, between its marks."""
        name, row = found["name"], found["row"]
        agent = agents_of(name, root)[0][found["agent"]]
        cell = {**agent["by_set"], **_cells(agent, "by_protocol")}[row]
        words = f"{rate_words(cell)}, {cell['successes']:,} of {cell['trials']:,}"
        return f"<!-- rate:{name} {found['agent']} {row} -->{words}<!-- /rate -->"

    return _RATES.sub(rate, _MARKS.sub(table, text))


def pages() -> list[Path]:
    """Return the pages that may show results."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
