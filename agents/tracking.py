"""Agent `bilevel_tracking`: `bilevel` that watches the object at 10 Hz and goes after it while it moves."""

from dataclasses import dataclass, field, replace

import numpy as np

from dexgrasp.agent import BY_CLOUD, Info, Observation
from dexgrasp.agents.bilevel import BilevelAgent
from dexgrasp.agents.stages import GoHome, LiftAndHold, SlideToEdge, Stage, TakeHold, take_hold, way_home
from dexgrasp.geometry.tracking import PlanarTracker
from dexgrasp.mechanics.kinematics.palm_ik import palm_frame, solve_palm
from dexgrasp.mechanics.kinematics.tree import RobotTree
from dexgrasp.motion.carrying import GuardedCarry
from dexgrasp.motion.motion import arm_and_hand
from dexgrasp.motion.move_until_contact import GuardedGrasp
from dexgrasp.planning.plan_scene import plan_scene
from dexgrasp_env.arrays import Array, Single
from dexgrasp_env.perception.scene import Scene
from dexgrasp_env.scene.constants import CONTROL_PERIOD

_STILL = np.array([0.004, 0.004, 0.06])  # m and rad, less than which is no motion


class FollowingGrasp(GuardedGrasp):
    """Grasp of a moving object: that of one at rest, and the arm adds the object's way since the plan.

    Attributes:
        shift: (3,) m, of the object from where the plan has it, when the arm gets there.
    """

    def __init__(self, held: GuardedGrasp) -> None:
        """Take the motion for an object that rests."""
        super().__init__(held.script, held.grasp, held._overtravel, held._pace)
        self.shift = np.zeros(3)

    @property
    def approached(self) -> float:
        """Share of the approach that is done."""
        return self._step / len(self._approach)

    @property
    def free(self) -> bool:
        """True until a finger touches, as far as the joints can tell."""
        return not (self._touched.any() or self._settled)

    def _next(self, q: Array) -> Array:
        if not self.shift.any():
            return super()._next(q)
        # Fingers are felt as if the arm was where the plan has it: its own lag is no contact.
        row = super()._next(arm_and_hand(self.targets, q, self.tree))
        # After 60 % of the approach the hand moves as the object does.
        joined = min(self.approached / 0.6, 1.0)
        return shifted(row, joined * joined * (3.0 - 2.0 * joined) * self.shift, self.tree)

    def stop(self, velocity: Array) -> None:
        """Move lift and hold to where the hand is, as it comes to rest from a velocity (3,) m/s."""
        lift, hold = self.script.phases["lift"], self.script.phases["hold"]
        seconds = CONTROL_PERIOD * np.arange(len(lift) + len(hold))
        brake = 0.2  # s in which the lift comes to rest over the table
        ways = self.shift + brake * (1.0 - np.exp(-seconds / brake))[:, None] * velocity
        rows = [shifted(row, way, self.tree) for row, way in zip([*lift, *hold], ways, strict=True)]
        moved = {"lift": np.array(rows[: len(lift)]), "hold": np.array(rows[len(lift) :])}
        self.script = replace(self.script, phases={**self.script.phases, **moved})


def shifted(row: Array, shift: Array, tree: RobotTree) -> Array:
    """Return set-points (n,) rad with the palm moved by `shift` (3,) m, not turned, as far as the arm reaches."""
    R, p = palm_frame(row, tree)
    q = row.copy()
    solve_palm(q, R, p + shift, tree, 20, 1e-4)
    return q


class Watch:
    """Motion of an object since the first look: rest, displacement, or a belt.

    Attributes:
        scene: of the first look.
        tracker: of its object.
        now: s since then.
        since: s, when it began to move; None while it rests.
        planned: (3,) pose that the plan has it in.
        velocity: (3,) m/s of the belt that it was found to be on; zeros on a table.
        renewals: plans since the first.
    """

    def __init__(self, scene: Scene) -> None:
        """Begin with a scene that has a target."""
        self.scene, self.tracker, self.now = scene, PlanarTracker(scene.target.points, 0.0), 0.0
        self.planned, self.velocity, self.renewals = np.zeros(3), np.zeros(3), 0
        self.since: float | None = None
        self._last: Array = np.zeros(0)

    def look(self, observation: Observation, free: bool) -> None:
        """Pass a control step, and take in the cloud where it is new and no hand is on the object."""
        self.now += CONTROL_PERIOD
        cloud = observation["cloud"]
        if free and not np.array_equal(cloud, self._last):
            self._last = cloud
            self.tracker.see(Scene.of_observation(observation).target.points, self.now)
        off = (np.abs(self.tracker.pose - self.planned) > 1.5 * _STILL).any()
        if not free or self.velocity.any():
            self.since = None
        elif self.since is None and off:
            self.since = self.now

    def outcome(self) -> Array | None:
        """Return the velocity (3,) m/s with which what has moved goes on, zeros where it rests; None: not yet known."""
        if self.since is None:
            return None
        if (np.ptp(np.array(self.tracker.poses)[-4:], axis=0) < _STILL).all():
            return np.zeros(3)
        # What moves evenly for longer than 0.75 s is on a belt.
        even = (self.tracker.unevenness < _STILL).all() and self.now - self.since > 0.75
        return np.append(self.tracker.velocity[:2], 0.0) if even else None


@dataclass(frozen=True, eq=False)
class Follow(TakeHold):
    """Approach and take hold, with an eye on the object: wait while it is being moved, plan anew, go along on a belt.

    Attributes:
        watch: of the object.
        kept: the last action, in a list.
    """

    motion: FollowingGrasp
    watch: Watch = field(kw_only=True)
    kept: list[Single] = field(default_factory=list, kw_only=True)

    def act(self, observation: Observation) -> Single:
        """Return the next set-points, or the last while the object is being moved."""
        if self.watch.since is None or not self.kept:
            self.kept[:] = [super().act(observation)]
        return self.kept[0]

    def next(self, observation: Observation) -> Stage:
        """Return this stage, one of another plan, or the one that lifts."""
        motion, watch = self.motion, self.watch
        if motion.done and not watch.velocity.any():
            return super().next(observation)
        if motion.done:
            motion.stop(watch.velocity)
            return LiftAndHold(self.state, GuardedCarry(motion))
        watch.look(observation, motion.free)
        if watch.velocity.any():
            # The arm is 0.15 s behind its set-points.
            motion.shift[:2] = (watch.tracker.at(watch.now + 0.15) - watch.planned)[:2]
        velocity = watch.outcome()
        return self if velocity is None else self._renewed(observation, velocity)

    def _renewed(self, observation: Observation, velocity: Array) -> Stage:
        """Return the stage with a plan for where the object is, or will be; the way home where there is none."""
        episode, watch = self.state.episode, self.watch
        # An approach takes 1.9 s, with the arm behind it.
        planned = watch.tracker.at(watch.now + 1.9) if velocity.any() else watch.tracker.pose
        scene = replace(watch.scene, target=watch.scene.target.placed(watch.tracker.matrix(planned)))
        plan = plan_scene(episode.planner, scene, episode.seed, episode.start(observation))
        watch.since = None
        if plan.found:
            watch.planned, watch.velocity, watch.renewals = planned, velocity, watch.renewals + 1
            return Follow(self.state._replace(plan=plan), FollowingGrasp(take_hold(plan)), watch=watch)
        home = way_home(self.state, observation) if self.state.looks else None
        return self if home is None else GoHome(self.state, home)


class TrackingAgent(BilevelAgent):
    """The planner with an eye on the object: its pose is followed in the clouds, and the plan renewed when it moves."""

    env_settings = BY_CLOUD | {"observe": "10hz"}

    def _scene(self, observation: Observation, info: Info) -> Scene:
        self._seen = super()._scene(observation, info)
        return self._seen

    def _enter(self, stage: Stage | None) -> None:
        # No camera looks past the edge that an object was slid over.
        seen = bool(len(self._seen.target)) and not isinstance(self._stage, SlideToEdge)
        if seen and type(stage) is TakeHold and "set_down" not in stage.motion.script.phases:
            watch = Watch(self._seen)
            stage = Follow(stage.state, FollowingGrasp(stage.motion), news=stage.news, watch=watch)
        super()._enter(stage)
        if isinstance(stage, Follow) and stage.watch.renewals:
            self.result, self.report.details["renewals"] = None, stage.watch.renewals
