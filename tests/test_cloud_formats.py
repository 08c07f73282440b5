"""What users have: clouds and cameras in the files of other programs, each made here."""

import importlib
from contextlib import suppress

import imageio.v3 as iio
import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose, assert_array_equal
from PIL import Image
from processes import typed
from refusals import refused
from scipy.spatial.transform import Rotation
from tables import DATA, mistakes, table
from test_scene_cloud import scene_points

from dexgrasp.cli.codes import ANSWER_IS_NO, OK
from dexgrasp.cli.main import main
from dexgrasp_env.perception.camera_files import Lens, read_cameras
from dexgrasp_env.perception.camera_pose import read_pose
from dexgrasp_env.perception.scan import cloud_of, read_scan
from dexgrasp_env.perception.selection import read_mask
from dexgrasp_env.robot.camera import Camera
from dexgrasp_env.yaml_file import read_yaml

POINTS = np.random.default_rng(5).uniform(-0.5, 0.5, (60, 3)).astype(np.float32)
POSE = Camera.look_at("", (1.0, -0.2, 0.7), (0.5, 0.0, 0.0)).T_world_camera
QUATERNION = Rotation.from_matrix(POSE[:3, :3]).as_quat()  # x y z w


TEXTS = table("texts_of_clouds")


@pytest.mark.parametrize("name", TEXTS)
def test_texts(name, tmp_path):
    head, line, tail, sign = TEXTS[name]
    whole = head == "0;0;0\n"  # numbers that have no comma
    body = "\n".join(line.format(*point, n=n) for n, point in enumerate(POINTS) if n >= whole)
    (tmp_path / name).write_text(head + body.replace(".", sign) + tail)
    first = [np.zeros(3)] if whole else POINTS[:1]
    assert_allclose(read_scan(tmp_path / name).points, [*first, *POINTS[1:]], atol=1e-6)


def test_arrays(tmp_path):
    record = np.zeros(60, [("rgb", "u4"), ("x", "f4"), ("y", "f4"), ("z", "f4")])
    for axis, column in zip("xyz", POINTS.T, strict=True):
        record[axis] = column
    for name, array in {"rows": POINTS.T, "record": record, "grid": POINTS.reshape(6, 10, 3)}.items():
        np.save(tmp_path / f"{name}.npy", array)
        assert_allclose(read_scan(tmp_path / f"{name}.npy").points, POINTS)
    np.savez(tmp_path / "a.npz", rgb=np.zeros((60, 3), np.uint8), xyz=POINTS)
    assert_allclose(read_scan(tmp_path / "a.npz").points, POINTS)
    assert len(cloud_of(np.eye(3))) == 3  # three points stay three points
    for wrong in (POINTS > 0.0, POINTS + 0j, np.zeros((3, 6, 10))):
        with refused("a cloud"):
            cloud_of(wrong)


def test_a_ply_that_was_cut_off_is_refused(tmp_path):
    axes, path = "".join(f"property float {axis}\n" for axis in "xyz"), tmp_path / "a.ply"
    head = f"ply\nformat ascii 1.0\nelement vertex 3\n{axes}end_header\n"
    path.write_text(f"{head}0 0 0\n")
    with refused("ends after 1 of 3 points"):
        read_scan(path)
    binary = head.replace("ascii", "binary_little_endian").encode() + POINTS[:3].tobytes()
    path.write_bytes(binary)
    assert_array_equal(read_scan(path).points, POINTS[:3])
    path.write_bytes(binary[:-1])
    with refused("ends after 2 of 3 rows"):
        read_scan(path)


def test_las(tmp_path):
    laspy = pytest.importorskip("laspy")
    scan = laspy.create()
    scan.header.scales = np.full(3, 1e-6)
    scan.x, scan.y, scan.z = POINTS.T.astype(float)
    with suppress(ImportError):
        importlib.import_module("lazrs")
        scan.write(tmp_path / "a.laz")
        assert_allclose(read_scan(tmp_path / "a.laz").points, POINTS, atol=1e-6)
    scan.write(tmp_path / "a.las")
    assert_allclose(read_scan(tmp_path / "a.las").points, POINTS, atol=1e-6)


def write_bag(path, clouds, frame="base_link"):
    """Write a bag with clouds by topic, the last of each being right; rows of the image are padded."""
    highlevel = pytest.importorskip("rosbags.typesys")
    from rosbags.rosbag1 import Writer as Bag1
    from rosbags.rosbag2 import Writer as Bag2

    one = path.suffix == ".bag"
    store = highlevel.get_typestore(highlevel.Stores.ROS1_NOETIC if one else highlevel.Stores.ROS2_HUMBLE)
    kinds, name = store.types, "sensor_msgs/msg/PointCloud2"
    field, time = kinds["sensor_msgs/msg/PointField"], kinds["builtin_interfaces/msg/Time"](0, 0)
    stamp = {"seq": 0} if one else {}
    header = kinds["std_msgs/msg/Header"](**stamp, stamp=time, frame_id=frame)
    fields = [field(axis, 4 * k, 7, 1) for k, axis in enumerate("xyz", start=1)]
    with Bag1(path) if one else Bag2(path, version=8) as bag:
        for topic, points in clouds.items():
            connection = bag.add_connection(topic, name, typestore=store)
            for n, shown in enumerate((points + 9, points)):
                data = np.zeros((6, 10 * 16 + 8), np.uint8)
                data[:, :160].reshape(6, 10, 16)[:, :, 4:] = shown.reshape(6, 10, 3).view(np.uint8)
                message = kinds[name](header, 6, 10, fields, False, 16, 168, data.ravel(), True)
                raw = store.serialize_ros1(message, name) if one else store.serialize_cdr(message, name)
                bag.write(connection, n, raw)


@pytest.mark.parametrize("name", ["a.bag", "a"])
def test_bags(name, tmp_path):
    write_bag(tmp_path / name, {"/points": POINTS})
    assert_allclose(read_scan(tmp_path / name).points, POINTS)
    if name == "a":  # the file in the folder is the folder's
        assert_allclose(read_scan(next((tmp_path / name).glob("*.db3"))).points, POINTS)
    write_bag(tmp_path / f"two{name}", {"/left": POINTS, "/right": -POINTS}, "left_optical_frame")
    with refused("'left_optical_frame' of a camera: .* by --camera-pose"):
        read_scan(tmp_path / f"two{name}#/left")
    with refused("valid are /left, /right"):
        read_scan(tmp_path / f"two{name}")
    with refused("unknown topic .* '/rigth' .the nearest is '/right'"):
        read_scan(tmp_path / f"two{name}#/rigth")
    seen = read_scan(tmp_path / f"two{name}#/right", T_base_camera=POSE)
    assert_allclose(seen.points, -POINTS @ POSE[:3, :3].T + POSE[:3, 3])


@pytest.mark.parametrize("path", sorted((DATA / "poses").iterdir()), ids=lambda path: path.name)
def test_poses(path):
    found = read_pose(str(path))
    assert_allclose(found, POSE, atol=2e-5)
    assert_allclose(found[:3, :3] @ found[:3, :3].T, np.eye(3), atol=1e-9)  # few digits are mended


def test_poses_in_numbers(tmp_path):
    x, y, z, w = QUATERNION
    place = " ".join(map(str, POSE[:3, 3]))
    assert_allclose(read_pose(f"{place} {w} {x} {y} {z}"), POSE, atol=1e-9)
    assert_allclose(read_pose(f"[{place}] {x}, {y}, {z}, {w} xyzw"), POSE, atol=1e-9)
    assert_allclose(read_pose(" ".join(f"{x:.17f}" for x in POSE.ravel())), POSE)
    np.save(tmp_path / "a.npy", POSE)
    assert_array_equal(read_pose(str(tmp_path / "a.npy")), POSE)
    for wrong, words in mistakes("poses_in_numbers").items():
        with refused(words):
            read_pose(wrong)


def folder_of(path, content, image=None, name="d.png"):
    path.mkdir(exist_ok=True)
    image = np.full((12, 16), 500, np.uint16) if image is None else image
    np.save(path / name, image) if name.endswith("npy") else iio.imwrite(path / name, image)
    (path / "cameras.yaml").write_text(yaml.safe_dump(content))
    return path


LENS = {"fx": 20.0, "fy": 21.0, "cx": 7.0, "cy": 6.0}
K = [20.0, 0.0, 7.0, 0.0, 21.0, 6.0, 0.0, 0.0, 1.0]
CALIBRATION, MESSAGE = (read_yaml(DATA / "cameras" / f"{name}.yaml") for name in ("calibration", "message"))
"""Files of ROS: of its calibrator, and of its topic."""


def test_cameras_of_other_programs_are_the_same(tmp_path):
    own = {"depth": "d.png", "width": 16, "height": 12, "T_base_camera": POSE.tolist()}
    expected = read_scan(folder_of(tmp_path / "own", {"cameras": [own | LENS]})).points
    (tmp_path / "named").mkdir()
    (tmp_path / "named" / "info.yaml").write_text(yaml.safe_dump(MESSAGE))
    pose = {"T_base_camera": np.r_[POSE[:3, 3], QUATERNION[3], QUATERNION[:3]].tolist()}
    for name, content in {
        "matrix": {"cameras": [own | {"K": np.reshape(K, (3, 3)).tolist()}]},
        "inside": {"cameras": [{"camera_info": CALIBRATION} | pose]},
        "named": {"cameras": [{"depth": "d.png", "camera_info": "info.yaml"} | pose]},
    }.items():
        found = read_scan(folder_of(tmp_path / name, content)).points
        assert_allclose(found, expected, atol=1e-9)
    alone = folder_of(tmp_path / "alone", CALIBRATION)
    assert_allclose(read_scan(alone, T_base_camera=POSE).points, expected)
    with refused("T_base_camera is missing: state it there, or by --camera-pose"):
        read_scan(alone)
    with refused("leave --camera-pose out"):
        read_scan(tmp_path / "own", T_base_camera=POSE)


@pytest.mark.parametrize(("change", "words"), mistakes("cameras"))
def test_cameras_that_are_wrong_are_refused_by_name(change, words, tmp_path):
    entry = {"depth": "d.png", "width": 16, "height": 12, "K": K, "T_base_camera": POSE.tolist()}
    with refused(words):
        read_scan(folder_of(tmp_path, {"cameras": [entry | change]}))


def test_which_image_is_meant_is_asked(tmp_path):
    folder_of(tmp_path, CALIBRATION)
    iio.imwrite(tmp_path / "colour.png", np.zeros((12, 16), np.uint8))
    with refused("which of colour.png, d.png"):
        read_cameras(tmp_path / "cameras.yaml", POSE)


def test_whole_numbers_are_millimetres_in_any_file(tmp_path):
    entry = {"depth": "d.npy", "width": 16, "height": 12, "T_base_camera": POSE.tolist()} | LENS
    whole = folder_of(tmp_path / "a", {"cameras": [entry]}, np.full((12, 16), 500, np.uint16), "d.npy")
    metres = folder_of(tmp_path / "b", {"cameras": [entry]}, np.full((12, 16), 0.5), "d.npy")
    assert_allclose(read_scan(whole).points, read_scan(metres).points)


@pytest.mark.parametrize("count", [4, 5, 8])
def test_distortion_is_undone(count):
    """Points of known rays are imaged by OpenCV's formula, written out; the lens gives the rays back."""
    k = np.array([0.12, -0.25, 0.003, -0.002, 0.1, 0.05, -0.03, 0.02])[:count]
    k1, k2, p1, p2, k3, k4, k5, k6 = [*k, *[0.0] * (8 - count)]
    lens = Lens(64, 48, 60.0, 61.0, 31.0, 24.0, tuple(k))
    x, y, _ = np.moveaxis(lens.directions(), -1, 0)
    r2 = x**2 + y**2
    radial = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
    u = 60.0 * (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2)) + 31.0
    v = 61.0 * (y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y) + 24.0
    assert_allclose(u, np.broadcast_to(np.arange(64), (48, 64)), atol=0.01)
    assert_allclose(v, np.broadcast_to(np.arange(48)[:, None], (48, 64)), atol=0.01)
    assert np.abs(x - (np.arange(64) - 31.0) / 60.0).max() > 0.003  # it is no small thing


def test_masks_of_images(tmp_path):
    marks = np.zeros((6, 8), np.uint8)
    marks[2:4, 3:6] = 2
    Image.fromarray(marks).save(tmp_path / "grey.png")
    Image.fromarray(marks > 0).save(tmp_path / "one.png")
    Image.fromarray(np.stack([marks * 100] * 3, axis=-1)).save(tmp_path / "white.png")
    palette = Image.fromarray(marks, mode="P")
    palette.putpalette([0, 0, 0, 9, 9, 9, 200, 10, 10])
    palette.save(tmp_path / "palette.png")
    for name in ("grey", "one", "white", "palette"):
        assert_array_equal(read_mask(tmp_path / f"{name}.png"), marks > 0)
    Image.fromarray(np.stack([marks * 100, marks, marks], axis=-1)).save(tmp_path / "red.png")
    with refused("has colours"):
        read_mask(tmp_path / "red.png")
    with refused("no label 7: valid are 2"):
        read_mask(tmp_path / "palette.png", 7)


def test_a_cloud_of_the_cameras_frame_is_planned_for_by_its_pose(tmp_path, capsys):
    points = scene_points(np.random.default_rng(3), (0.5, 0.12))
    np.save(tmp_path / "seen.npy", (points - POSE[:3, 3]) @ POSE[:3, :3])
    objects = f"plan --cloud {tmp_path / 'seen.npy'} --objects"
    x, y, z, w = QUATERNION
    place = " ".join(map(str, POSE[:3, 3]))
    assert main([*objects.split(), "--camera-pose", f"{place} {w} {x} {y} {z}"]) == OK
    assert "6 x 8 x" in capsys.readouterr().out
    np.savetxt(tmp_path / "inverse.txt", np.linalg.inv(POSE))
    for given, words in {
        f"{place} {x} {y} {z} {w}": "had the quaternion as ROS does",
        str(tmp_path / "inverse.txt"): "were inverted",
    }.items():
        assert main([*objects.split(), "--camera-pose", given]) == ANSWER_IS_NO
        assert words in capsys.readouterr().out
    assert typed(objects) == ANSWER_IS_NO
    assert "--camera-pose says where the camera is" in capsys.readouterr().out
