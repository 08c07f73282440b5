"""Damaged inputs for `fuzz.py`: bytes, JSON and meshes changed at random, from good ones of every kind."""

import copy
import io
import json
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import trimesh
import yaml

from dexgrasp_env.arrays import Array
from dexgrasp_env.poses import quat_to_matrix

Rng = np.random.Generator
STRANGE = [
    None, True, False, 0, -1, 1, 2**31, 2**63, -(2**70), 0.5, -0.0, 1e-300, 1e308, -1e9, float("nan"), float("inf"),
    "", " ", "x", "\x00", "é\u2603", "../../up", "/", "~nosuchuser/x.obj", "a" * 300, "\udcff", [], {}, [[]],
    [1, "2"], {"a": 1},
]  # fmt: skip
WORDS = [
    "pear", "sugar_box", "seen", "all20", "bilevel", "random", "hardcoded", "cvae", "os:system", "os:nosuch",
    "json:loads", "no.such:Agent", "ppo:x.zip", "x.zip", "a:b:c", ":", "::", ".", "-", "--", "-1", "0", "1", "3",
    "1e9", "nan", "inf", "-inf", "1e-300", "1e308", "0.001", "9" * 5000, "0x10", "1_0", "", " ", "\n",
    "~nosuchuser/x.obj", "/dev/null", "/dev/full", "/proc/self/mem", "/nowhere/x", "x.obj", "a" * 300, "\udcff",
    "é", "--json", "--help", "--seed", "--out", "--mesh-scale", "--mesh-mass", "--friction", "--mount",
    "palm_normal", "--trials", "--video", "failures", "--protocol", "lift", "lift-v0", "--agent", "--agents",
    "--objects", "--object", "--quick", "--workers", "--verify",
]  # fmt: skip


def change_bytes(data: bytes, rng: Rng) -> bytes:
    """Leave out, repeat or overwrite pieces, short ones mostly."""
    raw = bytearray(data)
    for _ in range(int(rng.integers(1, 5))):
        at, size = int(rng.integers(len(raw) + 1)), int(10 ** rng.uniform(0, 3))
        piece = bytes(raw[at : at + size])
        others = [
            b"",
            piece + piece,
            rng.bytes(size),
            b"\xff\xff\xff\xff",
            b"\x00\x00\x00\x00",
            b"nan ",
            b"1e99",
            b"-1 \n",
        ]
        raw[at : at + size] = _one_of(others, rng)
    return bytes(raw)


def change_json(content: Any, rng: Rng) -> bytes:
    """Change some values of a JSON tree, or its text."""
    content = copy.deepcopy(content)
    if rng.random() < 0.15:
        return change_bytes(json.dumps(content).encode(), rng)
    if rng.random() < 0.04:
        return _one_of([b"[" * 100_000, b'{"a":' * 50_000, b"9" * 5000, b'"\xff"', b""], rng)
    for _ in range(int(rng.integers(1, 4))):
        content = _change_value(content, rng)
    return json.dumps(content).encode()


def _change_value(content: Any, rng: Rng) -> Any:
    places = list(_places(content))
    if not places or rng.random() < 0.02:
        return _one_of(STRANGE, rng)
    holder, key = _one_of(places, rng)
    value, kind = holder[key], rng.random()
    if kind < 0.15 and isinstance(holder, dict):
        del holder[key]
    elif kind < 0.25 and isinstance(holder, list):
        holder.pop(key)
    elif kind < 0.6 and isinstance(value, int | float) and not isinstance(value, bool):
        holder[key] = value * float(rng.choice([0.0, -1.0, 1.01, 2.0, 1e3, 1e-9, 1e200]))
    else:
        holder[key] = copy.deepcopy(_one_of(STRANGE, rng))
    return content


def _places(content: Any, depth: int = 0) -> Any:
    """Every (container, key) of a tree, outer ones more often than their share."""
    items = enumerate(content) if isinstance(content, list) else getattr(content, "items", tuple)()
    for key, value in items:
        yield from [(content, key)] * (3 if depth < 2 else 1)
        yield from _places(value, depth + 1)


def change_zip(data: bytes, rng: Rng) -> bytes:
    """Change an entry of a zip, leave one out, or change the bytes of the whole."""
    if rng.random() < 0.3:
        return change_bytes(data, rng)
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(out, "w") as new:
        names = old.namelist()
        chosen, kind = names[int(rng.integers(len(names)))], rng.random()
        for name in names:
            content = old.read(name)
            if name == chosen:
                if kind < 0.25:
                    continue
                content = b"" if kind < 0.35 else _changed_entry(content, rng)
            new.writestr(name, content)
    return out.getvalue()


def change_file(path: Path, rng: Rng) -> bytes:
    """Return the content of a file changed as what it is, JSON or zip, or as bytes."""
    content = path.read_bytes()
    if path.suffix == ".json" and rng.random() < 0.7:
        return change_json(json.loads(content), rng)
    if path.suffix == ".yaml" and rng.random() < 0.8:
        return change_json(yaml.safe_load(content), rng)  # JSON is YAML
    if path.suffix == ".xml" and rng.random() < 0.8:
        return change_xml(content, rng)
    if path.suffix == ".npz" and rng.random() < 0.6:
        return change_zip(content, rng)
    return change_bytes(content, rng)


def change_xml(data: bytes, rng: Rng) -> bytes:
    """Leave elements out, repeat them in others, or change their attributes."""
    root = ElementTree.fromstring(data)
    for _ in range(int(rng.integers(1, 4))):
        elements, kind = list(root.iter()), rng.random()
        parent, element = _one_of([e for e in elements if len(e)], rng), _one_of(elements, rng)
        if kind < 0.15 and len(parent):
            parent.remove(parent[int(rng.integers(len(parent)))])
        elif kind < 0.25:
            parent.append(copy.deepcopy(element))
        elif element.attrib:
            key = _one_of(sorted(element.attrib), rng)
            words = element.attrib.pop(key).split() or [""]
            if kind > 0.35:
                words[int(rng.integers(len(words)))] = str(_one_of([*STRANGE, 0, -1, 1e-9, 1e9, "palm"], rng))
                element.attrib[key] = " ".join(words)
    return ElementTree.tostring(root)


def _changed_entry(content: bytes, rng: Rng) -> bytes:
    try:
        return change_json(json.loads(content), rng)
    except ValueError:
        return change_bytes(content, rng)


def solid(rng: Rng) -> trimesh.Trimesh:
    """Return a closed body of 2 to 20 cm."""
    make = [
        lambda: trimesh.creation.box(rng.uniform(0.01, 0.2, 3)),
        lambda: trimesh.creation.icosphere(2, float(rng.uniform(0.01, 0.08))),
        lambda: trimesh.creation.cylinder(float(rng.uniform(0.01, 0.06)), float(rng.uniform(0.02, 0.2)), sections=16),
        lambda: trimesh.creation.torus(0.05, float(rng.uniform(0.005, 0.02)), 16, 8),
        lambda: trimesh.creation.annulus(0.02, 0.04, float(rng.uniform(0.02, 0.15)), sections=16),
    ]  # fmt: skip
    mesh = _one_of(make, rng)()
    if rng.random() < 0.3:
        other = _one_of(make, rng)()
        other.apply_translation(rng.uniform(-0.06, 0.06, 3))
        mesh = trimesh.util.concatenate([mesh, other])
    return mesh


def block(rng: Rng) -> trimesh.Trimesh:
    """Return one of a few blocks, which take no time to decompose."""
    return trimesh.creation.box([0.04, 0.05 + 0.01 * int(rng.integers(12)), 0.06])


def _turned(points: Array, rng: Rng) -> Array:
    quat = rng.normal(size=4)
    return points @ quat_to_matrix(quat / np.linalg.norm(quat)).T


def _not_finite(points: Array, rng: Rng) -> Array:
    some = rng.random(len(points)) < rng.choice([1.5 / len(points), rng.uniform()])
    return np.where(some, rng.choice([np.nan, np.inf, -np.inf, 1e300]), points.T).T


MOVES: tuple[Callable[[Array, Rng], Array], ...] = (
    _turned,
    _not_finite,
    lambda points, rng: points + rng.normal(0.0, 10 ** rng.uniform(-5.0, -1.5), points.shape),
    lambda points, rng: points * rng.choice([1e-6, 0.01, 10.0, 1e3, 1e6]),
    lambda points, rng: points * rng.choice([-1.0, 0.0, 1e-4, 1.0], 3),
    lambda points, rng: points + rng.uniform(-1.0, 1.0, 3) * 10 ** rng.uniform(-2.0, 6.0),
    lambda points, rng: np.round(points, 2),
)
"""What happens to points, (N, 3): turned, not finite, noisy, of another unit, mirrored or flat, far away, rounded."""
_FACES: tuple[Callable[[Any, Any, int, Rng], Any], ...] = (
    lambda faces, some, count, rng: faces[~some],
    lambda faces, some, count, rng: np.where(some, faces[:, ::-1].T, faces.T).T,
    lambda faces, some, count, rng: np.concatenate([faces, faces[some]]),
    lambda faces, some, count, rng: np.where(some, faces[:, [1, 1, 2]].T, faces.T).T,
    lambda faces, some, count, rng: np.where(some, rng.integers(0, count, faces.T.shape), faces.T).T,
    lambda faces, some, count, rng: faces[: int(rng.integers(1, 4))],
)
"""What happens to some of the faces: lost, turned, doubled, without area, between any of `count` vertices, few left."""


def damage(mesh: trimesh.Trimesh, rng: Rng) -> tuple[trimesh.Trimesh, float]:
    """Return a mesh with up to three faults that real files have, and the scale to read it with."""
    vertices, faces = np.array(mesh.vertices), np.array(mesh.faces)
    for _ in range(int(rng.integers(0, 4))):
        if rng.random() < 0.5:
            vertices = _one_of(MOVES, rng)(vertices, rng)
        else:
            some = rng.random(len(faces)) < rng.uniform(0.01, 0.6)
            faces = _one_of(_FACES, rng)(faces, some, len(vertices), rng)
    if rng.random() < 0.1:  # triangles that share no vertex
        vertices, faces = vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3)
    scale = 0.001 if rng.random() < 0.1 else 1.0
    return trimesh.Trimesh(vertices / scale, faces, process=False), scale


def _one_of(things: Sequence[Any], rng: Rng) -> Any:
    return things[int(rng.integers(len(things)))]


def mesh_file(path: Path, rng: Rng) -> tuple[Path, float]:
    """Write a damaged mesh; return its path, with a suffix of its kind, and the scale to read it with."""
    kind = _one_of(("obj", "stl", "ply", "glb"), rng)
    mesh, scale = damage(solid(rng), rng)
    try:
        data = mesh.export(file_type=kind)
    except Exception:  # what cannot be written is a fault of the input, not of the reader
        data = b""
    raw = data.encode() if isinstance(data, str) else bytes(data)
    if rng.random() < 0.25:
        raw = change_bytes(raw, rng)
    path = path.with_suffix(f".{kind}")
    path.write_bytes(raw)
    return path, scale


def arguments(rng: Rng) -> list[str]:
    """Return arguments as somebody in a hurry types them; long work is not asked for."""
    good = (
        "list objects", "plan pear", "verify x.json", "doctor x.obj", "report runs", "compare runs a b",
        "evaluate --agents random --objects pear --trials 1", "replay runs --agent a --object b --trial 0",
        "benchmark nosuch", "dataset info runs", "train cvae --data runs --out runs/t", "demo --no-video",
    )  # fmt: skip
    command, *rest = _one_of([*map(str.split, good), [""], ["nosuch"]], rng)
    for _ in range(int(rng.integers(1, 4))):
        word, at = _one_of(WORDS, rng), int(rng.integers(len(rest) + 1))
        rest[at : at + int(rng.integers(2))] = [word]
    return [command, *rest]
