"""All four fingers of the Allegro in one grasp: its file names them, and nothing else changes."""

from refusals import rejected
from robots import variant

from dexgrasp.grasp.planned_record import Origin, planned_record
from dexgrasp.planning.cvae_source import make_source
from dexgrasp.planning.planner import Planner, small_box
from dexgrasp_env.robot.cell import make_cell

FINGERS = ["thumb", "index", "middle", "ring"]


def test_four_fingers_take_hold_and_the_judge_agrees(tmp_path):
    cell = make_cell(variant(tmp_path, hand={"grasp": FINGERS}))
    planner = Planner(cell=cell, source=make_source("auto", cell.robot))
    result = planner.plan(small_box(), 0, cell.robot.home.copy())
    assert result.success, result.reason
    (planned,) = result.found
    how = {"script": planned.script, "origin": Origin("bilevel")}
    record = planned_record("box", planned.grasp, small_box(), planner.settings, **how)
    assert record.fingers == tuple(FINGERS)
    assert rejected(record) == []
    assert planned.grasp.certificate.load > 1.0
