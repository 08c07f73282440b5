"""N episodes side by side: draws and resets them, and calls the kernel on their records.

The single environment has one, the vector environment many; only who advances the physics differs.
"""

import copy
from collections.abc import Callable, Mapping
from itertools import accumulate
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.random import Generator
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array, Arrays, Fields, Index, Mask
from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.tasks import kernel
from dexgrasp_env.tasks.constants import LIFT_HEIGHT, SETTLE_STEPS
from dexgrasp_env.tasks.control import GRASP_MODES, GRASP_SIZE, ONCE_MODES, ActionSpace, check_finite
from dexgrasp_env.tasks.disturbance import MOTION, draw_motion, moves_now
from dexgrasp_env.tasks.features import FARTHEST, SceneFeatures
from dexgrasp_env.tasks.grasp_actions import GraspActions
from dexgrasp_env.tasks.grasp_space import lifted_by, longest_grasp
from dexgrasp_env.tasks.observations import FLAT, key_columns, observation_space, unbounded
from dexgrasp_env.tasks.placement import check_pose
from dexgrasp_env.tasks.randomisation import Rngs, Variation
from dexgrasp_env.tasks.records import COMMANDS, EPISODE, FAILURES, INFOS, new_record, rules_of
from dexgrasp_env.tasks.reset_options import check_joints, check_options
from dexgrasp_env.tasks.set_points import control_of, set_points
from dexgrasp_env.tasks.settings import LiftSettings
from dexgrasp_env.tasks.simulation import NO_PHYSICS, Physics, Simulation, arm_chain
from dexgrasp_env.tasks.slots import EpisodeState, Slot, Starts
from dexgrasp_env.tasks.starts import ReverseStarts, pre_grasps
from dexgrasp_env.tasks.views import CameraObserver


class Episodes:
    """Records of N episodes and the scenes that they share; the base of every task.

    A task overrides `task_dtype`, what it notes; `_begin` or `_set_out`, how an episode starts; `_finish`, rewards and
    observation of a step; `endings`; `more_infos`.
    """

    task = "lift"
    task_dtype = np.dtype([])
    """Fields that the task notes of an episode beside `EPISODE`."""
    furniture = ""  # what else stands on the table, see `scene_spec`
    options: tuple[str, ...] = ("object", "object_pose", "joints", "state")  # of a reset
    neighbours = 0  # most objects beside the one that is meant

    def __init__(self, settings: LiftSettings, number: int) -> None:
        self.settings, self.views, robot = settings, CameraObserver(settings, number), settings.cell.robot
        self.simulations = {
            target: Simulation(model, settings.cell, belt=settings.disturbance.moves)
            for target, model in settings.load_objects(settings.objects).items()
        }
        motion = MOTION.descr if settings.disturbance.moves else []
        notes = np.dtype([(name, self.task_dtype[name]) for name in self.task_dtype.names or ()] + motion)
        self.records, self.task_records = np.zeros(number, EPISODE), np.zeros(number, notes)
        self.info_fields = self.records[[*INFOS.values()]]
        self.slots = [Slot() for _ in range(number)]
        self.one_model = number == 1 or settings.backend == "warp"
        """Whether episodes of an object share its scene's model, which is varied anew for each that is entered."""
        self.settle_steps = 0 if settings.backend == "warp" and number > 1 else SETTLE_STEPS
        """Physics steps of an object that was drawn to lie somewhere; by MuJoCo they take longer than all on a GPU."""
        self.rewards = np.zeros(number)
        self.commands = np.zeros((number, len(COMMANDS), robot.dof))
        self._rows, self._push = np.zeros((number, settings.frame_skip, robot.dof)), np.zeros((number, 3))
        hulls = [simulation.hull for simulation in self.simulations.values()]
        spans = zip(accumulate(map(len, hulls), initial=0), map(len, hulls), strict=False)
        self._hull_spans = dict(zip(self.simulations, spans, strict=True))
        first = next(iter(self.simulations.values()))
        self.action_space = ActionSpace(
            settings.control_mode, robot, settings.frame_skip, settings.action_scale, settings.hold
        )
        self.control = control_of(settings, arm_chain(first.base, robot))
        self.rules = rules_of(settings, first.columns, np.concatenate(hulls), NO_PHYSICS)
        self.truncating = np.zeros(len(FAILURES), bool)
        """Which of `FAILURES` truncate an episode; the others terminate it."""
        self.whole = settings.control_mode in ONCE_MODES  # an action is a whole episode
        self.span = longest_grasp(settings) if self.whole else settings.hold
        """Control steps of an action, at most."""
        self._columns = key_columns(settings.obs_mode, robot)
        self._width = max(columns.stop for columns in self._columns.values())
        self._grasps = GraspActions(settings, first, number) if settings.control_mode in GRASP_MODES else None
        self._features = SceneFeatures(number, self.whole) if settings.obs_mode == FLAT else None
        self.starts: Starts | None = pre_grasps(settings)

    def observation_space(self) -> spaces.Dict:
        """Return the space of one environment's observations; one of a single key `FLAT` is told as that array."""
        parts = observation_space(self.settings.obs_mode, self.views.image_shape, self.settings.cell.robot)
        if self._grasps:
            parts["grasp_state"] = unbounded(GRASP_SIZE)
        if self._features is None:
            return spaces.Dict(dict(sorted(parts.items())))
        return spaces.Dict({FLAT: spaces.Box(-FARTHEST, FARTHEST, self._features.shape(parts), np.float32)})

    def agent_space(self) -> spaces.Space[Any]:
        """Return the space of the observations that agents are given."""
        space = self.observation_space()
        return space if self._features is None else space[FLAT]

    def as_agent_sees(self, observation: Arrays) -> Any:
        """Return an observation as agents are given it."""
        return observation if self._features is None else observation[FLAT]

    def begin(self, i: int, rng: Generator, options: Mapping[str, Any] | None) -> tuple[Simulation, Arrays]:
        """Start episode `i`: draw what it is of and let its object settle, or go on from a state.

        Args:
            i: the slot.
            rng: of the episode.
            options: see `LiftEnv.reset`; where there are none, `starts` gives them, if set.

        Returns:
            Its scene, and the observation without cameras, arrays (1, ...) by key.

        Raises:
            InputError: for an unknown option, object or a pose that cannot be.
        """
        if not options and self.starts is not None:
            last = self.records[i], self.task_records[i]
            record = {name: part[name] for part in last for name in part.dtype.names or ()}
            options = self.starts(i, rng, record)
        simulation = self._begin(i, rng, check_options(options, self.options, self.simulations))
        judge = not self.slots[i].resumed
        if judge:
            self.records[i]["laid"] = simulation.object_pose()
        self._know_scene(i)
        return simulation, self.observe(i, simulation, rng, judge)

    def observe(self, i: int, simulation: Simulation, rng: Generator, judge: bool = False) -> Arrays:
        """Return the observation of episode `i` without cameras, arrays (1, ...) by key."""
        part, nothing = slice(i, i + 1), np.zeros(1, np.int64)
        return self.complete(part, simulation, self.conclude(part, simulation, nothing, [rng], judge))

    def look(
        self, i: int, qpos: Array, scene: Callable[[], Simulation], rng: Generator, begins: bool = False
    ) -> None:
        """Look with the cameras of episode `i`, where there are any and it is time; see `CameraObserver.observe`."""
        slot = self.slots[i]
        if self.settings.sees:
            fresh = begins and not (slot.resumed and slot.view.seen)
            self.views.observe(slot.view, qpos, scene, rng, fresh)

    def _know_scene(self, i: int) -> None:
        """Prepare what follows from how the object of episode `i` lay at first."""
        if self._grasps:
            self._grasps.begin(i, self.records[i])
        if self._features:
            self._features.begin(i, self.records[i])

    def _begin(self, i: int, rng: Generator, options: Mapping[str, Any]) -> Simulation:
        """Start episode `i` by options that are known."""
        settings, names = self.settings, list(self.simulations)
        self.slots[i].resumed = "state" in options
        if self.slots[i].resumed:
            # Where another was: with what that had achieved, and with time and chance of its own.
            simulation = self.set_state(i, options["state"], copy.deepcopy(rng))
            self.records[i]["elapsed"] = 0
            return simulation
        target = str(options.get("object", names[int(rng.integers(len(names)))]))
        simulation = self.simulations[target]
        variation = settings.randomisation.sample(rng, settings.mass, settings.friction_of(simulation.object))
        pose = settings.draw_pose(simulation.object, variation.size, rng)
        given = options.get("object_pose")
        if given is not None:
            pose = check_pose(given, simulation.object, variation.size, settings.cell)
        self._mount(i, target, (), variation)
        self.slots[i].joints = check_joints(options.get("joints"), settings.cell.robot)
        if given is not None:
            simulation.place(pose, self.slots[i].joints)
            simulation.check_free()
        self.records[i] = new_record(
            simulation.object, variation, self._hull_spans[target], settings.disturbance_steps > 0
        )
        self.task_records[i] = np.zeros((), self.task_records.dtype)
        joints = self.slots[i].joints
        self.commands[i] = settings.cell.robot.home if joints is None else joints
        if settings.disturbance.moves:
            motion = draw_motion(settings.disturbance, pose, settings.frame_skip, rng)
            self.task_records[list(MOTION.names or ())][i] = motion
        return self._set_out(i, pose, rng, given is not None)

    def _set_out(self, i: int, pose: Array, rng: Generator, given: bool) -> Simulation:
        """Put the object of episode `i` down at `pose` (7,), drawn or given, and let it settle; return its scene."""
        simulation = self.enter(i)
        simulation.place(pose, self.slots[i].joints)
        simulation.settle(SETTLE_STEPS if given else self.settle_steps)
        return simulation

    def enter(self, i: int) -> Simulation:
        """Mount the model of episode `i` in its scene, which it may share with others."""
        slot = self.slots[i]
        simulation = slot.simulation
        assert simulation is not None
        if slot.model is None:
            simulation.vary(slot.variation)
        else:
            simulation.model, simulation.variation = slot.model, slot.variation
        return simulation

    def _mount(self, i: int, target: str, neighbours: tuple[str, ...], variation: Variation) -> Simulation:
        """Give episode `i` its scene, varied: an object's alone is shared, with neighbours it is the episode's own."""
        slot, simulation = self.slots[i], self.simulations[target]
        same = (target, neighbours) == (slot.target, slot.neighbours)
        if neighbours and same and slot.simulation is not None:
            simulation = slot.simulation
        elif neighbours:
            models = self.settings.load_objects(neighbours)
            around = [models[name] for name in neighbours]
            simulation = Simulation(simulation.object, self.settings.cell, around, furniture=self.furniture)
        own = slot.simulation is simulation and slot.model is not simulation.base
        slot.simulation = simulation
        if not self.one_model and variation == Variation():
            slot.model = simulation.base  # shared, never written to
        elif not self.one_model:  # the scene's own otherwise, for good: people hold on to `unwrapped.model`
            if not own:
                slot.model, slot.variation = copy.copy(simulation.base), Variation()
            self.enter(i).vary(variation)
        slot.target, slot.neighbours, slot.variation = target, neighbours, variation
        return self.enter(i)

    def set_points(self, actions: Array, where: Physics, step: int = 0) -> tuple[Array, Array]:
        """Move the set-points by one control step.

        Args:
            actions: (N, m), a copy that may be written to.
            where: the episodes are.
            step: control steps since the actions were given.

        Returns:
            Rows (N, frame_skip, n) rad for the physics steps, and pushes (N, 3) N on the objects, or their `moves_now`.

        Raises:
            InputError: for an action that is not finite.
        """
        if self._grasps:
            actions = self._grasps.moves(actions, step, self.commands, where)
        if not set_points(self.records, self.commands, actions, self.control, self._rows, self._push):
            check_finite(actions)
        moves = self.settings.disturbance.moves
        return self._rows, moves_now(self.task_records, self.records) if moves else self._push

    def conclude(
        self, part: slice, where: Physics, warnings: Index, rngs: Rngs, judge: bool = True
    ) -> Arrays:
        """Advance progress, terms and rewards of a part of the episodes to the present, and observe it.

        Args:
            part: which.
            where: they are.
            warnings: (n,) bits of MuJoCo's that came up.
            rngs: theirs; None for one whose sensors are not read.
            judge: False to observe alone.

        Returns:
            The observation without cameras: arrays (n, ...) by key.
        """
        records = self.records[part]
        rows = np.empty((len(records), self._width), np.float32)
        noise = self.settings.randomisation.draw_joint_noise(records["variation"], self.rules.joints, rngs)
        kernel.conclude(
            records, where.current, warnings, self.commands[part], noise, self.rules, self.rewards[part], rows, judge
        )  # fmt: skip
        seen = {key: rows[:, columns] for key, columns in self._columns.items()}
        return self._finish(part, where, judge, seen)

    def _finish(self, part: slice, where: Physics, judge: bool, state: Arrays) -> Arrays:
        """Apply the task's own rules after `conclude`, and return its observation."""
        return state

    def complete(self, part: slice, where: Physics, state: Arrays) -> Arrays:
        """Return `conclude`'s observation of a part of the episodes with what is made of it once an action."""
        if self._grasps:
            seen = self._grasps.states(part, state["joint_positions"], where)
            state = dict(sorted({**state, "grasp_state": seen}.items()))
        if self._features is None:
            return state
        return {FLAT: self._features.of(part, state, self.records["elapsed"][part])}

    def endings(self) -> tuple[Mask, Mask]:
        """Return which episodes a failure has terminated, and which it has truncated, (N,) each."""
        failures = self.records["failure"]
        truncated = self.truncating[failures]
        over = failures > 0
        if self.whole:
            over |= self.records["elapsed"] > 0
        return over & ~truncated, truncated

    def advance(self, actions: Array, where: Physics, rngs: Rngs, running: NDArray[np.intp]) -> Arrays:
        """Step the running episodes by an action each; `rewards` are then what each gained, and all are observed.

        The kernel passes over all rows: those whose action has ended are put back to what they had come to.

        Args:
            actions: (N, m), a copy that may be written to.
            where: the episodes are.
            rngs: theirs; None for those that do not run.
            running: indices, ascending.
        """
        everything, pushed = slice(None), self.settings.disturbance.kind not in ("none", "shaken")
        going, rngs, gained = running, list(rngs), np.zeros(len(self.slots))
        rows, kept = (self.records, self.task_records, self.commands), {}
        late = lifted_by(self.settings) if self.whole else self.span
        for step in range(self.span):
            set_points, push = self.set_points(actions, where, step)
            warnings = where.step(set_points, push if pushed else None, going)
            seen = self.conclude(everything, where, warnings, rngs)
            if self.span == 1:
                return self.complete(everything, where, seen)
            gained[going] += self.rewards[going]
            over = self._is_over(late)[going]
            for i in going[over].tolist():
                kept[i], rngs[i] = copy.deepcopy([part[i] for part in (*seen.values(), *rows)]), None
            going = going[~over]
            if not len(going):
                break
        for i, parts in kept.items():
            for whole, part in zip((*seen.values(), *rows), parts, strict=True):
                whole[i] = part
        self.rewards[:] = gained
        return self.complete(everything, where, seen)

    def _is_over(self, late: int) -> Mask:
        """Return which actions (N,) are: where something failed, and a whole grasp once held, or `late` and not up."""
        records, done = self.records, self.records["failure"] > 0
        if self.whole:
            done |= records["success"] | ((records["elapsed"] >= late) & (records["height"] < LIFT_HEIGHT))
        return done

    def more_infos(self) -> Arrays:
        """Return the task's own infos beside `INFOS`, arrays (N,) by key; `level` where starts move back."""
        if not isinstance(self.starts, ReverseStarts):
            return {}
        return {"level": np.full(len(self.slots), self.starts.front)}

    def object_name(self, i: int) -> str:
        """Return the name of the object of episode `i`, "" before the first."""
        target = self.slots[i].target
        return self.simulations[target].object.name if target else ""

    def get_state(self, i: int, physics: Array, sensors: Array, rng: Generator) -> EpisodeState:
        """Return the state of episode `i`."""
        slot = self.slots[i]
        return EpisodeState(
            self._of(), slot.target, physics, sensors.copy(), self.records[i].copy(),
            self.task_records[i].copy(), self.commands[i].copy(), copy.deepcopy(rng.bit_generator.state),
            slot.variation, copy.deepcopy(slot.view), slot.neighbours,
        )  # fmt: skip

    def _of(self) -> Fields:
        """Return the settings, by name, that a state and this environment have to share."""
        keys = [
            "obs_mode",
            "control_mode",
            "mount",
            "disturbance",
            "frame_skip",
            "action_scale",
            "reward_weights",
        ]
        keys += ["views"] * self.settings.sees
        own = {key: getattr(self.settings, key) for key in keys}
        return {"task": self.task, "robot": self.settings.cell.robot.name, **own}

    def set_state(self, i: int, state: EpisodeState, rng: Generator) -> Simulation:
        """Make episode `i` that of a state, with its scene in it.

        Raises:
            InputError: if the state is of an object that the environment does not have, of another task or other
                settings, or is no state.
        """
        if not isinstance(state, EpisodeState):
            raise InputError(f"set_state takes what get_state returned, not a {type(state).__name__}")
        for key, value in self._of().items():
            if state.of.get(key) != value:
                raise InputError(f"the state has {key} {state.of.get(key)!r}, this environment {value!r}")
        if state.target not in self.simulations:
            raise unknown_name("object of the state", state.target, self.simulations)
        simulation = self._mount(i, state.target, state.neighbours, state.variation)
        self.records[i], self.task_records[i] = state.record, state.task_record
        self.commands[i] = state.commands
        self.records[i]["hull_first"], self.records[i]["hull_count"] = self._hull_spans[state.target]
        self.slots[i].view = copy.deepcopy(state.view)
        rng.bit_generator.state = copy.deepcopy(state.rng)
        simulation.set_state(state.physics)
        simulation.data.sensordata[:] = state.sensors[: len(simulation.data.sensordata)]
        self._know_scene(i)
        return simulation
