"""The judge: every claim of a grasp file computed again, by means of its own."""

from dexgrasp_env.extras import require_extra

require_extra("planner", "verify")
