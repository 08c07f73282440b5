"""Sensors through which observations, rewards and success read the simulation.

All of them live in `sensordata`, so that one environment and a batch read the same bits.
"""

from dataclasses import dataclass

import mujoco

from dexgrasp_env.robot.names import FINGERS, TIP_SITES

_OBJ = mujoco.mjtObj
_SENSOR = mujoco.mjtSensor
_FOUND, _FORCE = (1 << int(getattr(mujoco.mjtConDataField, f"mjCONDATA_{f}")) for f in ("FOUND", "FORCE"))
_NETFORCE = 3


def add_sensors(spec: mujoco.MjSpec) -> None:
    """Add tip positions, palm pose, tip contact forces and the object's contacts."""
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


def _contact(spec: mujoco.MjSpec, name: str, fields: int, other: tuple[mujoco.mjtObj, str] | None) -> None:
    sensor = spec.add_sensor(
        name=name, type=_SENSOR.mjSENS_CONTACT, objtype=_OBJ.mjOBJ_BODY, objname="object"
    )
    if other is not None:
        sensor.reftype, sensor.refname = other
    sensor.intprm[:3] = [fields, _NETFORCE, 1]


@dataclass(frozen=True)
class SensorIndex:
    """Where each reading lies in `sensordata` (slices of the last axis)."""

    tip_positions: slice  # 4 x 3 m, index middle ring thumb
    palm_position: slice  # 3 m
    palm_quat: slice  # 4 wxyz
    tip_forces: slice  # 4 x 3 N
    touching_any: int  # contacts of the object with anything
    touching_hand: int  # contacts of the object with the hand

    @classmethod
    def of(cls, model: mujoco.MjModel) -> "SensorIndex":
        """Resolve the addresses in a compiled model."""

        def span(first: str, last: str) -> slice:
            a, b = model.sensor(first), model.sensor(last)
            return slice(int(a.adr[0]), int(b.adr[0]) + int(b.dim[0]))

        return cls(
            tip_positions=span(f"{TIP_SITES[0]}_position", f"{TIP_SITES[-1]}_position"),
            palm_position=span("palm_position", "palm_position"),
            palm_quat=span("palm_quat", "palm_quat"),
            tip_forces=span(f"{FINGERS[0]}_force", f"{FINGERS[-1]}_force"),
            touching_any=int(model.sensor("touching_any").adr[0]),
            touching_hand=int(model.sensor("touching_hand").adr[0]),
        )
