"""Scenes and variations of running episodes, and the complete state of one."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import mujoco
from numpy.random import Generator

from dexgrasp_env.arrays import Array
from dexgrasp_env.tasks.randomisation import Variation
from dexgrasp_env.tasks.records import Records
from dexgrasp_env.tasks.simulation import Simulation
from dexgrasp_env.tasks.views import CameraViews

Starts = Callable[[int, Generator, Mapping[str, Any]], Mapping[str, Any]]
"""Returns the options of a reset that is given none: of a slot, its generator and the records of its last episode."""


@dataclass
class Slot:
    """Object, scene and variation of a running episode.

    Attributes:
        resumed: it began from a state that was given.
        joints: (n,) rad, where the robot began; None: at home.
    """

    target: str = ""
    neighbours: tuple[str, ...] = ()
    simulation: Simulation | None = None
    model: mujoco.MjModel | None = None
    variation: Variation = field(default_factory=Variation)
    view: CameraViews = field(default_factory=CameraViews)
    resumed: bool = False
    joints: Array | None = None


@dataclass
class EpisodeState:
    """Everything that an episode's future depends on, and nothing of the machine: it can be pickled and copied.

    Attributes:
        of: what the settings of an environment have to agree with, by name.
        target: the object, as `objects` names it.
        physics: MuJoCo's full integration state.
        sensors: its sensors as last read.
        record: one of `EPISODE`.
        task_record: what the task notes beside it.
        commands: (3, n) rad, `COMMANDS`.
        rng: state of the random generator.
        variation: of this episode.
        view: what the cameras saw, for `observe="reset"`, and where the calibration believes them to be.
        neighbours: the other objects on the table, by name.
    """

    of: Mapping[str, Any]
    target: str
    physics: Array
    sensors: Array
    record: Records
    task_record: Records
    commands: Array
    rng: Mapping[str, Any]
    variation: Variation
    view: CameraViews
    neighbours: tuple[str, ...] = ()
