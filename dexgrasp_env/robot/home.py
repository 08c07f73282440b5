"""Where every episode of the process's cell begins."""

from dexgrasp_env.robot.active import active_cell

HOME = active_cell().robot.home
HOME_ARM = HOME[: active_cell().robot.arm_dof]
OPEN_HAND = HOME[active_cell().robot.arm_dof :]
