"""Weight that a hand can lift, whatever the object's shape: what the torques of its joints bear."""

import numpy as np

from dexgrasp.mechanics.contacts import Contacts
from dexgrasp.mechanics.internal_force import firmest_squeeze
from dexgrasp.mechanics.kinematics.forward import body_frames, fingertips, hand_contact_jacobian
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp.planning.atlas import hand_atlas
from dexgrasp.planning.settings import PlannerSettings
from dexgrasp_env.arrays import unit
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.scene.constants import GRAVITY


def payload(cell: Cell) -> float:
    """Return the mass, kg, that half of the hand's postures lift with the palm down.

    Each tip of a grasp presses towards the middle of all, with the planner's friction and share of the torques.
    """
    tree, atlas, settings, found = robot_tree(cell), hand_atlas(cell), PlannerSettings(), []
    q, heavy = tree.home.copy(), 50.0  # kg that no hand lifts
    for k in np.linspace(0, len(atlas.joints) - 1, 200).astype(int):
        q[tree.arm :] = atlas.joints[k]
        tips, palm = fingertips(q, tree), body_frames(q, tree).R[tree.palm] @ tree.palm_rotation
        out = unit(tips - tips.mean(0))
        points = tips - tree.tip_radius * out
        contacts = Contacts(
            points, out, hand_contact_jacobian(q, points, out, tree), settings.torque_share * tree.torque,
            np.full(len(tips), settings.friction_squeeze), tips.mean(0), heavy * GRAVITY * palm[:, 0], tree.model,
        )  # fmt: skip
        found.append(heavy * firmest_squeeze(contacts).share)
    return float(np.median(found))
