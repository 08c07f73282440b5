"""The way from where the robot stands to the pregrasp: straight, else over a hover, else sampled; always the same."""

from collections.abc import Iterator

import numpy as np

from dexgrasp.mechanics.kinematics.palm_ik import palm_frame, shift_palm
from dexgrasp.motion.collision import CollisionChecker
from dexgrasp.motion.motion import NoPath, arm_and_hand
from dexgrasp_env.arrays import Array

_HOVERS = ((0.0, 0.15), (0.0, 0.10), (0.08, 0.08), (0.12, 0.0), (0.08, 0.0), (0.05, 0.12))
"""Where the last straight stretch may begin: m back along the palm's normal, and m up."""
TRIES = 3000
"""Growths of the trees; counted, not timed, so that a slow machine finds the same path."""
_SEED = 1


def plan_approach(checker: CollisionChecker, start: Array, pregrasp: Array, tries: int = TRIES) -> Array:
    """Return waypoints (m, n) rad from `start` to `pregrasp`, free by the checker; straight lines join them.

    Args:
        checker: of the scene; both ends are told to it (`CollisionChecker.allow`).
        start: (n,) rad.
        pregrasp: (n,) rad.
        tries: budget of the sampling planner.

    Raises:
        NoPath: with the bodies that are in the way.
    """
    for end in (start, pregrasp):
        checker.allow(end)
    contact = checker.first_contact(pregrasp[None])
    if contact is not None:
        raise NoPath("approach_blocked", f"at the pregrasp, {contact}")
    straight = np.stack([start, pregrasp])
    contact = checker.first_contact(straight)
    if contact is None:
        return straight
    descents = []
    for descent in _descents(checker, pregrasp):
        if checker.free(start, descent[0]):
            return np.vstack([start, descent])
        descents.append(descent)
    return _sampled(checker, start, pregrasp, descents, tries, str(contact))


def _descents(checker: CollisionChecker, pregrasp: Array) -> Iterator[Array]:
    """Yield free straight motions of the palm that end at the pregrasp, (m, n) each."""
    R, _ = palm_frame(pregrasp, checker.tree)
    for back, up in _HOVERS:
        shift = np.array([0.0, 0.0, up]) - back * R[:, 0]
        count = int(
            np.ceil(np.linalg.norm(shift) / 0.01)
        )  # m between points of a straight motion of the palm
        path, error = shift_palm(pregrasp, checker.tree, np.arange(1, count + 1)[:, None] / count * shift)
        descent = np.vstack([path[::-1], pregrasp])
        if error < 0.002 and checker.first_contact(descent) is None:  # m
            yield descent


def _sampled(
    checker: CollisionChecker, start: Array, pregrasp: Array, descents: list[Array], tries: int, contact: str
) -> Array:
    opened = arm_and_hand(start, pregrasp, checker.tree)
    checker.allow(opened)
    blocked = checker.first_contact(np.stack([start, opened]))
    if blocked is not None:
        raise NoPath("approach_blocked", f"while the fingers open, {blocked}")
    for descent in [*descents[:2], pregrasp[None]]:
        path = plan_arm(checker, opened, descent[0], tries)
        if path is not None:
            return np.vstack([start, path, descent[1:]])
    raise NoPath("approach_blocked", f"on the straight way {contact}, and no other was found")


def plan_arm(checker: CollisionChecker, start: Array, goal: Array, tries: int = TRIES) -> Array | None:
    """Find a path of the arm with RRT-Connect, fingers as in `goal`, and shorten it.

    Args:
        checker: of the scene.
        start: (n,) rad; its fingers are those of `goal`.
        goal: (n,) rad.
        tries: growths of the trees.

    Returns:
        Waypoints (m, n) rad, or None when the tries are used up.
    """
    path = _rrt_connect(checker, start, goal, tries)
    # The trees were grown at a coarser resolution than paths are checked with.
    return None if path is None or checker.first_contact(path) is not None else shorten(checker, path)


def _rrt_connect(checker: CollisionChecker, start: Array, goal: Array, tries: int) -> Array | None:
    """Return configurations (m, n) rad between which trees that grew together go straight."""
    from ompl import base, geometric, util

    util.setLogLevel(
        util.LOG_NONE
    )  # seeding again is meant: every object that draws numbers is made anew below
    util.RNG.setSeed(_SEED)
    dof, tree = checker.tree.arm, checker.tree

    def whole(state: base.State) -> Array:
        """Return the configuration (n,) rad of a state of the arm."""
        return np.concatenate([[state[j] for j in range(dof)], goal[dof:]])

    space, bounds = base.RealVectorStateSpace(dof), base.RealVectorBounds(dof)
    for j in range(dof):
        bounds.setLow(j, float(tree.lower[j]))
        bounds.setHigh(j, float(tree.upper[j]))
    space.setBounds(bounds)
    setup = geometric.SimpleSetup(space)
    setup.setStateValidityChecker(lambda state: checker.free(whole(state)))
    ends = [space.allocState(), space.allocState()]
    for state, q in zip(ends, (start, goal), strict=True):
        for j in range(dof):
            state[j] = float(q[j])
    setup.setStartAndGoalStates(*ends)
    information = setup.getSpaceInformation()
    information.setStateValidityCheckingResolution(0.002)  # of the space's extent: about 0.03 rad
    planner = geometric.RRTConnect(information)
    planner.setRange(0.6)  # rad: longest branch of the trees
    setup.setPlanner(planner)
    left = iter(range(tries))
    setup.solve(base.PlannerTerminationCondition(lambda: next(left, None) is None))
    if not setup.haveExactSolutionPath():
        return None
    return np.array([whole(state) for state in setup.getSolutionPath().getStates()])


def shorten(checker: CollisionChecker, path: Array) -> Array:
    """Cut corners of a free polyline (m, n) where the straight line between two of its points is free."""
    rng = np.random.default_rng(_SEED)
    for _ in range(120):
        if len(path) < 3:
            break
        length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
        at = np.sort(rng.random(2)) * length[-1]
        i, j = np.minimum(np.searchsorted(length, at, side="right") - 1, len(path) - 2)
        if i == j:
            continue
        a, b = _on_leg(path, length, i, at[0]), _on_leg(path, length, j, at[1])
        if checker.free(a, b):
            path = np.vstack([path[: i + 1], a, b, path[j + 1 :]])
    return path


def _on_leg(path: Array, length: Array, leg: int, at: float) -> Array:
    share = (at - length[leg]) / (length[leg + 1] - length[leg])
    return path[leg] + share * (path[leg + 1] - path[leg])
