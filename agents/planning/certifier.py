"""A feasible configuration made a grasp: forces that hold, an opening to close from, and the certificate."""

import numpy as np

from agents.grasp.certificate import Certificate
from agents.grasp.grasp import Grasp, GraspMotion
from agents.grasp.target import GraspTarget
from agents.kinematics.clearance import clearance_rows, empty_rows
from agents.kinematics.forward import body_frames, finger_jacobians
from agents.kinematics.tree import RobotTree
from agents.physics.forces import HoldingForces, holding_forces
from agents.physics.ratios import wrench_ratios
from agents.physics.wrench import solve_wrench_qp
from agents.planning.plan import Plan
from agents.planning.setpoints import grasp_motion, openings
from agents.planning.settings import PlannerSettings
from agents.planning.sqp import Solution
from dexgrasp_env.arrays import Array

_TORQUE_LIMIT = 0.7  # Nm
_OPEN_CLEARANCE = 0.004  # m between the open hand and the object, table and itself


class Certifier:
    """Certifies configurations of one robot."""

    def __init__(self, tree: RobotTree, settings: PlannerSettings, mount: str, with_closure: bool) -> None:
        """Prepare; without closure, forces that fail to hold are reported in the certificate, not refused."""
        self.tree, self.settings, self.mount = tree, settings, mount
        self._with_closure = with_closure

    def certify(self, solution: Solution, target: GraspTarget, plan: Plan) -> Grasp | None:
        """Return the grasp of a feasible configuration, or None and note in `plan` what it lacks."""
        settings, at = self.settings, solution.evaluation
        hold, mass, load = self._hold(solution, target)
        if not hold.holds and self._with_closure:
            plan.block(f"holding_forces: {hold.reason}", hold.residual)
            return None
        motion = self._open(solution.q, at.normals, hold.forces, target)
        if motion is None:
            plan.block("pregrasp_clearance")
            return None
        internal = solve_wrench_qp(at.contacts, at.normals, settings.friction)
        ratios = wrench_ratios(at.contacts, internal.forces, target.centre)
        certificate = Certificate(
            distances_cm=tuple(float(d) for d in 100.0 * (at.distances - settings.tip_radius)),  # type: ignore[arg-type]
            force_ratio_percent=ratios.force,
            torque_ratio_percent=ratios.torque,
            closure_residual=float(internal.residual),
            closure_margin=float(at.margin),
            min_clearance_m=self._clearance(solution.q, target, tips_touch=True),
            joint_limit_margin_rad=float(
                np.minimum(solution.q - self.tree.lower, self.tree.upper - solution.q).min()
            ),
            max_joint_torque_fraction=float(settings.torque_share * hold.max_torque_fraction),
            holds=bool(hold.holds),
            hold_residual=float(hold.residual),
            mass=mass,
            load=load,
            friction=settings.friction,
        )
        return Grasp(solution.q, at.contacts, at.normals, hold.forces, certificate, motion, self.mount)

    def _hold(self, solution: Solution, target: GraspTarget) -> tuple[HoldingForces, float, float]:
        """Return the firmest squeeze of `settings.loads` that the joints can hold, and mass and load it is made for."""
        settings, at = self.settings, solution.evaluation
        J = finger_jacobians(solution.q, self.tree)
        for share, disturbance in settings.loads:
            mass = share * target.mass
            hold = holding_forces(
                at.contacts, at.normals, settings.friction_hold, mass, target.centre, jacobians=J,
                torque_limits=settings.torque_share * _TORQUE_LIMIT, f_min=settings.least_press, safety=1.0,
                disturbance=disturbance, explain=(share, disturbance) == settings.loads[-1],
            )  # fmt: skip
            if hold.holds:
                break
        return hold, mass, share * (1.0 + disturbance)

    def _open(self, q: Array, normals: Array, forces: Array, target: GraspTarget) -> GraspMotion | None:
        for opening in openings():
            motion = grasp_motion(q, normals, forces, target, self.tree, self.settings, opening)
            clear = self._clearance(motion.pregrasp, target, tips_touch=False)
            if clear > min(_OPEN_CLEARANCE, 0.5 * opening):
                return motion
        return None

    def _clearance(self, q: Array, target: GraspTarget, tips_touch: bool) -> float:
        frames, rows = body_frames(q, self.tree), empty_rows(160)
        n = clearance_rows(self.tree, frames, target.distance.obstacle, 0.02, tips_touch, rows)
        return float(rows.values[:n].min()) if n else 0.02
