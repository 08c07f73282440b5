"""Result of planning: certified grasps with the way to each, or why there is none, and what the search did."""

import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol, TypeVar, runtime_checkable

import numpy as np

from dexgrasp.agent import Info, Observation, Report
from dexgrasp.geometry.convex import ConvexDistance
from dexgrasp.geometry.neighbours import SEEN
from dexgrasp.geometry.target import GraspTarget
from dexgrasp.grasp.diversity import component_shares, grasp_features
from dexgrasp.grasp.grasp import Grasp
from dexgrasp.grasp.identity import ObjectIdentity
from dexgrasp.grasp.planned_record import ObjectPose, Origin, grasp_json, planned_record
from dexgrasp.grasp.trajectory import ActionScript
from dexgrasp.planning.settings import PlannerSettings
from dexgrasp_env.arrays import Fields

Item = TypeVar("Item")
Progress = Callable[[int, int], None]
"""Told how many steps are done, and how many there are."""


class Planned(NamedTuple):
    """A certified grasp, and how it is carried out where an approach was asked for."""

    grasp: Grasp
    script: ActionScript | None


@dataclass
class SearchLog:
    """Record of a search.

    Attributes:
        seconds: time by stage.
        rounds: times that proposals were asked for.
        tried: starting postures that were refined.
        blocked: how often each reason blocked, with the smallest violation seen.
        began: when the search began (`perf_counter`).
    """

    seconds: dict[str, float] = field(default_factory=dict)
    rounds: int = 0
    tried: int = 0
    blocked: dict[str, tuple[int, float]] = field(default_factory=dict)
    began: float = field(default_factory=time.perf_counter)
    _last: float = field(default_factory=time.perf_counter)

    def lap(self, stage: str) -> None:
        """Book the time since the last lap, at first since the log was made."""
        now = time.perf_counter()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self._last
        self._last = now

    def laps(self, stage: str, items: Iterator[Item]) -> Iterator[Item]:
        """Book the time that each item takes to come."""
        for item in items:
            self.lap(stage)
            yield item
        self.lap(stage)

    def block(self, reason: str, violation: float = 0.0) -> None:
        """Note what stopped a posture, and by how much."""
        count, least = self.blocked.get(reason, (0, np.inf))
        self.blocked[reason] = (count + 1, min(least, violation))

    def counts(self) -> dict[str, int]:
        """Return how often each reason blocked."""
        return {reason: count for reason, (count, _) in self.blocked.items()}

    def totals(self) -> Counter[str]:
        """Return the same without the names of fingers and bodies."""
        return Counter(reason.split(":")[0] for reason, count in self.counts().items() for _ in range(count))

    def commonest(self) -> str | None:
        """Return what stopped most postures; None if nothing did."""
        totals = self.totals()
        return totals.most_common(1)[0][0] if totals else None


@dataclass
class PlanResult:
    """The outcome of planning one grasp, or several that differ.

    Attributes:
        target: what the object was taken for; None where no object was seen.
        settings: of the planner.
        seed: that it was planned with.
        asked: how many grasps were asked for; None: one.
        found: the grasps, by load, firmest first.
        shortfall: why there are fewer than asked, in a word that can be counted; None with all.
        sentence: the same for people, where what was seen says more than the word.
        relaxation: what could be had of a request that cannot be met, in words; empty where nothing was asked.
        log: of the search.
        planning_seconds: from the scene to the certified grasps with their approach.
        cpu_seconds: processor time of the search.
    """

    target: GraspTarget | None = None
    settings: PlannerSettings = field(default_factory=PlannerSettings)
    seed: int = 0
    asked: int | None = None
    found: list[Planned] = field(default_factory=list)
    shortfall: str | None = None
    sentence: str = ""
    relaxation: str = ""
    log: SearchLog = field(default_factory=SearchLog)
    planning_seconds: float = 0.0
    cpu_seconds: float = 0.0

    @property
    def neighbours(self) -> ConvexDistance | None:
        """Obstacles around the object, which must not be touched; None where there is nothing, or no object."""
        return None if self.target is None else self.target.around

    @property
    def grasps(self) -> list[Grasp]:
        """The grasps alone, firmest first."""
        return [planned.grasp for planned in self.found]

    @property
    def grasp(self) -> Grasp | None:
        """The firmest grasp, or None."""
        return self.found[0].grasp if self.found else None

    @property
    def script(self) -> ActionScript | None:
        """Its actions, where an approach was asked for."""
        return self.found[0].script if self.found else None

    @property
    def success(self) -> bool:
        """True with as many grasps as were asked for."""
        return len(self.found) == (self.asked or 1)

    @property
    def reason(self) -> str | None:
        """Why there are fewer grasps than asked, as files and tables have it; None with all."""
        if self.target is not None and not self.found:
            return f"no_grasp:{self.shortfall}"
        return self.shortfall

    @property
    def failure(self) -> str | None:
        """The reason why there is no grasp at all; None with one."""
        return None if self.found else self.reason

    @property
    def hidden_side(self) -> str:
        """Words on whether contacts hold both guesses of a side that no camera saw; empty where none was guessed."""
        if self.target is None or self.target.near is None or not self.found:
            return ""
        gap = max(self.target.gap(grasp.contacts) for grasp in self.grasps)
        if gap < SEEN:  # as surface that was seen may be off
            return "contacts hold the nearest and the farthest guess of the side that no camera saw"
        return f"doubt: contacts are on a side that no camera saw; it may be {1000 * gap:.0f} mm nearer"

    @property
    def diversity(self) -> list[float]:
        """Share of variance in the first 1 to 5 principal components of palm pose and joints; lower is more varied."""
        return component_shares(np.array([grasp_features(grasp) for grasp in self.grasps]))

    @property
    def per_second(self) -> float:
        """Grasps a second of one core."""
        return len(self.found) / max(self.cpu_seconds, 1e-9)

    def report(self) -> Report:
        """Return what an agent says that carries the grasp out."""
        seconds, tried = self.log.seconds, self.log.tried
        details: Fields = {
            "stages": seconds,
            # The columns of Table 6: where contacts come from, how a hand gets there, what makes it feasible.
            "stage_seconds": {
                "cvae": seconds.get("proposals", 0.0),
                "ik": seconds.get("postures", 0.0),
                "bilevel": seconds.get("bilevel", 0.0) + seconds.get("certificate", 0.0),
            },
            "stage_repeats": {"cvae": self.log.rounds, "ik": tried, "bilevel": tried},
            "blocked": self.log.counts(),
        }
        if self.grasp is not None:
            details["certificate"] = self.grasp.certificate.as_json()
        return Report(
            failure=self.failure,
            planning_seconds=self.planning_seconds,
            details={} if self.target is None else details,
        )

    def contents(
        self, name: str | ObjectIdentity, agent: str = "bilevel", pose: ObjectPose | None = None
    ) -> list[Fields]:
        """Return the grasps as grasp files hold them, firmest first.

        Args:
            name: which object, or only what to call it.
            agent: who planned.
            pose: of the true object, where it is known.
        """
        if self.target is None:
            return []
        origin = Origin(agent, self.seed, self.planning_seconds / max(len(self.found), 1))
        return [
            grasp_json(
                planned_record(
                    name, one.grasp, self.target, self.settings, script=one.script, pose=pose, origin=origin
                )
            )
            for one in self.found
        ]

    def as_json(
        self, name: str | ObjectIdentity, agent: str = "bilevel", pose: ObjectPose | None = None
    ) -> Fields:
        """Return the object that `dexgrasp plan --json` prints; `grasp` is the firmest. Arguments as in `contents`."""
        contents = self.contents(name, agent, pose)
        first = contents[0] if contents else None
        result = {
            "schema": 1,
            "object": name if isinstance(name, str) else name.name,
            "success": self.success,
            "reason": self.reason,
            "planning_seconds": self.planning_seconds,
            "stages": self.log.seconds,
            "blocked": self.log.counts(),
            "violations": {reason: float(least) for reason, (_, least) in self.log.blocked.items()},
            "grasp": first,
            "certificate": None if first is None else first["certificate"],
        }
        beside = {"relaxation": self.relaxation, "hidden_side": self.hidden_side}
        result |= {key: words for key, words in beside.items() if words}
        if self.asked is None:
            return result
        return result | {
            "asked": self.asked,
            "count": len(contents),
            "grasps_per_cpu_second": self.per_second,
            "diversity": self.diversity,
            "grasps": contents,
        }


@runtime_checkable
class PlansGrasps(Protocol):
    """Members that agents which plan certified grasps offer beside those of `Agent`.

    Attributes:
        settings: of the planner.
        result: the plan of the episode; None before the first.
    """

    settings: PlannerSettings
    result: PlanResult | None

    def plan(
        self,
        observation: Observation,
        info: Info,
        progress: Progress | None = None,
        relax: bool = False,
    ) -> PlanResult:
        """Plan from the first observation of an episode what was asked for; carry nothing out."""
