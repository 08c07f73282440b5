"""Metrics that DexGraspBench reports beside success: contact of the hand with the object, and penetration."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from dexgrasp.evaluation.scoring.hand import Candidate
from dexgrasp.evaluation.scoring.scene import FloatingScene, Physics
from dexgrasp.grasp.variety import component_shares
from dexgrasp_env.arrays import Array


def contact_metrics(candidate: Candidate) -> dict[str, float]:
    """Return metrics of the grasp stage, against the convex parts that the simulator collides.

    Returns:
        `penetration_m` and `self_penetration_m`, the deepest; `contact_number`, links of the hand within 2 mm;
        `contact_distance_m`, the mean over fingers of their distance (0 inside, at most 10 mm); and
        `contact_consistency_m`, the largest difference of the fingers' signed distances.
    """
    scene = FloatingScene(candidate, Physics(), 0.1)
    model, data = scene.model, scene.data
    of_object = model.geom_bodyid == scene.object_body
    margin = 0.010  # m: further apart than this is this far
    model.geom_margin[of_object] = model.geom_gap[of_object] = margin
    scene.reset(candidate.grasp)
    fingers = _fingers(scene)
    distances = dict.fromkeys(set(fingers.values()), margin)
    touching, deepest = set(), 0.0
    for body, distance, _ in scene.hand_contacts():
        deepest = max(deepest, -distance)
        if abs(distance) < 0.002:  # m: a link this near touches
            touching.add(body)
        if body in fingers:
            distances[fingers[body]] = min(distances[fingers[body]], distance)
    found = np.array(list(distances.values()) or [margin])
    own = np.isin(model.geom_bodyid[data.contact.geom], scene.hand_bodies).all(axis=1)
    return {
        "penetration_m": deepest,
        "self_penetration_m": float(np.max(-data.contact.dist[own], initial=0.0)),
        "contact_number": float(len(touching)),
        "contact_distance_m": float(np.maximum(found, 0.0).mean()),
        "contact_consistency_m": float(np.ptp(found)),
    }


def diversity(candidates: Sequence[Candidate]) -> list[float]:
    """Return the share of variance that the first 1 to 5 principal components explain; lower is more varied.

    Features: hand's position in the object frame, m, its rotation vector, rad, joints; as DexGraspBench, unscaled.
    Empty for fewer than three grasps, or hands of different joints.
    """
    if len(candidates) < 3 or len({c.hand.joint_names for c in candidates}) > 1:
        return []
    return component_shares(np.array([_features(c) for c in candidates]))


def _features(candidate: Candidate) -> Array:
    T = np.linalg.inv(candidate.T_world_object) @ candidate.grasp.T_world_hand
    return np.concatenate([T[:3, 3], Rotation.from_matrix(T[:3, :3]).as_rotvec(), candidate.grasp.joints])


def _fingers(scene: FloatingScene) -> dict[int, int]:
    """Return body -> the first body of its finger: the branches of the first body that has several."""
    parents = scene.model.body_parentid
    branches = np.bincount(parents[scene.hand_bodies])
    palm = next((body for body in scene.hand_bodies[:-1] if branches[body] > 1), -1)
    found: dict[int, int] = {}
    for body in scene.hand_bodies:  # parents come first
        if parents[body] == palm or parents[body] in found:
            found[body] = found.get(int(parents[body]), body)
    return found
