"""DexGraspBench (BODex, ICRA 2025): force closure and tabletop, with the constants of its code."""

import math

from dexgrasp.scoring.candidate import Candidate
from dexgrasp.scoring.protocols.base import AXES, GraspProtocol, Verdict
from dexgrasp.scoring.scene import FloatingScene, Physics
from dexgrasp_env.poses import shifted

_GRAVITY = 10.0  # m/s^2, as its code rounds it


class DexGraspBench(GraspProtocol):
    """What both of DexGraspBench's tests share: 100 g, friction 0.6 / 0.02, a pregrasp at most 10 mm deep."""

    most_moved = 0.05
    most_turned = math.radians(15.0)
    fixed_mass = 0.1  # kg
    _most_penetration = 0.010  # m
    _stage = 0.4  # s a stage: 10 x 10 steps of 4 ms

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
    physics = Physics()

    def judge(self, candidate: Candidate, seed: int) -> Verdict:
        """Push along each direction; the first that it does not bear fails it."""
        scene, worst = self._scene(candidate), Verdict(True, 1.0)
        for name, axis in AXES.items():
            scene.reset(candidate.pregrasp)
            failed = self._penetrates(scene)
            if failed is not None:
                return failed
            self._close(scene, self._stage, self._stage)
            scene.push(_GRAVITY * scene.mass * axis)
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
    physics = Physics(table_friction=0.6)
    _lift = 0.10  # m

    def judge(self, candidate: Candidate, seed: int) -> Verdict:
        """Close under the object's weight and lift."""
        scene = self._scene(candidate)
        failed = self._penetrates(scene)
        if failed is not None:
            return failed
        scene.push(_GRAVITY * scene.mass * AXES["-z"])
        squeeze, up = self._close(scene, self._stage, self._stage), self._lift * AXES["+z"]
        scene.move(squeeze, squeeze.shifted(up), self._stage)
        goal = shifted(candidate.T_world_object, up)
        return self._verdict(goal, scene.pose(), "off after the lift")
