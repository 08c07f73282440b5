"""Users' own meshes: every format, every defect."""

import os

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal
from refusals import refused
from scipy.spatial import ConvexHull
from tables import mistakes, table

from dexgrasp_env.objects import decompose
from dexgrasp_env.objects.decompose import convex_parts
from dexgrasp_env.objects.load import load_object, object_name, resolve_targets
from dexgrasp_env.objects.repair import is_solid, is_sound, repair
from dexgrasp_env.objects.shapes import union
from dexgrasp_env.objects.user_mesh import describe_mesh, load_mesh

pytestmark = pytest.mark.usefixtures("own_cache")

CAPSULE = trimesh.creation.capsule(radius=0.03, height=0.1, count=[16, 16])


def saved(tmp_path, mesh, name):
    mesh.export(tmp_path / name)
    return tmp_path / name


def bare(vertices, faces):
    return trimesh.Trimesh(vertices, faces, process=False)


@pytest.mark.parametrize("suffix", ["obj", "stl", "ply", "glb"])
def test_every_format_gives_the_same_object(tmp_path, suffix):
    moved = CAPSULE.copy().apply_translation([0.3, 0.1, -0.2])
    model = load_object(saved(tmp_path, moved, f"My thing.{suffix}"))
    assert model.name == "My thing"
    assert_allclose(model.extents, CAPSULE.extents, atol=1e-6)
    assert_allclose(model.mesh.center_mass, 0, atol=1e-6)
    assert model.mesh.volume == pytest.approx(CAPSULE.volume, rel=1e-4)
    assert len(model.parts) == 1
    assert model.mass == pytest.approx(400 * CAPSULE.volume, rel=1e-4)


def test_doctor_says_what_was_done(tmp_path):
    findings = describe_mesh(saved(tmp_path, defective("hole"), "hole.obj"))
    assert (findings[0].level, findings[0].problem[:30]) == ("info", "fit to use: 60 x 60 x 160 mm, ")
    assert any(f.level == "warning" and f.problem == "filled 1 hole" and f.remedy for f in findings)


def test_assumed_mass_is_kept_in_range(tmp_path):
    small = load_object(saved(tmp_path, trimesh.creation.box([0.01] * 3), "small.stl"))
    large = load_object(saved(tmp_path, trimesh.creation.box([0.3] * 3), "large.stl"))
    assert (small.mass, large.mass) == (0.02, 1.0)
    assert any("0.020 kg assumed: 400 kg/m3 gives 0.0004 kg" in note for note in small.notes)
    assert any(note.startswith("too large for the hand") for note in large.notes)


def bad_file(folder, defect):
    nan = CAPSULE.vertices.copy()
    nan[3] = np.nan
    meshes = {
        "millimetres": CAPSULE.copy().apply_scale(1000),
        "centimetres": CAPSULE.copy().apply_scale(100),
        "tiny": CAPSULE.copy().apply_scale(0.01),
        "nan": bare(nan, CAPSULE.faces),
        "flat": bare(table("square"), [[0, 1, 2], [0, 2, 3]]),
        "points": trimesh.PointCloud(CAPSULE.vertices),
    }
    if defect in meshes:
        return saved(folder, meshes[defect], "bad.ply")
    kind, _, suffix = defect.partition(".")
    path = folder / f"bad.{suffix}"
    if kind == "range":
        path.write_text("v 0 0 0\nv .1 0 0\nv 0 .1 0\nf 1 2 9\n")
    elif kind == "text":
        path.write_text("hello, I am no mesh")
    return path


@pytest.mark.parametrize(("defect", "message"), mistakes("meshes"))
def test_a_file_that_cannot_be_used_is_refused_in_one_line(tmp_path, defect, message):
    path = bad_file(tmp_path, defect)
    with refused(message):
        load_mesh(path)
    (finding,) = describe_mesh(path)
    assert finding.level == "error"
    assert finding.remedy


def defective(defect):
    mesh = CAPSULE.copy()
    faces = np.array(mesh.faces)
    if defect == "inverted":
        mesh.invert()
    elif defect == "some turned":
        faces[::3] = faces[::3, ::-1]
        mesh = bare(mesh.vertices, faces)
    elif defect == "hole":
        mesh = bare(mesh.vertices, np.delete(faces, slice(10, 30), axis=0))
    elif defect == "unwelded":
        mesh = bare(mesh.triangles.reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3))
    elif defect == "crumb":
        mesh = trimesh.util.concatenate(
            [mesh, trimesh.creation.icosphere(1, 0.001).apply_translation([0, 0, 0.2])]
        )
    elif defect == "soup":
        rng, soup = np.random.default_rng(0), mesh.subdivide().triangles
        soup = soup[rng.random(len(soup)) > 0.1] + rng.normal(0, 1e-4, (1, 3, 3))
        mesh = bare(soup.reshape(-1, 3), np.arange(3 * len(soup)).reshape(-1, 3))
    return mesh


@pytest.mark.parametrize(("defect", "note"), table("defects"))
def test_a_broken_surface_is_mended_and_it_is_said(defect, note):
    solid, notes = repair(defective(defect))
    assert is_solid(solid)
    assert solid.volume == pytest.approx(CAPSULE.volume, rel=0.08)
    assert_allclose(solid.extents, CAPSULE.extents, atol=2e-3)
    assert any(said.startswith(note) for said in notes) if note else notes == ()


def test_a_fine_mesh_is_simplified(tmp_path):
    ball = trimesh.creation.uv_sphere(0.04, count=[120, 120])
    assert len(ball.faces) > 28_000
    model = load_object(saved(tmp_path, ball, "fine.stl"))
    assert len(model.mesh.faces) <= 20_500
    assert model.mesh.volume == pytest.approx(ball.volume, rel=5e-3)
    assert any(note.startswith("simplified") for note in model.notes)


def test_a_concave_mesh_is_split_the_same_way_every_time_and_cached(tmp_path, monkeypatch):
    torus = trimesh.creation.torus(0.04, 0.012, 24, 12)
    parts, notes = convex_parts(torus)
    assert 3 <= len(parts) <= decompose.MOST_PARTS
    assert all(len(part.vertices) <= 64 for part in parts)
    assert notes == (f"split into {len(parts)} convex parts",)
    (path,) = (tmp_path / "cache" / "parts").iterdir()
    path.write_bytes(b"damaged")
    again, _ = convex_parts(torus)
    for one, other in zip(parts, again, strict=True):
        assert_array_equal(one.vertices, other.vertices)
    monkeypatch.setattr(decompose, "decompose", None)
    assert len(convex_parts(torus)[0]) == len(parts)


def cup_of():
    profile = table("cup_profile")
    return trimesh.creation.revolve(np.array(profile), sections=24)


def test_a_cup_stays_hollow():
    cup = cup_of()
    parts, _ = convex_parts(cup)
    assert 8 <= len(parts) <= decompose.MOST_PARTS
    solid = union([part.surface() for part in parts])
    assert solid.volume < 0.3 * cup.convex_hull.volume
    assert_allclose(solid.extents, cup.extents, atol=1e-3)
    inside = np.array([[x, 0, z] for x in (-0.015, 0.0, 0.015) for z in (0.02, 0.05, 0.085)])
    for part in parts:
        planes = ConvexHull(part.vertices).equations
        assert ((inside @ planes[:, :3].T + planes[:, 3]).max(axis=1) > 0.0).all()


def test_a_changed_file_is_read_again(tmp_path):
    path = saved(tmp_path, CAPSULE, "a.stl")
    first = load_object(path)
    assert load_object(path) is first
    saved(tmp_path, CAPSULE.copy().apply_scale(0.5), "a.stl")
    os.utime(path, ns=(1, 1))
    assert_allclose(load_object(path).extents, first.extents / 2, atol=1e-6)


def test_a_surface_that_crosses_itself_gets_a_possible_inertia():
    """A ball of which one side is inside out: closed, consistently wound, its centre of mass outside."""
    twisted = trimesh.creation.icosphere(3, 0.03)
    twisted.vertices[twisted.vertices[:, 0] > 0.004, 1] *= -1.0
    assert is_solid(twisted)
    assert not is_sound(twisted)
    solid, notes = repair(twisted)
    assert is_sound(solid)
    assert any(note.startswith(("rebuilt", "replaced")) for note in notes)


DEGENERATE = {
    "collinear": table("collinear"),
    "two vertices": table("two_corners"),
    "huge": ([[1e308] * 3, [-1e308] * 3, *CAPSULE.vertices[2:].tolist()], CAPSULE.faces.tolist()),
}


@pytest.mark.parametrize(("points", "faces"), DEGENERATE.values(), ids=DEGENERATE)
def test_degenerate_meshes_are_refused_in_one_line(tmp_path, points, faces):
    path = tmp_path / "bad.obj"
    lines = ["v " + " ".join(map(repr, point)) for point in points]
    lines += ["f " + " ".join(str(i + 1) for i in face) for face in faces]
    path.write_text("\n".join(lines))
    with refused():
        load_mesh(path)


def test_home_is_expanded_and_any_bytes_may_name_a_file(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    saved(tmp_path, CAPSULE, "x.stl")
    assert load_object("~/x.stl").name == "x"
    os.rename(tmp_path / "x.stl", os.fsencode(str(tmp_path)) + b"/b\xff.stl")
    target = str(tmp_path / "b\udcff.stl")
    assert resolve_targets([target]) == [target]
    assert load_object(target).name == object_name(target) == "b\ufffd"
