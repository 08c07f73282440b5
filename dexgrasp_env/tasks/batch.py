"""The only place that knows `mujoco.batch`: physics of many environments, of several objects, on all cores."""

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array
from dexgrasp_env.extras import usable_cores
from dexgrasp_env.tasks.simulation import Simulation

_CONTROL = int(mujoco.mjtState.mjSTATE_CTRL)


@dataclass
class _Group:
    """The environments that hold one object now: MuJoCo batches models of one layout only."""

    batch: Batch
    models: list[mujoco.MjModel]
    changed: bool = False  # models were exchanged or written to since the batch was told


class BatchPhysics:
    """States of N environments, advanced together.

    Attributes:
        qpos: (N, n + 7) positions after the last step.
        qvel: (N, n + 6) velocities.
        sensors: (N, n) `sensordata`.
    """

    def __init__(
        self, simulations: Mapping[str, Simulation], number: int, threads: int | None = None
    ) -> None:
        """Prepare, without any environment in it yet.

        Args:
            simulations: scenes by object.
            number: N.
            threads: at most so many at a time; None for one a core.
        """
        first = next(iter(simulations.values())).base
        self._simulations, self._number = simulations, number
        self._threads = threads or usable_cores()
        self._groups: dict[str, _Group] = {}
        self._targets = np.full(number, "", dtype=object)
        self._pool = (
            ThreadPoolExecutor(len(simulations)) if self._threads > 1 and len(simulations) > 1 else None
        )
        self.qpos, self.qvel = np.zeros((number, first.nq)), np.zeros((number, first.nv))
        self.sensors = np.zeros((number, first.nsensordata))

    def load(self, i: int, target: str) -> None:
        """Make environment `i` what its object's scene holds now: model, state and sensors."""
        simulation, group = self._simulations[target], self._group(target)
        self._leave(i, target)
        group.models[i], group.changed = simulation.model, True
        group.batch.state[i] = simulation.get_state()
        self._targets[i] = target
        self.qpos[i], self.qvel[i] = simulation.data.qpos, simulation.data.qvel
        self.sensors[i] = simulation.data.sensordata

    def _leave(self, i: int, target: str) -> None:
        """Give back the model of the object that environment `i` had before: several MB each."""
        before = self._targets[i]
        if before and before != target:
            group = self._groups[before]
            group.models[i] = self._simulations[before].base
            group.batch.set_models(group.models)
            group.changed = False

    def state(self, i: int) -> Array:
        """Return the full integration state of environment `i`."""
        return self._groups[self._targets[i]].batch.state[i].copy()

    def step(self, rows: Array, push: Array | None, which: NDArray[np.intp]) -> NDArray[np.int64]:
        """Advance environments by one control step.

        Args:
            rows: (N, frame_skip, n) set-points of the physics steps, rad.
            push: (N, 3) forces on the objects, N, or None where nobody pushes.
            which: indices of those that advance, ascending.

        Returns:
            (N,) warnings that came up, one bit each.
        """
        warnings = np.zeros(self._number, np.int64)
        targets = self._targets[which]
        shares = [(target, which[targets == target]) for target in dict.fromkeys(targets)]
        run = map if self._pool is None or len(shares) == 1 else self._pool.map
        for (_, ids), bits in zip(
            shares, run(lambda share: self._advance(rows, push, *share), shares), strict=True
        ):
            warnings[ids] = bits
        return warnings

    def _advance(
        self, rows: Array, push: Array | None, target: str, ids: NDArray[np.intp]
    ) -> NDArray[np.int64]:
        group, batch = self._groups[target], self._groups[target].batch
        if group.changed:
            batch.set_models(group.models)
            group.changed = False
        if push is not None:
            batch.bind("xfrc_applied")[ids, self._simulations[target].body, :3] = push[ids]
        before = batch.warning[ids, :, 1]  # (n, 7): the batch counts on, after the last info of each
        batch.rollout(rows.shape[1], rows[ids], _CONTROL, record=(), ids=ids)
        self.qpos[ids], self.qvel[ids] = batch.bind("qpos")[ids], batch.bind("qvel")[ids]
        self.sensors[ids] = batch.bind("sensordata")[ids]
        risen = batch.warning[ids, :, 1] > before
        return risen @ (1 << np.arange(risen.shape[1]))

    def _group(self, target: str) -> _Group:
        if target not in self._groups:
            # Groups run at the same time: two threads a core between them keep every core busy to the end.
            share = -(-2 * self._threads // len(self._simulations))
            base = self._simulations[target].base
            threads = 1 if self._threads == 1 else max(1, min(self._threads, share, self._number))
            batch = Batch(base, self._number, threads)
            batch.bind("sensordata")
            self._groups[target] = _Group(batch, [base] * self._number)
        return self._groups[target]

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()
        self._groups.clear()
