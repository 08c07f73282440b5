"""Agent `bilevel`: cloud -> hull -> proposals -> postures -> bilevel optimisation -> certified grasp -> actions."""

import time
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from dexgrasp.agent import Agent, Observation, Report
from dexgrasp.motion.guarded import GuardedExecution
from dexgrasp.motion.motion import NoPath
from dexgrasp.motion.retreat import Retreat
from dexgrasp.motion.turn import Turn
from dexgrasp.planning.carry import plan_turn
from dexgrasp.planning.many import GraspSet, Progress, check_count, plan_many
from dexgrasp.planning.planner import Plan, Planner, warm_up
from dexgrasp.planning.seen import start_of, target_from_cloud
from dexgrasp.planning.settings import PlannerSettings
from dexgrasp.planning.sources import make_source
from dexgrasp.shape.target import GraspTarget
from dexgrasp_env.errors import InputError


class BilevelAgent(Agent):
    """Plans from the cloud at reset and carries the grasp out; told nothing of the object's pose or mass.

    Where the joints feel that the object was lost, the arm goes home, looks again and grasps once more; where there is
    no grasp, it looks again at once.
    """

    env_settings: ClassVar[Mapping[str, Any]] = {
        "obs_mode": "pointcloud",
        "control_mode": "joint_position",
        "observe": "clear",
    }

    def __init__(
        self, proposals: str = "auto", settings: PlannerSettings | None = None, mount: str = "palm_normal",
        with_closure: bool = True, starts: str = "atlas", regrasps: int = 2, turns: bool = True,
    ) -> None:  # fmt: skip
        """Prepare the planner.

        Args:
            proposals: `surface` (all triples of surface points), `cvae` (learned), `uniform`, or `auto`: `cvae`, and
                `surface` for objects that are not convex or of which the network finds no triple in closure.
            settings: thresholds and budgets of the planner.
            mount: of the hand.
            with_closure: see `Planner`.
            starts: see `Planner`.
            regrasps: how often to look and plan again in an episode where the object was lost or no grasp found.
            turns: whether to turn an object that is barely held, once it is lifted (see `planning.carry`).
        """
        self.settings = settings or PlannerSettings()
        self._source = make_source(proposals)
        self._with_closure, self._starts = with_closure, starts
        self._planner = self._make(mount)
        self._seed, self._turns = 0, turns
        self.plan: Plan | None = None
        self.grasp_target: GraspTarget | None = None
        self._regrasps, self._left = regrasps, 0
        self._execution: GuardedExecution | Retreat | None = None

    def _make(self, mount: str) -> Planner:
        warm_up(mount, self._source)
        return Planner(
            self.settings, self._source, mount, starts=self._starts, with_closure=self._with_closure
        )

    def seed(self, seed: int) -> None:
        """Seed the proposals of the next episode."""
        self._seed = int(seed)

    def reset(self, observation: Observation, info: Mapping[str, Any]) -> None:
        """Plan from the cloud of the first observation."""
        start, began = start_of(observation), time.perf_counter()
        target = self._look(observation, info)
        if target is None:
            return
        hull_seconds = time.perf_counter() - began
        self.plan = self._planner.plan(target, self._seed, start)
        self._execution = self._carried_out(self.plan, target)
        # Only where the cameras look again: what they saw at first is no longer where the object is.
        self._left = self._regrasps if info.get("observe") in ("clear", "step") else 0
        self.report = Report(
            failure=None if self._execution else f"no_grasp:{self.plan.reason}",
            again=not self._execution and self._left > 0,
            planning_seconds=time.perf_counter() - began,
            details=_details(self.plan, hull_seconds),
        )
        if self.report.again:
            self._let_go(observation)

    def plan_set(
        self, observation: Observation, info: Mapping[str, Any], count: int, progress: Progress | None = None
    ) -> GraspSet | None:
        """Plan grasps that differ, of which none is carried out; None where no object is seen: `report` says why.

        Args:
            observation: the first of an episode.
            info: as `reset` takes it.
            count: grasps asked for.
            progress: called with steps done and steps in all.

        Raises:
            InputError: for a count out of range.
        """
        check_count(count)
        start, began = start_of(observation), time.perf_counter()
        target = self._look(observation, info)
        if target is None:
            return None
        hull_seconds = time.perf_counter() - began
        found = plan_many(self._planner, target, count, self._seed, start, progress)
        self.report = Report(
            failure=None if found.plans else f"no_grasp:{found.search.reason}",
            planning_seconds=time.perf_counter() - began,
            details=_details(found.search, hull_seconds),
        )
        return found

    def _look(self, observation: Observation, info: Mapping[str, Any]) -> GraspTarget | None:
        """Take the object from what is seen; None, with the reason in `report`, where there is none."""
        if info.get("mount", self._planner.mount) != self._planner.mount:
            self._planner = self._make(str(info["mount"]))
        self._execution, self.plan, self.grasp_target = None, None, None
        began, failure = time.perf_counter(), info.get("perception_failure")
        if not failure:
            self.grasp_target, failure = target_from_cloud(observation)
        if self.grasp_target is None:
            self.report = Report(failure=str(failure), planning_seconds=time.perf_counter() - began)
        return self.grasp_target

    def act(self, observation: Observation) -> NDArray[np.float32]:
        """Return the next set-points."""
        if self._execution is None:
            raise InputError("this agent has no plan: reset() says why in report.failure")
        if self._execution.lost and self._left:
            self._let_go(observation)
        elif isinstance(self._execution, Retreat) and self._execution.done and self._left:
            self._grasp_again(observation)
        return self._execution.action(observation["joint_positions"])

    def _carried_out(self, plan: Plan, target: GraspTarget | None) -> GuardedExecution | None:
        grasp, script, planner = plan.grasp, plan.script, self._planner
        if grasp is None or script is None or target is None:
            return None

        def turn() -> Turn | None:
            return plan_turn(grasp, script, target, planner.tree, self.settings) if self._turns else None

        return GuardedExecution(script, grasp.normals, grasp.forces, planner.tree, turn)

    def _let_go(self, observation: Observation) -> None:
        """Go home, where the cameras look again; stay as it is where there is no way."""
        try:
            self._execution = Retreat(start_of(observation), self._planner.tree)
        except NoPath:
            self._left, self.report.again = 0, False

    def _grasp_again(self, observation: Observation) -> None:
        """Plan from what the cameras see now that the hand is out of their way; without a grasp, stay."""
        self._left -= 1
        tries = self._regrasps - self._left
        self.report.details["regrasps"] = tries
        began = time.perf_counter()
        target, _ = target_from_cloud(observation)
        plan = (
            Plan()
            if target is None
            else self._planner.plan(target, self._seed + tries, start_of(observation))
        )
        carried = self._carried_out(plan, target)
        self._execution = carried or self._execution
        if (
            self.report.failure and self.report.planning_seconds is not None
        ):  # the first grasp is still to be found
            self.report.planning_seconds += time.perf_counter() - began
            self.report.again = carried is None and self._left > 0
            if carried is not None:
                self.report.failure, self.plan, self.grasp_target = None, plan, target


def _details(plan: Plan, hull_seconds: float) -> dict[str, Any]:
    details: dict[str, Any] = {
        "stages": {"hull": hull_seconds} | plan.seconds,
        # The columns of Table 6: where contacts come from, how a hand gets there, what makes it feasible.
        "stage_seconds": {
            "cvae": plan.seconds.get("proposals", 0.0),
            "ik": plan.seconds.get("postures", 0.0),
            "bilevel": plan.seconds.get("bilevel", 0.0) + plan.seconds.get("certificate", 0.0),
        },
        "stage_repeats": {"cvae": plan.rounds, "ik": plan.tried, "bilevel": plan.tried},
        "postures_tried": plan.tried,
        "blocked": {reason: count for reason, (count, _) in plan.blocked.items()},
    }
    if plan.grasp is not None:
        details["certificate"] = plan.grasp.certificate.as_json()
    return details
