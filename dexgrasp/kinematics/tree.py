"""The robot as flat arrays that compiled code can walk, taken once from the simulation's own model."""

from functools import lru_cache
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from dexgrasp.kinematics.cover import body_spheres, box_edges
from dexgrasp_env.arrays import Array
from dexgrasp_env.robot.model import compiled_robot
from dexgrasp_env.robot.names import ARM_BODIES, BODIES, GRASP_FINGERS, HAND_BODIES, JOINTS

Index = NDArray[np.int64]


class RobotTree(NamedTuple):
    """Bodies in topological order, base first; nb bodies, 23 joints, ns spheres.

    Spheres cover the collision shapes from outside, so that a clearance computed from them never exceeds the true one.
    """

    parent: Index  # (nb,), -1 for the base
    offset: Array  # (nb, 3) m, in the parent's frame
    rotation: Array  # (nb, 3, 3), in the parent's frame
    joint: Index  # (nb,) column of the body's joint, -1 if fixed
    axis: Array  # (nb, 3) joint axis in the body's frame
    ancestor: NDArray[np.bool_]  # (nb, 23): does the joint move the body
    tip_body: Index  # (3,) thumb, index, middle
    tip_offset: Array  # (3, 3) m, tip sphere centre in the distal link's frame
    palm: int  # index of the palm body
    palm_offset: Array  # (3,) m, the palm frame in its body
    palm_rotation: Array  # (3, 3)
    sphere_first: Index  # (nb + 1,): spheres of body b are sphere_first[b] .. sphere_first[b + 1]
    sphere_centre: Array  # (ns, 3) m, body frame
    sphere_radius: Array  # (ns,) m
    sphere_is_tip: NDArray[np.bool_]  # (ns,): covers the tip of a grasping finger, which may touch the object
    bound_centre: Array  # (nb, 3) m: one sphere around all of a body's
    bound_radius: Array  # (nb,) m, -1 where a body has none
    pairs: Index  # (np, 2) bodies whose distance is kept
    palm_box_centre: Array  # (3,) m, palm body frame
    palm_box_half: Array  # (3,) m
    thumb: int  # the thumb's medial link, which works right beside the palm
    thumb_edges: Array  # (ne, 3) m, points of its box's edges, in its frame
    lower: Array  # (23,) rad
    upper: Array  # (23,) rad


@lru_cache(maxsize=4)
def robot_tree(mount: str = "palm_normal") -> RobotTree:
    """Return the tree of the robot with the given mount; the same arrays at every call.

    Raises:
        InputError: if the mount is not known.
    """
    model = compiled_robot(mount)
    bodies = [model.body(name).id for name in BODIES]
    index = {body: i for i, body in enumerate(bodies)}
    parent = np.array([index.get(int(model.body_parentid[b]), -1) for b in bodies])
    joint = np.array([_joint_column(model, b) for b in bodies])
    quats = model.body_quat[bodies]
    spheres = [body_spheres(model, b) for b in bodies]
    first = np.concatenate([[0], np.cumsum([len(s.radius) for s in spheres])])
    bounds = [s.bound() for s in spheres]
    site = model.site("palm").id
    tips = [model.site(f"{finger}_tip").id for finger in GRASP_FINGERS]
    return RobotTree(
        parent=parent,
        offset=model.body_pos[bodies].copy(),
        rotation=np.stack([_matrix(q) for q in quats]),
        joint=joint,
        axis=np.array(
            [model.jnt_axis[model.body_jntadr[b]] if model.body_jntnum[b] else [0, 0, 0] for b in bodies]
        ),
        ancestor=_ancestors(parent, joint),
        tip_body=np.array([index[int(model.site_bodyid[s])] for s in tips]),
        tip_offset=model.site_pos[tips].copy(),
        palm=index[int(model.site_bodyid[site])],
        palm_offset=model.site_pos[site].copy(),
        palm_rotation=_matrix(model.site_quat[site]),
        sphere_first=first,
        sphere_centre=np.concatenate([s.centre for s in spheres]),
        sphere_radius=np.concatenate([s.radius for s in spheres]),
        sphere_is_tip=np.concatenate([s.is_tip for s in spheres]),
        bound_centre=np.array([centre for centre, _ in bounds]),
        bound_radius=np.array([radius for _, radius in bounds]),
        pairs=_body_pairs(),
        palm_box_centre=model.geom("palm").pos.copy(),
        palm_box_half=model.geom("palm").size.copy(),
        thumb=BODIES.index("thumb_medial"),
        thumb_edges=box_edges(model.geom("thumb_medial").pos, model.geom("thumb_medial").size),
        lower=np.array([model.joint(name).range[0] for name in JOINTS]),
        upper=np.array([model.joint(name).range[1] for name in JOINTS]),
    )


def _joint_column(model: mujoco.MjModel, body: int) -> int:
    if not model.body_jntnum[body]:
        return -1
    return JOINTS.index(model.joint(int(model.body_jntadr[body])).name)


def _matrix(quat: Array) -> Array:
    out = np.zeros(9)
    mujoco.mju_quat2Mat(out, quat)
    return out.reshape(3, 3)


def _ancestors(parent: Index, joint: Index) -> NDArray[np.bool_]:
    table = np.zeros((len(parent), len(JOINTS)), dtype=bool)
    for body in range(len(parent)):
        if parent[body] >= 0:
            table[body] = table[parent[body]]
        if joint[body] >= 0:
            table[body, joint[body]] = True
    return table


def _body_pairs() -> Index:
    """Pairs that a motion of the arm or of a finger can bring together; neighbours in the chain cannot collide."""
    fingers = ("index", "middle", "ring", "thumb")
    links = {
        finger: [BODIES.index(f"{finger}_{link}") for link in ("proximal", "medial", "distal")]
        for finger in fingers
    }
    neighbours = [
        ("index", "middle"),
        ("middle", "ring"),
        ("thumb", "index"),
        ("thumb", "middle"),
        ("thumb", "ring"),
    ]
    pairs = [(a, b) for one, two in neighbours for a in links[one] for b in links[two]]
    pairs += [(BODIES.index("palm"), links[finger][2]) for finger in fingers]
    pairs += [
        (BODIES.index("thumb_distal"), BODIES.index(base))
        for base in ("index_base", "middle_base", "thumb_base")
    ]
    pairs += [(BODIES.index("index_distal"), BODIES.index("thumb_base"))]
    low = [BODIES.index(name) for name in ARM_BODIES[:5]]
    hand = [BODIES.index(name) for name in HAND_BODIES]
    wrist = [BODIES.index(name) for name in ARM_BODIES[6:]]
    pairs += [(a, b) for a in low for b in hand]
    pairs += [(a, b) for a in low[:3] for b in wrist]
    pairs += [(BODIES.index("panda_link5"), b) for b in [*hand, *low[:3]]]
    return np.array(pairs)
