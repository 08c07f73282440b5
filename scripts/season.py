"""A season: agents scored once, on seeds that nobody could choose, published with every trial, and shown on pages.

    python scripts/season.py commit seasons/2027-01.json --round 9000000     say what is scored, before the seeds exist
    python scripts/season.py play seasons/2027-01.json --signature HEX       score it, publish it below docs/results
    python scripts/season.py verify seasons/2027-01.json --trials 20         check it: seeds, trials made again
    python scripts/season.py show 2027-01/robust                             one of its tables, from its trials
    python scripts/season.py write                                           put the tables of all into README and docs

Run it in the repository's root. The season's file says what is scored. `commit` writes SEASON.commit.json beside it:
settings and hashes of code, weights, cell, meshes and versions of each entry, and a round of a public randomness beacon
that lies ahead. Published before that round, it leaves nothing to choose: a seed is a hash of this file, of the round's
signature, of the entry's name and of a number. `--entropy WORDS` takes the place of a signature where no beacon is to
be had; it is recorded, and weaker, as whoever plays could have chosen it. `play` refuses whatever is not as it was
committed to, goes on where it was interrupted, and keeps every start and its --again REASON in
`docs/results/SEASON/season.json`.
"""

import gzip
import os
import random
import secrets
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

from season_commitment import Season, commit, committed, entropy_of, read_season
from season_pages import ROOT, TRIALS, pages, render, rewritten, unpack

from dexgrasp.cli.command import Argument, File, Script
from dexgrasp.cli.commands import run_script
from dexgrasp.evaluation.evaluate import evaluate
from dexgrasp.evaluation.replay import replay
from dexgrasp.evaluation.store import read_rows, trial_name
from dexgrasp.runs.pool import Backend
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import file_hash, read_json_object, write_atomically, write_json
from dexgrasp_env.valid import Count, number


class Record:
    """Record of the scorings of a season: time, what its seeds were drawn with, machine, reasons for repeated ones."""

    def __init__(self, season: Season, results: Path) -> None:
        """Read it, where there is one."""
        self.path = results / season.name / "season.json"
        self.season = season
        self.scorings: list[dict[str, Any]] = []
        if self.path.is_file():
            self.scorings = read_json_object(self.path, "restore it from git")["scorings"]

    def begin(self, drawn: Fields, again: str | None) -> int:
        """Begin a scoring, or go on with one; return its number.

        Raises:
            InputError: if the season was scored before and no reason is given.
        """
        last = self.scorings[-1] if self.scorings else None
        ours = {"commitment": file_hash(self.season.commitment), **drawn}
        if last and last["finished"] is None and ours.items() <= last.items():
            return len(self.scorings)
        if last and not again:
            raise InputError(
                f"season {self.season.name} was scored from {last['begun']} on: "
                "a second scoring needs --again REASON, which its record shows"
            )
        now = {"begun": _now(), "finished": None, "again": again, "processors": os.cpu_count()}
        self.scorings.append({**ours, **now})
        self._write()
        return len(self.scorings)

    def finish(self) -> None:
        """Note that every entry was scored."""
        self.scorings[-1]["finished"] = _now()
        self._write()

    def _write(self) -> None:
        write_json(self.path, {"schema": 2, "season": self.season.name, "scorings": self.scorings})


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="minutes")


def play(
    path: Path,
    workers: int,
    signature: str | None = None,
    words: str | None = None,
    again: str | None = None,
    root: Path = ROOT,
) -> Path:
    """Score what is missing of a season and publish it; return the folder of its results.

    Raises:
        InputError: if it may not be scored: not committed to, changed since, or scored before.
    """
    season = read_season(path)
    entropy, drawn = entropy_of(committed(season)["beacon"], signature, words)
    record = Record(season, root / "docs" / "results")
    scoring = record.begin(drawn, again)
    for name, (entry, seed) in season.seeds(entropy).items():
        folder = root / "runs" / f"{season.name}-{scoring}" / name
        evaluate(season.settings(entry, seed), folder, backend=Backend(workers=workers))
        publish(folder, record.path.parent / name)
    record.finish()
    return record.path.parent


def lacking(season: Season, results: Path) -> dict[str, str]:
    """Return the entries that cannot be checked here, each with the reason: not scored yet, or files are missing."""
    found = {}
    for entry in season.entries:
        try:
            season.settings(entry)
        except InputError as error:
            found[entry] = str(error)
        if not all((results / folder).is_dir() for folder in season.folders(entry)):
            found[entry] = "it is not scored yet"
    return found


CODE = "dexgrasp", "dexgrasp_env", "agents", "assets", "examples/agents_of_others"


def git(root: Path, *words: str) -> str:
    """Run git in a repository; return what it prints.

    Raises:
        InputError: with git's words, if it refuses.
    """
    done = subprocess.run(["git", *words], cwd=root, capture_output=True, text=True)
    if done.returncode:
        raise InputError(f"git {words[0]}: {done.stderr.strip()}")
    return done.stdout.strip()


def code_of(season: Season, root: Path = ROOT) -> Path:
    """Return the repository as it was when a season's results were published: here, or a worktree below runs/.

    Raises:
        InputError: if git does not know them.
    """
    commit = git(root, "log", "-1", "--format=%H", "--", f"docs/results/{season.name}") or "HEAD"
    if not git(root, "diff", "--name-only", commit, "--", *CODE):
        return root
    place = root / "runs" / f"code-{commit[:12]}"
    if not place.is_dir():
        git(root, "worktree", "add", "--detach", str(place), commit)
        (place / "sets").symlink_to(root / "sets")
    return place


def verify(season: Season, trials: int, seed: int, root: Path = ROOT) -> Iterator[tuple[bool | None, str]]:
    """Check a season: seeds and commitment, and trials made again; yield whether each is right, and words.

    An entry that is left out gives None.
    A trial is right if it ends in success as it did; on the same processor and versions all of it is equal bit for bit.

    Args:
        season: that is checked.
        trials: to make again.
        seed: that draws them.
        root: of the repository.

    Raises:
        InputError: if it was not scored, or is not as it was committed to.
    """
    results = root / "docs" / "results" / season.name
    if not results.is_dir():
        raise InputError(f"{results} is not there: score season {season.name} first")
    away = lacking(season, results)
    yield from ((None, f"{entry}: {reason}") for entry, reason in away.items())
    if season.commitment.is_file():
        last = Record(season, results.parent).scorings[-1]
        entropy, _ = entropy_of(committed(season, away)["beacon"], last.get("signature"), last.get("entropy"))
        for name, (_, drawn) in season.seeds(entropy).items():
            if (results / name).is_dir():
                told = read_json_object(results / name / "run.json", "score the season first")["seed"]
                yield told == drawn, f"seed of {name} is {told}, and follows from commitment and entropy"
    with tempfile.TemporaryDirectory() as place:
        here = [name for entry in season.entries if entry not in away for name in season.folders(entry)]
        unpacked = {name: unpack(results / name, Path(place)) for name in here}
        rows = [(name, row) for name, run in unpacked.items() for row in read_rows(run)]
        for name, row in random.Random(seed).sample(rows, min(trials, len(rows))):
            again = replay(
                unpacked[name], row["agent"], row["object"], row["trial"], protocol=row["protocol"]
            )
            words = f"other {', '.join(again.changed)}" if again.changed else "the same to the last bit"
            stale = f" (made with other {', '.join(again.stale)})" if again.stale else ""
            yield "success" not in again.changed, f"{name}: {trial_name(row)}: {words}{stale}"


def publish(folder: Path, out: Path) -> None:
    """Write an evaluation's settings and trials to `out`, compressed to the same bytes each time on any machine."""
    out.mkdir(parents=True, exist_ok=True)
    shutil.copy(folder / "run.json", out / "run.json")
    trials = (folder / TRIALS).read_bytes()
    for place in (ROOT, sys.prefix):  # that tracebacks name
        trials = trials.replace(f"{place}/".encode(), b"")
    write_atomically(out / f"{TRIALS}.gz", gzip.compress(trials, mtime=0))


class Commit(Script):
    """Commit to what is scored, before there are seeds.

    Attributes:
        season: a file of seasons/.
        round: of the beacon, ahead of now; none: entropy is entered by hand, which is weaker.
        again: commit anew, and say why.
    """

    season: Argument[File]
    round: Annotated[int | None, number(ge=1)] = None
    again: Annotated[str | None, "REASON"] = None

    def run(self) -> int:
        print(commit(self.season, self.round, datetime.now(UTC), self.again))
        return 0


class Play(Script):
    """Score a season and publish its trials.

    Attributes:
        season: a file of seasons/.
        signature: of the round that was committed to.
        entropy: entered by hand, where no round was.
        again: score a second time, and say why.
    """

    season: Argument[File]
    workers: Count = 1
    signature: Annotated[str | None, "HEX"] = None
    entropy: Annotated[str | None, "WORDS"] = None
    again: Annotated[str | None, "REASON"] = None

    def run(self) -> int:
        print(play(self.season, self.workers, self.signature, self.entropy, self.again))
        return 0


class Verify(Script):
    """Check a published season; exit code 1 where something differs.

    Attributes:
        season: a file of seasons/.
        trials: to make again.
        seed: that draws them (default: one of its own, which is printed).
    """

    season: Argument[File]
    trials: Count = 20
    seed: int | None = None

    def run(self) -> int:
        seed = secrets.randbits(31) if self.seed is None else self.seed
        season = read_season(self.season)
        if season.commitment.is_file() and (code := code_of(season)) != ROOT:
            print(f"with the code of the season, {code}", flush=True)
            words = (
                f"scripts/season.py verify seasons/{self.season.name} --trials {self.trials} --seed {seed}"
            )
            own = {**os.environ, "PYTHONPATH": str(code)}
            return subprocess.run([sys.executable, *words.split()], cwd=code, env=own).returncode
        print(f"trials are drawn with --seed {seed}")
        found = []
        for right, words in verify(season, self.trials, seed):
            print({True: "right", False: "WRONG", None: "left out"}[right], words, sep=": ", flush=True)
            found.append(right)
        print(f"{found.count(True)} right, {found.count(False)} wrong")
        return int(False in found)


class Show(Script):
    """Print the table of an entry, from its trials.

    Attributes:
        name: SEASON/ENTRY.
    """

    name: Argument[str]

    def run(self) -> int:
        print(render(self.name))
        return 0


class Write(Script):
    """Write the tables into the pages."""

    def run(self) -> int:
        for path in pages():
            path.write_text(rewritten(path.read_text()))
        return 0


if __name__ == "__main__":
    sys.exit(
        run_script(
            {
                "commit": Commit,
                "play": Play,
                "verify": Verify,
                "show": Show,
                "write": Write,
            }
        )
    )
