"""Ways that `verify` would refuse are refused when they are planned."""

from itertools import product

import numpy as np
import pytest
from robots import CELL, HOME

from dexgrasp.geometry.target import GraspTarget
from dexgrasp.grasp.trajectory import ActionScript
from dexgrasp.motion.motion import NoPath
from dexgrasp.motion.script import check_way

TARGET = GraspTarget.of_corners([np.array(list(product((0.50, 0.55), (0.30, 0.35), (0.0, 0.05))))])


def script(targets):
    pieces = np.split(np.asarray(targets), [20, 22, 24, 34])
    return ActionScript(
        dict(zip(("approach", "close", "squeeze", "lift", "hold"), pieces, strict=True)), HOME.copy()
    )


@pytest.fixture
def still():
    return script(np.repeat(HOME[None], 40, axis=0))


def test_a_set_point_that_stands_out_is_refused(still):
    targets = still.targets.copy()
    targets[9, 3] += 0.01
    with pytest.raises(NoPath, match="approach_bends"):
        check_way(script(targets), CELL, TARGET)


def test_a_hand_that_meets_itself_on_the_way_up_is_refused(still):
    targets = still.targets.copy()
    targets[24:34, 7:] = np.tile([0.0, 1.6, 1.6, 1.5], 4)  # a fist
    targets[24:34, 19:] = [1.35, 1.1, 1.6, 1.6]
    with pytest.raises(NoPath, match="lift_blocked"):
        check_way(script(targets), CELL, TARGET)
