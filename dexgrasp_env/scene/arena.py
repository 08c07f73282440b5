"""Table, floor and lights: everything that does not move."""

import mujoco

from dexgrasp_env.assets import asset_path
from dexgrasp_env.robot.model import attach
from dexgrasp_env.scene.constants import TABLE_ABOVE_FLOOR


def read_arena() -> mujoco.MjSpec:
    """Return floor, table, lights and physics, of which `constants` says what others need to know."""
    return mujoco.MjSpec.from_file(str(asset_path("scene", "arena.xml")))


def add_arena(spec: mujoco.MjSpec, base: float) -> None:
    """Add the arena with its physics, and the plinth under a base at height `base` m; the table's top is z = 0."""
    arena = read_arena()
    spec.option, spec.visual = arena.option, arena.visual
    attach(spec, arena, spec.worldbody.add_frame())
    plinth = {
        "type": mujoco.mjtGeom.mjGEOM_CYLINDER,
        "material": "plinth",
        "contype": 0,
        "conaffinity": 0,
        "group": 2,
    }
    half_height, middle = 0.5 * (TABLE_ABOVE_FLOOR + base) - 0.005, 0.5 * (base - TABLE_ABOVE_FLOOR) - 0.005
    spec.worldbody.add_geom(size=[0.11, half_height, 0], pos=[-0.04, 0, middle], **plinth)
    spec.worldbody.add_geom(size=[0.17, 0.012, 0], pos=[-0.04, 0, base - 0.012], **plinth)


def add_furniture(spec: mujoco.MjSpec, name: str) -> None:
    """Stand a `bin` on the table around where all may be in clutter, or a `tray` beside that; cameras see them."""
    attach(spec, mujoco.MjSpec.from_file(str(asset_path("scene", f"{name}.xml"))), spec.worldbody.add_frame())


def add_belt(spec: mujoco.MjSpec, base: str) -> None:
    """Lay a belt in the table, which then is only seen: so heavy that what stands on it does not slow it.

    `base` is the robot's first body.
    """
    table = spec.geom("table")
    table.name, table.contype, table.conaffinity = "table_seen", 0, 0
    belt = spec.worldbody.add_body(name="belt", pos=spec.body("table").pos, gravcomp=1.0)
    belt.add_freejoint(name="belt")
    belt.add_geom(name="table", type=table.type, size=table.size, pos=table.pos, group=3, mass=1000.0)
    spec.add_exclude(bodyname1="belt", bodyname2=base)  # as between bodies that stand still
    spec.option.tolerance = 1e-12  # of the solver, relative to masses
