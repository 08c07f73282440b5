"""A trajectory for a robot: planned, exported as rows of joint positions, and checked before anything moves."""

import subprocess
import sys

import numpy as np


def dexgrasp(*words: str) -> None:
    """Run a command of dexgrasp; a non-zero exit code ends the program."""
    subprocess.run([sys.executable, "-m", "dexgrasp_env", *words], check=True)


# Write the arm's rows at 1 kHz and the hand's at 333 Hz.
dexgrasp("plan", "soda", "--seed", "3", "--out", "out/soda")
dexgrasp("export", "out/soda/grasp.json", "--format", "csv", "--out", "out/robot")
dexgrasp("check", "out/robot")
arm = np.genfromtxt("out/robot/arm.csv", delimiter=",", names=True)
print(arm.dtype.names, arm["t"][-1], "s")
