"""The judge: every claim of a grasp file computed again, by means of its own.

Takes a grasp file; gives a list of checks. It never imports the planner or its solvers.
"""

from dexgrasp_env.extras import require_extra

require_extra("planner", "verify")
