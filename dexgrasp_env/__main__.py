"""`python -m dexgrasp_env` is `dexgrasp`, which acts in this package: it is run, not imported."""

import runpy

if __name__ == "__main__":
    runpy.run_module("dexgrasp", run_name="__main__")
