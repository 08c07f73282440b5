"""Settings of the environment, checked once at construction, and the weights of the reward; `terms` computes it."""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Annotated, Any

from numpy.random import Generator

from dexgrasp_env.arrays import Array, Fields
from dexgrasp_env.errors import InputError, unknown_argument, unknown_name
from dexgrasp_env.objects.catalogue import OBJECT_SETS
from dexgrasp_env.objects.load import Objects, has_own_size, load_target
from dexgrasp_env.objects.model import ObjectModel
from dexgrasp_env.rendering import RENDER_SIZE, SHOW_CAMERAS
from dexgrasp_env.robot.cell import Cell, make_cell
from dexgrasp_env.scene.constants import CONTROL_PERIOD, CONTROL_STEPS, FRICTION, TIMESTEP
from dexgrasp_env.sensing.sensor import SENSORS, Calibration, SensorModel
from dexgrasp_env.tasks.constants import MAX_EPISODE_STEPS, SHORTEST_SKIP, at_pace
from dexgrasp_env.tasks.control import CONTROL_MODES, GRASP_MODES, ONCE_MODES
from dexgrasp_env.tasks.disturbance import Disturbance
from dexgrasp_env.tasks.observations import FLAT, OBS_SUMS, knows_state
from dexgrasp_env.tasks.placement import PRESENTATIONS, Placement
from dexgrasp_env.tasks.randomisation import Randomisation
from dexgrasp_env.valid import Count, Friction, Mass, Positive, Rule, check, number, one_of, read, refuse_idle

REWARD_MODES = ("dense", "sparse", "best")
WEIGHTS = {
    "reach": 5.0, "close": 10.0, "contact": 5.0, "squeeze": 5.0, "lift": 15.0, "hold": 10.0, "success": 50.0,
}  # fmt: skip
"""Of the terms of the dense reward, in the order in which `terms` writes them."""


def _weights(given: Mapping[str, float]) -> dict[str, float]:
    for term, weight in given.items():
        if term not in WEIGHTS:
            raise unknown_name("reward_weights key", term, WEIGHTS)
        check(f"reward_weights {term}", weight, number(ge=0))
    return dict(given)


BACKENDS = ("mujoco", "warp")
_VIEWS = 4
OF_CAMERAS = ("views", "calibration", "sensor", "observe")
"""Arguments that change nothing where no camera looks."""
PICTURES = ("rgb_array", "depth_array")


@dataclass(frozen=True, kw_only=True)
class LiftSettings:
    """Everything that `gym.make` accepts, in checked form; see `LiftEnv` for meanings.

    `robot` and `mount` are given in the place of `cell`.
    """

    cell: Cell
    objects: Objects = OBJECT_SETS["ycb6"]
    obs_mode: Annotated[str, one_of((*OBS_SUMS, FLAT))] = "state"
    control_mode: Annotated[str, one_of(CONTROL_MODES)] = "joint_delta"
    reward_mode: Annotated[str, one_of(REWARD_MODES)] = "dense"
    friction: Friction | None = None
    mass: Annotated[float, number(gt=0, le=100)] = 1.0
    presentation: Annotated[str, one_of(PRESENTATIONS)] = "rest"
    disturbance: Annotated[Disturbance, Rule("a name or a mapping", Disturbance.of)] = Disturbance()
    object_pose: Placement = Placement()
    randomisation: Randomisation = Randomisation()
    views: tuple[str, ...] | int = _VIEWS
    calibration: Calibration = Calibration()
    sensor: Annotated[
        SensorModel, Rule(f"{', '.join(SENSORS)}, or settings of SensorModel", SensorModel.of)
    ] = field(default_factory=SensorModel.realistic)
    observe: Annotated[str, one_of(("step", "reset", "clear", "10hz"))] = "step"
    mesh_scale: Positive = 1.0
    mesh_mass: Mass | None = None
    render_mode: Annotated[str | None, one_of(("human", *PICTURES))] = None
    render_size: Annotated[tuple[int, int], RENDER_SIZE] = (480, 640)
    render_camera: str = "front"
    reward_weights: Annotated[dict[str, float] | None, Rule("a mapping of weights by term", _weights)] = None
    frame_skip: Annotated[int, number(ge=SHORTEST_SKIP, le=125, whole=True)] = CONTROL_STEPS
    action_scale: Annotated[float, number(gt=0, le=1)] = 1.0
    hold: Count = 1
    reward_scale: Positive = 1.0
    starts: str | None = None
    backend: Annotated[str, one_of(BACKENDS)] = "mujoco"
    device: str | None = None

    @classmethod
    def of(cls, **given: Any) -> "LiftSettings":
        """Check the arguments of the environment.

        Raises:
            InputError: one line that says which is wrong and what is valid.
        """
        known = ["robot", "mount", *(entry.name for entry in fields(cls) if entry.name != "cell")]
        for key in given:
            if key not in known:
                raise unknown_argument(key, known)
        cell = make_cell(given.pop("robot", None), given.pop("mount", None))
        settings = read(cls, given | {"cell": cell})
        check("render_camera", settings.render_camera, one_of((*SHOW_CAMERAS, *cell.camera_names)))
        settings.refuse_contradictions()
        latency = settings.randomisation.latency
        if latency and latency[1] > settings.period:
            raise InputError(
                f"randomisation latency is {latency}: valid is up to a control step, {settings.period} s"
            )
        settings = replace(settings, views=check("views", settings.views, _views_of(cell.camera_names)))
        refuse_idle(settings, settings.needs())
        return settings

    def needs(self) -> dict[str, tuple[bool, str]]:
        """Return the arguments that have an effect beside some others only: whether these are there, and which."""
        meshes = not all(map(has_own_size, self.objects)), "a mesh file among objects"
        cameras = self.sees, "an obs_mode of cameras"
        pictures = self.render_mode in PICTURES, f"a render_mode of {' or '.join(PICTURES)}"
        return {
            **dict.fromkeys(OF_CAMERAS, cameras),
            **dict.fromkeys(("render_size", "render_camera"), pictures),
            **dict.fromkeys(("mesh_scale", "mesh_mass"), meshes),
            "friction": (self.randomisation.friction is None, "a randomisation without friction"),
            "device": (self.backend == "warp", "backend='warp'"),
            "action_scale": (
                self.control_mode in ("joint_delta", "ee_delta"),
                "a control_mode whose actions are changes",
            ),
            "hold": (
                self.control_mode not in ONCE_MODES,
                "a control_mode whose actions are not whole grasps",
            ),
            "reward_weights": (self.reward_mode != "sparse", "reward_mode='dense' or 'best'"),
        }

    def refuse_contradictions(self) -> None:
        """Refuse actions about the object's true place beside cameras alone, and what the GPU's physics lacks.

        Raises:
            InputError: naming the modes that know the state, or the other physics.
        """
        if self.control_mode in GRASP_MODES and not knows_state(self.obs_mode):
            raise InputError(
                f"control_mode {self.control_mode!r} goes to where the object truly is: valid beside it are obs_mode "
                "state, features or state+..., which tell that too"
            )
        if self.backend == "warp" and (self.hold > 1 or self.control_mode in GRASP_MODES):
            raise InputError(
                "backend='warp' has one action a control step, of joints or of the palm: valid is mujoco"
            )
        if self.backend == "warp" and self.disturbance.moves:
            raise InputError(f"backend='warp' has no disturbance {self.disturbance.kind!r}: valid is mujoco")

    @property
    def sees(self) -> bool:
        """True where cameras look."""
        return self.obs_mode not in ("state", FLAT)

    @property
    def period(self) -> float:
        """Seconds of a control step."""
        return TIMESTEP * self.frame_skip

    @property
    def weights(self) -> dict[str, float]:
        """The weight of each term of the reward."""
        return WEIGHTS | (self.reward_weights or {})

    @property
    def agent_info(self) -> Fields:
        """Facts that an agent may know, by name."""
        names = "mount", "cell", "obs_mode", "control_mode", "observe"
        return {"control_period": CONTROL_PERIOD, **{name: getattr(self, name) for name in names}}

    @property
    def disturbance_steps(self) -> int:
        """Control steps that the disturbance takes."""
        return self.disturbance.steps_at(self.frame_skip)

    @property
    def usual_steps(self) -> int:
        """Control steps at 20 Hz that episodes have without a disturbance."""
        return MAX_EPISODE_STEPS

    def warn_of_limit(self, limit: float) -> None:
        """Warn where a usual time limit, which a wrapper keeps, leaves too few seconds at this pace.

        Args:
            limit: of an episode, control steps.
        """
        usual = self.usual_steps, self.usual_steps + self.disturbance.steps_at(CONTROL_STEPS)
        wanted = at_pace(self.usual_steps, self.frame_skip) + self.disturbance_steps
        if limit in usual and limit < wanted:
            warnings.warn(
                f"{limit} steps are {limit * self.period:g} s of the {wanted * self.period:g} s that an episode takes "
                f"with frame_skip={self.frame_skip} and disturbance {self.disturbance.kind!r}: "
                f"pass max_episode_steps={wanted}",
                stacklevel=3,
            )

    @property
    def mount(self) -> str:
        """Name of the hand's mount on the flange."""
        return self.cell.robot.mount.name

    @property
    def target_selection(self) -> str | None:
        """Hint by which perception finds the object; None: it is the largest that is seen."""
        return None

    def friction_of(self, model: ObjectModel) -> float:
        """Return the sliding coefficient given, else the object's own, else the default."""
        return float(self.friction or model.friction or FRICTION)

    def draw_pose(self, model: ObjectModel, size: float, rng: Generator) -> Array:
        """Draw a pose (7,) of an object `size` times as large, m and quaternion wxyz, world frame."""
        pose = self.object_pose.sample(model, rng, self.presentation)
        pose[2] *= size
        return pose

    def load_objects(self, names: Objects) -> dict[str, ObjectModel]:
        """Load objects by name; `mesh_scale` and `mesh_mass` apply to meshes of the user's alone."""
        return {name: load_target(name, self.mesh_scale, self.mesh_mass) for name in names}


def _views_of(cameras: tuple[str, ...]) -> Rule:
    """Return the rule of the cameras that look: names, or how many are drawn at each reset."""
    most = max(len(cameras), _VIEWS)  # a cell with fewer cameras has all of them look

    def validate(value: Any) -> tuple[str, ...] | int:
        """Return how many cameras are drawn, or the names of those that look."""
        if isinstance(value, int):
            return min(int(number(ge=1, le=most, whole=True).validate(value)), len(cameras))
        names = (value,) if isinstance(value, str) else tuple(value)
        if not names or len(set(names)) < len(names) or not set(names) <= set(cameras):
            raise ValueError
        return names

    return Rule(f"1 to {most} cameras, or names of {', '.join(cameras)}, each once", validate)
