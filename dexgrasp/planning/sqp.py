"""The bilevel optimisation, by sequential quadratic programming (SQP) with a trust region.

min |dq|^2 in the metric of how far the fingertips slide over the surface, subject to the linearised constraints of
`constraints`, softened so that every subproblem has a solution: contacts stay where the squeeze was judged, the rest of
hand and arm moves freely. A step is kept if it lowers the sum of violations. The lower problem enters through its value
and its gradient (envelope theorem). It ends with a feasible configuration, or with the
constraint that blocks and by how much.
"""

from dataclasses import dataclass

import daqp
import numpy as np

from dexgrasp.mechanics.kinematics.clearance import KINDS
from dexgrasp.mechanics.kinematics.forward import follow
from dexgrasp.planning.asked_rows import ASKED_KINDS, with_request
from dexgrasp.planning.constraints import MARGIN_SCALE, Bounds, Evaluation, evaluate, fixed_rows
from dexgrasp.planning.settings import GraspProblem
from dexgrasp_env.arrays import Array, Index
from dexgrasp_env.robot.robot import Robot

# A step costs (fingertips' slide / 0.5 m)^2 + 0.001 (joints' turn / 1 rad)^2.
_SLIDE, _TURN = 0.5, 1e-3
_TRUST, _LEAST_TRUST, _MOST_TRUST = 0.10, 2e-3, 0.25  # rad
TOLERANCE = 1e-6  # m: a constraint violated by less is met


@dataclass(frozen=True)
class Solution:
    """Outcome of the optimiser.

    Attributes:
        q: (n,) rad.
        evaluation: constraints there.
        blocking: the worst constraint, None if all hold.
        violation: by how much, m (cosines and margins in their own unit).
    """

    q: Array
    evaluation: Evaluation
    blocking: str | None
    violation: float

    @property
    def feasible(self) -> bool:
        """True where all constraints hold."""
        return self.blocking is None


def bounds_of(problem: GraspProblem, margin: float, slack: float = 0.0) -> Bounds:
    """Return the thresholds, tightened by `slack` m so that rounding elsewhere cannot break them."""
    settings = problem.settings
    return Bounds(
        settings.tip_radius + settings.distance[0] + slack,
        settings.tip_radius + settings.distance[1] - slack,
        margin,
        settings.tip_cosine,
        settings.pad_cosine,
        settings.clearance + slack,
        settings.off_table(problem.target.top) + slack,
        settings.friction,
    )


def solve(q: Array, problem: GraspProblem, *, with_margin: bool = True) -> Solution:
    """Make a configuration feasible.

    Args:
        q: (n,) rad, start.
        problem: object and robot; of the settings thresholds and the budget of iterations.
        with_margin: whether force closure is asked for.
    """
    return _Solver(problem, with_margin).run(np.array(q, dtype=float))


class _Solver:
    def __init__(self, problem: GraspProblem, with_margin: bool) -> None:
        tree, settings = problem.tree, problem.settings
        self._problem, self._moved = problem, tree.moved
        self._block, self._turn = np.ix_(tree.moved, tree.moved), _TURN * np.eye(len(tree.moved))
        self._obstacle, self._world = problem.target.distance.obstacle, problem.world
        self._tree, self._budget = tree, settings.iterations
        self._with_margin, self._shape, self._unit = with_margin, problem.shape, tree.unit[tree.moved]
        self._low = tree.lower[tree.moved] + settings.joint_margin * self._unit
        self._high = tree.upper[tree.moved] - settings.joint_margin * self._unit
        self._narrowed = with_margin and problem.target.narrowed
        self._goals = [
            bounds_of(problem, margin, slack=1e-4)
            for margin in (settings.closure_aim, settings.closure_margin + 0.02)
        ]
        self._least = bounds_of(problem, settings.closure_margin)

    def evaluate(self, q: Array, bounds: Bounds) -> Evaluation:
        """Return constraints and their gradients at `q` (n,) rad."""
        now = evaluate(q, self._tree, self._obstacle, self._world, bounds, self._shape, self._with_margin)
        return with_request(now, q, self._problem) if self._narrowed else now

    def run(self, q: Array) -> Solution:
        """Work towards the margin aimed at; where that is too much, towards the least one."""
        q[self._moved] = np.clip(q[self._moved], self._low, self._high)
        steps = 0
        for goal in self._goals:
            q, now, used = self._descend(q, goal, self._budget - steps)
            steps += used
            follow(q, self._tree)
            solution = self._solution(q, now, goal)
            if solution.feasible or not self._with_margin:
                break
        return solution

    def _descend(self, q: Array, goal: Bounds, budget: int) -> tuple[Array, Evaluation, int]:
        now, trust, steps = self.evaluate(q, goal), _TRUST, 0
        merit = _total_violation(now.values)
        while steps < budget and merit > TOLERANCE and trust > _LEAST_TRUST:
            steps += 1
            trial = q.copy()
            trial[self._moved] = np.clip(q[self._moved] + self._step(q, now, trust), self._low, self._high)
            evaluation = self.evaluate(trial, goal)
            reached = _total_violation(evaluation.values)
            if reached < merit - 1e-9:
                trust = min(2.0 * trust, _MOST_TRUST) if reached < 0.5 * merit else trust
                q, now, merit = trial, evaluation, reached
            else:
                trust *= 0.4
        return q, now, steps

    def _step(self, q: Array, now: Evaluation, trust: float) -> Array:
        A = np.ascontiguousarray(now.rows[:, self._moved])
        lower = np.maximum(self._low - q[self._moved], -trust * self._unit)
        upper = np.minimum(self._high - q[self._moved], trust * self._unit)
        n, m = len(self._moved), len(now.values)
        H = now.metric[self._block] / _SLIDE**2 + self._turn
        sense = np.zeros(n + m, dtype=np.int32)
        sense[n:] = 8  # daqp's mark of a soft constraint
        # Violations weigh so much more than a step that a feasible one is found if there is one.
        x, _, flag, _ = daqp.solve(
            H, np.zeros(n), A, np.concatenate([upper, np.full(m, 1e30)]),
            np.concatenate([lower, -now.values]), sense, rho_soft=1e-7, iter_limit=500,
        )  # fmt: skip
        if not np.isfinite(x).all():
            return np.zeros(n)
        return x if flag > 0 else np.clip(x, lower, upper) * 0.5

    def _solution(self, q: Array, now: Evaluation, goal: Bounds) -> Solution:
        """Judge by the least that is accepted, not by what was aimed at."""
        least, values, g = self._least, now.values.copy(), self._shape.contacts
        closure, *_, fixed = fixed_rows(g)
        values[:g] += goal.low - least.low
        values[g:closure] += least.high - goal.high
        if self._with_margin:
            values[closure] += MARGIN_SCALE * (goal.margin - least.margin)
        values[fixed:][now.labels[fixed:, 0] < len(KINDS)] += goal.clearance - least.clearance
        worst = np.argmin(values)
        violation = max(0.0, -float(values[worst]))
        feasible = violation <= TOLERANCE and bool(np.isfinite(values).all())
        blocking = None if feasible else _name(now.labels[worst], self._problem.cell.robot)
        return Solution(q, now._replace(values=values), blocking, violation)


def _total_violation(values: Array) -> float:
    return -np.minimum(values, 0.0).sum()


_TIP_ROWS = ("distance_min", "distance_max", "fingertip_axis", "fingertip_pad")
"""Names of the fixed rows beside closure's, of each one a finger."""


def _name(label: Index, robot: Robot) -> str:
    """Name a constraint in words that can be counted."""
    kind, a, b = label.tolist()
    row, g = -1 - kind, len(robot.hand.grasp)
    if row == 2 * g:
        return "closure_margin"
    if row >= 0:
        row -= row > 2 * g
        return f"{_TIP_ROWS[row // g]}:{robot.hand.grasp[row % g]}"
    if kind >= len(KINDS):
        return f"{ASKED_KINDS[kind - len(KINDS)]}:{robot.bodies[a]}"
    other = f":{robot.bodies[b]}" if b >= 0 else ""
    return f"clearance_{KINDS[kind]}:{robot.bodies[a]}{other}"
