"""The state that observations, rewards and success are functions of."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array
from dexgrasp_env.poses import components, join, rotation_components
from dexgrasp_env.scene.sensors import SensorIndex


@dataclass(frozen=True)
class ObjectConstants:
    """What does not change during an episode."""

    hull_vertices: Array  # (V, 3) m, object frame
    extents: Array  # (3,) m, of the mesh's axis-aligned box in the object frame
    mass: float  # kg

    @cached_property
    def hull_columns(self) -> Array:
        """(..., 3, V): the vertices as columns, as `lowest_point` reads them."""
        return np.ascontiguousarray(np.swapaxes(self.hull_vertices, -1, -2))

    @cached_property
    def extents_and_mass(self) -> Array:
        """(..., 4): as observations show them."""
        return np.concatenate([self.extents, np.asarray(self.mass)[..., None]], axis=-1)

    @cached_property
    def half_extents(self) -> Any:
        """Half the extents, number by number."""
        return components(0.5 * self.extents)


@dataclass(frozen=True)
class LiftState:
    """One moment of one simulation, or of many along leading axes (...); holds until the simulation's next step."""

    qpos: Array  # (..., 30): 23 joints, object position and quaternion wxyz
    qvel: Array  # (..., 29)
    sensordata: Array  # (..., n)
    targets: Array  # (..., 23) rad, set-points of the servos
    sensors: SensorIndex

    @cached_property
    def configuration(self) -> Any:
        """`qpos` number by number, see `poses.components`."""
        return components(self.qpos)

    @cached_property
    def readings(self) -> Any:
        """`sensordata` number by number, see `poses.components`."""
        return components(self.sensordata)

    @property
    def joint_positions(self) -> Array:
        """(..., 23) rad."""
        return self.qpos[..., :23]

    @property
    def joint_velocities(self) -> Array:
        """(..., 23) rad/s."""
        return self.qvel[..., :23]

    @property
    def object_position(self) -> Array:
        """(..., 3) m, centre of mass, robot base frame."""
        return self.qpos[..., 23:26]

    @property
    def object_quat(self) -> Array:
        """(..., 4) wxyz."""
        return self.qpos[..., 26:30]

    @cached_property
    def object_rotation(self) -> tuple[Any, ...]:
        """The nine numbers of the object's rotation matrix, row by row; each (...,)."""
        return rotation_components(*self.configuration[26:30])

    @property
    def object_velocity(self) -> Array:
        """(..., 6): m/s in the base frame, rad/s in the object frame."""
        return self.qvel[..., 23:29]

    @property
    def tip_positions(self) -> Array:
        """(..., 4, 3) m: index, middle, ring, thumb."""
        flat = self.sensordata[..., self.sensors.tip_positions]
        return flat.reshape(*flat.shape[:-1], 4, 3)

    @property
    def tip_forces(self) -> Array:
        """(..., 4, 3) N: contact force between tip and object, base frame."""
        flat = self.sensordata[..., self.sensors.tip_forces]
        return flat.reshape(*flat.shape[:-1], 4, 3)

    @property
    def palm_position(self) -> Array:
        """(..., 3) m."""
        return self.sensordata[..., self.sensors.palm_position]

    @property
    def palm_quat(self) -> Array:
        """(..., 4) wxyz."""
        return self.sensordata[..., self.sensors.palm_quat]

    @property
    def held_by_hand_alone(self) -> NDArray[np.bool_]:
        """(...,): the hand touches the object and nothing else does."""
        hand = self.readings[self.sensors.touching_hand]
        return (hand > 0) & (hand == self.readings[self.sensors.touching_any])

    @property
    def touched_by_hand(self) -> NDArray[np.bool_]:
        """(...,)."""
        return self.readings[self.sensors.touching_hand] > 0


def lowest_point(state: LiftState, constants: ObjectConstants) -> Array:
    """Height (...,) m of the object's lowest point above the table."""
    row = join(*state.object_rotation[6:])
    heights = (constants.hull_columns * row[..., None]).sum(-2).min(-1)  # no BLAS: see poses
    return state.configuration[25] + (float(heights) if isinstance(heights, float) else heights)
