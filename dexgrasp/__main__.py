"""`python -m dexgrasp` is `dexgrasp`."""

import sys

from dexgrasp.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
