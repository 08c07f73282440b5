"""The outcome of planning: a grasp or the reason why there is none, with the time of each stage."""

import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from dexgrasp.grasp.grasp import Grasp
from dexgrasp.motion.script import ActionScript

Item = TypeVar("Item")


@dataclass
class Plan:
    """The outcome of planning.

    Attributes:
        grasp: the first certified grasp that can be carried out, or None.
        script: its actions, where an approach was asked for.
        reason: why there is none: the constraint that blocked most often.
        seconds: time by stage.
        rounds: times that proposals were asked for.
        tried: postures tried.
        blocked: how often each reason blocked, with the smallest violation seen.
    """

    grasp: Grasp | None = None
    script: ActionScript | None = None
    reason: str | None = None
    seconds: dict[str, float] = field(default_factory=dict)
    rounds: int = 0
    tried: int = 0
    blocked: dict[str, tuple[int, float]] = field(default_factory=dict)

    @property
    def total_seconds(self) -> float:
        """Time of all stages."""
        return sum(self.seconds.values())

    def block(self, reason: str, violation: float = 0.0) -> None:
        """Note what stopped a posture, and by how much."""
        count, least = self.blocked.get(reason, (0, np.inf))
        self.blocked[reason] = (count + 1, min(least, violation))

    def commonest(self) -> str | None:
        """Return what stopped most postures, without the names of fingers and bodies; None if nothing did."""
        totals: Counter[str] = Counter()
        for reason, (count, _) in self.blocked.items():
            totals[reason.split(":")[0]] += count
        return totals.most_common(1)[0][0] if totals else None


class Clock:
    """Adds the time since the last lap to a stage of a plan."""

    def __init__(self, plan: Plan) -> None:
        self._plan, self._last = plan, time.perf_counter()

    def lap(self, stage: str) -> None:
        """Book the time since the last lap."""
        now = time.perf_counter()
        self._plan.seconds[stage] = self._plan.seconds.get(stage, 0.0) + now - self._last
        self._last = now

    def laps(self, stage: str, items: Iterator[Item]) -> Iterator[Item]:
        """Book the time that each item takes to come."""
        for item in items:
            self.lap(stage)
            yield item
        self.lap(stage)
