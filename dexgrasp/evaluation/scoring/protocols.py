"""Published protocols for grasps of a floating hand.

In all of them the hand moves from pregrasp to grasp to squeeze, and the object, pushed or lifted or shaken, must not
move further than allowed. Success rates are comparable within one protocol only. docs/scoring.md lists deviations from
the publications.
"""

import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from dexgrasp.evaluation.scoring.hand import FloatingGrasp, HandStage
from dexgrasp.evaluation.scoring.scene import BASE, ContactPhysics, FloatingScene, displacement
from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import unknown_name
from dexgrasp_env.poses import rigid, shifted

AXES: dict[str, Array] = {
    f"{sign}{axis}": float(f"{sign}1") * row
    for axis, row in zip("xyz", np.eye(3), strict=True)
    for sign in "-+"
}
"""Six directions of the world in DexGraspBench's order."""


@dataclass(frozen=True)
class Verdict:
    """Outcome of a test.

    Attributes:
        success: by the protocol.
        score: from 0 to 1: share of draws that succeeded where there are several, else 0 or 1.
        reason: code of the failure; None for successes.
        sentence: the same in words.
        moved_m: distance of the object from its expected position when it was judged.
        turned_rad: angle of the object from its expected rotation.
    """

    success: bool
    score: float
    reason: str | None = None
    sentence: str = "held"
    moved_m: float = 0.0
    turned_rad: float = 0.0


class GraspProtocol(ABC):
    """Base of protocols that score a grasp.

    Attributes:
        name: on the command line.
        summary: one line for people.
        physics: friction, solver, servo gain.
        most_moved: m, allowed displacement of the object.
        most_turned: rad, allowed rotation.
        closing: s, from the pregrasp to the grasp, and on to the squeeze.
        gravity: m/s^2.
        density: of the object, kg/m^3; or its `fixed_mass`, kg.
    """

    name: str
    summary: str
    physics: ContactPhysics
    most_moved: float
    most_turned: float
    closing: tuple[float, float]
    gravity: float = 9.81
    density: float = 0.0
    fixed_mass: float | None = None

    def mass(self, candidate: FloatingGrasp) -> float:
        """Return the mass of the object, kg."""
        return self.fixed_mass or self.density * float(candidate.object.mesh.volume)

    @abstractmethod
    def judge(self, candidate: FloatingGrasp, seed: int) -> Verdict:
        """Score a grasp; `seed` is of the protocol's own draws."""

    def _scene(self, candidate: FloatingGrasp) -> FloatingScene:
        """Return the scene with the hand in the pregrasp."""
        scene = FloatingScene(candidate, self.physics, self.mass(candidate))
        scene.reset(candidate.pregrasp)
        return scene

    def _close(self, scene: FloatingScene) -> HandStage:
        """Close from the pregrasp, and return the squeeze."""
        candidate, squeeze = scene.candidate, scene.candidate.squeeze_for(scene.servo_kp)
        scene.move(candidate.pregrasp, candidate.grasp, self.closing[0])
        scene.move(candidate.grasp, squeeze, self.closing[1])
        return squeeze

    def _close_under_weight(self, scene: FloatingScene) -> HandStage:
        """Close while the object's weight acts, and return the squeeze."""
        scene.push(self.gravity * scene.mass * AXES["-z"])
        return self._close(scene)

    def _verdict(self, before: Array, after: Array, when: str) -> Verdict:
        """Judge the object's pose `after` by the expected one, `before`; `when` is for the sentence."""
        moved, turned = displacement(before, after)
        if moved < self.most_moved and turned < self.most_turned:
            return Verdict(True, 1.0, moved_m=moved, turned_rad=turned)
        reason = "moved" if moved >= self.most_moved else "turned"
        how = f"{100 * moved:.1f} cm" if reason == "moved" else f"{math.degrees(turned):.0f} deg"
        return Verdict(False, 0.0, reason, f"{reason} by {how} {when}", moved, turned)


class DexGraspBench(GraspProtocol):
    """Base of both tests of DexGraspBench (BODex, ICRA 2025), with the constants of its code.

    100 g, friction 0.6 / 0.02, a pregrasp at most 10 mm deep.
    """

    most_moved = 0.05
    most_turned = math.radians(15.0)
    fixed_mass = 0.1  # kg
    _most_penetration = 0.010  # m
    closing = (0.4, 0.4)  # 10 x 10 steps of 4 ms each
    gravity = 10.0  # as its code has it

    def _penetrates(self, scene: FloatingScene) -> Verdict | None:
        depth = scene.penetration()
        if depth <= self._most_penetration:
            return None
        return Verdict(
            False, 0.0, "start_penetration", f"the pregrasp is {1000 * depth:.0f} mm in the object"
        )


class DexGraspBenchForceClosure(DexGraspBench):
    """`dgb_fc`: no gravity; 1 N for 2 s along each of six directions, from the start each time."""

    name = "dgb_fc"
    summary = (
        "DexGraspBench force closure: 100 g, mu 0.6, 1 N for 2 s along +-x, y, z; at most 5 cm and 15 deg"
    )
    physics = ContactPhysics()

    def judge(self, candidate: FloatingGrasp, seed: int) -> Verdict:
        """Push along each direction; the first that the grasp does not resist fails it."""
        scene, worst = self._scene(candidate), Verdict(True, 1.0)
        for name, axis in AXES.items():
            scene.reset(candidate.pregrasp)
            if failed := self._penetrates(scene):
                return failed
            self._close(scene)
            scene.push(self.gravity * scene.mass * axis)
            for _ in range(10):
                scene.run(0.2)
                verdict = self._verdict(candidate.T_world_object, scene.pose(), f"pushed along {name}")
                if not verdict.success:
                    return verdict
            worst = max(worst, verdict, key=lambda v: v.moved_m)
        return worst


class DexGraspBenchTabletop(DexGraspBench):
    """`dgb_tabletop`: from a table, lifted 10 cm in 0.4 s."""

    name = "dgb_tabletop"
    summary = "DexGraspBench tabletop: 100 g, mu 0.6, lifted 10 cm from a table; at most 5 cm and 15 deg off"
    physics = ContactPhysics(table_friction=0.6)
    _lift = 0.10  # m

    def judge(self, candidate: FloatingGrasp, seed: int) -> Verdict:
        """Close under the object's weight and lift."""
        scene = self._scene(candidate)
        if failed := self._penetrates(scene):
            return failed
        squeeze, up = self._close_under_weight(scene), self._lift * AXES["+z"]
        scene.move(squeeze, squeeze.shifted(up), 0.4)
        return self._verdict(shifted(candidate.T_world_object, up), scene.pose(), "off after the lift")


class FroggerPick(GraspProtocol):
    """FRoGGeR (IROS 2023), with the figures of its pick-up controller.

    `frogger_pick`: lifted 10 cm in 1 s, held 1.5 s, shaken by 3 mm from a quarter second into the lift on.
    """

    name = "frogger_pick"
    summary = "FRoGGeR's pick: 150 kg/m3, mu 0.7, 10 cm in 1 s, 1.5 s hold, 3 mm shake; at most 7.5 cm and 30 deg off"
    physics = ContactPhysics(
        friction=(0.7, 0.02), table_friction=0.7, servo_kp=10.0, timestep=0.002, impratio=100.0
    )
    most_moved = 0.075
    most_turned = math.radians(30.0)
    density = 150.0
    closing = (0.25, 0.25)
    _lift, _rise, _hold = 0.10, 1.0, 1.5  # m, s, s
    _wait = 0.5  # s before the lift
    _shake_start, _shake = 0.25, 0.003  # s into the lift, m
    _period = 0.01  # s between set-points

    def judge(self, candidate: FloatingGrasp, seed: int) -> Verdict:
        """Lift and hold; judged after every set-point."""
        scene = self._scene(candidate)
        squeeze = self._close_under_weight(scene)
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


class GetAGrip(GraspProtocol):
    """Get a Grip (CoRL 2024): success under noise of the hand's pose.

    `get_a_grip`: five draws of noise on the hand's pose, each closed, lifted 20 cm, shaken by 3 cm.
    """

    name = "get_a_grip"
    summary = "Get a Grip: hand 5 mm and 5 deg off, five draws; 500 kg/m3, mu 0.9, 20 cm lift, 3 cm shake; score: share"
    physics = ContactPhysics(friction=(0.9, 0.02), table_friction=1.0, servo_kp=10.0)
    most_moved = 0.10
    most_turned = math.radians(45.0)
    density = 500.0
    closing = (0.15, 0.10)
    _draws, _noise, _tilt = 5, 0.005, math.radians(5.0)  # m and rad, uniform in each of x, y, z
    _least_links = 3
    _lift, _shake = 0.20, 0.03  # m
    _beat = 325 / 60 / 38  # s: 38 targets in what 400 steps of 1/60 s leave after settling and closing

    def judge(self, candidate: FloatingGrasp, seed: int) -> Verdict:
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

    def _draw(self, scene: FloatingScene, candidate: FloatingGrasp) -> Verdict:
        scene.candidate = candidate
        scene.reset(candidate.pregrasp)
        squeeze = self._close_under_weight(scene)
        for start, end in itertools.pairwise(self._targets()):
            scene.move(squeeze.shifted(start), squeeze.shifted(end), self._beat)
        wanted = np.linalg.inv(candidate.grasp.T_world_hand) @ candidate.T_world_object
        verdict = self._verdict(wanted, np.linalg.inv(scene.pose(BASE)) @ scene.pose(), "in the hand")
        links = {body for body, _, force in scene.hand_contacts() if force > 0.0}
        if verdict.success and len(links) < self._least_links:
            few = f"only {len(links)} links touch it"
            return replace(verdict, success=False, score=0.0, reason="few_contacts", sentence=few)
        return verdict

    def _targets(self) -> Array:
        """Return offsets (38, 3) m of the hand from where it closed: up in eighths, then to and fro along x, y, z."""
        up = [(0, 0, part / 8 * self._lift) for part in (0, 1, 2, 3, 4, 5, 6, 7, 8, 8)]
        top, beats = np.array([0.0, 0.0, self._lift]), (0.5, 1.0, 0.5, 0.0, -0.5, -1.0, -0.5, 0.0, 0.0)
        shakes = [top + self._shake * beat * axis for axis in np.eye(3) for beat in beats]
        return np.array([*up, *shakes, top])


GRASP_PROTOCOLS: dict[str, type[GraspProtocol]] = {
    protocol.name: protocol
    for protocol in (DexGraspBenchForceClosure, DexGraspBenchTabletop, FroggerPick, GetAGrip)
}
"""Protocols for grasp files by name."""


def get_grasp_protocol(name: str) -> GraspProtocol:
    """Return a protocol by name.

    Raises:
        InputError: naming the valid ones.
    """
    if name not in GRASP_PROTOCOLS:
        raise unknown_name("protocol for grasp files", name, GRASP_PROTOCOLS)
    return GRASP_PROTOCOLS[name]()
