"""Code in a Python of its own."""

import subprocess
import sys
import textwrap


def python(code, *arguments, **options):
    """Run code, which must end well, and return what it printed."""
    command = [sys.executable, "-c", textwrap.dedent(code), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, **options)
    assert done.returncode == 0, done.stderr
    return done.stdout


def typed(line):
    """Run a command in this process, as one types it, and return its exit code."""
    from dexgrasp.cli.main import main  # what a test does not ask for is not imported

    return main(line.split())
