"""Sensors through which observations, rewards and success read the simulation.

All of them live in `sensordata`, so that one environment and a batch read the same bits.
"""

import mujoco
import numpy as np

from dexgrasp_env.arrays import Index
from dexgrasp_env.robot.robot import Robot

_OBJ = mujoco.mjtObj
_SENSOR = mujoco.mjtSensor
_FOUND, _FORCE = (1 << int(getattr(mujoco.mjtConDataField, f"mjCONDATA_{f}")) for f in ("FOUND", "FORCE"))


def add_sensors(spec: mujoco.MjSpec, robot: Robot, neighbours: int) -> None:
    """Add tip positions, palm pose, the object's contacts and their forces by tip and by finger.

    After them come the contacts of each neighbour with the robot, one number each.
    """
    palm, fingers = robot.hand.palm, robot.hand.fingers
    for tip in robot.tips:
        spec.add_sensor(
            name=f"{tip}_position", type=_SENSOR.mjSENS_FRAMEPOS, objtype=_OBJ.mjOBJ_SITE, objname=tip
        )
    spec.add_sensor(name="palm_position", type=_SENSOR.mjSENS_FRAMEPOS, objtype=_OBJ.mjOBJ_SITE, objname=palm)
    spec.add_sensor(name="palm_quat", type=_SENSOR.mjSENS_FRAMEQUAT, objtype=_OBJ.mjOBJ_SITE, objname=palm)
    for finger in fingers:
        _contact(spec, f"{finger.name}_force", _FORCE, (_OBJ.mjOBJ_GEOM, finger.tip))
    _contact(spec, "touching_any", _FOUND, None)
    _contact(spec, "touching_hand", _FOUND, (_OBJ.mjOBJ_XBODY, palm))
    for finger in fingers:
        _contact(spec, f"{finger.name}_press", _FORCE, (_OBJ.mjOBJ_XBODY, finger.bodies[0]))
    for k in range(neighbours):
        name = f"neighbour_{k}"
        _contact(spec, f"{name}_touched", _FOUND, (_OBJ.mjOBJ_XBODY, robot.bodies[0]), name)


def _contact(
    spec: mujoco.MjSpec, name: str, fields: int, other: tuple[mujoco.mjtObj, str] | None, body: str = "object"
) -> None:
    sensor = spec.add_sensor(name=name, type=_SENSOR.mjSENS_CONTACT, objtype=_OBJ.mjOBJ_BODY, objname=body)
    if other is not None:
        sensor.reftype, sensor.refname = other
    sensor.intprm[:3] = [fields, 3, 1]  # fields, reduced to the net force, of one contact


READINGS = {
    "tip_positions": "{tip}_position",  # F x 3 m, in the order of the fingers
    "palm_position": "palm_position",  # 3 m
    "palm_quat": "palm_quat",  # 4 wxyz
    "tip_forces": "{finger}_force",  # F x 3 N, between tip and object
    "touching_any": "touching_any",  # contacts of the object with anything
    "touching_hand": "touching_hand",  # contacts of the object with the hand
    "finger_forces": "{finger}_press",  # F x 3 N, between the whole finger and the object
}
"""What is read, with the sensor that each begins at: that of the first finger where there is one for each."""


def reading_columns(model: mujoco.MjModel, robot: Robot) -> Index:
    """Return the first column of each of `READINGS` in `sensordata`, (7,)."""
    first = robot.hand.fingers[0]
    names = [name.format(tip=first.tip, finger=first.name) for name in READINGS.values()]
    return np.array([int(model.sensor(name).adr[0]) for name in names])
