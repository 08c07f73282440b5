"""Demonstrations: rollouts of agents, converted, replayed, and stored as data sets that other libraries read."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dexgrasp.data.demonstrations.resets import DemoResets

__all__ = ["DemoResets"]


def __getattr__(name: str) -> object:
    """Import a name on first use."""
    if name not in __all__:
        raise AttributeError(f"module 'dexgrasp.data.demonstrations' has no attribute {name!r}")
    from dexgrasp.data.demonstrations.resets import DemoResets

    return DemoResets
