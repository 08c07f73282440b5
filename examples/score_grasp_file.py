"""A grasp file scored under a published protocol: a floating hand, an object in mid-air, pushed from six sides."""

import json
import subprocess
import sys
from pathlib import Path


def dexgrasp(*words: str) -> None:
    """Run a command of dexgrasp; a non-zero exit code ends the program."""
    subprocess.run([sys.executable, "-m", "dexgrasp_env", *words], check=True)


# Plan a grasp in mid-air and score it as DexGraspBench does.
dexgrasp("plan", "soda", "--floating", "--friction", "0.6", "--seed", "1", "--out", "out/floating")
dexgrasp("score", "out/floating/grasp.json", "--protocol", "dgb_fc", "--out", "out/scores")
scores = json.loads(Path("out/scores/scores.json").read_text())
print(sorted(scores))
