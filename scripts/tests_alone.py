"""Runs every file of tests by itself, each as on a new machine: with an empty cache and nothing compiled.

    nice -n 19 python scripts/tests_alone.py                     every file, one after the other: hours
    python scripts/tests_alone.py tests/test_cli.py              these files alone
    python scripts/tests_alone.py --compiled                     with what is compiled already: minutes

Prints a line a file; exits with 1 where one fails.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def passes(path: Path, compiled: bool) -> bool:
    """Run a file of tests in a process of its own and say what came of it."""
    began = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="dexgrasp-alone-") as folder:
        caches = {"DEXGRASP_CACHE": f"{folder}/cache"} | (
            {} if compiled else {"NUMBA_CACHE_DIR": f"{folder}/compiled"}
        )
        command = [sys.executable, "-m", "pytest", "--durations=0", "-p", "no:cacheprovider", str(path)]
        done = subprocess.run(command, cwd=ROOT, env=os.environ | caches, capture_output=True, text=True)
    good = done.returncode in (0, 5)  # 5: all of them are slow ones
    print(f"{'ok  ' if good else 'FAIL'} {path.name} {time.perf_counter() - began:.0f} s", flush=True)
    if not good:
        print(done.stdout[-4000:])
    return good


def main() -> int:
    """Run them; return the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("files", nargs="*", type=Path, default=sorted((ROOT / "tests").glob("test_*.py")))
    parser.add_argument("--compiled", action="store_true", help="keep what numba has compiled")
    args = parser.parse_args()
    return int(not all([passes(path.resolve(), args.compiled) for path in args.files]))


if __name__ == "__main__":
    sys.exit(main())
