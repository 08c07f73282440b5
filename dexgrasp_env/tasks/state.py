"""The state as it is observed: positions, velocities, readings of sensors, and what has been achieved."""

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array, Arrays
from dexgrasp_env.tasks.records import FAILURES
from dexgrasp_env.tasks.rules import PALM, TIP_FORCES, TIPS, Rules
from dexgrasp_env.tasks.simulation import PhysicsState


def observe(
    records: NDArray[np.void],
    now: PhysicsState,
    targets: Array,
    noise: Array | float,
    rules: Rules,
    private: bool,
) -> Arrays:
    """Return observations of N episodes, arrays (N, ...) of float32 by key in alphabetical order.

    Args:
        records: (N,), brought up to date.
        now: their physics.
        targets: (N, n) set-points, rad.
        noise: (N, n) rad, of the joint position sensors; 0 for none.
        rules: of the environment.
        private: whether what no camera tells is among them.
    """
    qpos, qvel, sensors = now
    n, tips = rules.joints, 3 * rules.fingers
    palm, tip, force = (rules.at[reading] for reading in (PALM, TIPS, TIP_FORCES))
    seen = {
        "fingertip_positions": sensors[:, tip : tip + tips],
        "joint_positions": qpos[:, :n] + noise,
        "joint_targets": targets,
        "joint_velocities": qvel[:, :n],
        "palm_pose": sensors[:, palm : palm + 7],  # the quaternion's reading follows the position's
    }
    if private:
        progress = np.column_stack([records["height"], np.minimum(records["held"] / rules.hold, 1.0)])
        own = {
            "fingertip_forces": sensors[:, force : force + tips],
            "object_mass": records["mass"][:, None],
            "object_pose": qpos[:, n : n + 7],
            "object_size": 2.0 * records["half_extents"],
            "object_velocity": qvel[:, n : n + 6],
            "progress": progress,
            "variation": records["variation"],
        }
        seen = dict(sorted((seen | own).items()))
    with np.errstate(over="ignore", invalid="ignore"):
        rows = {key: values.astype(np.float32) for key, values in seen.items()}
    diverged = records["failure"] == FAILURES.index("simulation_diverged")
    if diverged.any():
        for values in rows.values():
            values[diverged] = np.nan_to_num(values[diverged], nan=0.0, posinf=0.0, neginf=0.0)
    return rows
