"""The viewer's film and page."""

from dataclasses import fields

import numpy as np
import pytest
from robots import CELL, HOME

from dexgrasp.geometry.target import GraspTarget
from dexgrasp.grasp.certificate import Certificate
from dexgrasp.grasp.grasp import Grasp, GraspMotion
from dexgrasp.grasp.planned_record import Origin, planned_record
from dexgrasp.planning.settings import PlannerSettings
from dexgrasp.viewer.film import GraspPlayback, carried, palm_poses
from dexgrasp_env.objects.load import load_object


@pytest.fixture(scope="module")
def film():
    states = np.tile(HOME, (6, 1))
    states[3:, 1] -= 0.1
    shape = load_object("gelatin_box")
    T = np.eye(4)
    T[:3, 3] = 0.5, 0.0, 0.02
    mesh = shape.mesh.copy().apply_transform(T)
    contacts = np.array([[0.5, -0.04, 0.02], [0.48, 0.04, 0.02], [0.52, 0.04, 0.02]])
    normals = np.array([[0.0, -1, 0], [0, 1, 0], [0, 1, 0]])
    claims = dict.fromkeys((f.name for f in fields(Certificate)), 0.0) | {
        "distances_cm": (0.0,) * 3,
        "load": 1.5,
    }
    grasp = Grasp(
        HOME, contacts, normals, -4.0 * normals, Certificate(**claims), GraspMotion(HOME, HOME, HOME), CELL
    )
    record = planned_record(
        "gelatin", grasp, GraspTarget.of(mesh), PlannerSettings(), origin=Origin("a.b:<Firm>")
    )
    return GraspPlayback(record, states, carried(states, 2, T, CELL), shape, mesh.vertices)


def test_the_object_rests_until_it_is_lifted_and_then_follows_the_palm(film):
    assert np.array_equal(film.object_poses[1], film.object_poses[0])
    palms = palm_poses(film.states, CELL)
    in_palm = np.linalg.inv(palms) @ film.object_poses
    assert np.abs(in_palm[5] - in_palm[2]).max() < 1e-12
    assert np.abs(film.object_poses[5] - film.object_poses[0]).max() > 0.01


def test_the_page_is_whole_and_fetches_nothing(film):
    pytest.importorskip("viser")
    from dexgrasp.viewer.page import page

    text = page([film, film])
    assert text.count("a.b:&lt;Firm&gt;") == text.count("1.50") == 2
    assert "__VISER_EMBED_DATA__" in text
    assert text.rstrip().endswith("</html>")
    assert 'src="http' not in text
    assert 'href="http' not in text
