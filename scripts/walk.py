"""Walks through a tutorial as a new user would: every command as the page has it, each in a process of its own.

    python scripts/walk.py own-cloud > walk.txt

Prints what was typed, what came of it, and the seconds that it took; exits with 1 at the first command that fails.
Needs `dexgrasp` on the path, and works in an empty folder (`--folder`, else a temporary one).
"""

import argparse
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

DOCS = Path(__file__).parents[1] / "docs" / "tutorials"
FENCE = re.compile(
    r"^```(?:\{code-block\} )?(\w+)\n(?::caption: (\S+)\n\n)?(.*?)^```$", re.MULTILINE | re.DOTALL
)
KEPT = "walk_so_far.py"  # Python blocks go on where the last one ended


class Block(NamedTuple):
    """A block of a page: its language, the file that it is to be kept as (or nothing), its text."""

    language: str
    name: str
    text: str


def blocks(page: Path) -> list[Block]:
    """Return the fenced blocks of a page, in order."""
    return [Block(*found) for found in FENCE.findall(page.read_text())]


def commands(text: str) -> list[str]:
    """Return the command lines of a block of bash, comments apart."""
    lines = (re.sub(r"(^|\s)#.*", "", line).strip() for line in text.replace("\\\n", " ").splitlines())
    return [line for line in lines if line]


def walk(page: Path, folder: Path) -> bool:
    """Do what a page says in a folder; tell whether all of it went well."""
    for block in blocks(page):
        if block.name:
            (folder / block.name).write_text(block.text)
            print(f"\n--- {block.name}\n{block.text}", end="")
        elif block.language == "python":
            with (folder / KEPT).open("a") as file:
                file.write(block.text)
            if not typed([sys.executable, KEPT], f">>> {block.text}", folder):
                return False
        elif not all(typed(["bash", "-c", line], f"$ {line}", folder) for line in commands(block.text)):
            return False
    return True


def typed(command: list[str], shown: str, folder: Path) -> bool:
    """Run one command and print its transcript; tell whether it ended in 0."""
    began = time.perf_counter()
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    print(f"\n{shown.rstrip()}\n{done.stdout}{done.stderr}".rstrip())
    print(f"[{time.perf_counter() - began:.1f} s, exit code {done.returncode}]", flush=True)
    return done.returncode == 0


def main() -> int:
    """Walk; 0 if every command did."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("tutorial", choices=sorted(page.stem for page in DOCS.glob("*.md")))
    parser.add_argument("--folder", type=Path, help="an empty folder to work in, which stays")
    args = parser.parse_args()
    page = DOCS / f"{args.tutorial}.md"
    if args.folder:
        args.folder.mkdir(parents=True, exist_ok=True)
        return int(not walk(page, args.folder))
    with tempfile.TemporaryDirectory() as folder:
        return int(not walk(page, Path(folder)))


if __name__ == "__main__":
    sys.exit(main())
