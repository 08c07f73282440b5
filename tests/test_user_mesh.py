"""Users' own meshes: every format, every defect."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from dexgrasp_env.errors import InputError
from dexgrasp_env.objects import decompose, load_object
from dexgrasp_env.objects.decompose import convex_parts
from dexgrasp_env.objects.repair import closed_gently, is_solid, repair
from dexgrasp_env.objects.rest_poses import rest_poses
from dexgrasp_env.objects.user_mesh import describe_mesh, load_mesh, read_mesh

SCANS = sorted((Path(__file__).parents[2] / "shared" / "ycb").glob("*.obj"))
CAPSULE = trimesh.creation.capsule(radius=0.03, height=0.1, count=[16, 16])


@pytest.fixture(autouse=True)
def _own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("DEXGRASP_CACHE", str(tmp_path / "cache"))


def saved(tmp_path: Path, mesh: trimesh.Trimesh, name: str) -> Path:
    mesh.export(tmp_path / name)
    return tmp_path / name


def bare(vertices: np.ndarray, faces: np.ndarray) -> trimesh.Trimesh:
    return trimesh.Trimesh(vertices, faces, process=False)


@pytest.mark.parametrize("suffix", ["obj", "stl", "ply", "glb"])
def test_every_format_gives_the_same_object(tmp_path, suffix):
    moved = CAPSULE.copy().apply_translation([0.3, 0.1, -0.2])
    model = load_object(saved(tmp_path, moved, f"My thing.{suffix}"))
    assert model.name == "My thing"
    assert model.mesh.is_watertight
    np.testing.assert_allclose(model.extents, CAPSULE.extents, atol=1e-6)
    np.testing.assert_allclose(model.mesh.center_mass, 0, atol=1e-6)
    assert model.mesh.volume == pytest.approx(CAPSULE.volume, rel=1e-4)
    assert len(model.parts) == 1
    assert model.mass == pytest.approx(400 * CAPSULE.volume, rel=1e-4)
    assert any("mass" in note for note in model.notes)


def test_scale_and_mass_are_taken(tmp_path):
    path = saved(tmp_path, CAPSULE.copy().apply_scale(1000), "mm.stl")
    model = load_object(path, scale=0.001, mass=0.25)
    np.testing.assert_allclose(model.extents, CAPSULE.extents, atol=1e-6)
    assert model.mass == 0.25
    assert not any("mass" in note for note in model.notes)


def test_assumed_mass_is_kept_in_range(tmp_path):
    small = load_object(saved(tmp_path, trimesh.creation.box([0.02] * 3), "small.stl"))
    large = load_object(saved(tmp_path, trimesh.creation.box([0.3] * 3), "large.stl"))
    assert (small.mass, large.mass) == (0.02, 1.0)
    assert any(note.startswith("too large for the hand") for note in large.notes)


def bad_file(folder: Path, defect: str) -> Path:
    nan = CAPSULE.vertices.copy()
    nan[3] = np.nan
    square = bare([[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]], [[0, 1, 2], [0, 2, 3]])
    meshes = {
        "millimetres": CAPSULE.copy().apply_scale(1000),
        "centimetres": CAPSULE.copy().apply_scale(100),
        "tiny": CAPSULE.copy().apply_scale(0.01),
        "nan": bare(nan, CAPSULE.faces),
        "flat": square,
    }
    if defect in meshes:
        return saved(folder, meshes[defect], "bad.ply")
    if defect == "points":
        return saved(folder, trimesh.PointCloud(CAPSULE.vertices), "bad.ply")
    if defect == "folder":
        return folder
    kind, _, suffix = defect.partition(".")
    path = folder / f"bad.{suffix}"
    good = CAPSULE.export(file_type=suffix) if suffix in ("obj", "stl", "ply", "glb") else b""
    data = good.encode() if isinstance(good, str) else good
    contents = {
        "empty": b"",
        "text": b"hello, I am no mesh\n",
        "half": data[: len(data) // 2],
        "missing": None,
    }
    contents["range"] = b"v 0 0 0\nv .1 0 0\nv 0 .1 0\nf 1 2 9\n"
    if contents[kind] is not None:
        path.write_bytes(contents[kind])
    return path


@pytest.mark.parametrize(
    ("defect", "message"),
    [
        ("millimetres", "millimetres: pass --mesh-scale 0.001"),
        ("centimetres", "--mesh-scale 0.01 or 0.001"),
        ("tiny", "1.6 mm"),
        ("nan", "1 vertices that are not finite"),
        ("flat", "flat"),
        ("points", "no faces"),
        ("folder", "does not exist"),
        ("missing.obj", "does not exist"),
        ("text.dae", "wrong kind '.dae': valid are .obj, .stl, .ply, .glb"),
        ("empty.stl", "is empty"),
        *((f"text.{suffix}", "cannot be read|no faces") for suffix in ("obj", "stl", "ply", "glb")),
        *((f"half.{suffix}", "cannot be read|no faces|damaged") for suffix in ("obj", "stl", "ply", "glb")),
        ("range.obj", "cannot be read|damaged"),
    ],
)
def test_a_file_that_cannot_be_used_is_refused_in_one_line(tmp_path, defect, message):
    path = bad_file(tmp_path, defect)
    with pytest.raises(InputError, match=message) as caught:
        load_mesh(path)
    assert "\n" not in str(caught.value)
    (finding,) = describe_mesh(path)
    assert finding.level == "error"
    assert finding.remedy


def defective(defect: str) -> trimesh.Trimesh:
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
    elif defect == "fin":
        fin = [[*faces[0, :2], len(mesh.vertices)]]
        mesh = bare(np.concatenate([mesh.vertices, [[0, 0, 0.0]]]), np.concatenate([faces, fin]))
    elif defect == "crumb":
        mesh = trimesh.util.concatenate(
            [mesh, trimesh.creation.icosphere(1, 0.001).apply_translation([0, 0, 0.2])]
        )
    elif defect == "soup":
        rng = np.random.default_rng(0)
        soup = mesh.subdivide().triangles
        soup = soup[rng.random(len(soup)) > 0.1] + rng.normal(0, 1e-4, (1, 3, 3))
        mesh = bare(soup.reshape(-1, 3), np.arange(3 * len(soup)).reshape(-1, 3))
    return mesh


@pytest.mark.parametrize(
    ("defect", "note"),
    [
        ("inverted", "turned faces"),
        ("some turned", "turned faces"),
        ("hole", "filled 1 hole"),
        ("unwelded", None),
        ("fin", "dropped 1 loose piece"),
        ("crumb", "dropped 1 loose piece"),
        ("soup", "rebuilt on a grid"),
    ],
)
def test_a_broken_surface_is_mended_and_it_is_said(defect, note):
    solid, notes = repair(defective(defect))
    assert is_solid(solid)
    assert solid.volume == pytest.approx(CAPSULE.volume, rel=0.08)
    np.testing.assert_allclose(solid.extents, CAPSULE.extents, atol=2e-3)
    assert any(said.startswith(note) for said in notes) if note else notes == ()


def test_a_surface_that_encloses_nothing_becomes_its_hull():
    panel = trimesh.creation.box((0.1, 0.1, 0.1))
    panel.update_faces(panel.face_normals.argmax(1) != 2)
    panel.update_faces(np.arange(len(panel.faces)) < 4)
    solid, notes = repair(panel)
    assert is_solid(solid)
    assert notes


def test_bodies_are_kept_as_one_rigid_object():
    boxes = [trimesh.creation.box([0.05] * 3).apply_translation([x, 0, 0]) for x in (0, 0.03)]
    solid, notes = repair(trimesh.util.concatenate(boxes))
    assert solid.volume == pytest.approx(0.05 * 0.05 * 0.08, rel=1e-6)
    assert any(note.startswith("2 bodies") for note in notes)


def test_a_mesh_of_100_000_faces_is_simplified(tmp_path):
    ball = trimesh.creation.uv_sphere(0.04, count=[224, 224])
    assert len(ball.faces) > 95_000
    model = load_object(saved(tmp_path, ball, "fine.stl"))
    assert len(model.mesh.faces) <= 20_500
    assert model.mesh.volume == pytest.approx(ball.volume, rel=5e-3)
    assert any(note.startswith("simplified") for note in model.notes)


def test_a_concave_mesh_is_split_the_same_way_every_time_and_cached(tmp_path, monkeypatch):
    torus = trimesh.creation.torus(0.04, 0.012, 24, 12)
    parts, notes = convex_parts(torus)
    assert 3 <= len(parts) <= 8
    assert all(len(part.vertices) <= 64 for part in parts)
    assert notes == (f"split into {len(parts)} convex parts",)
    (path,) = (tmp_path / "cache" / "parts").iterdir()
    path.write_bytes(b"damaged")
    again, _ = convex_parts(torus)
    for one, other in zip(parts, again, strict=True):
        np.testing.assert_array_equal(one.vertices, other.vertices)
    monkeypatch.setattr(decompose, "_run", None)
    assert len(convex_parts(torus)[0]) == len(parts)


def test_a_decomposition_that_takes_too_long_gives_the_hull():
    parts, (note,) = convex_parts(trimesh.creation.torus(0.04, 0.012, 24, 12), timeout=0.01)
    assert len(parts) == 1
    assert "convex hull stands in" in note


def test_doctor_says_what_was_done(tmp_path):
    findings = describe_mesh(saved(tmp_path, defective("hole"), "hole.obj"))
    assert findings[0].level == "info"
    assert "fit to use: 60 x 60 x 160 mm" in findings[0].problem
    assert any(f.level == "warning" and f.problem == "filled 1 hole" and f.remedy for f in findings)


def test_a_changed_file_is_read_again(tmp_path):
    import os

    path = saved(tmp_path, CAPSULE, "a.stl")
    first = load_object(path)
    assert load_object(path) is first
    saved(tmp_path, CAPSULE.copy().apply_scale(0.5), "a.stl")
    os.utime(path, ns=(1, 1))
    np.testing.assert_allclose(load_object(path).extents, first.extents / 2, atol=1e-6)


@pytest.mark.skipif(not SCANS, reason="the scans are not here")
@pytest.mark.parametrize("path", SCANS, ids=lambda path: path.stem)
def test_scans_become_solids(path):
    raw = read_mesh(path)
    solid, _ = repair(raw)
    assert is_solid(solid)
    np.testing.assert_allclose(solid.extents, raw.extents, atol=1e-3)
    assert closed_gently(solid) is not None


@pytest.mark.skipif(not SCANS, reason="the scans are not here")
def test_a_scan_is_fit_to_use():
    path = next(path for path in SCANS if "mustard" in path.stem)
    model = load_object(path, mass=0.603)
    assert len(model.parts) <= 8
    assert 1 <= len(rest_poses(model)) <= 12
    assert max(rest_poses(model), key=lambda pose: pose.height).height > 0.06
