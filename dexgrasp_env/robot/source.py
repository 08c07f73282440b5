"""Reader of robot descriptions as their makers ship them: URDF or MJCF, cleaned until MuJoCo compiles them.

Each step is a function on the description's XML tree that returns what it changed, a line each.
"""

import re
from collections.abc import Iterator
from contextlib import suppress
from itertools import dropwhile
from math import inf, prod
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element
from xml.parsers.expat import ExpatError, ParserCreate

import mujoco
import numpy as np

from dexgrasp_env.errors import InputError
from dexgrasp_env.locales import with_decimal_points
from dexgrasp_env.robot.description_text import find_file
from dexgrasp_env.robot.mjcf import as_mjcf, compiler_of, gather, new_name, take_radians
from dexgrasp_env.robot.urdf import as_urdf

WRIST = 3
"""Joints before the palm: more are an arm's."""
_NEXT_TO_NONE = {"boundmass": "1e-4", "boundinertia": "1e-8"}  # kg, kg m2
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
        notes = as_mjcf(root)
    meshes = dict[str, bytes]()
    model = _compile(root, path, notes, meshes)
    for mend in (_part_palm,) if root.tag == "robot" else (take_radians, gather, _part_palm):
        if said := mend(root, model):
            notes.append(said)
            model = _compile(root, path, notes, meshes)
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
    return Source(model, (*notes, *_servo_ranges(model)), _velocities(root))


def _servo_ranges(model: mujoco.MjModel) -> list[str]:
    """Narrow joints to where their servos can be sent; return a line on those that lose, or get, a range.

    A tendon's servo gives ranges to joints that have none, as if they moved alike.
    """
    m, found, scale = model, [], -model.actuator_biasprm[:, 1] * model.actuator_gear[:, 0]
    holds = (m.actuator_ctrllimited != 0) & (scale > 0.0)
    for a in np.flatnonzero(holds & (m.actuator_dyntype != mujoco.mjtDyn.mjDYN_INTEGRATOR)).tolist():
        ends = (m.actuator_gainprm[a, 0] * m.actuator_ctrlrange[a] + m.actuator_biasprm[a, 0]) / scale[a]
        moved = [(m.actuator_trnid[a, 0], 1.0)] * (m.actuator_trntype[a] == mujoco.mjtTrn.mjTRN_JOINT)
        if m.actuator_trntype[a] == mujoco.mjtTrn.mjTRN_TENDON:
            joints, coefs = wrapped_joints(m, m.actuator_trnid[a, 0])
            total = sum(map(abs, coefs))
            moved = [
                (j, np.sign(c) * total)
                for j, c in zip(joints, coefs, strict=True)
                if c and not m.jnt_limited[j]
            ]
        for joint, lever in moved:
            was = m.jnt_range[joint] if m.jnt_limited[joint] else np.array([-np.inf, np.inf])
            now = np.clip(np.sort(ends / lever), *was)
            if now[0] < now[1] and np.abs(now - was).max() > 0.01:  # rad or m: less is rounding
                found.append(m.joint(joint).name)
                m.jnt_range[joint], m.jnt_limited[joint] = now, True
    return [f"ranges of {', '.join(found)} are those of their servos, which are narrower"] if found else []


def wrapped_joints(model: mujoco.MjModel, tendon: int) -> tuple[list[int], list[float]]:
    """Return the joints of a fixed tendon and their coefficients; nothing of one that runs over sites or pulleys."""
    own = slice(model.tendon_adr[tendon], model.tendon_adr[tendon] + model.tendon_num[tendon])
    if (model.wrap_type[own] != mujoco.mjtWrap.mjWRAP_JOINT).any():
        return [], []
    return model.wrap_objid[own].tolist(), model.wrap_prm[own].tolist()


def below(model: mujoco.MjModel, body: int) -> list[int]:
    """Return the bodies that hang on a body and have or lead to joints."""
    children = np.flatnonzero(model.body_parentid == body).tolist()
    return [b for b in children if b and (model.body_jntnum[b] or below(model, b))]


def branching(model: mujoco.MjModel, body: int = 0) -> int:
    """Return the first body from one on, by default the world, that bears several chains, or the last one."""
    while len(found := below(model, body)) == 1:
        (body,) = found
    return body


def limb(model: mujoco.MjModel, body: int) -> list[int]:
    """Return the jointed bodies from the world to a body: those before the first that has a shape let it float."""
    found, shown = list[int](), {*model.body_weldid[model.geom_bodyid].tolist()}
    while body:
        found += [body] * int(model.body_jntnum[body] > 0)
        body = int(model.body_parentid[body])
    return list(dropwhile(lambda own: own not in shown, reversed(found)))


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
        root = _parsed(text)
    except OSError:
        raise InputError(f"MuJoCo cannot read {path}: it is no file") from None
    except ExpatError as error:
        raise InputError(f"MuJoCo cannot read {path}: {error}") from None
    for element in root.iter():
        if "xacro" in element.tag or any("${" in text or "$(" in text for text in element.attrib.values()):
            raise InputError(f"{path} is a xacro: expand it first, with `xacro {path.name} > robot.urdf`")
        element.tag = element.tag.rpartition(":")[2]
        for prefixed in [key for key in element.attrib if ":" in key or key == "xmlns"]:
            del element.attrib[prefixed]
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


def _parsed(text: bytes) -> Element:
    """Return the tree of an XML text, names with the prefixes that it writes: some makers' are bound to nothing."""
    builder, parser = ElementTree.TreeBuilder(), ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = builder.start, builder.end
    parser.Parse(text, True)
    return builder.close()


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


def _part_palm(root: Element, model: mujoco.MjModel) -> str:
    """Give what bears the fingers on the last link of an arm a body of its own, the palm: the link is the arm's."""
    body = branching(model)
    name = model.body(body).name
    if not model.body_jntnum[body] or len(limb(model, body)) <= WRIST or len(below(model, body)) < 2:
        return ""
    palm = new_name(root, f"{name}_palm")
    if root.tag == "robot":
        for parent in root.findall(f"joint/parent[@link='{name}']"):
            parent.set("link", palm)
        ElementTree.SubElement(root, "link", {"name": palm})
        joint = ElementTree.SubElement(root, "joint", {"name": palm, "type": "fixed"})
        for tag, link in (("parent", name), ("child", palm)):
            ElementTree.SubElement(joint, tag, {"link": link})
    for own in root.findall(f".//body[@name='{name}']"):
        moved = [child for child in own if child.find(".//joint") is not None]
        for child in moved:
            own.remove(child)
        ElementTree.SubElement(own, "body", {"name": palm}).extend(moved)
    return f"fingers hang on {name!r}, the arm's last link: their palm is {palm!r}, which has no shape"


def _compile(root: Element, path: Path, notes: list[str], meshes: dict[str, bytes]) -> mujoco.MjModel:
    """Compile a tree, mending what MuJoCo asks for; `meshes` gets those that are converted."""
    message = ""
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
    folder, suffix, converted = file.removesuffix(str(element.get(key))), Path(file).suffix, dict[Path, str]()
    for own, key in owners:
        place = Path(folder + str(own.get(key)))
        if place.suffix == suffix and place.is_file():
            if root.tag == "mujoco" and not own.get("name"):
                own.set("name", place.stem)
            converted[place] = converted.get(place) or _convert(place, path, meshes)
            own.set(key, converted[place])
    return f"meshes that MuJoCo cannot read are converted: {suffix}"


def _convert(file: Path, path: Path, meshes: dict[str, bytes]) -> str:
    """Add a mesh of a description to those that are converted; return what it is called there."""
    from dexgrasp_env.objects.user_mesh import read_mesh

    name = f"{len(meshes)}_{file.stem}.obj"
    try:
        mesh = read_mesh(file)
    except InputError as error:
        raise InputError(f"MuJoCo cannot read {path}: {error}") from None
    if len(mesh.faces) > 100_000:  # MuJoCo takes minutes over more; what collides is a hull anyway
        mesh = mesh.convex_hull
    meshes[name] = str(mesh.export(file_type="obj")).encode()
    return name


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
    """Take a body's mass and inertia from its shapes where those that are stated are none; of none, a grain's."""
    found = re.search(r"Element name '([^']*)'", message)
    if found is None or not re.search("must have positive eigenvalues|mass and inertia", message):
        return
    for body in [*root.iter("link"), *root.iter("body")]:
        if body.get("name") == found[1] and (inertial := body.find("inertial")) is not None:
            body.remove(inertial)
            yield f"mass or inertia of {found[1]!r} is none: that of its shapes is taken"
            return
    settings = compiler_of(root)
    if "mjMINVAL" in message and "boundmass" not in settings.attrib:
        settings.attrib |= _NEXT_TO_NONE
        yield f"{found[1]!r} has neither mass nor shapes: what has none gets next to none"


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


_AFTER = (_drop_actuator, _drop_attribute, _from_shapes)
