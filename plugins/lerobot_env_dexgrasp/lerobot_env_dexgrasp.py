"""Plug-in of LeRobot: importing it registers `--env.type=dexgrasp`."""

from dexgrasp.learning.lerobot.config import DexGraspEnv

__all__ = ["DexGraspEnv"]
