"""Agent `bilevel`: cloud -> hull -> proposals -> postures -> bilevel optimisation -> certified grasp -> actions."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from dexgrasp.agent import BY_CLOUD, Agent, Observation, cell_of
from dexgrasp.motion.carried import SettingAside, WayAside
from dexgrasp.motion.carrying import GuardedCarry
from dexgrasp.motion.motion import NoPath
from dexgrasp.motion.move_until_contact import GuardedGrasp
from dexgrasp.motion.retreat import Retreat
from dexgrasp.motion.slide import Slide
from dexgrasp.planning.carry import plan_turn
from dexgrasp.planning.overhang import plan_slid, plan_slide
from dexgrasp.planning.plan_scene import default_planner, plan_scene, start_of
from dexgrasp.planning.planner import LIFT_BLOCKED, Planner
from dexgrasp.planning.rearrange import plan_aside
from dexgrasp.planning.result import PlanResult, Progress
from dexgrasp.planning.settings import PlannerSettings, Problem
from dexgrasp_env.arrays import Array, Single
from dexgrasp_env.errors import InputError
from dexgrasp_env.perception.scene import ObjectCloud, Scene
from dexgrasp_env.robot.cell import Cell, default_cell

_NUDGE = 0.01  # m that neighbours may be pushed where a second look gives no grasp
_PUSH = 0.05  # m, where none of them can be set aside either


class State(NamedTuple):
    """Where in an episode the agent is: it looks, grasps, carries; what it loses it leaves, and looks again."""

    motion: GuardedGrasp | GuardedCarry | SettingAside | Slide | Retreat
    plan: PlanResult  # the last one
    looks: int  # that are left
    moves: int = 0  # of neighbours, that are left
    aside: WayAside | None = None  # of a neighbour that is in hand, or that was when the robot went home


class BilevelAgent(Agent):
    """Plans from the cloud at reset and carries the grasp out; told nothing of the object's pose or mass.

    Where the joints feel that the object was lost, the arm goes home, looks again and grasps once more; where there is
    no grasp, a neighbour that is in the way is set aside first, what lies flat is slid over the table's edge, or the
    agent looks again at once.
    """

    env_settings = BY_CLOUD | {"observe": "clear"}

    def __init__(
        self,
        proposals: str = "auto",
        settings: PlannerSettings | None = None,
        cell: Cell | None = None,
        *,
        regrasps: int = 2,
        turns: bool = True,
        moves: int = 8,
    ) -> None:
        """Prepare the planner.

        Args:
            proposals: `surface` (all triples of surface points), `cvae` (learned), or `auto`: `cvae`, and `surface` for
                objects that are not convex or of which the network finds no triple in closure.
            settings: thresholds and budgets of the planner.
            cell: of the robot, where an episode says none; the simulated one by default.
            regrasps: how often to look and plan again in an episode where the object was lost or no grasp found.
            turns: whether to turn an object that is barely held, once it is lifted (see `planning.carry`).
            moves: how many neighbours to set aside at most where the object cannot be grasped among them.
        """
        self.settings = settings or PlannerSettings()
        self.result: PlanResult | None = None
        self._proposals = proposals
        self._planner = self._make(cell or default_cell())
        self._regrasps, self.turns, self._moves = regrasps, turns, moves
        self._seed, self._looks = 0, regrasps
        self._state: State | None = None

    def _make(self, cell: Cell) -> Planner:
        return default_planner(cell, self.settings, self._proposals)

    def seed(self, seed: int) -> None:
        """Seed the proposals of the next episode."""
        self._seed = int(seed)

    def plan(
        self,
        observation: Observation,
        info: Mapping[str, Any],
        count: int | None = None,
        progress: Progress | None = None,
    ) -> PlanResult:
        """Plan from the first observation of an episode; nothing is carried out.

        Args:
            observation: of a cloud.
            info: as `reset` takes it.
            count: grasps asked for, that differ; None plans one.
            progress: called with steps done and steps in all, where there is a count.

        Raises:
            InputError: for a count out of range, or an observation that shows no cloud or no robot.
        """
        if (cell := cell_of(info, self._planner.cell)) != self._planner.cell:
            self._planner = self._make(cell)
        scene = self._scene(observation, info)
        return plan_scene(
            self._planner, scene, self._seed, self._start(observation), count=count, progress=progress
        )

    def reset(self, observation: Observation, info: Mapping[str, Any]) -> None:
        """Plan from the cloud of the first observation."""
        self._state, self.result = None, None
        plan = self.result = self.plan(observation, info)
        self.report = plan.report()
        # Only where the cameras look again: what they saw at first is no longer where the object is.
        again = info.get("observe") in ("clear", "step")
        # Among neighbours each try shifts something, and another grasp may then be there.
        crowded = plan.around is not None and self._regrasps > 0
        self._looks = max(self._regrasps, self._moves) if crowded else self._regrasps
        looks, moves = (self._looks, self._moves) if again else (0, 0)
        if plan.found:
            self._state = State(self._grasp(plan), plan, looks, moves)
        elif plan.target is not None and again:
            home = self._way_home(observation, plan) if looks else None
            waiting = None if home is None else State(home, plan, looks, moves)
            self._state = (
                self._make_way(observation, plan, moves, looks, self._scene(observation, info))
                or self._slide(observation, plan, looks)
                or waiting
            )
            self.report.again, self.report.planning_seconds = self._state is not None, plan.planning_seconds

    def act(self, observation: Observation) -> Single:
        """Return the next set-points."""
        if self._state is None:
            raise InputError("this agent has no plan: reset() says why in report.failure")
        self._state = self._next(self._state, observation)
        return self._state.motion.action(observation["joint_positions"])

    def _next(self, state: State, observation: Observation) -> State:
        """Return the state to act in: what is grasped is carried, what is lost is left, and at home it looks again."""
        match state.motion:
            case GuardedGrasp(done=True) as held if state.aside is not None:
                return state._replace(motion=SettingAside(held, state.aside))
            case GuardedGrasp(done=True) as held:
                return state._replace(motion=self._carry(held, state.plan))
            case Slide(done=True) as slide if self.report.again:
                return self._grasp_slid(state, slide, observation)
            case SettingAside(done=True):
                home = self._way_home(observation, state.plan)
                return state if home is None else state._replace(motion=home)
            # Where the hold is long over, the hand has something else: neighbours feel like the object.
            case GuardedCarry() as carry if state.looks and (
                carry.lost or (carry.overdue and state.plan.around is not None)
            ):
                if (home := self._way_home(observation, state.plan)) is not None:
                    return state._replace(motion=home)
                # Right above the table the hand may have no room to open: it has a little higher.
                return state if carry.lifting else state._replace(looks=0)
            case Retreat(done=True) if state.looks or state.aside is not None:
                return self._look_again(state, observation)
        return state

    def _scene(self, observation: Observation, info: Mapping[str, Any] | None = None) -> Scene:
        return Scene.of_observation(observation, info)

    def _start(self, observation: Observation) -> Array:
        return start_of(observation, self._planner.cell.robot)

    def _grasp(self, plan: PlanResult, **how: float) -> GuardedGrasp:
        grasp, script = plan.found[0]
        assert script is not None  # every plan here begins where the robot stands
        return GuardedGrasp(script, grasp, **how)

    def _carry(self, held: GuardedGrasp, plan: PlanResult) -> GuardedCarry:
        turn = None
        if self.turns and plan.target is not None:
            turn = plan_turn(held.grasp, held.script, Problem(plan.target, held.grasp.cell, plan.settings))
        return GuardedCarry(held, turn)

    def _way_home(self, observation: Observation, plan: PlanResult) -> Retreat | None:
        """Return the way home, where the cameras look again; None where there is none."""
        try:
            return Retreat(self._start(observation), self._planner.cell, plan.around)
        except NoPath:
            return None

    def _make_way(
        self, observation: Observation, plan: PlanResult, moves: int, looks: int, scene: Scene
    ) -> State | None:
        """Return the state in which a neighbour is taken to be set aside; None where there is none to take."""
        if not (moves and scene.neighbours and plan.target is not None):
            return None
        with plan.going_on():
            aside = plan_aside(
                self._planner, scene, plan.target, self._seed + moves, self._start(observation)
            )
        if aside is None:
            return None
        self.report.details["moves"] = self._moves - moves + 1
        return State(self._grasp(aside.plan), aside.plan, looks, moves - 1, aside.way)

    def _slide(self, observation: Observation, plan: PlanResult, looks: int) -> State | None:
        """Return the state in which what lies flat is slid over the table's edge; None where that does not help."""
        if plan.target is None or not looks:
            return None
        with plan.going_on():
            slide = plan_slide(self._planner, plan.target, self._seed, self._start(observation))
        return None if slide is None else State(slide, plan, looks)

    def _grasp_slid(self, state: State, slide: Slide, observation: Observation) -> State:
        """Plan the grasp of what now sticks out over the edge, from where the joints say that it was pushed to."""
        assert state.plan.target is not None  # it was pushed
        with state.plan.going_on():
            plan = plan_slid(self._planner, state.plan.target, slide, self._seed, self._start(observation))
        self.report.planning_seconds = state.plan.planning_seconds
        self.report.again = False
        self.report.details["slid"] = slide.moved
        if not plan.found:
            return state
        # The object is not where files state it, and no camera looks past the edge.
        self.report.failure, self.result = None, None
        # It lies on the table, so its height is known; a finger that went on from below would tip it over.
        return State(self._grasp(plan, overtravel=0.0), plan, looks=0)

    def _look_again(self, state: State, observation: Observation) -> State:
        """Plan from what the cameras see now that the hand is out of their way; without a grasp, make way, or stay."""
        looks, moves = state.looks - (state.aside is None), state.moves
        tries = self._looks - looks
        scene, start = self._scene(observation), self._start(observation)
        plan = plan_scene(self._planner, scene, self._seed + tries, start)
        if tries and plan.shortfall != LIFT_BLOCKED:
            plan = self._among(scene, plan, start, _NUDGE)
        way = None if plan.found else self._make_way(observation, plan, moves, looks, scene)
        if way is None and tries >= self._regrasps:
            plan = self._among(scene, plan, start, _PUSH)
            looks *= bool(plan.found)  # what has not been found so far is not there
        after = way or State(self._grasp(plan) if plan.found else state.motion, plan, looks, moves)
        if tries:
            self.report.details["regrasps"] = tries
        if self.report.failure:  # the first grasp is still to be found
            plan.planning_seconds += self.report.planning_seconds or 0.0
            self.report.planning_seconds = plan.planning_seconds
            self.report.again = not plan.found and (looks > 0 or after.aside is not None)
            if plan.found:
                # Moves may have shifted the object: such a grasp is not of the pose that files state.
                touching = "touching" in self.report.details
                self.report.failure, self.result = None, None if moves < self._moves or touching else plan
        return after

    def _among(self, scene: Scene, plan: PlanResult, start: Array, give: float) -> PlanResult:
        """Return a plan that may push neighbours by `give` m; `plan` where that has a grasp, or this gives none."""
        if plan.found or plan.target is None or not scene.neighbours:
            return plan
        pushing = plan_scene(self._planner, scene, self._seed, start, give=give)
        plan.planning_seconds += pushing.planning_seconds
        if not pushing.found:
            return plan
        self.report.details["touching"] = give
        pushing.planning_seconds = plan.planning_seconds
        return pushing


class AloneAgent(BilevelAgent):
    """The same, blind to what stands around the object: what knowing of neighbours is worth."""

    def _scene(self, observation: Observation, info: Mapping[str, Any] | None = None) -> Scene:
        return replace(super()._scene(observation, info), neighbours=(), rest=ObjectCloud())
