"""A season: agents scored once, on seeds that nobody could know, published with every trial, and shown on pages.

    python scripts/season.py seeds seasons/2026-12.json                  which seeds a tagged release gives it
    python scripts/season.py run seasons/2026-12.json --workers 4        score it, publish it below docs/results
    python scripts/season.py write                                       put the tables of all into README and docs

Run it in the repository's root. The file says what is scored; it is committed before the release that it names is
tagged. A seed is a hash of the tagged commit, of the file, of the entry's name and of a number, so that it exists only
when neither planner nor season can change any more. A run that was interrupted goes on; a second scoring is refused
without --again REASON, and `docs/results/SEASON/season.json` keeps every reason.

A page shows an entry between `<!-- results:SEASON/ENTRY -->` and `<!-- /results:SEASON/ENTRY -->`, or some of its rows
alone (`results:SEASON/ENTRY ROW ...`); a figure in a sentence stands between `<!-- rate:SEASON/ENTRY AGENT ROW -->` and
`<!-- /rate -->`. A test holds every page against the trials.
"""

import gzip
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Annotated, Any

from dexgrasp.cli.command import Argument, File, Script
from dexgrasp.cli.commands import run_script
from dexgrasp.evaluation.evaluate import evaluate
from dexgrasp.evaluation.report.build import read_agents
from dexgrasp.evaluation.report.tables import rate_words
from dexgrasp.evaluation.settings import EvaluationSettings
from dexgrasp.runs.pool import Backend
from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.files import read_json_object, write_atomically, write_json
from dexgrasp_env.valid import Count

ROOT = Path(__file__).resolve().parents[1]
SCHEMA = 1
SCORED = ("dexgrasp_env", "dexgrasp", "agents", "assets")
"""What outcomes rest on: as released while a season is scored."""
TRIALS = "trials.jsonl"
_MARKS = re.compile(
    r"<!-- results:(?P<name>[\w/-]+)(?P<rows>[^>]*) -->\n(?P<text>.*?)<!-- /results:(?P=name) -->", re.DOTALL
)
_RATES = re.compile(
    r"<!-- rate:(?P<name>[\w/-]+) (?P<agent>\S+) (?P<row>\S+) -->.*?<!-- /rate -->", re.DOTALL
)


@dataclass(frozen=True)
class Season:
    """Content of a season.

    Attributes:
        name: of the season, the file's stem.
        release: the tag whose code is scored.
        entries: settings of evaluations by name, with `seeds` (how many of each), a `title` and a `note` for readers.
        digest: of the file.
    """

    name: str
    release: str
    entries: Mapping[str, Mapping[str, Any]]
    digest: str

    def folders(self, entry: str) -> list[str]:
        """Return the names of an entry's evaluations, one a seed.

        Raises:
            InputError: for an entry that there is not.
        """
        if entry not in self.entries:
            raise unknown_name(f"entry of season {self.name}", entry, self.entries)
        return [f"{entry}-{number}" for number in range(self.entries[entry].get("seeds", 1))]

    def scorings(self, commit: str) -> Iterator[tuple[str, EvaluationSettings]]:
        """Yield every evaluation by the name of its folder, with its settings.

        Raises:
            InputError: for settings that are none.
        """
        for name, entry in self.entries.items():
            words = {key: value for key, value in entry.items() if key not in ("seeds", "title", "note")}
            for number, folder in enumerate(self.folders(name)):
                seed = season_seed(commit, self.digest, name, number)
                yield folder, EvaluationSettings.of(**words, seed=seed)


def season_seed(commit: str, digest: str, entry: str, number: int) -> int:
    """Return a seed below 2^31 that follows from the release, the season's file, the entry and a number."""
    words = f"{commit} {digest} {entry} {number}"
    return int.from_bytes(hashlib.sha256(words.encode()).digest()[:4], "big") >> 1


def read_season(path: Path) -> Season:
    """Read a season's file.

    Raises:
        InputError: if it is none.
    """
    content = read_json_object(path, "name a file of seasons/")
    entries, release = content.get("entries"), content.get("release")
    known = isinstance(entries, dict) and all(isinstance(entry, dict) for entry in entries.values())
    if content.get("schema") != SCHEMA or not known or not isinstance(release, str):
        raise InputError(f"{path} is no season: it has schema {SCHEMA}, a release's tag and entries by name")
    return Season(path.stem, release, entries, hashlib.sha256(path.read_bytes()).hexdigest())


def released(season: Season, path: Path, root: Path = ROOT) -> str:
    """Return the commit of the release, with which the code and the file that are here agree.

    Raises:
        InputError: if the tag does not exist, or something differs from it.
    """
    commit = _git(root, "rev-parse", "--verify", "--quiet", f"{season.release}^{{commit}}").strip()
    if not commit:
        raise InputError(f"{season.name} is of release {season.release}: there is no such tag yet")
    rests_on = [*SCORED, str(path.resolve().relative_to(root.resolve()))]
    changed = _git(root, "diff", "--name-only", commit, "--", *rests_on).split()
    changed += _git(root, "ls-files", "--others", "--exclude-standard", "--", *rests_on).split()
    if changed:
        raise InputError(f"{changed[0]} is not as it was released ({season.release}): check that release out")
    return commit


def _git(root: Path, *words: str) -> str:
    return subprocess.run(["git", "-C", str(root), *words], capture_output=True, text=True).stdout


class Record:
    """Record of a scoring: time, source, machine, and the reason for a repeated one."""

    def __init__(self, season: Season, results: Path) -> None:
        """Read it, where there is one."""
        self.path = results / season.name / "season.json"
        self.season = season
        self.scorings: list[dict[str, Any]] = []
        if self.path.is_file():
            self.scorings = read_json_object(self.path, "restore it from git")["scorings"]

    def begin(self, commit: str, again: str | None) -> int:
        """Begin a scoring, or go on with one; return its number.

        Raises:
            InputError: if the season was scored before and no reason is given.
        """
        last = self.scorings[-1] if self.scorings else None
        ours = {"commit": commit, "file": self.season.digest}
        if last and last["finished"] is None and ours.items() <= last.items():
            return len(self.scorings)
        if last and not again:
            raise InputError(
                f"season {self.season.name} was scored from {last['begun']} on, at {last['commit'][:10]}: "
                "a second scoring needs --again REASON, which its record shows"
            )
        self.scorings.append({**ours, "begun": _now(), "finished": None, "again": again, "load": os.getloadavg()[0],
                              "processors": os.cpu_count()})  # fmt: skip
        self._write()
        return len(self.scorings)

    def finish(self) -> None:
        """Note that every entry was scored."""
        self.scorings[-1]["finished"] = _now()
        self._write()

    def _write(self) -> None:
        write_json(self.path, {"schema": SCHEMA, "season": self.season.name, "scorings": self.scorings})


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="minutes")


def run(path: Path, workers: int, again: str | None = None, root: Path = ROOT) -> Path:
    """Score what is missing of a season and publish it; return the folder of its results.

    Raises:
        InputError: if it may not be scored: not released, changed since, or scored before.
    """
    season = read_season(path)
    commit = released(season, path, root)
    scorings = list(season.scorings(commit))  # mistakes in any entry show before the record is begun
    record = Record(season, root / "docs" / "results")
    number = record.begin(commit, again)
    for name, settings in scorings:
        folder = root / "runs" / f"{season.name}-{number}" / name
        evaluate(settings, folder, backend=Backend(workers=workers))
        publish(folder, record.path.parent / name)
    record.finish()
    return record.path.parent


def publish(folder: Path, out: Path) -> None:
    """Write an evaluation's settings and trials to `out`, compressed to the same bytes each time on any machine."""
    out.mkdir(parents=True, exist_ok=True)
    shutil.copy(folder / "run.json", out / "run.json")
    trials = (folder / TRIALS).read_bytes()
    for place in (ROOT, sys.prefix):  # that tracebacks name
        trials = trials.replace(f"{place}/".encode(), b"")
    write_atomically(out / f"{TRIALS}.gz", gzip.compress(trials, mtime=0))


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
    command = f"python scripts/season.py run seasons/{name.partition('/')[0]}.json"
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
        words = f"{cell['successes']:,} of {cell['trials']:,}, {rate_words(cell)}"
        return f"<!-- rate:{name} {found['agent']} {row} -->{words}<!-- /rate -->"

    return _RATES.sub(rate, _MARKS.sub(table, text))


def pages() -> list[Path]:
    """Return the pages that may show results."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


class Seeds(Script):
    """Says the seeds of a season."""

    season: Argument[File]

    def run(self) -> int:
        season = read_season(self.season)
        seeds = {name: own.seed for name, own in season.scorings(released(season, self.season))}
        print(json.dumps(seeds, indent=1))
        return 0


class Run(Script):
    """Scores a season.

    Attributes:
        season: a file of seasons/.
        again: score a second time, and say why.
    """

    season: Argument[File]
    workers: Count = 1
    again: Annotated[str | None, "REASON"] = None

    def run(self) -> int:
        print(run(self.season, self.workers, self.again))
        return 0


class Write(Script):
    """Puts the tables into the pages."""

    def run(self) -> int:
        for path in pages():
            path.write_text(rewritten(path.read_text()))
        return 0


if __name__ == "__main__":
    sys.exit(run_script({"seeds": Seeds, "run": Run, "write": Write}))
