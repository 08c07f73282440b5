"""What somebody may hand over by mistake: refused before it fills the memory."""

import os
import re
import struct
import subprocess
import sys
import zipfile
import zlib

import imageio.v3 as iio
import numpy as np
import pytest
import trimesh
import yaml
from refusals import refused
from tables import table

from dexgrasp.agents.checkpoint_reader import read_settings
from dexgrasp.data.dataset.dataset import read_manifest
from dexgrasp.evaluation.scoring.readers.dexgraspbench import read_dictionary
from dexgrasp.evaluation.store import read_run
from dexgrasp.export.read import read_trajectory
from dexgrasp.grasp.file import read_grasp
from dexgrasp.runs.lines import Lines, read_lines
from dexgrasp.runs.weights import read_arrays, read_policy
from dexgrasp_env.files import read_json_object, read_npz, write_atomically
from dexgrasp_env.objects import user_mesh
from dexgrasp_env.objects.sets import read_set
from dexgrasp_env.objects.user_mesh import read_mesh
from dexgrasp_env.perception import cloud
from dexgrasp_env.perception.camera_files import read_cameras
from dexgrasp_env.perception.scan import cloud_of, read_scan
from dexgrasp_env.robot.cell import default_cell, read_cell
from dexgrasp_env.yaml_file import read_yaml

MOST = 1.5e9  # bytes of memory
PEAK = """
import resource, subprocess, sys
code = subprocess.run(sys.argv[1:]).returncode
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
sys.exit(code)
"""


def sparse(path, size: int = 10**10):
    """Make a file that has a size and next to no content."""
    with path.open("wb") as file:
        file.truncate(size)
    return path


def bomb(path, block: int = 1 << 24, blocks: int = 240):
    """Make an npz of a few MB that unpacks to 4 GB of zeros: what one block of them is packed to, repeated."""
    shape = (block * blocks // 24, 3)
    pack = zlib.compressobj(9, zlib.DEFLATED, -zlib.MAX_WBITS)
    head = (
        b"\x93NUMPY\x01\x00\x76\x00"
        + f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}}}".ljust(117).encode()
    )
    data = pack.compress(head + b"\n") + pack.flush(zlib.Z_FULL_FLUSH)
    data += (pack.compress(bytes(block)) + pack.flush(zlib.Z_FULL_FLUSH)) * blocks + pack.flush()
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("points.npy", data)
        entry = archive.infolist()[0]
        entry.compress_type, entry.file_size = zipfile.ZIP_DEFLATED, len(head) + 1 + block * blocks
    return path


def lying_stl(path):
    path.write_bytes(bytes(80) + struct.pack("<I", 1 << 31) + bytes(50))
    return path


def fifo(path):
    os.mkfifo(path)
    return path


def given(path):
    return path


CASES = table("handed_over")


@pytest.mark.parametrize("case", CASES)
def test_commands_refuse_in_one_line_and_little_memory(case, tmp_path):
    before, make, name, words = CASES[case]
    command = [sys.executable, "-m", "dexgrasp_env", *before.split(), str(globals()[make](tmp_path / name))]
    # The peak of a process counts that of the one it was forked from: a small one stands in between.
    done = subprocess.run(
        [sys.executable, "-c", PEAK, *command], capture_output=True, cwd=tmp_path, text=True
    )
    said, errors = done.stdout.splitlines(), done.stderr.splitlines()
    assert (done.returncode, len(said)) == (2, 1), errors
    assert words in errors[-1]
    assert len(errors) == 1
    assert int(said[0]) * (1 if sys.platform == "darwin" else 1024) < MOST


READERS = {
    "yaml": read_yaml, "json": lambda path: read_json_object(path, ""), "npz": read_npz, "npy": read_dictionary,
    "safetensors": read_arrays, "jsonl": lambda path: read_lines(path, "trial", lambda _: None),
    "lines.jsonl": lambda path: Lines(path, "trial", lambda _: None), "zip": read_settings,
    "stl": read_mesh, "obj": read_mesh, "glb": read_mesh, "ply": read_mesh, "gltf": read_mesh, "off": read_mesh,
    "pcd": read_scan, "scan.ply": read_scan, "grasp.json": read_grasp, "cell.yaml": read_cell,
    "cameras.yaml": read_cameras, "set.json": lambda path: read_set(str(path)),
    "trajectory.json": lambda path: read_trajectory(path, default_cell()),
    "manifest.json": lambda path: read_manifest(path.parent), "policy.json": lambda path: read_policy(path.parent),
    "run.json": lambda path: read_run(path.parent),
}  # fmt: skip
"""Readers by the file's name, or by how it ends."""


def file_of(kind, folder):
    return folder / (kind if "." in kind else f"x.{kind}")


@pytest.mark.parametrize("kind", READERS)
def test_every_reader_bounds_what_it_reads(kind, tmp_path):
    with refused(r"9,536\.7 MiB, more than the \d+ that are read"):
        READERS[kind](sparse(file_of(kind, tmp_path)))


DAMAGE = {
    "empty": b"", "text": b"hello, I am nothing of the kind\n", "zeros": bytes(40), "cut off": b'{"a": [1, ',
    "lying": b"\x93NUMPY\x01\x00\x02\x00{}", "no text": b"\xfd\xfe", "deep": b"[" * 5_000, "a list": b"[]",
    "a long number": b"1" * 5000, "nan": b'{"a": NaN}',
}  # fmt: skip
UNFINISHED = DAMAGE.keys() - {"text"}  # a last line without its end is left out
FINE = {"yaml": ("empty", "text", "a list", "nan"), "jsonl": UNFINISHED, "lines.jsonl": UNFINISHED}


@pytest.mark.parametrize("damage", DAMAGE)
@pytest.mark.parametrize("kind", READERS)
def test_every_reader_refuses_what_is_damaged_in_one_line(kind, damage, tmp_path):
    path = file_of(kind, tmp_path)
    path.write_bytes(DAMAGE[damage])
    if damage in FINE.get(kind, ()):
        READERS[kind](path)
    elif kind == "npz":  # whose callers say what is wrong
        with pytest.raises(ValueError, match="no archive of plain arrays"):
            read_npz(path)
    else:
        with refused(re.escape(path.name)):
            READERS[kind](path)


@pytest.mark.parametrize("kind", READERS)
def test_every_reader_knows_a_pointer_of_git_lfs(kind, tmp_path):
    path = file_of(kind, tmp_path)
    path.write_text("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n")
    with refused("git lfs pull"):
        READERS[kind](path)


def test_text_is_bounded_closer_than_what_is_binary(tmp_path):
    path = tmp_path / "m.ply"
    path.write_bytes(b"ply\nformat ascii 1.0\n")
    os.truncate(path, 25 << 20)
    with refused(r"24 that are read of ascii \.ply files: save less in it"):
        read_mesh(path)


def test_faces_count_as_often_as_a_scene_shows_them(tmp_path, monkeypatch):
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    scene = trimesh.Scene({"box": box})
    scene.graph.update(frame_to="again", matrix=np.eye(4), geometry="box")
    scene.export(tmp_path / "two.glb")
    assert len(read_mesh(tmp_path / "two.glb").faces) == 24
    monkeypatch.setattr(user_mesh, "_MOST_FACES", 23)
    with refused("24 faces, more than 23: decimate"):
        read_mesh(tmp_path / "two.glb")


def test_points_are_counted_before_they_are_converted(tmp_path, monkeypatch):
    monkeypatch.setattr(cloud, "_MOST_POINTS", 10)
    assert len(cloud_of(np.ones((10, 3), np.int8))) == 10
    with refused("12 points, more than 10"):
        cloud_of(np.ones((3, 4, 3), np.int8))
    header = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nPOINTS 2147483648\nDATA ascii\n"
    (tmp_path / "c.pcd").write_text(header + "1 2 3\n")
    with refused("2,147,483,648 points"):
        read_scan(tmp_path / "c.pcd")


def test_images_are_measured_before_they_become_points(tmp_path, monkeypatch):
    lens = {"width": 10, "height": 8, "fx": 1, "fy": 1, "cx": 1, "cy": 1, "T_base_camera": np.eye(4).tolist()}
    (tmp_path / "cameras.yaml").write_text(yaml.safe_dump({"cameras": [{"depth": "d.png", **lens}] * 2}))
    iio.imwrite(tmp_path / "d.png", np.full((8, 10), 500, np.uint16))
    assert len(read_scan(tmp_path)) == 160
    monkeypatch.setattr(cloud, "_MOST_POINTS", 100)
    with refused("160 points"):
        read_scan(tmp_path)
    monkeypatch.setattr(cloud, "_MOST_POINTS", 10)
    with refused("80 points"):
        read_scan(tmp_path)
    iio.imwrite(tmp_path / "d.png", np.full((40, 50), 500, np.uint16))
    with refused("its camera says 8 rows of 10 pixels"):
        read_scan(tmp_path)


def test_a_full_disk_says_which_file_it_was(tmp_path, monkeypatch):
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OSError, match="No space left") as error:
        write_atomically(tmp_path / "grasp.json", b"{}")
    assert error.value.filename == str(tmp_path / "grasp.json")
    assert not list(tmp_path.iterdir())
