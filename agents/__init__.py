"""Agents: planners and policies that act in the environments."""

__all__ = ["Agent", "Report", "make_agent", "plan_cloud"]
_HOMES = {
    "Agent": "agents.base", "Report": "agents.base", "make_agent": "agents.registry",
    "plan_cloud": "agents.policies.from_cloud",
}  # fmt: skip


def __getattr__(name: str) -> object:
    """Import what is asked for, and neither torch nor numba before that."""
    if name not in _HOMES:
        raise AttributeError(f"module 'agents' has no attribute {name!r}")
    import importlib

    return getattr(importlib.import_module(_HOMES[name]), name)
