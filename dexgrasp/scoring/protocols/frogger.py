"""FRoGGeR (IROS 2023): a pick from a table, with the figures of its pick-up controller."""

import math
from collections.abc import Iterator

import numpy as np

from dexgrasp.scoring.candidate import Candidate
from dexgrasp.scoring.protocols.base import AXES, GRAVITY, GraspProtocol, Verdict
from dexgrasp.scoring.scene import Physics
from dexgrasp_env.arrays import Array
from dexgrasp_env.poses import shifted


class FroggerPick(GraspProtocol):
    """`frogger_pick`: lifted 10 cm in 1 s, held 1.5 s, shaken by 3 mm from a quarter second into the lift on."""

    name = "frogger_pick"
    summary = "FRoGGeR's pick: 150 kg/m3, mu 0.7, 10 cm in 1 s, 1.5 s hold, 3 mm shake; at most 7.5 cm and 30 deg off"
    physics = Physics(friction=(0.7, 0.02), table_friction=0.7, servo_kp=10.0, timestep=0.002, impratio=100.0)
    most_moved = 0.075
    most_turned = math.radians(30.0)
    density = 150.0
    _lift, _rise, _hold = 0.10, 1.0, 1.5  # m, s, s
    _wait = 0.5  # s before the lift
    _shake_start, _shake = 0.25, 0.003  # s into the lift, m
    _period = 0.01  # s between set-points

    def judge(self, candidate: Candidate, seed: int) -> Verdict:
        """Lift and hold; judged all the way."""
        scene = self._scene(candidate)
        scene.push(GRAVITY * scene.mass * AXES["-z"])
        squeeze = self._close(scene, 0.25, 0.25)
        scene.run(self._wait)
        verdict = Verdict(True, 1.0)
        for time, offset in self._path():
            scene.aim(shifted(squeeze.T_world_hand, offset), squeeze.joints)
            scene.run(self._period)
            goal = shifted(candidate.T_world_object, offset)
            verdict = self._verdict(goal, scene.pose(), f"off, {time:.2f} s into the lift")
            if not verdict.success:
                return verdict
        return verdict

    def _path(self) -> Iterator[tuple[float, Array]]:
        """Yield the time since the lift began, s, and the hand's offset (3,) m."""
        for step in range(1, round((self._rise + self._hold) / self._period) + 1):
            time = step * self._period
            offset = np.array([0.0, 0.0, self._lift * min(time / self._rise, 1.0)])
            if time >= self._shake_start:
                t = time + self._wait
                offset += self._shake * np.array([np.sin(5 * t), np.cos(4 * t), np.cos(3 * t)])
            yield time, offset
