"""Reader of robot descriptions as their makers ship them: URDF or MJCF, cleaned until MuJoCo compiles them.

Each step is a function on the description's XML tree that returns what it changed, a line each.
"""

import re
from collections.abc import Iterator
from contextlib import suppress
from math import inf, prod
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from dexgrasp_env.errors import InputError
from dexgrasp_env.locales import with_decimal_points
from dexgrasp_env.robot.description_text import find_file
from dexgrasp_env.robot.urdf import as_urdf

BASE = "base"
"""Name of the body that everything hangs on where a description has its first links in the world itself."""
_XACRO = "{} is a xacro: expand it first, with `xacro {} > robot.urdf`"
_UNREAD = ("custom", "keyframe", "sensor", "size", "skin", "statistic", "texture", "visual")
_MOST, _DEEPEST = 100_000, 150  # elements of a description, and how deep they nest


class Source(NamedTuple):
    """A description that compiles, and what was changed so that it does."""

    model: mujoco.MjModel
    notes: tuple[str, ...]
    velocity: dict[str, float]
    """rad/s or m/s of the joints that state one (URDF)."""


def read_source(path: Path) -> Source:
    """Return the compiled description of a URDF or MJCF file.

    Raises:
        InputError: in one line, for what MuJoCo cannot read after all mends.
    """
    root = _tree(path)
    _check_size(root, path)
    if root.tag == "robot":
        notes = as_urdf(root, path)
    else:
        notes = [note for step in _BEFORE for note in step(root)]
    model = _compile(root, path, notes)
    if _begins_in_world(model) and root.tag != "robot":
        notes.append(f"links that stand in the world are those of one body, {_gather(root)!r}")
        model = _compile(root, path, notes)
    numbers = (
        model.body_pos,
        model.body_quat,
        model.body_mass,
        model.geom_pos,
        model.geom_size,
        model.jnt_range,
    )
    if not all(np.isfinite(own).all() for own in numbers):
        raise InputError(f"MuJoCo cannot read {path}: a place, size, mass or range in it is no finite number")
    return Source(model, tuple(notes), _velocities(root))


def _velocities(root: Element) -> dict[str, float]:
    """Return the rates of joints that state one, a number that is one."""
    found = dict[str, float]()
    for joint in root.iter("joint"):
        for limit in joint.findall("limit"):
            with suppress(ValueError):
                found[str(joint.get("name"))] = float(limit.get("velocity", 0.0))
    return {name: rate for name, rate in found.items() if 0.0 < rate < inf}


def _tree(
    path: Path, seen: tuple[Path, ...] = (), read: list[int] | None = None, base: Path | None = None
) -> Element:
    """Return the XML tree of a file, what it includes put in its place.

    Args:
        path: of the file.
        seen: files that include or attach it.
        read: bytes that were read so far, of all files.
        base: folder of the model that includes it; its own without.
    """
    path, read = path.resolve(), read or [0]
    if path in seen:
        raise InputError(f"MuJoCo cannot read {path}: it includes itself")
    try:
        if not path.is_file():
            raise OSError
        read[0] += path.stat().st_size
        text = path.read_bytes() if read[0] <= 32 << 20 else b""  # 32 MiB
        if not text or b"<!ENTITY" in text.replace(b"\0", b""):  # in UTF-16 as well
            raise InputError(f"MuJoCo cannot read {path}: it is empty or too large, or defines entities")
        root = ElementTree.fromstring(text)
    except OSError:
        raise InputError(f"MuJoCo cannot read {path}: it is no file") from None
    except ElementTree.ParseError as error:
        said = _XACRO.format(path, path.name) if b"<xacro:" in text else f"MuJoCo cannot read {path}: {error}"
        raise InputError(said) from None
    for element in root.iter():
        if "xacro" in element.tag or any("${" in text or "$(" in text for text in element.attrib.values()):
            raise InputError(_XACRO.format(path, path.name))
        element.tag = element.tag.rpartition("}")[2]  # a namespace says nothing here
    if root.tag not in ("robot", "mujoco", "mujocoinclude"):
        raise InputError(f"MuJoCo cannot read {path}: <{root.tag}> is neither URDF nor MJCF")
    root.tag = root.tag.removesuffix("include")
    base = base or path.parent
    for parent in list(root.iter()):
        for k, child in reversed(list(enumerate(parent))):
            file = base / str(child.get("file"))
            if child.tag == "include":
                parent[k : k + 1] = list(_tree(file, (*seen, path), read, base))
            elif child.tag == "model" and child.get("file"):
                _tree(file, (*seen, path), read)  # MuJoCo ends where one attaches itself
                child.set("file", str(file))
    return root


def _check_size(root: Element, path: Path) -> None:
    """Refuse what is too large or nests too deep to be one robot."""
    level, count, depth = [(root, 1)], 0, 0
    while level:
        count, depth = count + sum(times for _, times in level), depth + 1
        if count > _MOST or depth > _DEEPEST:
            raise InputError(f"{path} has over {_MOST} elements, or {_DEEPEST} in each other: no robot has")
        level = [(child, times * _copies(child)) for element, times in level for child in element]


def _copies(element: Element) -> int:
    """Return how many elements one stands for; a thousand cells of a picture or a field of heights are one."""
    sides = re.findall(r"\d+", element.get("count", ""))
    asks = ("nrow", "ncol", "width", "height", "nuser_")  # for memory
    cells = [text for key, text in element.items() if key.startswith(asks) and text.isdigit()]
    return max(1, prod(map(int, sides))) * max(1, prod(map(int, cells)) // 1000)


def _drop_floors(root: Element) -> list[str]:
    """Take planes out: a floor is no part of a robot."""
    found = [
        (body, geom) for body in root.iter() for geom in body.findall("geom") if geom.get("type") == "plane"
    ]
    for body, geom in found:
        body.remove(geom)
    return [f"{len(found)} floors are left out"] if found else []


def _drop_unread(root: Element) -> list[str]:
    """Take out what nothing here reads: sensors and keyframes, textures and skins, and how a scene is shown."""
    for holder in [root, *root.findall("asset"), *root.findall("deformable")]:
        for own in [own for own in holder if own.tag in _UNREAD]:
            holder.remove(own)
    for material in root.iter("material"):
        material.attrib.pop("texture", None)
        for layer in material.findall("layer"):
            material.remove(layer)
    return []


def _held(holder: Element, tag: str) -> list[tuple[Element, Element]]:
    """Return the elements of a tag in another, or in frames in it, each with what it lies in."""
    found = [(holder, own) for own in holder.findall(tag)]
    return found + [pair for frame in holder.findall("frame") for pair in _held(frame, tag)]


def _first_bodies(root: Element) -> list[tuple[Element, Element]]:
    """Return the bodies that lie in the world, each with what holds it."""
    return [pair for world in root.findall("worldbody") for pair in _held(world, "body")]


def _drop_others(root: Element) -> list[str]:
    """Leave out what floats or is moved by hand and has no joints, objects and goals of a scene, and what names it."""
    gone = set[str]()
    for holder, body in _first_bodies(root):
        free = body.find("freejoint") is not None or body.find("joint[@type='free']") is not None
        joints = [joint for joint in body.iter("joint") if joint.get("type") != "free"]
        if (free or body.get("mocap") == "true") and not joints:
            holder.remove(body)
            gone |= {own.get("name", "a body without a name") for own in body.iter("body")}
    if not gone:
        return []
    for section in [*root.findall("equality"), *root.findall("contact")]:
        for own in list(section):
            if gone & {*own.attrib.values()}:
                section.remove(own)
    return [f"{', '.join(sorted(gone))} has no joints and floats or is moved by hand: it is left out"]


def _drop_free_joints(root: Element) -> list[str]:
    """Fix what floats, on a free joint or on six of its own."""
    found = [
        (body, joint)
        for body in root.iter("body")
        for joint in body
        if joint.tag == "freejoint" or joint.get("type") == "free"
    ]
    for _, body in _first_bodies(root):
        if len(own := body.findall("joint")) >= 6:  # one a direction
            found += [(body, joint) for joint in own]
    for body, joint in found:
        body.remove(joint)
    return list(dict.fromkeys(f"body {body.get('name', '')!r} floats: it is fixed" for body, _ in found))


def _name(root: Element) -> list[str]:
    """Name bodies that bear others or have joints, and joints, where they have no name."""
    bodies = [
        body
        for body in root.iter("body")
        if any(body.find(f".//{tag}") is not None for tag in ("body", "joint"))
    ]
    joints = [joint for body in bodies for _, joint in _held(body, "joint")]
    notes = []
    for what, all_of in ((BASE, bodies), ("joint", joints)):
        found = [own for own in all_of if not own.get("name")]
        for k, own in enumerate(found):
            own.set("name", f"{what}_{k}")
        notes += (
            [f"{len(found)} {found[0].tag}s without a name are called {what}_0 and so on"] if found else []
        )
    return notes


def _part_joints(root: Element) -> list[str]:
    """Give each of several joints of a body a body of its own, all but the last ones of next to no mass."""
    found = []
    for body in list(root.iter("body")):
        joints = [own for own in body.findall("joint") if own.get("type") != "ball"]
        for k, joint in enumerate(joints[:-1]):
            inner = Element("body", {key: own for key, own in body.items() if key in ("name", "gravcomp")})
            inner.extend(own for own in list(body) if own is not joint)
            for own in list(inner):
                body.remove(own)
            ElementTree.SubElement(
                body, "inertial", {"pos": "0 0 0", "mass": "1e-4", "diaginertia": "1e-8 1e-8 1e-8"}
            )
            body.append(inner)
            body.set("name", f"{body.get('name', BASE)}_{k}")
            found.append(inner.get("name", ""))
            body = inner
    return [f"joints of {', '.join(map(repr, dict.fromkeys(found)))} get a body each"] if found else []


def _gather(root: Element) -> str:
    """Put all that lies in the world below one body; return its name, which no other has."""
    taken, name = {body.get("name") for body in root.iter("body")}, BASE
    while name in taken:
        name = f"{name}_{BASE}"
    worlds = root.findall("worldbody")
    own = [(world, child) for world in worlds for child in world if child.tag not in ("light", "camera")]
    for world, child in own:
        world.remove(child)
    ElementTree.SubElement(worlds[0], "body", {"name": name}).extend(child for _, child in own)
    return name


def _begins_in_world(model: mujoco.MjModel) -> bool:
    """Tell whether chains of joints begin in the world itself, not in one body that stands still."""
    roots = {*model.body_rootid[np.flatnonzero(model.body_jntnum)].tolist()}
    solid = model.geom_bodyid[(model.geom_contype | model.geom_conaffinity) != 0]
    return len(roots) > 1 or bool(len(roots) and model.body_jntnum[min(roots)] and (solid == 0).any())


def _compile(root: Element, path: Path, notes: list[str]) -> mujoco.MjModel:
    """Compile a tree, mending what MuJoCo asks for."""
    message, meshes = "", dict[str, bytes]()
    for _ in range(100):  # one change after the other
        try:
            spec = with_decimal_points(_spec, root, path, meshes)
            model = with_decimal_points(spec.compile)
        except (ValueError, OSError, MemoryError) as error:
            message = " ".join(str(error).split())
        else:
            notes += _balanced(spec, model)
            return model
        mends = (said for step in _AFTER for said in step(root, message))
        mend = next(mends, None) or _fetch(root, message, path, meshes)
        if mend is None:
            break
        notes.append(mend)
    raise InputError(f"MuJoCo cannot read {path}: {message[:200]}")


def _spec(root: Element, path: Path, meshes: dict[str, bytes]) -> mujoco.MjSpec:
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"), assets=meshes)
    if root.tag == "mujoco":
        spec.modelfiledir = str(path.resolve().parent)
        spec.meshdir, spec.texturedir = _folder(path, spec.meshdir), _folder(path, spec.texturedir)
    spec.compiler.balanceinertia = True
    return spec


def _balanced(spec: mujoco.MjSpec, model: mujoco.MjModel) -> list[str]:
    """Return a line on the bodies whose inertia MuJoCo made alike about all axes: what was stated is no body's."""
    found = []
    for body in spec.bodies:
        xx, yy, zz, xy, xz, yz = body.fullinertia
        full = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        stated = body.inertia if np.isnan(xx) else np.linalg.eigvalsh(full)
        alike = np.ptp(model.body_inertia[body.id]) == 0.0 and model.body_mass[body.id] > 0.0
        if body.explicitinertial and alike and np.ptp(stated) > 1e-6 * np.max(stated):
            found.append(body.name)
    names = ", ".join(map(repr, found))
    said = f"inertias of {names} are no body's (A + B < C): their means are taken about all axes"
    return [said] if found else []


def _fetch(root: Element, message: str, path: Path, meshes: dict[str, bytes]) -> str | None:
    """Find or convert the file that MuJoCo could not open or decode; None where it is no such matter."""
    named = re.search(r"file '([^']+)'", message)
    file = named[1] if named else ""
    owners = [(e, key) for e in root.iter() for key in ("file", "filename") if file and e.get(key)]
    owner = next(((e, key) for e, key in owners if file.endswith(str(e.get(key)))), None)
    if owner is None:
        return None
    element, key = owner
    if not Path(file).is_file():
        found = find_file(file, path)
        if found is None:
            return None
        element.set(key, str(found))
        return f"{file} is not there: {found} is taken"
    if "decoder" not in message:
        return None
    from dexgrasp_env.objects.user_mesh import read_mesh

    own = f"{len(meshes)}_{Path(file).stem}.obj"
    try:
        mesh = read_mesh(Path(file))
    except InputError as error:
        raise InputError(f"MuJoCo cannot read {path}: {error}") from None
    if len(mesh.faces) > 100_000:  # MuJoCo takes minutes over more; what collides is a hull anyway
        mesh = mesh.convex_hull
    meshes[own] = str(mesh.export(file_type="obj")).encode()
    if root.tag == "mujoco" and not element.get("name"):
        element.set("name", Path(file).stem)
    element.set(key, own)
    return f"meshes that MuJoCo cannot read are converted: {Path(file).suffix}"


def _folder(path: Path, name: str) -> str:
    """Return the folder of meshes that a file names: relative to itself, or to a folder above it."""
    places = [folder / name for folder in path.resolve().parents]
    return str(next((place for place in places if place.is_dir()), places[0]))


def _drop_attribute(root: Element, message: str) -> Iterator[str]:
    """Drop an attribute of another version of MuJoCo."""
    found = re.search(r"unrecognized attribute: '([\w.]+)'\s*Element '([\w.]+)'", message)
    if found is None:
        return
    name, tag = found.groups()
    if owners := [element for element in root.iter(tag) if name in element.attrib]:
        for element in owners:
            del element.attrib[name]
        yield f"attribute {name!r} of <{tag}> is of another MuJoCo: it is left out"


def _from_shapes(root: Element, message: str) -> Iterator[str]:
    """Take a body's mass and inertia from its shapes where those that are stated are none."""
    found = re.search(r"Element name '([^']*)'", message)
    if found is None or not re.search("must have positive eigenvalues|mass and inertia", message):
        return
    for body in [*root.iter("link"), *root.iter("body")]:
        if body.get("name") == found[1] and (inertial := body.find("inertial")) is not None:
            body.remove(inertial)
            yield f"mass or inertia of {found[1]!r} is none: that of its shapes is taken"


def _drop_actuator(root: Element, message: str) -> Iterator[str]:
    """Drop a servo of what is not in the file."""
    found = re.search(r"unknown transmission target '([^']*)'", message)
    for section in root.findall("actuator") if found else ():
        for servo in list(section):
            if found and any(text == found[1] for key, text in servo.items() if key != "name"):
                section.remove(servo)
                what = f"actuator {servo.get('name', '')!r} drives {found[1]!r}"
                yield f"{what}, which is not in the file: it is left out"
                return


_BEFORE = (_drop_unread, _drop_floors, _drop_others, _drop_free_joints, _part_joints, _name)
_AFTER = (_drop_actuator, _drop_attribute, _from_shapes)
