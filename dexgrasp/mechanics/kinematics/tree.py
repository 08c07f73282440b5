"""The robot as flat arrays that compiled code can walk, taken once from the simulation's own model."""

from functools import lru_cache
from typing import Any, NamedTuple, Self

import mujoco
import numpy as np

from dexgrasp.mechanics.contact_models import ContactModel, contact_model
from dexgrasp.mechanics.kinematics.pairs import meeting_pairs
from dexgrasp_env.arrays import Array, Index, Mask, middle
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.robot.hulls import corners_of
from dexgrasp_env.robot.model import colliding, compiled_robot, posed
from dexgrasp_env.robot.robot import SLIDE, STRONGEST, Robot

_SWING, _TWIST = 0.5, 1.3  # rad of the first and of the last joint from home, where inverse kinematics begins


class _Links(NamedTuple):
    """The links of a robot as compiled code takes them: each array more makes every call dearer.

    Bodies in topological order, base first; nb bodies, n joints of which `arm` are the arm's, g tips.
    """

    parent: Index  # (nb,), -1 for the base
    offset: Array  # (nb, 3) m, in the parent's frame
    rotation: Array  # (nb, 3, 3), in the parent's frame
    joint: Index  # (nb,) column of the body's joint, -1 if fixed
    axis: Array  # (nb, 3) joint axis in the body's frame
    slides: Mask  # (nb,) whether the joint slides
    gear: Array  # (nb, 3) place of the joint: the first times its column, and the second; how much it moves with it
    tip_body: Index  # (g,) last bodies of the grasping fingers, the opposing one first
    tip_offset: Array  # (g, 3) m, tip sphere centre in the distal link's frame
    palm: int  # index of the palm body
    palm_offset: Array  # (3,) m, the palm frame in its body
    palm_rotation: Array  # (3, 3)
    palm_middle: Array  # (3,) m of the box around the palm, palm body frame
    pairs: Index  # (np, 2) bodies whose distance is kept
    torsion: float  # m, of soft tips: torsional friction over sliding friction
    follows: Index  # (n,) the joint that each follows, -1 where it does not; of a tendon's joints the last
    ratio: Array  # (n, 3) at which multiple, how much farther; of a tendon coefficient and stop, and 1 where it stands
    lower: Array  # (n,) rad; of slides m, as below
    upper: Array  # (n,) rad
    arm: int
    base: int  # bodies from the base on that may be near the table beside it


class RobotTree(_Links):
    """A robot's links, and what plain code alone asks of its joints."""

    stands: Mask  # (n,) whether the joint stands on its stop in a grasp
    unit: Array  # (n,) what counts as much as a radian: 1, or `SLIDE` m
    velocity: Array  # (n,) rad/s
    acceleration: Array  # (n,) rad/s^2
    home: Array  # (n,) rad, arm at home and hand open
    moved: Index  # columns of the joints that a grasp moves: but those of idle fingers, and those that follow others
    fingers: Index  # (g, 2) columns of the grasping fingers: first, and one past the last
    torque: Array  # (n - arm,) Nm, limits of the hand, with what follows it
    stiffness: Array  # (n - arm,) Nm/rad, of the hand's servos, with what follows them
    response: Array  # (n,) s that joints stay behind set-points which move evenly
    tip_radius: float  # m
    starts: Array  # (k, arm) rad, where inverse kinematics begins; first joints less the goal's direction

    @property
    def model(self) -> ContactModel:
        """Contact model of the fingertips."""
        return contact_model(self.torsion)

    def _replace(self, /, **changed: Any) -> Self:
        """Return a tree with other links; a NamedTuple's own would lose what plain code alone asks."""
        tree = super()._replace(**changed)
        vars(tree).update(vars(self))
        return tree


def rotation_matrix(quat: Array) -> Array:
    """Return the rotation (3, 3) of a quaternion wxyz, as the simulation computes it."""
    out = np.zeros(9)
    mujoco.mju_quat2Mat(out, quat)
    return out.reshape(3, 3)


@lru_cache(maxsize=8)
def robot_tree(cell: Cell) -> RobotTree:
    """Return the tree of a cell's robot where it stands; the same arrays at every call."""
    robot, model = cell.robot, compiled_robot(cell)
    if cell.table is not None:
        return _moved_tree(robot_tree(cell.seeing(None)), model, robot)
    bodies = [model.body(name).id for name in robot.bodies]
    index = {body: i for i, body in enumerate(bodies)}
    touching = tuple(finger.tip for finger in robot.grasping)
    columns = model.body_jntadr[bodies].tolist()  # joints are in the order of the robot's files
    follows, ratio = _following(robot)
    stands = ratio[:, 2] > 0.0
    slides = model.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE
    unit = np.where(slides, SLIDE, 1.0)
    palm = robot.hand.palm
    site, tips = model.site(palm).id, [model.site(tip).id for tip in touching]
    tree = RobotTree(
        parent=np.array([index.get(model.body_parentid[b], -1) for b in bodies]),
        offset=model.body_pos[bodies].copy(),
        rotation=np.stack([rotation_matrix(q) for q in model.body_quat[bodies]]),
        joint=np.array([follows[j] if j >= 0 and follows[j] >= 0 and not stands[j] else j for j in columns]),
        axis=np.array([model.jnt_axis[j] if j >= 0 else np.zeros(3) for j in columns]),
        slides=np.array([j >= 0 and slides[j] for j in columns]),
        gear=np.array(
            [[1.0, 0.0, float(j < 0)] if j < 0 or stands[j] else ratio[j, [0, 1, 0]] for j in columns]
        ),
        tip_body=np.array([index[model.site_bodyid[s]] for s in tips]),
        tip_offset=model.site_pos[tips].copy(),
        palm=index[model.site_bodyid[site]],
        palm_offset=model.site_pos[site].copy(),
        palm_rotation=rotation_matrix(model.site_quat[site]),
        palm_middle=_palm_middle(model, robot),
        pairs=np.array(body_pairs(robot, model)),
        torsion=robot.hand.torsion,
        follows=follows,
        ratio=ratio,
        lower=robot.lower.copy(),
        upper=robot.upper.copy(),
        arm=robot.arm_dof,
        base=robot.arm.plinth,
    )
    vars(tree).update(
        stands=stands,
        unit=unit,
        velocity=robot.velocity.copy(),
        acceleration=_followed(model, robot),
        home=robot.home.copy(),
        moved=_moved(robot),
        fingers=np.array([[own.start, own.stop] for own in (robot.columns[f.name] for f in robot.grasping)]),
        torque=driven(robot, np.minimum(robot.torque, STRONGEST / unit), 1)[robot.hand_columns],
        stiffness=driven(robot, robot.stiffness, 2)[robot.hand_columns],
        response=(model.dof_damping - model.actuator_biasprm[:, 2]) / model.actuator_gainprm[:, 0],
        tip_radius=robot.hand.tip_radius,
        starts=_starts(model, robot),
    )
    return tree


def _moved_tree(tree: RobotTree, model: mujoco.MjModel, robot: Robot) -> RobotTree:
    """Return a robot's tree with its base where another model of the same robot has it."""
    bodies = [model.body(name).id for name in robot.bodies]
    rotation = tree.rotation.copy()
    rotation[0] = rotation_matrix(model.body_quat[bodies[0]])
    moved = tree._replace(offset=model.body_pos[bodies], rotation=rotation)
    vars(moved).update(starts=_starts(model, robot))
    return moved


def _following(robot: Robot) -> tuple[Index, Array]:
    """Return `RobotTree.follows` and `ratio`."""
    C, c = robot.drive
    follows = np.where(np.diag(C) == 1.0, -1, np.argmax(np.abs(C), axis=1))
    ratio = np.stack([np.where(follows < 0, 1.0, C.sum(1)), c, ~C.any(1)], axis=1)
    for tendon in robot.hand.tendons:
        *stopped, last = map(robot.joints.index, tendon.joints)
        follows[stopped], ratio[stopped, 0] = last, tendon.coefs[:-1]
    return follows, ratio


def _starts(model: mujoco.MjModel, robot: Robot) -> Array:
    if robot.arm.starts:
        return np.array(robot.arm.starts)
    x, y, _ = posed(model, robot.home).body(robot.arm.bodies[-1]).xpos
    starts = np.tile(robot.arm.home, (5, 1))
    starts[:, 0] = round(float(robot.home[0] - np.arctan2(y, x)), 9) + 0.0
    starts[1:3, -1] += [_TWIST, -_TWIST]
    starts[3:, 0] += [_SWING, -_SWING]
    return starts


def _moved(robot: Robot) -> Index:
    moved = np.diag(robot.drive[0]) == 1.0
    for finger in robot.hand.fingers:
        if finger.name not in robot.hand.grasp:
            moved[robot.columns[finger.name]] = False
    return np.flatnonzero(moved)


def driven(robot: Robot, values: Array, power: int) -> Array:
    """Return torque limits (power 1) or stiffnesses (2) of joints (n,) with those of what follows them."""
    C = np.abs(robot.drive[0]) ** power
    return np.where(np.diag(C) == 1.0, values @ C, values)


def _followed(model: mujoco.MjModel, robot: Robot) -> Array:
    """Return the accelerations (n,) rad/s^2 of the limits, less where a finger's servo is too weak for its rotor."""
    followed, hand = robot.acceleration.copy(), robot.hand_columns
    rotors = np.maximum(model.dof_armature[hand], 1e-6)
    # share of a finger's torque that may speed up its rotor; the rest bears its links
    followed[hand] = np.minimum(followed[hand], 0.5 * robot.torque[hand] / rotors)
    return followed


def _palm_middle(model: mujoco.MjModel, robot: Robot) -> Array:
    """Return the middle (3,) m of the box around the palm's shapes, in its frame; the origin of one without."""
    corners = [
        corners_of(model, g) @ rotation_matrix(model.geom_quat[g]).T + model.geom_pos[g]
        for g in colliding(model, model.body(robot.hand.palm).id)
    ]
    return middle(np.concatenate(corners or [np.zeros((1, 3))]))


def body_pairs(robot: Robot, model: mujoco.MjModel) -> list[tuple[int, int]]:
    """Return the pairs of bodies, their numbers, that a motion can bring together: no neighbours in the chain."""
    number = robot.bodies.index
    pairs = [(number(a), number(b)) for a, b in robot.hand.self_pairs or meeting_pairs(robot, model)]
    if robot.hand.beside_palm:
        pairs.append((number(robot.hand.beside_palm), number(robot.hand.palm)))
    arm, hand = (list(map(number, part.bodies)) for part in (robot.arm, robot.hand))
    low, elbow, wrist = arm[:-3], arm[-3], arm[-2:]
    pairs += [(a, b) for a in low for b in hand]
    pairs += [(a, b) for a in low[:3] for b in wrist]
    return pairs + [(elbow, b) for b in [*hand, *low[:3]]]
