"""The stages of an episode of `bilevel`: each acts until it names the next; what was planned goes on with it."""

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from dexgrasp.agent import Info, Observation
from dexgrasp.motion.carried import CarryAside, plan_retreat
from dexgrasp.motion.carrying import GuardedCarry
from dexgrasp.motion.motion import Motion, NoPath, Played
from dexgrasp.motion.move_until_contact import GuardedGrasp
from dexgrasp.motion.slide import Slide
from dexgrasp.planning.carry import plan_turn
from dexgrasp.planning.overhang import plan_slid, plan_slide
from dexgrasp.planning.plan_scene import plan_scene, start_of
from dexgrasp.planning.planner import LIFT_BLOCKED, Planner
from dexgrasp.planning.rearrange import plan_rearrangement
from dexgrasp.planning.result import PlanResult
from dexgrasp.planning.settings import GraspProblem
from dexgrasp_env.arrays import Array, Fields, Single
from dexgrasp_env.perception.scene import Scene


class News(NamedTuple):
    """The outcome of planning on the way to a stage, for the report."""

    plan: PlanResult  # for the object, with or without a grasp
    seconds: float  # of planning, since the news before
    again: bool  # the object may yet be grasped, though the plan has no grasp
    as_seen: bool  # a grasp of the plan is of the pose that files state
    details: Fields


@dataclass(frozen=True, eq=False)
class Episode:
    """The data that all stages of an episode share.

    Attributes:
        planner: of the cell.
        seed: of the first plan.
        observe: makes a scene of an observation and what is known beside it.
        turns: an object that is barely held is turned, once it is lifted.
        regrasps: looks after which neighbours may be pushed farther.
        looks: allowed in all.
        moves: of neighbours, allowed in all.
    """

    planner: Planner
    seed: int
    observe: Callable[[Observation, Info], Scene]
    turns: bool
    regrasps: int
    looks: int
    moves: int

    def start(self, observation: Observation) -> Array:
        """Return the set-points (n,) rad from which a plan begins now."""
        return start_of(observation, self.planner.cell.robot)


class State(NamedTuple):
    """The data that one stage hands to the next."""

    episode: Episode
    plan: PlanResult  # the last one, whose neighbours are still there
    looks: int  # that are left
    moves: int = 0  # of neighbours, that are left


@dataclass(frozen=True, eq=False)
class Stage(ABC):
    """Stage of an episode: acts until it names the next.

    Attributes:
        state: of the episode.
        motion: that it carries out.
        news: of what was planned just before it; None where nothing was.
    """

    state: State
    motion: Motion
    news: News | None = field(default=None, kw_only=True)

    def act(self, observation: Observation) -> Single:
        """Return the next set-points."""
        return self.motion.action(observation["joint_positions"])

    @abstractmethod
    def next(self, observation: Observation) -> "Stage":
        """Return the stage to act in: this one, or the one that follows it."""


class Stay(Stage):
    """Hold of the last set-points: nothing is left to try."""

    def next(self, observation: Observation) -> Stage:
        """Return this stage."""
        return self


@dataclass(frozen=True, eq=False)
class TakeHold(Stage):
    """Approach, closing and pressing, on the object or on a neighbour that is set aside then."""

    motion: GuardedGrasp

    def next(self, observation: Observation) -> Stage:
        """Return the stage that carries what the hand has."""
        if not self.motion.done:
            return self
        if "set_down" in self.motion.script.phases:
            return PutAside(self.state, CarryAside(self.motion))
        (episode, plan, *_), grasp, turn = self.state, self.motion.grasp, None
        if episode.turns and plan.target is not None:
            turn = plan_turn(grasp, self.motion.script, GraspProblem(plan.target, grasp.cell, plan.settings))
        return LiftAndHold(self.state, GuardedCarry(self.motion, turn))


@dataclass(frozen=True, eq=False)
class LiftAndHold(Stage):
    """Lift, turn and hold, until the joints feel that the object was lost."""

    motion: GuardedCarry

    def next(self, observation: Observation) -> Stage:
        """Return the way home where the object was lost and may be looked for again."""
        # Where the hold is long over, the hand has something else: neighbours feel like the object.
        lost = self.motion.lost or (self.motion.overdue and self.state.plan.neighbours is not None)
        if not (lost and self.state.looks):
            return self
        if home := way_home(self.state, observation):
            return GoHome(self.state, home)
        # Right above the table the hand may have no room to open: it has a little higher.
        return self if self.motion.lifting else replace(self, state=self.state._replace(looks=0))


@dataclass(frozen=True, eq=False)
class PutAside(Stage):
    """Carrying and release of the object at its goal, or of a neighbour where it is out of the way."""

    motion: CarryAside

    def next(self, observation: Observation) -> Stage:
        """Return the way home; the look at its end counts as none."""
        target = self.state.plan.target
        asked = target and target.demand
        if not self.motion.done or (asked and asked.request.goal):
            return self  # what was asked for stands where it is to stand
        home = way_home(self.state, observation)
        return self if home is None else GoHome(self.state, home, counted=False)


@dataclass(frozen=True, eq=False)
class SlideToEdge(Stage):
    """Push of a flat object until it sticks out over the table's edge."""

    motion: Slide

    def next(self, observation: Observation) -> Stage:
        """Plan the grasp of what now sticks out, from where the joints say that it was pushed to."""
        if not self.motion.done:
            return self
        episode, before, *_ = self.state
        assert before.target is not None  # it was pushed
        start, began = episode.start(observation), time.perf_counter()
        plan = plan_slid(episode.planner, before.target, self.motion, episode.seed, start)
        # The object is not where files state it, and no camera looks past the edge.
        news = News(
            plan, time.perf_counter() - began, again=False, as_seen=False, details={"slid": self.motion.moved}
        )
        if not plan.found:
            return Stay(self.state, self.motion, news=news)
        # It lies on the table, so its height is known; a finger that went on from below would tip it over.
        return TakeHold(State(episode, plan, looks=0), take_hold(plan, overtravel=0.0), news=news)


@dataclass(frozen=True, eq=False)
class GoHome(Stage):
    """Way of the empty hand out of the cameras' view, at whose end they look again.

    Attributes:
        counted: the look at the end of the way is one of those that are left.
    """

    motion: Played
    counted: bool = True

    def next(self, observation: Observation) -> Stage:
        """Plan from what the cameras see now; without a grasp make way, push neighbours, or look once more."""
        episode, _, looks, moves = self.state
        if not (self.motion.done and (looks or not self.counted)):
            return self
        looks -= self.counted
        tries = episode.looks - looks
        scene, start = episode.observe(observation, {}), episode.start(observation)
        began = time.perf_counter()
        plan, pushed = plan_scene(episode.planner, scene, episode.seed + tries, start), 0.0
        if tries and plan.shortfall != LIFT_BLOCKED:
            plan, pushed = plan_pushing(episode, scene, start, plan, give=0.01)
        state = State(episode, plan, looks, moves)
        way = None if plan.found else make_way(state, scene, start)
        if not plan.found and way is None and tries >= episode.regrasps:
            # None of them can be set aside either; what is not found so far is not there.
            plan, pushed = plan_pushing(episode, scene, start, plan, give=0.05)
            state = state._replace(plan=plan, looks=looks if plan.found else 0)
        details = {"touching": pushed} if pushed else {"moves": episode.moves - moves + 1} if way else {}
        news = News(
            plan,
            time.perf_counter() - began,
            again=way is not None or state.looks > 0,
            # Moves may have shifted the object: a grasp is then not of the pose that files state.
            as_seen=moves == episode.moves and not pushed,
            details=details | ({"regrasps": tries} if tries else {}),
        )
        if way is not None:
            return replace(way, news=news)
        if plan.found:
            return TakeHold(state, take_hold(plan), news=news)
        return GoHome(state, self.motion, news=news)


def first_stage(episode: Episode, plan: PlanResult, observation: Observation, info: Info) -> Stage | None:
    """Return the stage after the first plan; None where there is neither a grasp nor anything to try.

    Args:
        episode: that begins.
        plan: of its first observation.
        observation: the first one.
        info: as `Agent.reset` takes it.
    """
    # Only where the cameras look again: what they saw at first is no longer where the object is.
    again = info.get("observe") in ("clear", "step", "10hz")
    state = State(episode, plan, episode.looks, episode.moves) if again else State(episode, plan, 0)
    if plan.found:
        return TakeHold(state, take_hold(plan))
    if plan.target is None or not again:
        return None
    start, began = episode.start(observation), time.perf_counter()
    stage: Stage | None = make_way(state, episode.observe(observation, info), start)
    details = {} if stage is None else {"moves": 1}
    if stage is None and state.looks:
        if slide := plan_slide(episode.planner, plan.target, episode.seed, start):
            stage = SlideToEdge(state._replace(moves=0), slide)
        elif home := way_home(state, observation):
            stage = GoHome(state, home)
    news = News(plan, time.perf_counter() - began, again=True, as_seen=False, details=details)
    return None if stage is None else replace(stage, news=news)


def take_hold(plan: PlanResult, **how: float) -> GuardedGrasp:
    """Return the motion that takes hold by the firmest grasp of a plan."""
    grasp, script = plan.found[0]
    assert script is not None  # every plan here begins where the robot stands
    firm = 20.0  # N, with which fingers close at their usual pace
    return GuardedGrasp(script, grasp, pace=min(1.0, (plan.settings.max_force or firm) / firm), **how)


def way_home(state: State, observation: Observation) -> Played | None:
    """Return the way home, where the cameras look again; None where there is none."""
    try:
        return plan_retreat(
            state.episode.start(observation), state.episode.planner.cell, state.plan.neighbours
        )
    except NoPath:
        return None


def make_way(state: State, scene: Scene, start: Array) -> TakeHold | None:
    """Return the stage in which a neighbour is taken to be set aside; None where there is none to take."""
    episode, plan, looks, moves = state
    if not (moves and scene.neighbours and plan.target is not None):
        return None
    found = plan_rearrangement(episode.planner, scene, plan.target, episode.seed + moves, start)
    if found is None:
        return None
    return TakeHold(State(episode, found, looks, moves - 1), take_hold(found))


def plan_pushing(
    episode: Episode, scene: Scene, start: Array, plan: PlanResult, give: float
) -> tuple[PlanResult, float]:
    """Return a plan that may push neighbours by `give` m, and that; where it has no grasp, `plan`, and 0."""
    if plan.found or plan.target is None or not scene.neighbours:
        return plan, 0.0
    pushing = plan_scene(episode.planner, scene, episode.seed, start, neighbour_margin=give)
    return (pushing, give) if pushing.found else (plan, 0.0)
