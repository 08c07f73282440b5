"""Properties that hold for every input: poses, cones, distances, parsers."""

import json

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.testing import assert_allclose, assert_array_equal
from refusals import refused
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation

from dexgrasp.grasp.file import record_of
from dexgrasp.mechanics.contacts import shape_of
from dexgrasp.mechanics.margin import cone_margin
from dexgrasp_env.perception.cloud import remove_outliers
from dexgrasp_env.perception.kernels import has_near
from dexgrasp_env.perception.neighbourhoods import linked
from dexgrasp_env.perception.scan import cloud_of
from dexgrasp_env.poses import quat_conjugate, quat_multiply, quat_to_matrix, rotate

COORDINATES = st.floats(-1.0, 1.0, width=32)


def vectors(*shape):
    return hnp.arrays(np.float64, (*shape, 3), elements=COORDINATES)


@st.composite
def directions(draw, *shape):
    v = draw(vectors(*shape))
    size = np.linalg.norm(v, axis=-1, keepdims=True)
    assume((size > 0.1).all())
    return v / size


@st.composite
def quaternions(draw):
    q = draw(hnp.arrays(np.float64, (4,), elements=COORDINATES))
    assume(np.linalg.norm(q) > 0.1)
    return q / np.linalg.norm(q)


@given(quaternions(), quaternions(), vectors())
def test_quaternions_are_scipy_rotations(p, q, v):
    first, second = Rotation.from_quat(p[[1, 2, 3, 0]]), Rotation.from_quat(q[[1, 2, 3, 0]])
    assert_allclose(rotate(p, v), first.apply(v), atol=1e-12)
    assert_allclose(quat_to_matrix(quat_multiply(p, q)), (first * second).as_matrix(), atol=1e-12)
    assert_allclose(rotate(quat_conjugate(p), rotate(p, v)), v, atol=1e-12)


@given(directions(3), vectors(3), quaternions(), st.permutations(range(3)), st.floats(0.2, 5.0))
def test_the_margin_knows_no_frame_order_or_scale(n, p, q, order, scale):
    area = np.linalg.norm(np.cross(p[1] - p[0], p[2] - p[0]))
    assume(area > 0.05)
    value = cone_margin(p, n, 0.5, shape_of(3))[0]
    order = list(order)
    moved = cone_margin(scale * rotate(q, p)[order] + 0.3, rotate(q, n)[order], 0.5, shape_of(3))[0]
    assert moved == pytest.approx(value, rel=1e-5, abs=1e-5)
    assert value <= 1.0 + 1e-9


@given(hnp.arrays(np.float64, (40, 3), elements=st.floats(0.0, 0.1)), st.floats(0.005, 0.05))
def test_neighbours_and_clusters_are_those_of_all_distances(points, radius):
    near = np.linalg.norm(points[:, None] - points, axis=-1)
    assume(np.abs(near - radius).min() > 1e-12)  # on the radius itself rounding decides
    kept = remove_outliers(cloud_of(points), radius, 3).pixel
    counts = (near <= radius).sum(axis=1)
    some = (near[:, ::2] <= radius).sum(axis=1) >= 5
    assert_array_equal(has_near(points, points[::2], radius, 5), some)
    assert_array_equal(kept, np.flatnonzero(counts > 3))
    labels = connected_components(near <= radius, directed=False)[1]
    assert_array_equal(linked(points, radius), labels)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers(-5, 5) | st.floats() | st.text(max_size=5),
    lambda part: st.lists(part, max_size=4) | st.dictionaries(st.text(max_size=5), part, max_size=4),
    max_leaves=12,
)


@given(JSON)
def test_no_json_but_a_grasp_is_read_as_one(content):
    json.dumps(content)  # as read_grasp finds it in a file
    with refused():
        record_of(content)
