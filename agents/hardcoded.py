"""The hard-coded baseline of section 3.5 of the supplementary: one posture over the middle of the cloud."""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from dexgrasp.agent import Agent, Observation, Report
from dexgrasp.geometry.convex import ConvexDistance
from dexgrasp.grasp.grasp import GraspMotion
from dexgrasp.grasp.script import ActionScript
from dexgrasp.kinematics.palm_ik import solve_palm
from dexgrasp.kinematics.tree import RobotTree, robot_tree
from dexgrasp.motion.motion import NoPath
from dexgrasp.motion.script import make_script
from dexgrasp.planning.seen import start_of
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.perception.scene import Scene
from dexgrasp_env.tasks.control import normalise

_RING = (0.0, -0.15, 0.0, 0.0)  # out of the way
_OPEN = (-0.149, 0.858, 0.0, 0.044, 0.064, 0.857, 0.0, 0.068, *_RING, 1.38, 0.35, -0.1, 0.2)
_CLOSED = (-0.099, 0.773, 0.936, -0.227, 0.059, 0.768, 0.969, -0.227, *_RING, 1.38, 0.35, 0.45, 0.2)
_FIRM = (-0.099, 0.773, 0.936, -0.227, 0.059, 0.768, 0.969, -0.227, *_RING, 1.38, 0.35, 0.85, 0.2)
_TILT = 0.2  # rad, thumb up: the thumb is the longer
_MIN_POINTS = 20
_HULL_FACES = 80
_IK_ERROR = 0.003  # m


@dataclass(frozen=True)
class HardcodedSettings:
    """What was tuned by hand; lengths in metres, in the frame of the grip.

    That frame has u along the short axis of the object, from thumb to fingers, v across it, z up.

    Attributes:
        u_offset: of the palm from the cloud's mean.
        v_offset: of the palm from the cloud's mean.
        z_offset: of the palm above the cloud's highest point.
        least_z: of the palm above the table, so that the fingertips clear it.
        hand_open: (16,) rad, wide around the object.
        hand_closed: (16,) rad, index and middle where they stay, the thumb half way.
        hand_firm: (16,) rad, thumb set-point inside any object: its servo saturates.
    """

    u_offset: float = 0.010
    v_offset: float = -0.028
    z_offset: float = 0.045
    least_z: float = 0.137
    hand_open: tuple[float, ...] = _OPEN
    hand_closed: tuple[float, ...] = _CLOSED
    hand_firm: tuple[float, ...] = _FIRM


class HardcodedAgent(Agent):
    """Puts the same hand posture over every object and closes it.

    The wrist goes over the mean of the cloud, at a fixed height above its top, turned so that thumb and
    fingers close along the short principal axis of the cloud seen from above. Nothing else of the shape is
    used, but that the way there keeps clear of the cloud's convex hull. Index and middle go to fixed
    positions; the thumb's servo saturates and presses the object against them whatever its width.
    """

    env_settings: ClassVar[Mapping[str, Any]] = {
        "obs_mode": "pointcloud",
        "control_mode": "joint_position",
        "observe": "reset",
    }

    def __init__(self, settings: HardcodedSettings | None = None) -> None:
        self.settings = settings or HardcodedSettings()
        self._script: ActionScript | None = None
        self._rest = np.zeros(23, np.float32)
        self._step = 0

    def reset(self, observation: Observation, info: Mapping[str, Any]) -> None:
        """Plan from the cloud; stand still for the episode where that fails."""
        began = time.perf_counter()
        start = start_of(observation)
        self._step, self._script, self._rest = 0, None, normalise(start).astype(np.float32)
        self.report = Report()
        points = Scene.of_observation(observation).target.points
        if len(points) < _MIN_POINTS:
            self.report.failure = "no_cloud"
            return
        try:
            self._script, details = self._plan(start, points, info.get("mount", "palm_normal"))
            self.report.details = details
        except NoPath as blocked:
            self.report.failure = blocked.reason
            self.report.details = {"detail": blocked.detail}
        except InputError:  # the hull of the points
            self.report.failure = "cloud_has_no_volume"
        self.report.planning_seconds = time.perf_counter() - began

    def act(self, observation: Observation) -> NDArray[np.float32]:
        """Return the next action of the script."""
        if self._script is None:
            return self._rest
        action = self._script.action(self._step)
        self._step += 1
        return action

    def _plan(self, start: Array, points: Array, mount: str) -> tuple[ActionScript, dict[str, Any]]:
        tree, obstacle = robot_tree(mount), _obstacle(points)
        blocked = NoPath("out_of_reach", "the arm reaches neither of the two turns of the wrist")
        for axis, arm in self._reachable(tree, start, points):
            pregrasp, grasp, squeeze = (np.concatenate([arm, hand]) for hand in self._hands())
            motion = GraspMotion(pregrasp, grasp, squeeze)
            try:
                script = make_script(start, motion, obstacle, mount, margin=0.002)
            except NoPath as reason:
                blocked = reason
                continue
            return script, {"grip_axis": axis.tolist(), "phases": list(script.phases)}
        raise blocked

    def _hands(self) -> list[Array]:
        s = self.settings
        return [np.array(hand) for hand in (s.hand_open, s.hand_closed, s.hand_firm)]

    def _reachable(self, tree: RobotTree, start: Array, points: Array) -> list[tuple[Array, Array]]:
        """Grip axes (3,) and arm configurations (7,) of the two wrist turns, nearer to the start first."""
        found = []
        for axis in (short_axis(points), -short_axis(points)):
            R, p = self._palm_goal(points, axis)
            q = start.copy()
            q[7:] = self.settings.hand_open
            q[0] = np.arctan2(p[1], p[0])
            if solve_palm(q, R, p, tree, 300, 1e-5) < _IK_ERROR:
                found.append((float(np.abs(q[:7] - start[:7]).max()), axis, q[:7].copy()))
        return [(axis, arm) for _, axis, arm in sorted(found, key=lambda item: item[0])]

    def _palm_goal(self, points: Array, axis: Array) -> tuple[Array, Array]:
        """Return rotation (3, 3) and position (3,) m of the palm frame for a grip along `axis` (3,)."""
        s = self.settings
        down = np.array([0.0, 0.0, -1.0])
        x = np.cos(_TILT) * down - np.sin(_TILT) * axis
        z = np.sin(_TILT) * down + np.cos(_TILT) * axis
        y = np.cross(z, x)
        position = points.mean(axis=0) + s.u_offset * axis + s.v_offset * y
        position[2] = max(points[:, 2].max() + s.z_offset, s.least_z)
        return np.stack([x, y, z], axis=1), position


def short_axis(points: Array) -> Array:
    """Return the unit vector (3,), level, of the smaller principal axis of points (N, 3) seen from above."""
    flat = points[:, :2] - points[:, :2].mean(axis=0)
    _, axes = np.linalg.eigh((flat[:, :, None] * flat[:, None, :]).mean(axis=0))
    return np.array([*axes[:, 0], 0.0])


def _obstacle(points: Array) -> ConvexDistance:
    """Convex hull of the cloud and its shadow on the table: what cameras miss is below what they see."""
    shadow = points * [1.0, 1.0, 0.0]
    return ConvexDistance.from_points(np.concatenate([points, shadow]), max_faces=_HULL_FACES)
