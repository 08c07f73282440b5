"""Grasps that are likely enough to hold, where that is asked for (`plan --at-least P`), or none."""

import numpy as np

from dexgrasp.grasp.content import planned_record
from dexgrasp.grasp.record import HoldsProbability
from dexgrasp.planning.many import plan_many
from dexgrasp.planning.planner import Planner
from dexgrasp.planning.result import Planned, PlanResult, Progress
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError

UNSURE = "not_sure_enough"
_MORE = 24  # grasps that differ, looked at where the first one is not likely enough


def sure_of(
    result: PlanResult, planner: Planner, start: Array | None, progress: Progress | None = None
) -> PlanResult:
    """Return a plan without the grasps that are less likely to be lifted and held than the planner's settings ask.

    Where one grasp was asked for and is not likely enough, the likeliest of others takes its place if that is.

    Args:
        result: of the planner, with a target.
        planner: that made it.
        start: (n,) rad, set-points the robot approaches from.
        progress: called with steps done and steps in all.

    Raises:
        InputError: where no probability is known: of another robot, among neighbours, on very slippery surfaces.
    """
    result.found = _likely(result, result.found)
    if (
        not result.found
        and result.asked is None
        and result.target is not None
        and UNSURE in result.log.blocked
    ):
        others = plan_many(planner, result.target, _MORE, result.seed, start, progress)
        result.found = _likely(result, others.found)[:1]
    if not result.success and UNSURE in result.log.blocked:
        result.shortfall = UNSURE
    return result


def _likely(result: PlanResult, found: list[Planned]) -> list[Planned]:
    """Return those that are likely enough, the likeliest first where one was asked for; note what the others lack."""
    least, chances = (
        result.settings.at_least,
        np.array([chances_of(one, result).lifted.value for one in found]),
    )
    for chance in chances[chances < least]:
        result.log.block(UNSURE, float(least - chance))
    order = np.argsort(-chances, kind="stable") if result.asked is None else np.arange(len(found))
    return [found[k] for k in order if chances[k] >= least]


def chances_of(planned: Planned, result: PlanResult) -> HoldsProbability:
    """Return how likely a grasp of a plan is to hold.

    Raises:
        InputError: where no model knows.
    """
    assert result.target is not None
    known = planned_record("", planned.grasp, result.target, result.settings).holds_probability
    if known is None:
        raise InputError(
            "at_least: how likely a grasp holds is known of the Panda with the Allegro hand alone, of objects without "
            "neighbours, on surfaces of friction 0.3 or more"
        )
    return known
