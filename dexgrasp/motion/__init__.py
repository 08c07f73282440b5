"""From a grasp configuration to actions: approach, close, squeeze, lift, hold."""

from dexgrasp_env.extras import require_extra

require_extra("planner", "the execution of grasps")
