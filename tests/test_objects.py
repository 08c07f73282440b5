"""The catalogue: sizes, masses, surfaces, contact parts, names."""

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from refusals import refused
from tables import mistakes

from dexgrasp_env.objects.catalogue import CATALOGUE, catalogue_object
from dexgrasp_env.objects.load import load_object, resolve_targets
from dexgrasp_env.objects.mjcf import add_to_spec
from dexgrasp_env.objects.model import ObjectModel, reduced_hull
from dexgrasp_env.objects.parts import MAX_VERTICES
from dexgrasp_env.objects.repair import is_sound
from dexgrasp_env.objects.shapes import to_manifold, union
from dexgrasp_env.robot.hulls import mesh_of

EVERY = sorted(CATALOGUE)


def compiled(model: ObjectModel) -> mujoco.MjModel:
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body(name="object")
    body.add_freejoint()
    add_to_spec(spec, body, model, condim=3)
    return spec.compile()


@pytest.mark.parametrize("name", EVERY)
def test_surface_is_a_clean_solid_that_contact_parts_fill(name):
    model = load_object(name)
    mesh = model.mesh
    assert is_sound(mesh)
    assert 1000 <= len(mesh.faces) <= 7000
    assert mesh.area_faces.min() > 0
    assert_allclose(mesh.center_mass, 0, atol=1e-7)
    assert all(len(part.vertices) <= MAX_VERTICES for part in model.parts)
    contact, surface = to_manifold(union([part.surface() for part in model.parts])), to_manifold(mesh)
    assert (contact ^ surface).volume() / (contact + surface).volume() > 0.95


@pytest.mark.parametrize("name", EVERY)
def test_compiles_with_the_mass_and_inertia_mujoco_finds_in_the_mesh(name):
    model = load_object(name)
    mj_model = compiled(model)
    assert mj_model.body_mass[1] == pytest.approx(model.mass)
    assert_allclose(mj_model.body_ipos[1], 0, atol=1e-9)
    spec = mujoco.MjSpec()
    mesh = spec.add_mesh(name="m", uservert=model.mesh.vertices.ravel(), userface=model.mesh.faces.ravel())
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_EXACT
    body = spec.worldbody.add_body()
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="m", mass=model.mass)
    own = spec.compile()
    assert_allclose(np.sort(mj_model.body_inertia[1]), np.sort(own.body_inertia[1]), rtol=2e-3)


@pytest.mark.parametrize("name", ["mustard_bottle", "massage_ball"])
def test_contact_geoms_lie_where_the_parts_are(name):
    """Names and groups are the agreed ones; what is seen does not collide."""
    model = load_object(name)
    mj_model = compiled(model)
    data = mujoco.MjData(mj_model)
    mujoco.mj_forward(mj_model, data)
    assert list(mj_model.geom_group) == [2] + [3] * len(model.parts)
    assert mj_model.geom("object_visual").contype[0] == mj_model.geom("object_visual").conaffinity[0] == 0
    for i, part in enumerate(model.parts):
        geom = mj_model.geom(f"object_{i}").id
        assert mj_model.geom_condim[geom] == 3
        if part.kind != "mesh":
            assert_allclose(data.geom_xpos[geom], part.position, atol=1e-9)
            continue
        world = mesh_of(mj_model, geom)[0] @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
        assert_allclose(world.max(0), (part.vertices + part.position).max(0), atol=1e-6)


@pytest.mark.parametrize(("target", "options", "message"), mistakes("objects"))
def test_bad_targets_are_refused_in_one_line(target, options, message):
    with refused(message):
        load_object(target, **options)


def test_bad_lists_of_targets_are_refused():
    for targets in mistakes("lists"):
        with refused():
            resolve_targets(targets)


@pytest.mark.parametrize("name", ["massage_ball", "sandwich_side"])
def test_an_object_read_from_the_cache_is_the_one_that_was_made(name):
    made = CATALOGUE[name].build()
    for read in (catalogue_object.__wrapped__(name), catalogue_object.__wrapped__(name)):
        assert (read.content_hash, read.notes, read.rgba) == (made.content_hash, made.notes, made.rgba)
        assert_array_equal(read.inertia, made.inertia)
        assert_array_equal(read.solid.corners, made.solid.corners)


def test_a_sliver_has_a_reduced_hull():
    """Its furthest points along even directions lie in one plane, of which Qhull makes no hull."""
    angles = np.linspace(0.0, 2 * np.pi, 120, endpoint=False)
    rim = 0.008 * np.stack([np.cos(angles), np.sin(angles), np.zeros(120)], axis=1)
    hull = reduced_hull(np.concatenate([rim, [[0.0, 0.0, -3e-5]]]), 40)
    assert 0.0 < len(hull.vertices) <= 40
    assert hull.extents == pytest.approx([0.016, 0.016, 3e-5], rel=0.02)
