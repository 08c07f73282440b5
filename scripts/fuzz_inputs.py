"""Damaged inputs for `fuzz.py`: bytes, JSON and meshes changed at random, from good ones of every kind."""

import copy
import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

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
    "--objects", "--object", "--quick", "--workers", "--verify", "--power",
]  # fmt: skip


def change_bytes(data: bytes, rng: Rng) -> bytes:
    """Flip, cut, repeat, insert or empty."""
    raw = bytearray(data)
    for _ in range(int(rng.integers(1, 5))):
        if not raw:
            break
        at, kind = int(rng.integers(len(raw))), int(rng.integers(6))
        if kind == 0:
            raw[at] ^= 1 << int(rng.integers(8))
        elif kind == 1:
            del raw[at:]
        elif kind == 2:
            del raw[at : at + int(rng.integers(1, 40))]
        elif kind == 3:
            raw[at:at] = rng.bytes(int(rng.integers(1, 20)))
        elif kind == 4:
            raw[at:at] = raw[at : at + int(rng.integers(1, 200))]
        else:
            raw[at : at + 4] = rng.choice(
                [b"\xff\xff\xff\xff", b"\x00\x00\x00\x00", b"nan ", b"1e99", b"-1 \n"]
            )
    return bytes(raw)


def change_json(content: Any, rng: Rng) -> bytes:
    """Change some values of a JSON tree, or its text."""
    content = copy.deepcopy(content)
    if rng.random() < 0.15:
        return change_bytes(json.dumps(content).encode(), rng)
    if rng.random() < 0.04:
        return [b"[" * 100_000, b'{"a":' * 50_000, b"9" * 5000, b'"\xff"', b""][int(rng.integers(5))]
    for _ in range(int(rng.integers(1, 4))):
        content = _change_value(content, rng)
    return json.dumps(content).encode()


def _change_value(content: Any, rng: Rng) -> Any:
    places = list(_places(content))
    if not places or rng.random() < 0.02:
        return STRANGE[int(rng.integers(len(STRANGE)))]
    holder, key = places[int(rng.integers(len(places)))]
    value, kind = holder[key], rng.random()
    if kind < 0.15 and isinstance(holder, dict):
        del holder[key]
    elif kind < 0.25 and isinstance(holder, list):
        holder.pop(key)
    elif kind < 0.6 and isinstance(value, int | float) and not isinstance(value, bool):
        holder[key] = value * float(rng.choice([0.0, -1.0, 1.01, 2.0, 1e3, 1e-9, 1e200]))
    else:
        holder[key] = copy.deepcopy(STRANGE[int(rng.integers(len(STRANGE)))])
    return content


def _places(content: Any, depth: int = 0) -> Any:
    """Every (container, key) of a tree, outer ones more often than their share."""
    items = (
        content.items()
        if isinstance(content, dict)
        else enumerate(content)
        if isinstance(content, list)
        else ()
    )
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
    mesh = make[int(rng.integers(len(make)))]()
    if rng.random() < 0.3:
        other = make[int(rng.integers(len(make)))]()
        other.apply_translation(rng.uniform(-0.06, 0.06, 3))
        mesh = trimesh.util.concatenate([mesh, other])
    return mesh


def block(rng: Rng) -> trimesh.Trimesh:
    """Return one of a few blocks, which take no time to decompose."""
    return trimesh.creation.box([0.04, 0.05 + 0.01 * int(rng.integers(12)), 0.06])


def damage(mesh: trimesh.Trimesh, rng: Rng) -> tuple[trimesh.Trimesh, float]:
    """Return a mesh with the faults that real files have, and the scale to read it with."""
    vertices, faces, scale = np.array(mesh.vertices), np.array(mesh.faces), 1.0
    for _ in range(int(rng.integers(0, 4))):
        kind, some = int(rng.integers(14)), rng.random(len(faces)) < rng.uniform(0.01, 0.6)
        if kind == 0 and len(faces):
            faces = faces[~some]
        elif kind == 1:
            faces[some] = faces[some][:, ::-1]
        elif kind == 2:
            vertices = vertices + rng.normal(0, 10 ** rng.uniform(-5, -1.5), vertices.shape)
        elif kind == 3 and len(vertices):
            vertices[int(rng.integers(len(vertices)))] = rng.choice([np.nan, np.inf, 1e308, 1e30, -5.0, 0.0])
        elif kind == 4:
            vertices, scale = vertices * 1000.0, 0.001
        elif kind == 5:
            vertices = vertices * float(rng.choice([1e-6, 0.01, 10.0, 1e6, -1.0]))
        elif kind == 6:
            vertices = vertices + rng.uniform(-1, 1, 3) * 10 ** rng.uniform(-2, 6)
        elif kind == 7:
            vertices = vertices * rng.choice([0.0, 1e-4, 1.0], 3)
        elif kind == 8 and len(faces):
            faces = np.concatenate([faces, faces[some]])
        elif kind == 9 and len(faces):
            faces[some, 0] = faces[some, 1]
        elif kind == 10 and len(vertices):
            faces[some] = rng.integers(0, len(vertices), (int(some.sum()), 3))
        elif kind == 11 and len(faces):
            faces = faces[: int(rng.integers(1, 4))]
        elif kind == 12:
            vertices, faces = vertices[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3)
        elif kind == 13:
            vertices = np.round(vertices, 2)
    return trimesh.Trimesh(vertices, faces, process=False), scale


def mesh_file(path: Path, rng: Rng) -> tuple[Path, float]:
    """Write a damaged mesh; return its path, with a suffix of its kind, and the scale to read it with."""
    kind = ("obj", "stl", "ply", "glb")[int(rng.integers(4))]
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
    good = {
        "list": ["objects"], "plan": ["pear"], "verify": ["x.json"], "doctor": ["x.obj"], "report": ["runs"],
        "evaluate": ["--agents", "random", "--objects", "pear", "--trials", "1"], "compare": ["runs", "a", "b"],
        "replay": ["runs", "--agent", "a", "--object", "b", "--trial", "0"], "benchmark": ["nosuch"],
        "dataset": ["info", "runs"], "train": ["cvae", "--data", "runs", "--out", "runs/t"], "demo": ["--no-video"],
    }  # fmt: skip
    command = str(rng.choice([*good, "", "nosuch"]))
    rest = list(good.get(command, []))
    for _ in range(int(rng.integers(1, 4))):
        word, at = WORDS[int(rng.integers(len(WORDS)))], int(rng.integers(len(rest) + 1))
        rest[at : at + int(rng.integers(2))] = [word]
    return [command, *rest]
