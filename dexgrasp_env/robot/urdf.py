"""Mends of a URDF's tree: meshes found, mimics of what moves, last links that collide as they are seen."""

from collections import Counter
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from dexgrasp_env.errors import InputError
from dexgrasp_env.robot.description_text import find_file

_MOVING = ("revolute", "continuous", "prismatic")


def as_urdf(root: Element, path: Path) -> list[str]:
    """Find the meshes of a URDF, drop what MuJoCo cannot show, set its compiler; return what was changed, a line each.

    Raises:
        InputError: for a mesh that is not found, or names that are there twice.
    """
    notes = []
    for old in root.findall("mujoco"):
        root.remove(old)
    settings = {"fusestatic": "false", "strippath": "false", "discardvisual": "true", "meshdir": ""}
    ElementTree.SubElement(ElementTree.SubElement(root, "mujoco"), "compiler", settings)
    for joint in root.findall("joint[@type='floating']"):
        joint.set("type", "fixed")
        notes.append(f"joint {joint.get('name', '')!r} floats: it is fixed")
    notes += [*_check_joints(root, path), *_show_ends(root)]
    for link in root.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            mesh = shape.find("geometry/mesh")
            if mesh is None:
                continue
            found = find_file(str(mesh.get("filename")), path)
            if shape.tag == "visual" and (
                found is None or found.suffix.lower() not in (".obj", ".stl", ".msh")
            ):
                link.remove(shape)
            elif found is None:
                raise InputError(
                    f"{path}: mesh {mesh.get('filename')!r} of link {link.get('name')!r} is not found"
                )
            else:
                mesh.set("filename", str(found))
    return notes


def _check_joints(root: Element, path: Path) -> list[str]:
    """Refuse names of joints or links that are there twice; take out mimics of or by what does not move."""
    for kind in ("joint", "link"):
        (name, count), *_ = Counter(own.get("name") for own in root.findall(kind)).most_common(1) or [("", 0)]
        if count > 1:
            raise InputError(f"{path} has {count} {kind}s of the name {name!r}: give each one its own")
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


def _show_ends(root: Element) -> list[str]:
    """Make visual shapes of last links collide where they have no others; of all links where none has."""
    fixed, bearing = dict[str, str](), set[str]()
    for joint in root.findall("joint"):
        parent, child = (
            str(own.get("link")) for tag in ("parent", "child") for own in joint.findall(tag)[:1]
        )
        if joint.get("type") == "fixed":
            fixed[child] = parent
        else:
            bearing.add(parent)

    def whole(link: str) -> str:
        """Return the link that one is fixed to in the end."""
        for _ in fixed:
            link = fixed.get(link, link)
        return link

    links = {str(link.get("name")): link for link in root.findall("link")}
    solid = {whole(name) for name, link in links.items() if link.find("collision") is not None}
    kept = solid | set(map(whole, bearing)) if solid else set()
    found = [
        name for name, link in links.items() if link.find("visual") is not None and whole(name) not in kept
    ]
    for visual in (own for name in found for own in links[name].findall("visual")):
        visual.tag = "collision"
    return [f"nothing of {', '.join(found)} collides: the visual shapes are taken"] if found else []
