"""Table, floor and lights: everything that does not move."""

from collections.abc import Sequence

import mujoco

from dexgrasp_env.assets import asset_path
from dexgrasp_env.robot.model import attach
from dexgrasp_env.scene.constants import BIN_THICKNESS, TABLE_HEIGHT


def read_arena() -> mujoco.MjSpec:
    """Return floor, table, lights and physics, of which `constants` says what others need to know."""
    return mujoco.MjSpec.from_file(str(asset_path("scene", "arena.xml")))


def add_arena(spec: mujoco.MjSpec, base: float) -> None:
    """Add the arena with its physics, and the plinth under a base at height `base` m; the table's top is z = 0."""
    arena = read_arena()
    spec.option, spec.visual = arena.option, arena.visual
    attach(spec, arena, spec.worldbody.add_frame())
    plinth = {"type": mujoco.mjtGeom.mjGEOM_CYLINDER, "material": "plinth"}
    unseen = {"contype": 0, "conaffinity": 0, "group": 2}
    half_height, middle = 0.5 * (TABLE_HEIGHT + base) - 0.005, 0.5 * (base - TABLE_HEIGHT) - 0.005
    world = spec.worldbody
    world.add_geom(size=[0.11, half_height, 0], pos=[-0.04, 0, middle], **plinth, **unseen)
    world.add_geom(size=[0.17, 0.012, 0], pos=[-0.04, 0, base - 0.012], **plinth, **unseen)


def add_bin(spec: mujoco.MjSpec, low: Sequence[float], high: Sequence[float], height: float) -> None:
    """Stand walls on the table around a rectangle from `low` to `high` (x, y), m; cameras see them."""
    (x0, y0), (x1, y1) = low, high
    middle, half, thick = (
        (0.5 * (x0 + x1), 0.5 * (y0 + y1)),
        (0.5 * (x1 - x0), 0.5 * (y1 - y0)),
        BIN_THICKNESS,
    )
    walls = [((x, middle[1]), (0.5 * thick, half[1] + thick)) for x in (x0 - 0.5 * thick, x1 + 0.5 * thick)]
    walls += [((middle[0], y), (half[0], 0.5 * thick)) for y in (y0 - 0.5 * thick, y1 + 0.5 * thick)]
    for k, ((x, y), (half_x, half_y)) in enumerate(walls):
        spec.worldbody.add_geom(
            name=f"bin_{k}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[half_x, half_y, 0.5 * height],
            pos=[x, y, 0.5 * height],
            rgba=[0.55, 0.6, 0.65, 1.0],
            group=2,
        )
