"""Mounts of the process's cell."""

from dexgrasp_env.robot.active import active_cell

MOUNTS = {mount.name: mount for mount in active_cell().robot.hand.mounts}
