"""Names of the robot's parts in the model, in the order every array follows."""

ARM_JOINTS: tuple[str, ...] = tuple(f"panda_joint{i}" for i in range(1, 8))
"""The seven joints of the arm, base to flange."""

FINGERS: tuple[str, ...] = ("index", "middle", "ring", "thumb")
"""The fingers in the order of the hand's joints."""

GRASP_FINGERS: tuple[str, ...] = ("thumb", "index", "middle")
"""The fingers that grasp, in the order of a grasp's three contacts."""

FINGER_COLUMNS: dict[str, slice] = {finger: slice(7 + 4 * i, 11 + 4 * i) for i, finger in enumerate(FINGERS)}
"""Where a finger's joints are in a 23-vector."""

FINGER_LINKS: tuple[str, ...] = ("base", "proximal", "medial", "distal")
"""The links of one finger, palm to tip; body `<finger>_<link>`."""

HAND_JOINTS: tuple[str, ...] = tuple(f"{finger}_{i}" for finger in FINGERS for i in range(4))
"""The sixteen joints of the hand."""

JOINTS: tuple[str, ...] = ARM_JOINTS + HAND_JOINTS
"""All 23 joints: the order of every 23-vector. Actuators have the same names."""

ARM_BODIES: tuple[str, ...] = tuple(f"panda_link{i}" for i in range(8))
"""The bodies of the arm; `panda_link0` is fixed to the world."""

HAND_BODIES: tuple[str, ...] = ("palm", *(f"{finger}_{link}" for finger in FINGERS for link in FINGER_LINKS))
"""The bodies of the hand."""

BODIES: tuple[str, ...] = ARM_BODIES + HAND_BODIES
"""All bodies of the robot."""

MOUNT_NAMES: tuple[str, ...] = ("palm_normal", "fingers_along")
"""How the hand may sit on the flange; where, the cell says."""

FLANGE_SITE = "flange"
"""The arm's flange, z out of it."""

PALM_SITE = "palm"
"""The palm frame: z towards the fingers, +x out of the palm's face, +y towards the index finger."""

TIP_SITES: tuple[str, ...] = tuple(f"{finger}_tip" for finger in FINGERS)
"""Centres of the tip spheres, in the order of `FINGERS`."""

TIP_GEOMS: tuple[str, ...] = TIP_SITES
"""The tips' collision geoms bear their sites' names, in the order of `FINGERS`."""
