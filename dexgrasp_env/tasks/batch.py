"""Physics of many environments, of several objects, on all cores, by `mujoco.batch`, which only this file knows."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array, Index
from dexgrasp_env.cores import usable_cores
from dexgrasp_env.tasks.disturbance import drive_belt
from dexgrasp_env.tasks.simulation import CONTROL, PhysicsState, Simulation

if TYPE_CHECKING:
    from dexgrasp_env.tasks.episodes import Episodes


@dataclass
class _Group:
    """The environments of one scene: MuJoCo batches models of one layout only.

    Any may be in a scene of one object, one alone in a scene with neighbours, which is its own.
    """

    batch: Batch
    models: list[mujoco.MjModel]
    first: int  # environment whose state is the batch's first
    changed: bool = False  # models were exchanged or written to since the batch was told


class BatchPhysics:
    """States of N environments, advanced together.

    Attributes:
        current: where they are after the last step.
    """

    def __init__(self, episodes: "Episodes", threads: int | None) -> None:
        """Prepare for episodes, none of which has begun, on so many threads at a time; None for one a core."""
        shared, neighbours = list(episodes.simulations.values()), episodes.neighbours
        first, number = shared[0].base, len(episodes.slots)
        self._number = number
        self._threads = threads or usable_cores()
        self._groups: dict[Simulation, _Group] = {}
        self._scenes = np.full(number, None, dtype=object)
        # Groups run at the same time: two threads a core between them keep every core busy to the end.
        groups = number if neighbours else len(shared)
        self._share = min(self._threads, -(-2 * self._threads // groups), number)
        self._pool = (
            ThreadPoolExecutor(min(groups, 2 * self._threads) if neighbours else groups)
            if self._threads > 1 and groups > 1
            else None
        )
        sizes = first.nq + 7 * neighbours, first.nv + 6 * neighbours, first.nsensordata + neighbours
        self.current = PhysicsState(*(np.zeros((number, size)) for size in sizes))
        self.peak_forces = np.zeros(number)

    def load(self, i: int, simulation: Simulation) -> None:
        """Make environment `i` what a scene holds now: model, state and sensors."""
        if simulation not in self._groups:
            first, number = (i, 1) if simulation.neighbours else (0, self._number)
            batch = Batch(simulation.base, number, min(self._share, number))
            batch.bind("sensordata")
            self._groups[simulation] = _Group(batch, [simulation.base] * number, first)
        group = self._groups[simulation]
        self._leave(i, simulation)
        row = i - group.first
        group.models[row], group.changed = simulation.model, True
        group.batch.state[row] = simulation.get_state()
        self._scenes[i], self.peak_forces[i] = simulation, 0.0
        self._note(slice(i, i + 1), *simulation.current)

    def _note(self, ids: Any, *values: Array) -> None:
        """Write positions, velocities and sensors of environments, zeros where there is room for more objects."""
        for whole, part in zip(self.current, values, strict=True):
            whole[ids, : part.shape[-1]] = part
            whole[ids, part.shape[-1] :] = 0.0

    def _leave(self, i: int, simulation: Simulation) -> None:
        """Give back the model of the scene that environment `i` had before: several MB each."""
        before = self._scenes[i]
        if before is None or before is simulation:
            return
        if before.neighbours:
            del self._groups[before]
            return
        group = self._groups[before]
        group.models[i] = before.base
        group.batch.set_models(group.models)
        group.changed = False

    def state(self, i: int) -> Array:
        """Return the full integration state of environment `i`."""
        group = self._groups[self._scenes[i]]
        return group.batch.state[i - group.first].copy()

    def step(self, rows: Array, push: Array | None, which: NDArray[np.intp]) -> Index:
        """Advance environments by one control step; see `Physics`."""
        warnings = np.zeros(self._number, np.int64)
        scenes = self._scenes[which]
        shares = [(scene, which[scenes == scene]) for scene in dict.fromkeys(scenes)]
        run = map if self._pool is None or len(shares) == 1 else self._pool.map
        for (_, ids), bits in zip(
            shares, run(lambda share: self._advance(rows, push, *share), shares), strict=True
        ):
            warnings[ids] = bits
        return warnings

    def _advance(self, rows: Array, push: Array | None, scene: Simulation, ids: NDArray[np.intp]) -> Index:
        group = self._groups[scene]
        batch, own = group.batch, ids - group.first
        if group.changed:
            batch.set_models(group.models)
            group.changed = False
        if scene.belt and push is not None:
            qpos, qvel = batch.bind("qpos"), batch.bind("qvel")
            for row, i in zip(own, ids, strict=True):
                drive_belt(qpos[row], qvel[row], scene.cell.robot.dof, push[i])
        elif push is not None:
            batch.bind("xfrc_applied")[own, scene.body, :3] = push[ids]
        before = batch.warning[own, :, 1]  # (n, 7): the batch counts on, after the last info of each
        record = ("sensordata",) if scene.neighbours or scene.watches_forces else ()
        readings = batch.rollout(rows.shape[1], rows[ids], CONTROL, record=record, ids=own)
        sensors = batch.bind("sensordata")[own]
        if scene.neighbours:
            sensors[:, scene.touches] = readings["sensordata"][:, :, scene.touches].max(axis=1)
        if scene.watches_forces:
            self.peak_forces[ids] = scene.peaks_of(readings["sensordata"])
        self._note(ids, batch.bind("qpos")[own], batch.bind("qvel")[own], sensors)
        risen = batch.warning[own, :, 1] > before
        return risen @ (1 << np.arange(risen.shape[1]))

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()
        self._groups.clear()
