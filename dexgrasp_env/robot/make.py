"""Maker of robot files from a maker's URDF or MJCF: what can be derived is, and what cannot is assumed and noted."""

from dataclasses import replace
from itertools import combinations
from pathlib import Path

import mujoco
import numpy as np
import yaml

from dexgrasp_env.arrays import Array, Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import write_atomically
from dexgrasp_env.poses import inverse, placed, shifted
from dexgrasp_env.robot.description import bearers, pose_of
from dexgrasp_env.robot.hand_maker import PLATE, HandMaker, stated
from dexgrasp_env.robot.hulls import corners_of
from dexgrasp_env.robot.model import posed, swept
from dexgrasp_env.robot.part import NamedParts, Part
from dexgrasp_env.robot.postures import (
    always_near,
    home_posture,
    open_posture,
    overlapping_links,
    put_aside,
)
from dexgrasp_env.robot.rebuilt import FLANGE, about, base_frame, compiled, frame_entry, matrix
from dexgrasp_env.robot.recipes import Recipe
from dexgrasp_env.robot.robot import Frame
from dexgrasp_env.robot.robot_file import SCHEMA, find_beside, make_arm, make_hand
from dexgrasp_env.robot.source import WRIST, branching, limb
from dexgrasp_env.yaml_file import YAML_SUFFIXES


def _gripper_entry(maker: HandMaker, entry: Fields) -> Fields:
    """Return what a gripper's file says: open nearly as far as it opens, rods collide with no part of it."""
    names = [name for finger in entry["fingers"] for name in finger["joints"]]
    open_at = maker.opened[maker.joint_ids(names)]
    bodies = [entry["palm"], *(body for finger in entry["fingers"] for body in finger["bodies"])]
    rods = {body for finger in entry["fingers"][:-2] for body in finger["bodies"]}
    rigid_pairs = [pair for pair in combinations(bodies, 2) if rods & {*pair}]
    entry["open"] = np.clip(np.round(open_at, 6), entry["lower"], entry["upper"]).tolist()
    value = make_hand(entry)
    near = always_near(value, compiled(value))
    return entry | stated({"excluded": [*dict.fromkeys([*rigid_pairs, *near])]})


def hand_entry(
    path: Path, named: NamedParts | None = None, arm: Fields | None = None
) -> tuple[Fields, list[str]]:
    """Return what a hand's file says of a description, and what was assumed.

    Args:
        path: of the description.
        named: parts of the hand that the user names.
        arm: what the file of an arm of the same description says, on which the hand sits as it is there.

    Raises:
        InputError: for what is no hand of two fingers or more.
    """
    maker = HandMaker(path, named)
    entry = maker.entry()
    if arm is not None:
        entry["mounts"]["palm_normal"] = _as_built(maker, arm)
    if maker.jaws:
        return _gripper_entry(maker, entry), maker.notes
    value = make_hand({**entry, "open": np.clip(0.0, entry["lower"], entry["upper"]).tolist()})
    near = always_near(value, compiled(value))
    for _ in range(3):  # overlapping links are excluded in between
        value = replace(value, excluded=near)
        model = compiled(value)
        open_at = open_posture(value, model)
        touching = overlapping_links(model, np.array(open_at))
        if not touching:
            break
        pairs = ", ".join(" and ".join(pair) for pair in touching)
        maker.notes.append(f"hand excluded: {pairs} overlap as they are joined, and do not collide")
        near += touching
    open_at = put_aside(value, model, open_at)
    places = dict(zip(value.joints.names, open_at, strict=True))
    for finger in entry["fingers"]:
        if "aside" in finger:
            finger["aside"] = [places[joint] for joint in finger["joints"]]
    position = entry["mounts"]["palm_normal"]["position"]
    if arm is None:
        behind = FLANGE + PLATE + _behind(model, np.array(open_at), position)
        position[2] = max(position[2], round(behind, 6))
    return entry | stated({"excluded": near, "open": open_at}), maker.notes


def _as_built(maker: HandMaker, arm: Fields) -> Fields:
    """Return how the palm frame sits on the last link of an arm of the same description, as mounts state it."""
    flange = maker.pose(arm["bodies"][-1]) @ matrix(Frame(**arm["frame"]))
    return frame_entry(shifted(flange, -FLANGE * flange[:3, 2]), maker.frame)


def _behind(model: mujoco.MjModel, q: Array, position: Array) -> float:
    """Return how far behind its palm frame an open hand, mounted at `position` (3,) m, reaches near the flange, m."""
    data, most = posed(model, q), 0.0
    T_palm = inverse(pose_of(data.body(1)))
    for g in np.flatnonzero(model.geom_contype).tolist():
        x, y, z = placed(T_palm @ pose_of(data.geom(g)), corners_of(model, g)).T
        near = np.hypot(z + position[0], y - position[1]) < 0.08  # m: as wide as an arm's last link
        most = max(most, -float(x[near].min(initial=0.0)))
    return most


def parts_of(path: Path) -> tuple[bool, bool]:
    """Tell whether a description has a hand, and whether it has an arm: what branches ends in fingers.

    Raises:
        InputError: for what is neither.
    """
    part = Part(path)
    body = branching(part.model)
    branches = bool(part.below(body))
    return branches, len(limb(part.model, body)) > WRIST or not branches


def arm_entry(path: Path) -> tuple[Fields, list[str]]:
    """Return what an arm's file says of a description, and what was assumed.

    Raises:
        InputError: for what is no chain of hinges.
    """
    part = Part(path)
    m, data = part.model, part.data
    root = part.below(0)
    if len(root) != 1:
        raise InputError(f"{path} has {len(root)} chains of bodies: valid is one arm, without a hand")
    chain, fewest = part.chain(root[0]), 4  # joints of an arm: fewer bring no palm over a table
    if any(part.below(b) for b in part.below(chain[-1])):
        part.notes.append(f"the hand in the file hangs on {m.body(chain[-1]).name!r}: the arm ends there")
    low, high = part.ranges(m.body_jntadr[chain[-1:]])[0]
    if len(chain) > fewest and high - low < 2.5 and min(-low, high) < 0.3:  # rad
        jaw = part.names(chain[-1:])[1][0]
        part.notes.append(f"arm: {jaw!r} moves to one side alone, as a jaw does: the arm ends before it")
        chain.pop()
    bodies, joints = part.names(chain)
    if (part.units(part.joint_ids(joints)) < 1.0).any():
        raise InputError(f"{path} has an arm whose joints slide: valid is an arm of hinges")
    if len(joints) < fewest:
        raise InputError(
            f"{path} is one chain of {len(joints)} joints: valid are an arm of {fewest} or more, and a hand of two"
            " fingers that move"
        )
    if root[0] in chain:
        raise InputError(
            f"{path}: the first body turns: valid is a base that stands still, and the arm on it"
        )
    own = [b for b in range(m.nbody) if m.body_weldid[b] == chain[-1] and not _bears(part, b, chain[-1])]
    sites = np.flatnonzero(np.isin(m.site_bodyid, own))  # of a palm are none of the flange's
    axis, anchor = data.xaxis[m.body_jntadr[chain[-1]]], data.xanchor[m.body_jntadr[chain[-1]]]
    along = np.abs(data.site_xmat[sites, 2::3] @ axis) > 1.0 - 1e-6
    sites = sites[along] if along.any() else sites  # others draw axes, for one
    off = np.linalg.norm(np.cross(data.xpos[own] - anchor, axis), axis=1)  # m from the last joint's axis
    marks = [
        b for b, away in zip(own, off, strict=True) if away < 1e-3 and not m.body_geomnum[b]
    ]  # tool0, for one
    last = m.body([*marks, chain[-1]][0])
    flange = pose_of(data.site(sites[-1]) if len(sites) else data.body(last.id))
    if not len(sites):
        part.notes.append(f"arm frame: no site at the flange, the frame of {last.name!r} assumed")
    if abs(axis @ flange[:3, 2]) < 1.0 - 1e-6:
        part.notes.append("arm frame: the flange's z is no axis of the last joint, which is taken")
    wrist, outwards = data.xanchor[m.body_jntadr[chain[-2]]], flange[:3, 2] @ axis
    if abs(outwards) < 0.05:
        outwards = (flange[:3, 3] - wrist) @ axis
    flange = about(flange[:3, 3], axis if outwards >= -1e-9 else -axis, flange[:3, 0])
    shoulder, base = m.joint(joints[1]).id, base_frame(data, joints)
    if base[2, 2] < 1.0:
        part.notes.append(
            f"arm base: {joints[0]!r} turns about a level axis in the file: it stands upright here"
        )
    height = data.xanchor[shoulder] @ base[:3, 2]
    entry: Fields = {
        **part.head(), "bodies": [m.body(root[0]).name, *bodies], "joints": joints,
        "frame": frame_entry(part.pose(chain[-1]), flange),
        **part.limits(joints, "arm"), "shoulder": np.round([0.0, 0.0, height], 4).tolist(),
        "reach": round(_reach(part, flange, chain[-1], shoulder), 3), "shaken": [0, (len(joints) - 1) // 2],
    }  # fmt: skip
    value = make_arm({**entry, "home": np.clip(0.0, entry["lower"], entry["upper"]).tolist()})
    home, found = home_posture(value, compiled(value))
    if not found:
        part.notes.append(
            "arm home: none looks down on the table; state one, and look at the flange's frame and the ranges"
        )
    return entry | {"home": home}, part.notes


def _bears(part: Part, body: int, last: int) -> bool:
    """Tell whether a body on the last link of an arm, or what is between them, bears joints."""
    above = bearers(part.model, body)
    return any(part.below(b) for b in above[: above.index(last)])


def _reach(part: Part, flange: Array, last: int, shoulder: int) -> float:
    """Return the largest distance of the flange from a joint in random postures, m."""
    local = np.linalg.inv(part.pose(last)) @ flange[:, 3]
    low, high = part.ranges().T
    drawn = np.random.default_rng(0).uniform(low, high, (4000, len(low)))
    return max(
        float(np.linalg.norm((pose_of(data.body(last)) @ local)[:3] - data.xanchor[shoulder]))
        for data in swept(part.model, drawn)
    )


def make_robot(
    hand: Path | None,
    arm: Path | None,
    out: Path,
    named: NamedParts | None = None,
    recipe: Recipe | None = None,
) -> list[str]:
    """Write a robot's file, and beside it its hand's and its arm's where they are given as URDF or MJCF.

    Args:
        hand: its description, or a hand's file; None for our Allegro.
        arm: its description, or an arm's file; None for our Panda.
        out: the robot's file to be.
        named: parts of the hand that the user names.
        recipe: of the hand.

    Returns:
        What was assumed, a line each.

    Raises:
        InputError: for a description that no file can be made of.
    """
    files, notes = dict[str, Fields](), list[str]()
    robot = {"name": out.stem, "arm": "panda.yaml", "hand": "allegro.yaml"}
    for kind, path in (("arm", arm), ("hand", hand)):
        if path is not None and path.suffix in YAML_SUFFIXES:
            robot[kind] = str(find_beside(Path(), str(path)).resolve())
        elif path is not None:
            if kind == "arm":
                content, said = arm_entry(path)
            else:
                own = files.get(robot["arm"]) if path == arm else None
                content, said = hand_entry(path, named or (recipe.named if recipe else None), own)
            if recipe is not None and kind == "hand":
                content = recipe.changed(content)
                said.append(
                    f"hand: as the recipe for {recipe.file} says: {recipe.why or 'nothing besides the file'}"
                )
            robot[kind] = f"{out.stem}_{kind}.yaml"
            files[robot[kind]] = {"kind": kind, **content}
            notes += said
    files[out.name] = {"kind": "robot", **robot, "mount": "palm_normal"}
    for name, content in files.items():
        text = yaml.safe_dump(
            {"schema": SCHEMA, **content}, sort_keys=False, default_flow_style=None, width=110
        )
        write_atomically(out.parent / name, text.encode())
    return list(dict.fromkeys(notes))
