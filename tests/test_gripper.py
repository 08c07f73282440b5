"""A parallel gripper: slides, one following the other, two soft contacts; planned, simulated, pushed, verified."""

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose
from refusals import refused, rejected
from robots import variant
from tables import mistakes

from dexgrasp.evaluation.evaluate import evaluate
from dexgrasp.evaluation.settings import EvaluationSettings
from dexgrasp.evaluation.store import read_rows
from dexgrasp.export.grasp_export import grasp_facts
from dexgrasp.grasp.file import read_grasp
from dexgrasp.grasp.verify.scene import Scene
from dexgrasp.mechanics.kinematics.forward import fingertips, hand_contact_jacobian
from dexgrasp.mechanics.kinematics.robot_check import check_robot
from dexgrasp.mechanics.kinematics.tree import robot_tree
from dexgrasp_env.objects.load import load_object
from dexgrasp_env.robot.cell import make_cell
from dexgrasp_env.robot.robot_file import read_robot
from dexgrasp_env.scene.build import build_scene
from dexgrasp_env.tasks.randomisation import Variation, apply_variation

CELL = make_cell("panda_gripper")
TREE = robot_tree(CELL)


def test_jacobians_are_those_of_what_drives():
    """Both jaws move with the first slide, which has the torque and the stiffness of both."""
    assert [finding for finding in check_robot(CELL) if finding.level != "info"] == []
    q, normals = CELL.robot.home.copy(), np.array([[0.6, 0.8, 0.0], [0.0, -1.0, 0.0]])
    tips = fingertips(q, TREE)
    ours = hand_contact_jacobian(q, tips, normals, TREE)
    scene = Scene(CELL, [], ("left", "right"))
    scene.place(q)
    assert_allclose(ours, scene.jacobians(tips, normals), atol=1e-12)
    gap = [
        np.linalg.norm(np.diff(fingertips(q - [0, 0, 0, 0, 0, 0, 0, by, by], TREE), axis=0))
        for by in (0.0, 0.01)
    ]
    assert gap[0] - gap[1] == pytest.approx(0.02)
    assert np.array_equal(ours[:, :, 1], np.zeros((2, 4)))
    assert (TREE.torque[0], TREE.stiffness[0]) == (120.0, 12000.0)


def test_soft_tips_turn_against_friction():
    """Their pairs have condim 4, with torsional friction that follows the sliding one."""
    base = build_scene(load_object("sugar_box"), CELL)
    model = build_scene(load_object("sugar_box"), CELL)
    apply_variation(model, base, Variation(friction=0.35), mujoco.MjData(model))
    for built, friction in ((base, 0.7), (model, 0.35)):
        tips = [k for k in range(built.npair) if "tip" in built.pair(k).name]
        assert len(tips) == 2
        assert set(built.pair_dim[tips]) == {4}
        assert_allclose(built.pair_friction[tips, :3], [[friction, friction, 0.008 * friction]] * 2)
    coupling = base.equality("right_slide")
    assert base.eq_type[coupling.id] == mujoco.mjtEq.mjEQ_JOINT


def test_it_lifts_what_is_pushed_and_the_judge_agrees(tmp_path):
    settings = EvaluationSettings.of(
        ["bilevel"], ["glasses_case"], trials=1, seed=1000, robot="panda_gripper", protocols=["pushed@1"]
    )
    evaluate(settings, tmp_path)
    (row,) = read_rows(tmp_path)
    assert row["success"], row["reason"]
    record = read_grasp(tmp_path / row["grasp"], CELL)
    assert rejected(record) == []
    assert record.forces.shape == (2, 4)
    squeeze = grasp_facts(record, CELL, 6000.0)["squeeze"]
    assert squeeze["offset"] == pytest.approx((record.squeeze - record.grasp)[7:], abs=1e-6)
    apart = record.grasp.copy()
    apart[-1] += 0.002
    object.__setattr__(record, "grasp", apart)
    failed = rejected(record)
    assert "coupled joints as stated" in failed


@pytest.mark.parametrize(("change", "words"), mistakes("grippers"))
def test_what_no_gripper_is_ends_in_a_line(change, words, tmp_path):
    with refused(words):
        read_robot(variant(tmp_path, "panda_gripper", hand=change))
