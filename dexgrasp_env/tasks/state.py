"""The state as it is observed: positions, velocities, readings of sensors, and what has been achieved."""

import numpy as np

from dexgrasp_env.arrays import Array, Arrays, Mask
from dexgrasp_env.tasks.records import FAILURES, PALM, TIP_FORCES, TIPS, Records, Rules
from dexgrasp_env.tasks.simulation import PhysicsState


def observe(
    records: Records,
    now: PhysicsState,
    targets: Array,
    noise: Array | None,
    rules: Rules,
    private: bool,
) -> Arrays:
    """Return observations of N episodes, arrays (N, ...) of float32 by key in alphabetical order.

    Args:
        records: (N,), brought up to date.
        now: their physics.
        targets: (N, n) set-points, rad.
        noise: (N, n) rad, of the joint position sensors; None for none.
        rules: of the environment.
        private: whether what no camera tells is among them.
    """
    failures = records["failure"]
    if np.count_nonzero(failures):  # quicker than any()
        now = _finite(now, failures == FAILURES.index("simulation_diverged"))
    n, tips = rules.joints, 3 * rules.fingers
    palm, tip, force = rules.at[PALM], rules.at[TIPS], rules.at[TIP_FORCES]
    qpos, qvel, sensors = (values.astype(np.float32) for values in now)
    joints = qpos[:, :n] if noise is None else (now.qpos[:, :n] + noise).astype(np.float32)
    tip_positions, targets = sensors[:, tip : tip + tips], targets.astype(np.float32)
    pose = sensors[:, palm : palm + 7]  # the quaternion's reading follows the position's
    if not private:
        return {
            "fingertip_positions": tip_positions, "joint_positions": joints, "joint_targets": targets,
            "joint_velocities": qvel[:, :n], "palm_pose": pose,
        }  # fmt: skip
    half_extents, progress, variation = (
        records[name].astype(np.float32) for name in ("half_extents", "progress", "variation")
    )
    return {
        "fingertip_forces": sensors[:, force : force + tips], "fingertip_positions": tip_positions,
        "joint_positions": joints, "joint_targets": targets, "joint_velocities": qvel[:, :n],
        "object_mass": records["mass"].astype(np.float32)[:, None], "object_pose": qpos[:, n : n + 7],
        "object_size": 2.0 * half_extents, "object_velocity": qvel[:, n : n + 6],
        "palm_pose": pose, "progress": progress, "variation": variation,
    }  # fmt: skip


def _finite(now: PhysicsState, diverged: Mask) -> PhysicsState:
    """Return the physics with zeros in place of what is no number of single precision, where it has diverged."""
    largest = np.finfo(np.float32).max
    return PhysicsState(*(np.where(diverged[:, None] & ~(np.abs(v) <= largest), 0.0, v) for v in now))
