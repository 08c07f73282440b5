"""Grasp physics: friction cones, wrenches, closure, margins, forces."""

from dexgrasp_env.extras import require_extra

require_extra("planner", "the physics of grasps")
