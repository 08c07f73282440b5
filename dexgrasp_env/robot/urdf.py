"""Mends of a URDF's tree: meshes found, mimics of what moves, last links that collide as they are seen."""

from collections import Counter
from contextlib import suppress
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from dexgrasp_env.errors import InputError
from dexgrasp_env.robot.description_text import find_file

_MOVING = ("revolute", "continuous", "prismatic")
_SHAPES = ("box", "capsule", "cylinder", "mesh", "sphere")

Parents = dict[str, tuple[str, bool]]
"""Of each link that hangs on another, that one, and whether it is fixed to it."""


def as_urdf(root: Element, path: Path) -> list[str]:
    """Find the meshes of a URDF, drop what MuJoCo cannot show, set its compiler; return what was changed, a line each.

    Raises:
        InputError: for a shape that MuJoCo does not know, a mesh that is not found, links that make no tree, or names
            that are there twice.
    """
    notes = []
    for old in root.findall("mujoco"):
        root.remove(old)
    settings = {"fusestatic": "false", "strippath": "false", "discardvisual": "true", "meshdir": ""}
    ElementTree.SubElement(ElementTree.SubElement(root, "mujoco"), "compiler", settings)
    for joint in root.findall("joint"):
        if (kind := joint.get("type")) in ("floating", "planar"):
            joint.set("type", "fixed")
            notes.append(f"joint {joint.get('name', '')!r} is {kind}: it is fixed")
    parents = _parents(root, path)
    notes += [*_drop_lonely(root, parents), *_drop_mimics(root), *_show_ends(root, parents), *_weigh(root)]
    for link in root.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            fault = _find_shape(shape, path)
            if fault and shape.tag == "visual":
                link.remove(shape)
            elif fault:
                raise InputError(f"{path}: {fault.format(link=repr(link.get('name')))}")
    return notes


def _find_shape(shape: Element, path: Path) -> str:
    """Put in where the mesh of a shape is; return what is wrong with it, with room for the link's name."""
    form = shape.find("geometry/*")
    if form is None or form.tag not in _SHAPES:
        what = "none" if form is None else f"<{form.tag}>"
        return f"a shape of link {{link}} is {what}: valid are {', '.join(_SHAPES)}"
    if form.tag != "mesh":
        return ""
    found = find_file(str(form.get("filename")), path)
    if found is None:
        return f"mesh {form.get('filename')!r} of link {{link}} is not found"
    form.set("filename", str(found))
    is_read = shape.tag == "collision" or found.suffix.lower() in (".obj", ".stl", ".msh")
    return "" if is_read else "a picture alone"


def _parents(root: Element, path: Path) -> Parents:
    """Return which link hangs on which.

    Raises:
        InputError: for names that are there twice, joints of links that are not there, and circles.
    """
    for kind in ("joint", "link"):
        (name, count), *_ = Counter(own.get("name") for own in root.findall(kind)).most_common(1) or [("", 0)]
        if count > 1:
            raise InputError(f"{path} has {count} {kind}s of the name {name!r}: give each one its own")
    links, found = {str(link.get("name")) for link in root.findall("link")}, Parents()
    for joint in root.findall("joint"):
        ends = [str(own.get("link")) for tag in ("parent", "child") for own in joint.findall(tag)[:1]]
        if len({*ends} & links) < 2:
            named = " and ".join(map(repr, ends))
            raise InputError(f"{path}: joint {joint.get('name')!r} joins {named}: valid are two of its links")
        parent, child = ends
        if child in found:
            raise InputError(
                f"{path}: link {child!r} hangs on {found[child][0]!r} and {parent!r}: valid is one"
            )
        found[child] = parent, joint.get("type") == "fixed"
    known = set[str]()
    for link in found:
        path_up = set[str]()
        while link in found and link not in known:
            known.add(link)
            path_up.add(link)
            link = found[link][0]
        if link in path_up:
            raise InputError(f"{path}: joints close a circle at link {link!r}: valid is a tree")
    return found


def _drop_lonely(root: Element, parents: Parents) -> list[str]:
    """Leave out links that hang on nothing and bear nothing, beside those that do."""
    joined = parents.keys() | {parent for parent, _ in parents.values()}
    found = [link for link in root.findall("link") if joined and link.get("name") not in joined]
    for link in found:
        root.remove(link)
    return [f"link {link.get('name')!r} hangs on nothing: it is left out" for link in found]


def _weigh(root: Element) -> list[str]:
    """Leave a link one inertial at most, with a mass; where the inertia is missing it gets that of 2 cm around it."""
    found = []
    for link in root.findall("link"):
        for k, own in enumerate(link.findall("inertial")):
            mass = own.find("mass")
            if k or mass is None:
                link.remove(own)
            elif own.find("inertia") is None:
                with suppress(ValueError):  # MuJoCo says it of what is no number
                    about = str(float(mass.get("value", "")) * 0.02**2)
                    alike = dict.fromkeys(("ixx", "iyy", "izz"), about)
                    ElementTree.SubElement(own, "inertia", alike | dict.fromkeys(("ixy", "ixz", "iyz"), "0"))
            else:
                continue
            found.append(repr(link.get("name")))
    names = ", ".join(dict.fromkeys(found))
    return (
        [f"{names} say mass or inertia not at all, or twice: 2 cm around the mass assumed"] if found else []
    )


def _drop_mimics(root: Element) -> list[str]:
    """Take out mimics of or by what does not move."""
    joints = root.findall("joint")
    moving, notes = {joint.get("name") for joint in joints if joint.get("type") in _MOVING}, []
    for joint in joints:
        mimic, name = joint.find("mimic"), joint.get("name")
        if mimic is not None and not {name, mimic.get("joint")} <= moving:
            joint.remove(mimic)
            notes.append(
                f"joint {name!r} mimics {mimic.get('joint')!r}: one of them does not move, it is left out"
            )
    return notes


def _show_ends(root: Element, parents: Parents) -> list[str]:
    """Make visual shapes of last links collide where they have no others; of all links where none has."""

    def whole(link: str) -> str:
        """Return the link that one is fixed to in the end."""
        while link in parents and parents[link][1]:
            link = parents[link][0]
        return link

    links = {str(link.get("name")): link for link in root.findall("link")}
    solid = {whole(name) for name, link in links.items() if link.find("collision") is not None}
    bearing = {whole(parent) for parent, is_fixed in parents.values() if not is_fixed}
    kept = solid | bearing if solid else set()
    found = [
        name for name, link in links.items() if link.find("visual") is not None and whole(name) not in kept
    ]
    for visual in (own for name in found for own in links[name].findall("visual")):
        visual.tag = "collision"
    return [f"nothing of {', '.join(found)} collides: the visual shapes are taken"] if found else []
