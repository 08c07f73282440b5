"""Grasps that many tests look at: planned once, on catalogue objects and on a mug of a user's."""

import trimesh
from robots import HOME

from dexgrasp.geometry.target import GraspTarget
from dexgrasp.grasp.identity import ObjectIdentity
from dexgrasp.grasp.planned_record import ObjectPose, Origin, grasp_json, planned_record
from dexgrasp.planning.planner import Planner
from dexgrasp.planning.settings import PlannerSettings
from dexgrasp_env.objects.catalogue import CATALOGUE
from dexgrasp_env.objects.load import load_object

SETTINGS = PlannerSettings()
PLACED = {}


def catalogue(name):
    mesh = load_object(name).mesh.copy()
    turn = trimesh.transformations.rotation_matrix(0.5, [0, 0, 1])
    mesh.apply_transform(turn)
    low, high = mesh.bounds
    shift = [0.48 - (low + high)[0] / 2, 0.05 - (low + high)[1] / 2, -low[2]]
    mesh.apply_translation(shift)
    PLACED[name] = trimesh.transformations.translation_matrix(shift) @ turn
    return mesh


def lying(size, at=(0.5, 0.0), mass=None):
    """A box on the table."""
    return GraspTarget.of(trimesh.creation.box(size).apply_translation([*at, size[2] / 2]), mass=mass)


def users_mesh():
    """A mug without its handle's charm: not convex, off centre."""
    cup = trimesh.creation.annulus(0.026, 0.032, 0.09)
    handle = trimesh.creation.box((0.03, 0.01, 0.05))
    handle.apply_translation([0.04, 0, 0])
    mesh = trimesh.util.concatenate([cup, handle])
    mesh.apply_translation([0.5, -0.05, -mesh.bounds[0, 2]])
    return mesh


def hammer():
    """A handle and a head across its end, lying down: its hull is mostly air."""
    handle, head = trimesh.creation.box((0.18, 0.03, 0.045)), trimesh.creation.box((0.035, 0.11, 0.05))
    handle.apply_translation([0.50, 0.0, 0.0225])
    head.apply_translation([0.60, 0.0, 0.025])
    return handle, head


MESHES = {
    "sugar_box": catalogue, "pear": catalogue, "tomato_soup_can": catalogue, "tetrahedron": catalogue,
    "massage_ball": catalogue, "users_mesh": lambda name: users_mesh(),
    "hammer": lambda name: hammer(),
}  # fmt: skip


def plan_contents():
    """Return name -> content of a grasp file."""
    found = {}
    for seed, (name, make) in enumerate(MESHES.items()):
        made = make(name)
        meshes = made if isinstance(made, tuple) else (made,)
        mass = load_object(name).mass if name in CATALOGUE else 0.2
        grasp_target = GraspTarget.of(*meshes, mass=mass)
        plan = Planner().plan(grasp_target, seed, HOME)
        assert plan.grasp is not None, (name, plan.reason)
        identity, pose = name, None
        if name in CATALOGUE:
            identity = ObjectIdentity.of(load_object(name), name)
            pose = ObjectPose(load_object(name).solid, PLACED[name])
        record = planned_record(
            identity, plan.grasp, grasp_target, SETTINGS,
            script=plan.script, pose=pose, origin=Origin("bilevel", seed),
        )  # fmt: skip
        found[name] = grasp_json(record)
    return found


def failing(checks):
    return {name for name, c in checks.items() if not c.holds}
