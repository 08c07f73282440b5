"""`python -m dexgrasp_env` is `dexgrasp`.

The command line belongs to the package that acts in this one; it is found by its entry point, not by an import.
"""

import sys
from importlib.metadata import entry_points


def main() -> int:
    """Run the console script that the installed distribution declares."""
    scripts = entry_points(group="console_scripts", name="dexgrasp")
    if not scripts:
        print("dexgrasp is not installed: pip install . in its checkout", file=sys.stderr)
        return 2
    return int(next(iter(scripts)).load()())


if __name__ == "__main__":
    sys.exit(main())
