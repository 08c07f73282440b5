"""Clouds of whole scenes: read from files, one object isolated, or a reason."""

import struct

import lzf
import numpy as np
import pytest
from refusals import refused
from robots import CELL
from seen_tables import find

from dexgrasp.geometry.convex import ConvexDistance
from dexgrasp.geometry.neighbours import neighbours_of
from dexgrasp_env.perception.reasons import WORDS
from dexgrasp_env.perception.scan import read_scan
from dexgrasp_env.perception.scene import Scene


@pytest.fixture
def rng():
    return np.random.default_rng(7)


BOX = np.array([0.06, 0.08, 0.05])


def table(rng, count=6000, height=0.0):
    points = np.column_stack([rng.uniform(0.25, 0.85, count), rng.uniform(-0.5, 0.5, count), np.zeros(count)])
    points[:, 2] = height + rng.normal(0.0, 0.0008, count)
    return points


def box(rng, centre, size=BOX, count=3000):
    """Points on the sides and the top of a box that stands on the table."""
    local = rng.uniform(-0.5, 0.5, (count, 3))
    face = rng.integers(0, 5, count)
    local[np.arange(count), face // 2] = np.where(face % 2 == 0, 0.5, -0.5)
    local[face == 4, 2] = 0.5
    return local * size + [centre[0], centre[1], 0.5 * size[2]] + rng.normal(0.0, 0.0005, (count, 3))


def scene_points(rng, *centres):
    return np.concatenate([table(rng), *(box(rng, centre) for centre in centres)])


def test_the_object_is_found_and_the_table_is_not_part_of_it(rng):
    found = find(scene_points(rng, (0.5, 0.1)))
    assert found.reason is None
    low, high = found.target.points.min(0), found.target.points.max(0)
    assert np.abs(0.5 * (low + high)[:2] - [0.5, 0.1]).max() < 0.003
    assert np.abs((high - low)[:2] - BOX[:2]).max() < 0.005
    assert 0.0 < low[2] < 0.012


def test_what_is_wrong_is_named(rng):
    good = scene_points(rng, (0.5, 0.1))
    cases = {
        "empty_cloud": good[:5],
        "unit_is_not_metres": 1000.0 * good,
        "upside_down": good * [1.0, 1.0, -1.0],
        "table_not_at_base_height": good + np.array([0.0, 0.0, 0.12]),
        "no_object_on_the_table": table(rng),
        "plane_not_found": box(rng, (0.5, 0.1)) + np.array([0.0, 0.0, 0.2]),
        "several_objects": scene_points(rng, (0.5, 0.15), (0.5, -0.15)),
        "out_of_reach": scene_points(rng, (0.82, 0.46)),
        "table_tilted": tilted(good, 25.0),
    }
    for reason, points in cases.items():
        found = find(points)
        assert found.reason == reason, (reason, found.reason)
        assert WORDS[reason] in found.sentence


def tilted(points, degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return points @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def test_what_stands_around_is_seen(rng):
    wall = rng.uniform([0.2, 0.3, 0.0], [0.8, 0.305, 0.2], (12_000, 3))
    points = np.concatenate([scene_points(rng, (0.5, 0.1), (0.5, -0.05), (0.38, 0.1)), wall])
    found = find(points, near=(0.5, 0.1, 0.03))
    assert np.abs(found.target.points.mean(0)[:2] - [0.5, 0.1]).max() < 0.01
    middles = sorted(one.points.mean(0)[0] for one in found.neighbours)
    assert np.allclose(middles, [0.38, 0.5], atol=0.01)
    assert len(found.rest) > 200  # the wall is no object, and it is there
    assert found.rest.points[:, 1].min() > 0.29
    parts = [ConvexDistance.from_points(part, 12) for one in neighbours_of(found) for part in one]
    beyond = ConvexDistance.union(parts).distance(wall[wall[:, 2] > 0.01] + CELL.base)
    assert beyond.max() < 0.002  # obstacles have no gaps
    arrays = found.as_observation(1024, neighbour_rows=8192)
    again = Scene.of_observation(arrays)
    assert [len(one) for one in again.neighbours] == [len(one) for one in found.neighbours]
    assert np.array_equal(again.rest.points, found.rest.points)
    assert not Scene.of_observation(found.as_observation(1024)).neighbours


def test_what_hangs_high_is_in_the_way_and_what_is_under_it_is_free(rng):
    bar = rng.uniform([0.45, -0.3, 0.6], [0.5, 0.3, 0.62], (2000, 3))
    found = find(np.concatenate([scene_points(rng, (0.5, 0.1)), bar]))
    assert found.reason is None
    around = np.concatenate([corners for parts in neighbours_of(found) for corners in parts])
    assert around[:, 2].min() > 0.56
    assert np.abs(np.ptp(around, axis=0)[:2] - [0.05, 0.6]).max() < 0.06


def test_flying_pixels_and_holes_leave_the_object(rng):
    points = scene_points(rng, (0.5, 0.1))
    flying = rng.uniform([0.3, -0.3, 0.02], [0.7, 0.3, 0.3], (60, 3))
    kept = points[~((np.abs(points[:, 0] - 0.5) < 0.01) & (points[:, 2] > 0.01))]  # a stripe is missing
    found = find(np.concatenate([kept, flying]))
    assert found.reason is None
    assert np.abs(np.ptp(found.target.points, axis=0)[:2] - BOX[:2]).max() < 0.02


def test_files_give_the_points_that_were_written(rng, tmp_path):
    points = rng.uniform(0.0, 0.5, (200, 3)).astype(np.float32)
    header = "# .PCD\nVERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH 200\nHEIGHT 1\n"
    head = header + "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 200\nDATA {}\n"
    rows = np.zeros(200, [("p", "<f4", 3), ("c", "<u4")])
    rows["p"] = points
    ascii_rows = "\n".join(f"{x} {y} {z} 0" for x, y, z in points)
    (tmp_path / "a.pcd").write_text(head.format("ascii") + ascii_rows)
    (tmp_path / "b.pcd").write_bytes(head.format("binary").encode() + rows.tobytes())
    columns = points.T.tobytes() + bytes(800)
    packed = lzf.compress(columns)
    sizes = struct.pack("<II", len(packed), len(columns))
    (tmp_path / "bc.pcd").write_bytes(head.format("binary_compressed").encode() + sizes + packed)
    lines = "\n".join(f"{x} {y} {z}" for x, y, z in points)
    properties = "".join(f"property float {axis}\n" for axis in "xyz")
    (tmp_path / "e.ply").write_text(
        f"ply\nformat ascii 1.0\nelement vertex 200\n{properties}end_header\n{lines}\n"
    )
    for path in sorted(tmp_path.iterdir()):
        assert np.abs(read_scan(path).points - points).max() < 1e-6, path.name


@pytest.mark.parametrize(
    "head",
    [
        "ply\nformat ascii 1.0\nelement vertex 2\n{}end_header\n",
        "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nPOINTS 2\nDATA ascii\n",
    ],
)
def test_headers_may_begin_with_a_byte_order_mark(tmp_path, head):
    path = tmp_path / ("a.ply" if head.startswith("ply") else "a.pcd")
    properties = "".join(f"property float {axis}\n" for axis in "xyz")
    path.write_text(head.format(properties) + "0.5 0.25 0\n1 2 3\n", encoding="utf-8-sig")
    assert read_scan(path).points.tolist() == [[0.5, 0.25, 0.0], [1.0, 2.0, 3.0]]


def test_cells_of_a_table_may_be_empty_and_the_first_column_unnamed(tmp_path):
    (tmp_path / "a.csv").write_text(",x,y,z\n0,0.5,0.25,0\n1,,,\n2,1,2,3\n")
    assert read_scan(tmp_path / "a.csv").points.tolist() == [[0.5, 0.25, 0.0], [1.0, 2.0, 3.0]]


def test_fields_of_a_pcd_may_be_several_numbers(tmp_path):
    head = "FIELDS normal x y z\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 3 1 1 1\nPOINTS 3\nDATA ascii\n"
    path = tmp_path / "a.pcd"
    path.write_text(head + "0 0 1 0.5 0.1 0.2\n" * 3)
    assert read_scan(path).points == pytest.approx(np.tile([0.5, 0.1, 0.2], (3, 1)))
    path.write_text(head + "0 0 1 0.5 0.1 0.2\n")
    with refused("ends after 1 of 3 points"):
        read_scan(path)
    path.write_text(head.replace("POINTS 3", "POINTS -1"))
    with refused("has -1 points"):
        read_scan(path)


def test_damaged_files_are_one_line(tmp_path):
    (tmp_path / "cut.pcd").write_bytes(b"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nPOINTS 9\nDATA binary\n1234")
    np.save(tmp_path / "flat.npy", np.zeros(7))
    np.save(tmp_path / "nan.npy", np.full((9, 3), np.nan))
    np.savez(tmp_path / "two.npz", a=np.zeros((3, 3)), b=np.zeros((3, 3)))
    for name, text in {
        "bad.ply": "ply\nformat ascii 1.0\nelement vertex 3\n",
        "flat.xyz": "1 2\n3 4\n",
        "what.xlsx": "1 2 3",
    }.items():
        (tmp_path / name).write_text(text)
    head = b"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nPOINTS 9\nDATA binary_compressed\n"
    for name, body in (("short", b"12"), ("wrong", bytes(300)), ("back", b"\x02\0\0\0\x6c\0\0\0\x20\x09")):
        (tmp_path / f"{name}.pcd").write_bytes(head + body)
    (tmp_path / "giant.pcd").write_bytes(head.replace(b"TYPE", b"COUNT 1 1 90000000\nTYPE") + bytes(300))
    for path in [*sorted(tmp_path.iterdir()), tmp_path / "missing.ply", tmp_path]:
        with refused():
            read_scan(path)


def test_a_unit_is_of_files(rng, tmp_path):
    points = rng.uniform(0.0, 0.5, (50, 3))
    np.save(tmp_path / "mm.npy", 1000.0 * points)
    assert np.abs(read_scan(tmp_path / "mm.npy", "mm").points - points).max() < 1e-9
    with refused("depth_scale"):
        read_scan(tmp_path, "mm")
