"""Table, floor and lights: everything that does not move."""

import mujoco

from dexgrasp_env.scene.constants import (
    IMPRATIO,
    TABLE_CENTRE_X,
    TABLE_HEIGHT,
    TABLE_SIZE,
    TIMESTEP,
    TOLERANCE,
)

_BOX = mujoco.mjtGeom.mjGEOM_BOX
_CYLINDER = mujoco.mjtGeom.mjGEOM_CYLINDER
VISUAL_GROUP = 2


def set_physics(spec: mujoco.MjSpec) -> None:
    """Set the solver options of `constants`."""
    option = spec.option
    option.timestep = TIMESTEP
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = IMPRATIO
    option.tolerance = TOLERANCE
    # A diverged state must be seen and reported, not silently reset by the engine.
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET


def add_arena(spec: mujoco.MjSpec, base: float) -> None:
    """Add materials, lights, floor, the plinth under a base at height `base` m, and the table, whose top is z = 0."""
    _add_look(spec)
    world = spec.worldbody
    world.add_geom(
        name="floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0, 0, 0.05],
        pos=[0, 0, -TABLE_HEIGHT],
        material="floor",
    )
    half = [0.5 * side for side in TABLE_SIZE]
    table = world.add_body(name="table", pos=[TABLE_CENTRE_X, 0, 0])
    table.add_geom(
        name="table",
        type=_BOX,
        size=half,
        pos=[0, 0, -half[2]],
        material="table",
        condim=3,
    )
    for x in (-1, 1):
        for y in (-1, 1):
            top = -TABLE_SIZE[2]
            leg = dict(pos=[x * (half[0] - 0.05), y * (half[1] - 0.05), 0.5 * (top - TABLE_HEIGHT)])
            size = [0.025, 0.025, 0.5 * (TABLE_HEIGHT + top)]
            table.add_geom(
                type=_BOX, size=size, material="metal", contype=0, conaffinity=0, group=VISUAL_GROUP, **leg
            )
    plinth = dict(material="plinth", contype=0, conaffinity=0, group=VISUAL_GROUP)
    half_height, middle = 0.5 * (TABLE_HEIGHT + base) - 0.005, 0.5 * (base - TABLE_HEIGHT) - 0.005
    world.add_geom(type=_CYLINDER, size=[0.11, half_height, 0], pos=[-0.04, 0, middle], **plinth)
    world.add_geom(type=_CYLINDER, size=[0.17, 0.012, 0], pos=[-0.04, 0, base - 0.012], **plinth)


def _add_look(spec: mujoco.MjSpec) -> None:
    spec.visual.headlight.ambient = [0.42, 0.42, 0.42]
    spec.visual.headlight.diffuse = [0.35, 0.35, 0.35]
    spec.visual.headlight.specular = [0.1, 0.1, 0.1]
    spec.visual.global_.offwidth = 1920
    spec.visual.global_.offheight = 1080
    spec.visual.quality.shadowsize = 2048
    spec.visual.map.znear = 0.005
    texture = mujoco.mjtTexture
    builtin = mujoco.mjtBuiltin
    spec.add_texture(
        name="sky", type=texture.mjTEXTURE_SKYBOX, builtin=builtin.mjBUILTIN_GRADIENT,
        rgb1=[0.90, 0.93, 0.96], rgb2=[0.45, 0.52, 0.60], width=256, height=1536,
    )  # fmt: skip
    spec.add_texture(
        name="floor", type=texture.mjTEXTURE_2D, builtin=builtin.mjBUILTIN_CHECKER,
        rgb1=[0.86, 0.88, 0.90], rgb2=[0.80, 0.82, 0.85], width=256, height=256,
    )  # fmt: skip
    _material(spec, "floor", [1, 1, 1, 1], reflectance=0.05, texture="floor", texrepeat=[2, 2])
    _material(spec, "table", [0.80, 0.72, 0.62, 1], specular=0.15, shininess=0.2)
    _material(spec, "metal", [0.35, 0.36, 0.38, 1], specular=0.5, shininess=0.6)
    _material(spec, "plinth", [0.26, 0.28, 0.31, 1], specular=0.3, shininess=0.4)
    spec.worldbody.add_light(
        name="key", pos=[0.9, -1.0, 1.9], dir=[-0.25, 0.55, -1.0], diffuse=[0.55, 0.55, 0.52],
        specular=[0.25, 0.25, 0.25], castshadow=True, cutoff=60.0,
    )  # fmt: skip
    spec.worldbody.add_light(
        name="fill", pos=[-0.5, 1.2, 1.6], dir=[0.5, -0.6, -0.8], diffuse=[0.22, 0.24, 0.28], castshadow=False
    )


def _material(
    spec: mujoco.MjSpec, name: str, rgba: list[float], texture: str | None = None, **look: object
) -> None:
    material = spec.add_material(name=name, rgba=rgba, **look)
    if texture:
        material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = texture
        material.texuniform = True
