"""Get a Grip (CoRL 2024): success under noise of the hand's pose, lifted from a table and shaken."""

import itertools
import math
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from dexgrasp.scoring.candidate import Candidate
from dexgrasp.scoring.protocols.base import AXES, GRAVITY, GraspProtocol, Verdict
from dexgrasp.scoring.scene import BASE, FloatingScene, Physics
from dexgrasp_env.arrays import Array
from dexgrasp_env.poses import rigid


class GetAGrip(GraspProtocol):
    """`get_a_grip`: five draws of noise on the hand's pose, each closed, lifted 20 cm, shaken by 3 cm."""

    name = "get_a_grip"
    summary = "Get a Grip: hand 5 mm and 5 deg off, five draws; 500 kg/m3, mu 0.9, 20 cm lift, 3 cm shake; score: share"
    physics = Physics(friction=(0.9, 0.02), table_friction=1.0, servo_kp=10.0)
    most_moved = 0.10
    most_turned = math.radians(45.0)
    density = 500.0
    _draws, _noise, _tilt = 5, 0.005, math.radians(5.0)  # m and rad, uniform in each of x, y, z
    _least_links = 3
    _lift, _shake = 0.20, 0.03  # m
    _beat = 325 / 60 / 38  # s: 38 targets in what 400 steps of 1/60 s leave after settling and closing

    def judge(self, candidate: Candidate, seed: int) -> Verdict:
        """Score each draw; all of them must hold for a success."""
        rng, scene = np.random.default_rng(seed), self._scene(candidate)
        verdicts = []
        for _ in range(self._draws):
            shift = rng.uniform(-self._noise, self._noise, 3)
            turn = Rotation.from_euler("xyz", rng.uniform(-self._tilt, self._tilt, 3)).as_matrix()
            verdicts.append(self._draw(scene, candidate.displaced(rigid(turn, shift))))
        held = sum(v.success for v in verdicts)
        worst = next((v for v in verdicts if not v.success), verdicts[-1])
        text = f"{held} of {self._draws} draws held" + ("" if worst.success else f"; {worst.sentence}")
        return replace(worst, score=held / self._draws, sentence=text)

    def _draw(self, scene: FloatingScene, candidate: Candidate) -> Verdict:
        scene.candidate = candidate
        scene.reset(candidate.pregrasp)
        scene.push(GRAVITY * scene.mass * AXES["-z"])
        squeeze = self._close(scene, 0.15, 0.10)
        for start, end in itertools.pairwise(self._targets()):
            scene.move(squeeze.shifted(start), squeeze.shifted(end), self._beat)
        wanted = np.linalg.inv(candidate.grasp.T_world_hand) @ candidate.T_world_object
        found = np.linalg.inv(scene.pose(BASE)) @ scene.pose()
        verdict = self._verdict(wanted, found, "in the hand")
        links = {body for body, _, force in scene.hand_contacts() if force > 0.0}
        if verdict.success and len(links) < self._least_links:
            few = f"only {len(links)} links touch it"
            return replace(verdict, success=False, score=0.0, reason="few_contacts", sentence=few)
        return verdict

    def _targets(self) -> Array:
        """Offsets of the hand (38, 3), m, from where it closed: up by eighths, then to and fro along x, y, z."""
        up = [(0, 0, part / 8 * self._lift) for part in (0, 1, 2, 3, 4, 5, 6, 7, 8, 8)]
        top, beats = np.array([0.0, 0.0, self._lift]), (0.5, 1.0, 0.5, 0.0, -0.5, -1.0, -0.5, 0.0)
        shakes: list[Array] = []
        for axis in np.eye(3):
            shakes += [top + self._shake * beat * axis for beat in beats] + [top]
        return np.array([*up, *shakes, top])
