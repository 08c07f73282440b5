"""A grasp checked again by another way, so that a wrong planner cannot certify itself.

The planner uses its own kinematics, its own distance to convex hulls, covering spheres and a closed form of the
margin. Here: MuJoCo's kinematics, exact distances to the mesh by closest triangles, MuJoCo's geometry distances between
the true collision shapes, and a conic solver on the exact friction cones.
"""

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from agents.geometry.exact import closest_on_mesh
from agents.grasp.file import GraspRecord
from agents.physics.conic import conic_margin, conic_residual
from agents.planning.settings import PlannerSettings
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.robot.limits import LOWER, TORQUE, UPPER
from dexgrasp_env.robot.model import robot_spec
from dexgrasp_env.robot.names import GRASP_FINGERS
from dexgrasp_env.scene.constants import FRICTION

_LENGTH, _FORCE = 2e-5, 0.02  # tolerances: m of lengths (file digits, triangle soup), N of force balance
_ANGLE = 1e-3  # of unit vectors
_MARGIN = 1e-3
_RESIDUAL = 1e-6  # N^2, as in the paper's feasibility test
_GRAVITY = 9.81
_ALWAYS_APART = (
    0.003  # m: links that the joint ranges keep this far apart do not count in the planner's least clearance
)


@dataclass(frozen=True)
class Check:
    """One constraint computed again: its value, the bound, and whether it holds."""

    name: str
    value: float
    bound: str
    holds: bool


def verify(record: GraspRecord) -> list[Check]:
    """Compute every constraint of a grasp again, from its joint positions and the hull alone.

    Returns:
        All checks; the grasp is good only if every one of them holds.
    """
    model, data, hull = _scene(record)
    data.qpos[:23] = record.arrays["q"]
    mujoco.mj_forward(model, data)
    tips = np.array([data.site(f"{finger}_tip").xpos for finger in GRASP_FINGERS])
    distance, contacts, normals = closest_on_mesh(hull, tips)
    return [
        _threshold_check(record),
        *_contact_checks(record, distance, normals, contacts),
        *_limit_checks(record),
        *_clearance_checks(record, model, data),
        *_closure_checks(record, contacts, normals),
        *_force_checks(record, model, data, contacts, normals),
    ]


def _threshold_check(record: GraspRecord) -> Check:
    """The file's own thresholds must be no looser than the project's: a grasp cannot move the bar it is held to."""
    own, ours = record.settings, PlannerSettings()
    looser = [
        own.distance[0] < ours.distance[0], own.distance[1] > ours.distance[1], own.tip_radius != ours.tip_radius,
        own.clearance < ours.clearance, own.closure_margin < ours.closure_margin,
        max(own.friction, own.friction_hold) > FRICTION,
    ]  # fmt: skip
    return Check("thresholds looser than ours", float(sum(looser)), "0", not any(looser))


def _scene(record: GraspRecord) -> tuple[mujoco.MjModel, mujoco.MjData, Any]:
    import trimesh

    hull = trimesh.Trimesh(record.hull, process=False).convex_hull
    spec = robot_spec(record.mount)
    mesh = spec.add_mesh(name="hull")
    mesh.uservert = np.asarray(hull.vertices).ravel()
    mesh.userface = np.asarray(hull.faces).ravel()
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
    spec.worldbody.add_geom(name="object", type=mujoco.mjtGeom.mjGEOM_MESH, meshname="hull")
    spec.worldbody.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
    model = spec.compile()
    return model, mujoco.MjData(model), hull


def _contact_checks(record: GraspRecord, distance: Array, normals: Array, contacts: Array) -> list[Check]:
    low, high = record.settings.distance
    depth = distance - record.settings.tip_radius
    checks = [
        Check(
            f"distance:{finger}", 100.0 * float(d), f"[{100 * low:.2f}, {100 * high:.2f}] cm",
            bool(low - _LENGTH <= d <= high + _LENGTH),
        )
        for finger, d in zip(GRASP_FINGERS, depth, strict=True)
    ]  # fmt: skip
    off = float(np.abs(contacts - record.arrays["contacts"]).max())
    turned = float(np.abs(normals - record.arrays["normals"]).max())
    claimed = float(np.abs(100.0 * depth - np.asarray(record.certificate["distances_cm"], dtype=float)).max())
    return [
        *checks,
        Check("contacts as claimed", off, f"<= {_LENGTH} m", off <= _LENGTH),
        Check("normals as claimed", turned, "<= 0.02", turned <= 0.02),
        Check("distances as claimed", claimed, "<= 0.002 cm", claimed <= 0.002),
    ]


def _limit_checks(record: GraspRecord) -> list[Check]:
    checks = []
    for name in ("q", "pregrasp", "grasp", "squeeze"):
        q = record.arrays[name]
        margin = float(np.minimum(q - LOWER, UPPER - q).min())
        checks.append(Check(f"joint limits:{name}", margin, ">= 0 rad", margin >= -1e-9))
    q = record.arrays["q"]
    least = float(np.minimum(q - LOWER, UPPER - q).min())
    return [*checks, *_claim(record, "joint_limit_margin_rad", "joint limit margin", least, 1e-6)]


def _claim(record: GraspRecord, key: str, name: str, value: float, tolerance: float) -> list[Check]:
    """Compare what the certificate says, if it says it, with what was found."""
    if key not in record.certificate:
        return []
    off = abs(value - float(record.certificate[key]))
    return [Check(f"{name} as claimed", off, f"<= {tolerance:g}", off <= tolerance)]


def _clearance_checks(record: GraspRecord, model: mujoco.MjModel, data: mujoco.MjData) -> list[Check]:
    """Distances between the true collision shapes, in the grasp; the pregrasp's tips must be clear as well."""
    bound = record.settings.clearance
    grasp = _least_clearances(model, data, tips_touch=True)
    checks = [Check(f"clearance {k}", v, f">= {bound} m", v >= bound - _LENGTH) for k, v in grasp.items()]
    if "min_clearance_m" in record.certificate:  # a bound, so only too much is wrong
        counted = [v for k, v in grasp.items() if k != "self" or v < _ALWAYS_APART]
        excess = float(record.certificate["min_clearance_m"]) - min(counted)
        checks.append(
            Check("least clearance over the true one", excess, f"<= {_LENGTH} m", excess <= _LENGTH)
        )
    data.qpos[:23] = record.arrays["pregrasp"]
    mujoco.mj_forward(model, data)
    opened = _least_clearances(model, data, tips_touch=False)
    checks += [Check(f"pregrasp clearance {k}", v, "> 0 m", v > 0.0) for k, v in opened.items()]
    data.qpos[:23] = record.arrays["q"]
    mujoco.mj_forward(model, data)
    return checks


def _least_clearances(model: mujoco.MjModel, data: mujoco.MjData, tips_touch: bool) -> dict[str, float]:
    obstacle, table = model.geom("object").id, model.geom("table").id
    robot = [g for g in range(model.ngeom) if model.geom_contype[g] and g not in (obstacle, table)]
    touching = {model.geom(f"{finger}_tip").id for finger in GRASP_FINGERS} if tips_touch else set()
    moving = [g for g in robot if model.body_weldid[model.geom_bodyid[g]] != 0]
    from_to = np.zeros(6)

    def least(pairs: list[tuple[int, int]]) -> float:
        return min((mujoco.mj_geomDistance(model, data, a, b, 0.05, from_to) for a, b in pairs), default=0.05)

    far = [
        g for g in moving if model.geom(g).name.split("_")[0] != "panda" or int(model.geom(g).name[10]) > 2
    ]
    return {
        "hand_object": least([(g, obstacle) for g in moving if g not in touching]),
        "hand_table": least([(g, table) for g in far]),
        "self": least(_self_pairs(model, robot)),
    }


def _self_pairs(model: mujoco.MjModel, geoms: list[int]) -> list[tuple[int, int]]:
    """Pairs that may collide in the simulation: not of one body, of neighbours, or excluded by the model."""
    excluded = {(int(s) >> 16, int(s) & 0xFFFF) for s in model.exclude_signature}
    pairs = []
    for i, a in enumerate(geoms):
        for b in geoms[i + 1 :]:
            one, two = sorted((int(model.geom_bodyid[a]), int(model.geom_bodyid[b])))
            welded = model.body_weldid[one] == model.body_weldid[two]
            neighbours = (
                model.body_weldid[model.body_parentid[model.body_weldid[two]]] == model.body_weldid[one]
            )
            if not (welded or neighbours or (one, two) in excluded or (two, one) in excluded):
                pairs.append((a, b))
    return pairs


def _closure_checks(record: GraspRecord, contacts: Array, normals: Array) -> list[Check]:
    mu = record.settings.friction
    residual = conic_residual(contacts, normals, mu).upper
    margin = _exact_margin(contacts, normals, mu)
    least = record.settings.closure_margin
    return [
        Check("Eq. 4 residual, exact cone", residual, f"< {_RESIDUAL} N^2", residual < _RESIDUAL),
        Check("closure margin, exact cone", margin, f">= {least}", margin >= least - _MARGIN),
        *_claim(record, "closure_margin", "closure margin", margin, 10 * _MARGIN),
    ]


def _exact_margin(contacts: Array, normals: Array, mu: float) -> float:
    try:
        return conic_margin(contacts, normals, mu).value
    except InputError:  # contacts that cannot press: no closure at all
        return -1.0


def _force_checks(
    record: GraspRecord, model: mujoco.MjModel, data: mujoco.MjData, contacts: Array, normals: Array
) -> list[Check]:
    """Forces balance gravity, lie in the exact cones, and are within the joint torque limits."""
    f = record.arrays["forces"]
    weight = np.array([0.0, 0.0, -_GRAVITY * record.mass])
    force = float(np.linalg.norm(f.sum(0) + weight))
    arm = contacts - record.arrays["centre"]
    torque = float(np.linalg.norm(np.cross(arm, f).sum(0)))
    press = -(f * normals).sum(1)
    sliding = np.linalg.norm(f + press[:, None] * normals, axis=1)
    use = float((sliding / np.maximum(record.settings.friction_hold * press, 1e-9)).max())
    fraction = _torque_fraction(model, data, contacts, f)
    return [
        Check("forces balance gravity", force, f"<= {_FORCE} N", force <= _FORCE),
        Check("torques balance gravity", torque, f"<= {_FORCE * 0.1} Nm", torque <= 0.1 * _FORCE),
        Check("least pressing force", float(press.min()), "> 0 N", bool(press.min() > 0.0)),
        Check("share of friction used", use, "<= 1", use <= 1.0 + _ANGLE),
        Check("joint torque over limit", fraction, "<= 1", fraction <= 1.0 + _ANGLE),
        *_claim(record, "max_joint_torque_fraction", "joint torque", fraction, _ANGLE),
    ]


def _torque_fraction(model: mujoco.MjModel, data: mujoco.MjData, contacts: Array, forces: Array) -> float:
    """Largest joint torque that forces at the contact points ask for, over its limit."""
    torque, J = np.zeros(model.nv), np.zeros((3, model.nv))
    for finger, point, f in zip(GRASP_FINGERS, contacts, forces, strict=True):
        mujoco.mj_jac(model, data, J, None, point, model.body(f"{finger}_distal").id)
        torque += J.T @ f
    return float((np.abs(torque[7:23]) / TORQUE[7:]).max())
