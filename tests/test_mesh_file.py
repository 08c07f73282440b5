"""Mesh files as other programs write them: polygons, byte order marks, bytes too many or too few."""

import numpy as np
import pytest
import trimesh
from refusals import refused
from tables import table

from dexgrasp_env.objects.load import load_object
from dexgrasp_env.objects.user_mesh import read_mesh

pytestmark = pytest.mark.usefixtures("own_cache")

BALL = trimesh.creation.icosphere(2, 0.03)
U = np.array(table("outline_u")) / 100
ARROW = np.array(table("outline_arrow")) / 100
"""Concave outlines: a fan over the first is wrong from most corners, over the second from two of four."""


def prism_text(outline, suffix):
    """A prism 4 cm high whose ends are one polygon each, as modelling programs write it."""
    n = len(outline)
    vertices = np.vstack([np.c_[outline, np.zeros(n)], np.c_[outline, np.full(n, 0.04)]])
    faces = [
        [*range(n)][::-1],
        [*range(n, 2 * n)],
        *([i, (i + 1) % n, (i + 1) % n + n, i + n] for i in range(n)),
    ]
    rows = [" ".join(map(str, vertex)) for vertex in vertices.tolist()]
    if suffix == "off":
        lists = [" ".join(map(str, [len(face), *face, 0.5, 0.5, 0.5])) for face in faces]
        return "\n".join(["OFF # of a prism", f"{2 * n} {n + 2} 0", *rows, *lists])
    if suffix == "obj":
        corners = [" ".join(f"{i + 1}//1" for i in face) for face in faces]
        return "".join(f"v {row}\n" for row in rows) + "vn 0 0 1\n" + "".join(f"f {one}\n" for one in corners)
    head = f"""ply\nformat ascii 1.0\nelement vertex {2 * n}
property float x\nproperty float y\nproperty float z
element face {n + 2}\nproperty list uchar int vertex_indices\nend_header"""
    lists = [" ".join(map(str, [len(face), *face])) for face in faces]
    return "\n".join([head, *rows, *lists, ""])


@pytest.mark.parametrize("suffix", ["obj", "ply", "off"])
@pytest.mark.parametrize("outline", [U, ARROW], ids=["U", "arrow"])
def test_concave_polygons_are_cut_into_triangles_within_them(tmp_path, outline, suffix):
    x, y = outline.T
    area = 0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum()
    around = np.linalg.norm(outline - np.roll(outline, 1, axis=0), axis=1).sum()
    for start in range(len(outline)):
        path = tmp_path / f"{start}.{suffix}"
        path.write_text(prism_text(np.roll(outline, -start, axis=0), suffix))
        mesh = read_mesh(path)
        assert mesh.area == pytest.approx(2 * area + 0.04 * around, rel=1e-6)
        assert load_object(path).mesh.volume == pytest.approx(0.04 * area, rel=1e-6)


def test_a_binary_stl_is_read_as_far_as_it_counts(tmp_path):
    path, data = tmp_path / "a.stl", BALL.export(file_type="stl")
    path.write_bytes(data + b"made by a scanner")
    assert load_object(path).mesh.volume == pytest.approx(BALL.volume, rel=1e-4)
    path.write_bytes(data[: 84 + 50 * 99 + 20])
    with refused("is damaged .it ends after 99 of 320 triangles.: export it again"):
        load_object(path)
    path.write_text("solid a\n facet normal 0 0 1\n  outer loop\n   vertex 0 0 0\n")
    with refused("is damaged .it ends before its last facet."):
        load_object(path)


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_a_ply_that_is_cut_off_is_refused(tmp_path, encoding):
    path, data = tmp_path / "a.ply", BALL.export(file_type="ply", encoding=encoding)
    for less in (12, 400):
        path.write_bytes(data[:-less])
        with refused("is damaged|cannot be read as ply .*: export it again"):
            load_object(path)


@pytest.mark.parametrize("behind", [b"", b"a viewer's note"])
def test_binary_polygons_may_have_any_number_of_corners(tmp_path, behind):
    head, body = prism_text(U, "ply").split("end_header\n")
    rows = [line.split() for line in body.splitlines()]
    packed = np.array(rows[: 2 * len(U)], "<f4").tobytes()
    packed += b"".join(
        bytes([int(n)]) + np.array(corners, "<i4").tobytes() for n, *corners in rows[2 * len(U) :]
    )
    head = head.replace("ascii", "binary_little_endian") + "end_header\n"
    (tmp_path / "u.ply").write_bytes(head.encode() + packed + behind)
    assert load_object(tmp_path / "u.ply").mesh.volume == pytest.approx(0.04 * 34e-4, rel=1e-5)
    (tmp_path / "u.ply").write_bytes(head.encode() + packed[:-5])
    with refused("is damaged .it ends after 9 of 10 rows of face"):
        load_object(tmp_path / "u.ply")


def test_texts_may_have_decimal_commas_and_capitals(tmp_path):
    for suffix in ("obj", "off", "ply"):
        head, end, body = prism_text(U, suffix).rpartition("end_header")
        (tmp_path / f"u.{suffix}").write_text(head + end + body.replace(".", ","))
        assert load_object(tmp_path / f"u.{suffix}").mesh.volume == pytest.approx(0.04 * 34e-4, rel=1e-6)
    (tmp_path / "b.stl").write_text(BALL.export(file_type="stl_ascii").replace(".", ",").upper())
    assert read_mesh(tmp_path / "b.stl").volume == pytest.approx(BALL.volume, rel=1e-4)


def test_a_binary_stl_may_begin_with_the_words_of_a_text(tmp_path):
    data = BALL.export(file_type="stl")
    (tmp_path / "b.stl").write_bytes(b"solid facet".ljust(80) + data[80:] + b"tail")
    assert read_mesh(tmp_path / "b.stl").volume == pytest.approx(BALL.volume, rel=1e-4)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_texts_may_begin_with_a_byte_order_mark(tmp_path, encoding):
    for suffix in ("obj", "ply"):
        path = tmp_path / f"a.{suffix}"
        path.write_text(prism_text(U, suffix), encoding=encoding)
        assert load_object(path).mesh.volume == pytest.approx(0.04 * 34e-4, rel=1e-6)
    if encoding == "utf-8-sig":
        (tmp_path / "a.stl").write_text(BALL.export(file_type="stl_ascii"), encoding=encoding)
        assert read_mesh(tmp_path / "a.stl").volume == pytest.approx(BALL.volume, rel=1e-4)


def test_strips_of_triangles_are_faces(tmp_path):
    corners = np.array(table("corner")) / 100
    strips = table("strips")  # the second begins with a triangle without area
    head = "ply\nformat ascii 1.0\nelement vertex 4\n" + "".join(f"property float {a}\n" for a in "xyz")
    head += "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    rows = "".join(f"{x} {y} {z}\n" for x, y, z in corners) + " ".join(map(str, [10, *strips])) + "\n"
    (tmp_path / "a.ply").write_text(head + rows)
    mesh = read_mesh(tmp_path / "a.ply")
    assert len(mesh.faces) == 4
    assert load_object(tmp_path / "a.ply").mesh.volume == pytest.approx(0.04**3 / 6, rel=1e-3)


def test_files_that_say_their_unit_come_in_metres(tmp_path):
    pytest.importorskip("lxml")
    big = trimesh.Scene(trimesh.creation.box((40, 50, 60)))
    (tmp_path / "a.3mf").write_bytes(big.export(file_type="3mf"))  # millimetres, as its makers have it
    assert load_object(tmp_path / "a.3mf").extents == pytest.approx([0.04, 0.05, 0.06])


def test_files_of_collada(tmp_path):
    pytest.importorskip("collada")
    from trimesh.exchange.dae import export_collada

    data = export_collada(trimesh.creation.box((4, 5, 6)))
    assert b"<unit" not in data or b'meter="1"' in data
    unit = b'<unit name="centimetre" meter="0.01"/>'
    (tmp_path / "a.dae").write_bytes(data.replace(b"<up_axis>", unit + b"<up_axis>"))
    assert load_object(tmp_path / "a.dae").extents == pytest.approx([0.04, 0.05, 0.06])
    (tmp_path / "b.dae").write_bytes(b"hello")
    with refused("cannot be read as dae"):
        read_mesh(tmp_path / "b.dae")


def test_gltf_with_its_buffers_beside(tmp_path):
    for name, data in trimesh.Scene(BALL).export(file_type="gltf").items():
        (tmp_path / name).write_bytes(data)
    assert load_object(tmp_path / "model.gltf").extents == pytest.approx(BALL.extents)
    next(tmp_path.glob("*.bin")).unlink()
    with refused("cannot be read as gltf"):
        read_mesh(tmp_path / "model.gltf")
