"""Sensors through which observations, rewards and success read the simulation.

All of them live in `sensordata`, so that one environment and a batch read the same bits.
"""

import mujoco
import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.robot.names import FINGERS, TIP_SITES

_OBJ = mujoco.mjtObj
_SENSOR = mujoco.mjtSensor
_FOUND, _FORCE = (1 << int(getattr(mujoco.mjtConDataField, f"mjCONDATA_{f}")) for f in ("FOUND", "FORCE"))
_NETFORCE = 3


def add_sensors(spec: mujoco.MjSpec) -> None:
    """Add tip positions, palm pose, the object's contacts and their forces by tip and by finger."""
    for site in TIP_SITES:
        spec.add_sensor(
            name=f"{site}_position", type=_SENSOR.mjSENS_FRAMEPOS, objtype=_OBJ.mjOBJ_SITE, objname=site
        )
    spec.add_sensor(
        name="palm_position", type=_SENSOR.mjSENS_FRAMEPOS, objtype=_OBJ.mjOBJ_SITE, objname="palm"
    )
    spec.add_sensor(name="palm_quat", type=_SENSOR.mjSENS_FRAMEQUAT, objtype=_OBJ.mjOBJ_SITE, objname="palm")
    for finger in FINGERS:
        _contact(spec, f"{finger}_force", _FORCE, (_OBJ.mjOBJ_GEOM, f"{finger}_tip"))
    _contact(spec, "touching_any", _FOUND, None)
    _contact(spec, "touching_hand", _FOUND, (_OBJ.mjOBJ_XBODY, "palm"))
    for finger in FINGERS:
        _contact(spec, f"{finger}_press", _FORCE, (_OBJ.mjOBJ_XBODY, f"{finger}_base"))


def _contact(spec: mujoco.MjSpec, name: str, fields: int, other: tuple[mujoco.mjtObj, str] | None) -> None:
    sensor = spec.add_sensor(
        name=name, type=_SENSOR.mjSENS_CONTACT, objtype=_OBJ.mjOBJ_BODY, objname="object"
    )
    if other is not None:
        sensor.reftype, sensor.refname = other
    sensor.intprm[:3] = [fields, _NETFORCE, 1]


READINGS = {
    "tip_positions": f"{TIP_SITES[0]}_position",  # 4 x 3 m, index middle ring thumb
    "palm_position": "palm_position",  # 3 m
    "palm_quat": "palm_quat",  # 4 wxyz
    "tip_forces": f"{FINGERS[0]}_force",  # 4 x 3 N, between tip and object
    "touching_any": "touching_any",  # contacts of the object with anything
    "touching_hand": "touching_hand",  # contacts of the object with the hand
    "finger_forces": f"{FINGERS[0]}_press",  # 4 x 3 N, between the whole finger and the object
}
"""What is read, with the sensor that each begins at."""


def reading_columns(model: mujoco.MjModel) -> NDArray[np.int64]:
    """Return the first column of each of `READINGS` in `sensordata`, (7,)."""
    return np.array([int(model.sensor(name).adr[0]) for name in READINGS.values()])
