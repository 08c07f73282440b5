"""N episodes side by side: draws and resets them, and calls the kernel on their records.

The single environment has one, the vector environment many; only who advances the physics differs.
"""

import copy
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple
from difflib import get_close_matches
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.random import Generator
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array, Arrays, Fields, Index, Mask
from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.objects.load import Objects
from dexgrasp_env.objects.model import ObjectModel
from dexgrasp_env.scene.constants import TIMESTEP
from dexgrasp_env.tasks import kernel
from dexgrasp_env.tasks.control import check_finite
from dexgrasp_env.tasks.observations import cut, layout, observation_space
from dexgrasp_env.tasks.placement import check_pose
from dexgrasp_env.tasks.randomisation import Variation
from dexgrasp_env.tasks.records import COMMANDS, EPISODE, FAILURES, INFO_COLUMNS, INFO_KINDS, PHASES
from dexgrasp_env.tasks.rules import rules_of
from dexgrasp_env.tasks.set_points import control_of, set_points
from dexgrasp_env.tasks.settings import LiftSettings
from dexgrasp_env.tasks.simulation import NO_PHYSICS, Simulation, StateHolder, arm_chain, warning_names
from dexgrasp_env.tasks.slots import EpisodeState, Slot, Starts
from dexgrasp_env.tasks.views import CameraObserver


class Episodes:
    """Records, slots and the scenes that they share."""

    task = "lift"
    task_dtype = np.dtype([])
    """Of what the task notes of an episode beside its record."""
    walled = False  # whether what is set out stands in a bin
    options: tuple[str, ...] = ("object", "object_pose", "state")
    """Of a reset."""
    neighbours = 0
    """Most objects beside the one that is meant."""
    around: Objects = ()
    """What they are drawn from."""

    def __init__(self, settings: LiftSettings, number: int) -> None:
        self.settings, self.views, robot = settings, CameraObserver(settings, number), settings.cell.robot
        self.simulations = {
            target: Simulation(model, settings.cell)
            for target, model in settings.load_objects(settings.objects).items()
        }
        self.records, self.task_records = np.zeros(number, EPISODE), np.zeros(number, self.task_dtype)
        self.slots = [Slot() for _ in range(number)]
        self.one_model = number == 1
        """Whether episodes of an object share its scene's model, which is varied anew for each that is entered."""
        self.settle: Callable[[Simulation], None] = Simulation.settle
        """How an object comes to rest where it was drawn to lie."""
        self.info_columns = np.zeros((number, len(INFO_COLUMNS) + len(settings.weights)))
        self.rewards = np.zeros(number)
        self.commands = np.zeros((number, len(COMMANDS), robot.dof))
        self._rows, self._push = np.zeros((number, settings.frame_skip, robot.dof)), np.zeros((number, 3))
        hulls = [simulation.hull for simulation in self.simulations.values()]
        ends = np.cumsum([len(hull) for hull in hulls]).tolist()
        self._hull_spans = {
            target: (end - len(hull), len(hull))
            for target, hull, end in zip(self.simulations, hulls, ends, strict=True)
        }
        first = next(iter(self.simulations.values()))
        self.control = control_of(settings, arm_chain(first.base, robot))
        self.rules = rules_of(settings, first.columns, np.concatenate(hulls), NO_PHYSICS)
        self.layout = layout(settings.obs_mode, robot)
        self.width = max(part.stop for part in self.layout.values())
        self.truncating = np.zeros(len(FAILURES), bool)
        """Which of `FAILURES` truncate an episode; the others terminate it."""
        self.starts: Starts | None = None
        self.device: Any = None
        """Where progress is kept between resets, if not here: a `WarpEpisodes`."""

    def observation_space(self) -> spaces.Dict:
        """Return the space of one environment's observations."""
        return observation_space(self.settings.obs_mode, self.views.image_shape, self.settings.cell.robot)

    # -- starting ------------------------------------------------------------------------------------------------

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
            self.fetch()
            last = self.records[i], self.task_records[i]
            options = self.starts(
                i, rng, {name: part[name] for part in last for name in part.dtype.names or ()}
            )
        simulation = self._begin(i, rng, self._check_options(options))
        judge = not self.slots[i].resumed
        return simulation, self.conclude(slice(i, i + 1), simulation, np.zeros(1, np.int64), [rng], judge)

    def _begin(self, i: int, rng: Generator, options: Mapping[str, Any]) -> Simulation:
        """Start episode `i` by options that are known."""
        settings, names = self.settings, list(self.simulations)
        self.slots[i].resumed = "state" in options
        if self.slots[i].resumed:
            # Where another was: with what that had achieved, and with time and chance of its own.
            simulation = self.set_state(i, options["state"], copy.deepcopy(rng))
            self.records[i]["elapsed"] = 0
            return simulation
        target = options.get("object", names[int(rng.integers(len(names)))])
        simulation = self.simulations[target]
        variation = settings.randomisation.sample(rng, settings.mass, settings.friction_of(simulation.object))
        pose = self._draw_pose(simulation.object, variation, rng)
        given = options.get("object_pose")
        if given is not None:
            pose = check_pose(given, simulation.hull * variation.size, settings.cell)
        self._mount(i, target, (), variation)
        if given is not None:
            simulation.place(pose)
            simulation.check_free()
        self._start_record(i, target, variation)
        return self._set_out(i, pose, rng, given is not None)

    def _draw_pose(self, model: ObjectModel, variation: Variation, rng: Generator) -> Array:
        pose = self.settings.object_pose.sample(model, rng, self.settings.presentation)
        pose[2] *= variation.size
        return pose

    def _set_out(self, i: int, pose: Array, rng: Generator, given: bool) -> Simulation:
        """Put the object of episode `i` down at `pose` (7,), drawn or given, and let it settle; return its scene."""
        simulation = self.enter(i)
        simulation.place(pose)
        if given:
            simulation.settle()
        else:
            self.settle(simulation)
        return simulation

    def _check_options(self, options: Mapping[str, Any] | None) -> Fields:
        options = {key: value for key, value in (options or {}).items() if not self._is_foreign(key)}
        for key in options:
            if key not in self.options:
                raise unknown_name("reset option", key, self.options)
        if "object" in options and options["object"] not in self.simulations:
            raise unknown_name("object", options["object"], self.simulations)
        if "state" in options and (beside := sorted({"object", "object_pose"} & options.keys())):
            raise InputError(
                f"reset options {', '.join(beside)} beside state: valid is either, as it has its own"
            )
        return options

    def _is_foreign(self, key: str) -> bool:
        """Return whether a reset option is of another program's name space, as `lerobot_new_rollout` is; warn of it.

        What begins with a word of ours is a mistake in one of ours.
        """
        space, underscore, _ = str(key).partition("_")
        foreign = bool(underscore) and not get_close_matches(
            space, {"reset", *" ".join(self.options).replace("_", " ").split()}
        )
        if foreign:
            warnings.warn(f"reset option {key!r} is of another program: it is passed over", stacklevel=6)
        return foreign

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
            simulation = simulation.among([models[name] for name in neighbours], self.walled)
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

    def _start_record(self, i: int, target: str, variation: Variation) -> None:
        model, record = self.simulations[target].object, self.records[i]
        self.records[i], self.task_records[i] = np.zeros((), EPISODE), np.zeros((), self.task_dtype)
        record["half_extents"] = 0.5 * model.extents * variation.size
        record["mass"] = model.mass * variation.mass * variation.size**3
        record["size"] = variation.size
        record["variation"] = astuple(variation)
        record["hull_first"], record["hull_count"] = self._hull_spans[target]
        record["latency"] = round(variation.latency / TIMESTEP)
        self.commands[i] = self.settings.cell.robot.home
        record["grip_quat"][0] = 1.0
        record["phase"] = PHASES.index("none" if self.settings.disturbance.kind == "none" else "before")

    # -- stepping ------------------------------------------------------------------------------------------------

    def set_points(self, actions: Array) -> tuple[Array, Array]:
        """Move the set-points by one control step.

        Args:
            actions: (N, m), a copy that may be written to.

        Returns:
            Rows (N, frame_skip, n) rad for the physics steps, and pushes (N, 3) N on the object.

        Raises:
            InputError: for an action that is not finite.
        """
        if self.device:
            self.device.set_points(actions)
        elif not set_points(self.records, self.commands, actions, self.control, self._rows, self._push):
            check_finite(actions)
        return self._rows, self._push

    def conclude(
        self,
        part: slice,
        where: StateHolder,
        warnings: Index,
        rngs: Sequence[Generator | None],
        judge: bool = True,
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
        noise = self._joint_noise(records, rngs)
        if self.device and part == slice(None):
            noisy = self.settings.randomisation.joint_noise is not None
            rows = self.device.conclude(noise if noisy else None)
        else:
            rows = np.empty((len(records), self.width), np.float32)
            state, out = (
                (*where.current, self.commands[part]),
                (self.info_columns[part], self.rewards[part], rows),
            )
            kernel.conclude(records, state, warnings, noise, self.rules, out, judge)
            if self.device:
                self.device.load(part.start, rows)
        return self._finish(part, where, judge, cut(rows, self.layout))

    def _finish(self, part: slice, where: StateHolder, judge: bool, state: Arrays) -> Arrays:
        """Apply the task's own rules after `conclude`, and return its observation."""
        return state

    def _joint_noise(self, records: NDArray[np.void], rngs: Sequence[Generator | None]) -> Array:
        n = self.settings.cell.robot.dof
        if self.settings.randomisation.joint_noise is None:
            return np.zeros((len(records), n))
        size = records["variation"][:, 5:]
        return size * np.array([np.zeros(n) if rng is None else rng.standard_normal(n) for rng in rngs])

    def endings(self) -> tuple[Mask, Mask]:
        """Return which episodes a failure has terminated, and which it has truncated, (N,) each."""
        failures = self.records["failure"]
        truncated = self.truncating[failures]
        return (failures > 0) & ~truncated, truncated

    # -- telling -------------------------------------------------------------------------------------------------

    def info(self, i: int) -> Fields:
        """Return the info of episode `i` alone, plain values; `infos` of one takes a tenth of a step."""
        numbers = self.info_columns[i].tolist()
        told = {
            key: kind[int(number)] if isinstance(kind, tuple) else kind(number)
            for (key, kind), number in zip(INFO_KINDS.items(), numbers, strict=False)
        }
        target = self.slots[i].target
        return told | {
            "object": self.simulations[target].object.name if target else "",
            "mujoco_warnings": warning_names(told["mujoco_warnings"]),
            "variation": dict(vars(self.slots[i].variation)),
            "reward_terms": dict(zip(self.settings.weights, numbers[len(told) :], strict=True)),
            **{key: values[i : i + 1].tolist()[0] for key, values in self.more_infos().items()},
        }

    def infos(self) -> Fields:
        """Return the infos without cameras, arrays (N,) by key: the same at reset and at every step."""
        told = self.info_columns.T.copy()
        infos: Fields = {}
        for (key, kind), numbers in zip(INFO_KINDS.items(), told, strict=False):
            named = isinstance(kind, tuple)
            infos[key] = np.array(kind, object)[numbers.astype(int)] if named else numbers.astype(kind)
        names = [self.simulations[slot.target].object.name if slot.target else "" for slot in self.slots]
        warnings = [*map(warning_names, infos["mujoco_warnings"].tolist())]
        return infos | {
            "object": np.array(names, object),
            "mujoco_warnings": np.array(warnings, object),
            "variation": dict(zip(vars(Variation()), self.records["variation"].T.copy(), strict=True)),
            "reward_terms": dict(zip(self.settings.weights, told[len(infos) :], strict=True)),
            **self.more_infos(),
        }

    def more_infos(self) -> Arrays:
        """Return the task's own infos beside `INFO_COLUMNS`, arrays (N,) by key."""
        return {}

    # -- states --------------------------------------------------------------------------------------------------

    def get_state(self, i: int, physics: Array, sensors: Array, rng: Generator) -> EpisodeState:
        """Return the state of episode `i`."""
        slot = self.slots[i]
        self.fetch()
        return EpisodeState(
            self._of(), slot.target, physics, sensors.copy(), self.info_columns[i].copy(), self.records[i].copy(),
            self.task_records[i].copy(), self.commands[i].copy(), copy.deepcopy(rng.bit_generator.state),
            slot.variation, copy.deepcopy(slot.view), slot.neighbours,
        )  # fmt: skip

    def fetch(self) -> None:
        """Update records and commands from the device, where they are kept on one."""
        if self.device:
            self.device.fetch()

    def _of(self) -> Fields:
        """Return what a state has to agree with."""
        settings = self.settings
        keys = (
            "obs_mode", "control_mode", "mount", "disturbance", "frame_skip", "action_scale",
            "reward_weights",
        )  # fmt: skip
        own = {key: getattr(settings, key) for key in keys}
        seen = {} if settings.obs_mode == "state" else {"views": settings.views}
        return {"task": self.task, "robot": settings.cell.robot.name, **own, **seen}

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
        self.records[i], self.task_records[i], self.commands[i] = (
            state.record,
            state.task_record,
            state.commands,
        )
        self.records[i]["hull_first"], self.records[i]["hull_count"] = self._hull_spans[state.target]
        self.info_columns[i] = state.info_columns
        self.slots[i].view = copy.deepcopy(state.view)
        rng.bit_generator.state = copy.deepcopy(state.rng)
        simulation.set_state(state.physics)
        simulation.data.sensordata[:] = state.sensors[: len(simulation.data.sensordata)]
        if self.device:
            self.device.load(i)
        return simulation
