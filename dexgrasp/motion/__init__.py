"""Motion from a grasp configuration: approach, close, squeeze, lift, turn, hold, retreat.

Takes joint angles and obstacles; gives set-points, one a control step. It never chooses contacts.
"""

from dexgrasp_env.extras import require_extra

require_extra("planner", "the execution of grasps")
