"""Dexterous grasping on a table: geometry, mechanics, planning, grasp files, motion, learning, evaluation, commands."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dexgrasp.agent import Agent, Report
    from dexgrasp.planning.plan_scene import plan_cloud
    from dexgrasp.registry import make_agent

__all__ = ["Agent", "Report", "make_agent", "plan_cloud"]
_HOMES = {
    "Agent": "dexgrasp.agent", "Report": "dexgrasp.agent", "make_agent": "dexgrasp.registry",
    "plan_cloud": "dexgrasp.planning.plan_scene", "__version__": "dexgrasp_env",
}  # fmt: skip


def __getattr__(name: str) -> object:
    """Import what is asked for, and neither torch nor numba before that."""
    if name not in _HOMES:
        raise AttributeError(f"module 'dexgrasp' has no attribute {name!r}")
    import importlib

    return getattr(importlib.import_module(_HOMES[name]), name)
