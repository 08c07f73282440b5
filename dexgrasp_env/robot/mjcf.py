"""Mends of an MJCF's tree: what a scene has besides the robot, what floats, joints and links without names."""

from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

BASE = "base"
"""Name of the body that everything hangs on where a description has its first links in the world itself."""
_UNREAD = ("custom", "keyframe", "sensor", "size", "skin", "statistic", "texture", "visual")


def as_mjcf(root: Element) -> list[str]:
    """Leave out of an MJCF what is no robot, name and part what is one; return what was changed, a line each."""
    steps = (_drop_unread, _drop_floors, _drop_others, _drop_free_joints, _part_joints, _name)
    return [note for step in steps for note in step(root)]


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


def _drop_floors(root: Element) -> list[str]:
    """Take planes out: a floor is no part of a robot."""
    found = [
        (body, geom) for body in root.iter() for geom in body.findall("geom") if geom.get("type") == "plane"
    ]
    for body, geom in found:
        body.remove(geom)
    return [f"{len(found)} floors are left out"] if found else []


def _drop_others(root: Element) -> list[str]:
    """Leave out objects and goals of a scene, and what names them: no servo or link moves them, others it does."""
    moved = [
        own
        for tag in ("actuator", "tendon", "equality")
        for section in root.iter(tag)
        for own in section.iter()
    ]
    linked, gone = {text for own in moved for text in own.attrib.values()}, set[str]()
    bodies = [(*pair, {own.get("name") for own in pair[1].iter()}) for pair in _first_bodies(root)]
    driven = any(linked & names for _, _, names in bodies)
    for holder, body, names in bodies:
        joints = [joint for joint in body.iter("joint") if joint.get("type") != "free"]
        floats = any(
            body.find(mark) is not None for mark in ("freejoint", "joint[@type='free']", "[@mocap='true']")
        )
        if driven and not linked & names if joints else floats:
            holder.remove(body)
            gone |= {own.get("name", "a body without a name") for own in body.iter("body")}
    if not gone:
        return []
    for section in [*root.findall("equality"), *root.findall("contact")]:
        for own in list(section):
            if gone & {*own.attrib.values()}:
                section.remove(own)
    return [
        f"{', '.join(sorted(gone))} floats, or moves without a servo, as objects of a scene: it is left out"
    ]


def _drop_free_joints(root: Element) -> list[str]:
    """Fix what floats on a free joint."""
    found = [
        (body, joint)
        for body in root.iter("body")
        for joint in body
        if joint.tag == "freejoint" or joint.get("type") == "free"
    ]
    for body, joint in found:
        body.remove(joint)
    return list(dict.fromkeys(f"body {body.get('name', '')!r} floats: it is fixed" for body, _ in found))


def _part_joints(root: Element) -> list[str]:
    """Give each of several joints of a body a body of its own."""
    found = []
    for body in list(root.iter("body")):
        joints = [own for own in body.findall("joint") if own.get("type") != "ball"]
        for k, joint in enumerate(joints[:-1]):
            inner = Element("body", {key: own for key, own in body.items() if key in ("name", "gravcomp")})
            inner.extend(own for own in list(body) if own is not joint)
            for own in list(inner):
                body.remove(own)
            body.append(inner)
            body.set("name", f"{body.get('name', BASE)}_{k}")
            found.append(inner.get("name", ""))
            body = inner
    return [f"joints of {', '.join(map(repr, dict.fromkeys(found)))} get a body each"] if found else []


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


def _held(holder: Element, tag: str) -> list[tuple[Element, Element]]:
    """Return the elements of a tag in another, or in frames in it, each with what it lies in."""
    found = [(holder, own) for own in holder.findall(tag)]
    return found + [pair for frame in holder.findall("frame") for pair in _held(frame, tag)]


def _first_bodies(root: Element) -> list[tuple[Element, Element]]:
    """Return the bodies that lie in the world, each with what holds it."""
    return [pair for world in root.findall("worldbody") for pair in _held(world, "body")]


def take_radians(root: Element, model: mujoco.MjModel) -> str:
    """Read angles in radians where joints would hardly turn: parts of a scene leave the unit to the whole."""
    turning = (model.jnt_limited != 0) & (model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE)
    widths = np.ptp(model.jnt_range[turning], axis=1)
    # Two turns, 12.6 rad, are 0.22 rad where they are read as degrees: no joint turns farther.
    plain = not len(widths) or (np.median(widths) > 0.05 and widths.max() > 0.22)
    if plain or root.find("compiler[@angle='radian']") is not None:
        return ""
    compiler_of(root).set("angle", "radian")
    return f"joints that turn by {widths.max():.2g} rad are in other units than it says: radians are taken"


def gather(root: Element, model: mujoco.MjModel) -> str:
    """Put all that lies in the world below one body where chains of joints begin there."""
    if not _begins_in_world(model):
        return ""
    name = new_name(root, BASE)
    worlds = root.findall("worldbody")
    own = [(world, child) for world in worlds for child in world if child.tag not in ("light", "camera")]
    for world, child in own:
        world.remove(child)
    ElementTree.SubElement(worlds[0], "body", {"name": name}).extend(child for _, child in own)
    return f"links that stand in the world are those of one body, {name!r}"


def _begins_in_world(model: mujoco.MjModel) -> bool:
    """Tell whether chains of joints begin in the world itself, not in one body that stands still."""
    roots = {*model.body_rootid[np.flatnonzero(model.body_jntnum)].tolist()}
    solid = model.geom_bodyid[(model.geom_contype | model.geom_conaffinity) != 0]
    return len(roots) > 1 or bool(len(roots) and model.body_jntnum[min(roots)] and (solid == 0).any())


def new_name(root: Element, name: str) -> str:
    """Return a name that no link or body has, that one or a longer one."""
    taken = {own.get("name") for tag in ("body", "link") for own in root.iter(tag)}
    while name in taken:
        name = f"{name}_{BASE}"
    return name


def compiler_of(root: Element) -> Element:
    """Return the element of a description that tells MuJoCo how to compile it, the last one."""
    found = root.findall("mujoco/compiler" if root.tag == "robot" else "compiler")
    return found[-1] if found else ElementTree.SubElement(root, "compiler")
