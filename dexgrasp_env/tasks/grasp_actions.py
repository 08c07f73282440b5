"""Actions and states of the grasp space for N episodes side by side; it imports numba."""

import numpy as np

from dexgrasp_env.arrays import AnyArray, Array, Single
from dexgrasp_env.tasks.control import GRASP_SIZE, check_finite
from dexgrasp_env.tasks.grasp_space import (
    grasp_frame,
    grasp_space,
    grasp_states,
    home_yaw,
    palm_actions,
    table_frame,
)
from dexgrasp_env.tasks.records import Records
from dexgrasp_env.tasks.settings import LiftSettings
from dexgrasp_env.tasks.simulation import Physics, Simulation


class GraspActions:
    """Actions of the grasp space, in a frame where the object of each episode lay at first, or in that of the table."""

    def __init__(self, settings: LiftSettings, simulation: Simulation, number: int) -> None:
        """Prepare.

        Args:
            settings: of the environment.
            simulation: one of its scenes.
            number: of episodes.

        Raises:
            InputError: for a hand that has no postures of grasps.
        """
        self._space, self._at, self._yaw = grasp_space(settings), simulation.columns, home_yaw(simulation)
        self._frames = np.tile(table_frame(self._yaw), (number, 1))
        self._fixed = settings.control_mode == "table_grasp_once"
        self._moves = np.zeros((number, 6 + len(self._space.opened)))

    def begin(self, i: int, record: Records) -> None:
        """Take how the object of episode `i` lay at first, from the episode's record."""
        if not self._fixed:
            self._frames[i] = grasp_frame(record, self._yaw)

    def moves(self, actions: Array, step: int, commands: Array, where: Physics) -> Array:
        """Return the actions (N, 6 + m) of `ee_delta` that go one control step towards grasp actions.

        Args:
            actions: (N, 7).
            step: control steps since they were given.
            commands: (N, 3, n) rad, `COMMANDS`.
            where: the episodes are.

        Raises:
            InputError: for an action that is not finite.
        """
        if step == 0:
            check_finite(actions)
        sensors = where.current.sensors
        palm_actions(actions, step, self._frames, commands, sensors, self._at, self._space, self._moves)
        return self._moves

    def states(self, part: slice, positions: AnyArray, where: Physics) -> Single:
        """Return the states (n, 7) of palms and hands of a part of the episodes: the actions that would keep them.

        Args:
            part: which.
            positions: (n, ...) rad, of the joints.
            where: they are.
        """
        seen = np.empty((len(self._frames[part]), GRASP_SIZE), np.float32)
        grasp_states(self._frames[part], positions, where.current.sensors, self._at, self._space, seen)
        return seen
