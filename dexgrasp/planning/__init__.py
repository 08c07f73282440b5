"""From a cloud or a mesh to a certified grasp."""

from dexgrasp_env.extras import require_extra

require_extra("planner", "the planner")
