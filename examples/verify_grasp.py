"""A grasp file: planned by the command, read, and verified by the independent judge."""

import subprocess
import sys
from pathlib import Path

from dexgrasp.grasp.file import read_grasp
from dexgrasp.grasp.verify.verify import verify

# Plan a grasp of a soda can and print every check.
command = [sys.executable, "-m", "dexgrasp_env", "plan", "soda", "--seed", "3", "--out", "out/soda"]
subprocess.run(command, check=True)
checks = verify(read_grasp(Path("out/soda/grasp.json")))
for check in checks:
    print(check)
