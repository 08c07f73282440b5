"""The only place that knows mujoco_warp: physics of many environments on a GPU, or on the processor, as one graph."""

from collections.abc import Iterable
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array
from dexgrasp_env.errors import InputError
from dexgrasp_env.extras import from_extra
from dexgrasp_env.scene.merged import MergedScene
from dexgrasp_env.tasks.simulation import Simulation, warning_mask

with from_extra():
    import warp as wp

    wp.config.log_level = wp.LOG_ERROR  # that there is no GPU is said by `_find`, to who asks for one
    import mujoco_warp as mjw

_ROWS = 128  # of constraints that a world has room for: random actions reach 87
_CONTACTS = 32  # a world, all worlds together: random actions have 24
_STATE = ("qpos", "qvel", "ctrl", "qacc_warmstart")
_OVERFLOW = mjw.OverflowType
_FULL = {
    "CNSTRFULL": _OVERFLOW.NEFC | _OVERFLOW.NJMAX_NNZ,
    "CONTACTFULL": _OVERFLOW.BROADPHASE | _OVERFLOW.NARROWPHASE | _OVERFLOW.CCD | _OVERFLOW.EPA_HORIZON
    | _OVERFLOW.CONTACT_MATCH,
}  # fmt: skip
"""MuJoCo's warning -> what a world may run out of."""
_TOO_LARGE = 1e10  # mjMAXVAL


@wp.kernel(enable_backward=False)
def _scatter(
    rows: wp.array2d[wp.int32],
    worlds: wp.array[wp.int32],
    first: int,
    column: int,
    out: wp.array2d[wp.int32],
) -> None:
    """Write columns of rows, from `first`, to an array's columns, from `column`, in the rows of the worlds."""
    row, k = wp.tid()
    out[worlds[row], column + k] = rows[row, first + k]


class WarpPhysics:
    """States of N environments, advanced together on a device; it is used as `BatchPhysics` is.

    Every world advances at each step, those too whose episode is over. A world whose numbers go wrong, or that meets
    more contacts or constraints than there is room for, is told with MuJoCo's warnings.

    Attributes:
        qpos: (N, n + 7) positions after the last step.
        qvel: (N, n + 6) velocities.
        sensors: (N, n) `sensordata`.
    """

    def __init__(
        self, simulations: Iterable[Simulation], number: int, device: str | None, frame_skip: int
    ) -> None:
        """Prepare, without any environment in it yet.

        Args:
            simulations: scenes of one object that environments share.
            number: N.
            device: as warp names it: `cuda:0`, `cpu`; None: a GPU where there is one.
            frame_skip: physics steps of a control step.

        Raises:
            InputError: if there is no such device.
        """
        scenes = list(simulations)
        self._device = _find(device)
        self._merged = MergedScene([scene.object for scene in scenes], scenes[0].cell)
        self._scenes = [scenes[0]] * number
        self._push_column = 6 * scenes[0].body
        self._pending: dict[int, NDArray[np.int32]] = {}
        self._graph: Any = None
        model = _accepted(self._merged.model)
        example = self._merged.fields(scenes[0].object, scenes[0].base)
        worlds = max(number, 2)  # warp looks for absent meshes only where they differ between worlds
        with wp.ScopedDevice(self._device):
            self._model = mjw.put_model(model, batch_sizes=dict.fromkeys(example, worlds))
            self._model.opt.warn_overflow = 0  # it is read at every step instead
            self._data = mjw.make_data(model, nworld=number, nconmax=_CONTACTS, njmax=_ROWS)
            self._controls = wp.zeros((frame_skip, number, model.nu), dtype=float)
        columns = {name: self._merged.first_column(name) for name in example}
        self._targets = [(_as_ints(getattr(self._model, name)), column) for name, column in columns.items()]
        self._targets += [(_as_ints(getattr(self._data, name)), 0) for name in _STATE]
        self._widths = [value.size for value in example.values()]
        self._widths += [array.shape[1] for array, _ in self._targets[len(example) :]]
        self._pushes = _as_ints(self._data.xfrc_applied)
        self.qpos, self.qvel = np.zeros((number, model.nq)), np.zeros((number, model.nv))
        self.sensors = np.zeros((number, model.nsensordata))

    def load(self, i: int, simulation: Simulation) -> None:
        """Make environment `i` what a scene holds now: model, state and sensors; the device hears of it at a step.

        Raises:
            InputError: for an object with meshes of another size than its own: worlds share them.
        """
        if simulation.variation.size != 1.0 and any(part.kind == "mesh" for part in simulation.object.parts):
            name = simulation.object.name
            raise InputError(
                f"backend='warp' scales no meshes, and {name} has some: leave randomisation size out"
            )
        data = simulation.data
        fields = self._merged.fields(simulation.object, simulation.model)
        values = [*fields.values(), *(getattr(data, name) for name in _STATE)]
        self._pending[i] = np.concatenate([_bits(value) for value in values])
        self._scenes[i] = simulation
        self.qpos[i], self.qvel[i], self.sensors[i] = data.qpos, data.qvel, data.sensordata

    def state(self, i: int) -> Array:
        """Return the full integration state of environment `i`."""
        self._flush()
        simulation = self._scenes[i]
        mujoco.mj_resetData(simulation.model, simulation.data)
        self._fetch(i, simulation)
        return simulation.get_state()

    def _fetch(self, i: int, simulation: Simulation) -> None:
        for name in _STATE:
            getattr(simulation.data, name)[:] = getattr(self._data, name).numpy()[i]

    def advance(self, simulation: Simulation, rows: Array) -> int:
        """Advance the one environment that there is from what a scene holds, and have the scene hold what is then.

        Of applied forces only that on the object counts.

        Args:
            simulation: the scene.
            rows: (1, frame_skip, n) set-points of the physics steps, rad.

        Returns:
            The warnings that came up, one bit each.
        """
        data = simulation.data
        self.load(0, simulation)
        bits = self.step(rows, data.xfrc_applied[None, simulation.body, :3], np.arange(1))
        self._fetch(0, simulation)
        data.sensordata[:] = self.sensors[0]
        return int(bits[0])

    def step(self, rows: Array, push: Array | None, which: NDArray[np.intp]) -> NDArray[np.int64]:
        """Advance environments by one control step; arguments and result as of `BatchPhysics.step`."""
        self._flush()
        if push is not None:
            self._scatter(np.arange(len(push)), _bits(push), [(self._pushes, self._push_column)], [3])
        self._controls.assign(np.ascontiguousarray(rows.swapaxes(0, 1), dtype=np.float32))
        if self._graph is None:
            self._capture()
        wp.capture_launch(self._graph)
        data = self._data
        self.qpos[which], self.qvel[which] = data.qpos.numpy()[which], data.qvel.numpy()[which]
        self.sensors[which] = data.sensordata.numpy()[which]
        warnings = np.zeros(len(rows), np.int64)
        warnings[which] = self._warnings(data.overflow.numpy())[which]
        return warnings

    def _warnings(self, overflow: NDArray[np.int32]) -> NDArray[np.int64]:
        """Return the warnings (N,), one bit each, that the last step gives rise to."""
        bad = {"BADQPOS": _bad(self.qpos), "BADQVEL": _bad(self.qvel)}
        bad |= {name: overflow & int(kinds) > 0 for name, kinds in _FULL.items()}
        bits = np.zeros(len(overflow), np.int64)
        for name, rows in bad.items():
            bits[rows] |= warning_mask(name)
        return bits

    def _capture(self) -> None:
        """Record the control step: what it launches is compiled, or found compiled, in a step that is undone."""
        before = [getattr(self._data, name).numpy().copy() for name in _STATE]
        with wp.ScopedDevice(self._device):
            mjw.step(self._model, self._data)
            with wp.ScopedCapture() as capture:
                self._data.overflow.zero_()
                for k in range(len(self._controls)):
                    wp.copy(self._data.ctrl, self._controls[k])
                    mjw.step(self._model, self._data)
        self._graph = capture.graph
        for name, value in zip(_STATE, before, strict=True):
            getattr(self._data, name).assign(value)

    def _flush(self) -> None:
        """Tell the device what was loaded: one copy, and a launch for each array."""
        if self._pending:
            worlds, rows = np.array(list(self._pending)), np.stack(list(self._pending.values()))
            self._scatter(worlds, rows, self._targets, self._widths)
            self._pending.clear()

    def _scatter(
        self,
        worlds: NDArray[np.int64],
        rows: NDArray[np.int32],
        targets: list[tuple[Any, int]],
        widths: list[int],
    ) -> None:
        """Write rows (k, sum of the widths) of worlds (k,) to arrays, each from a column of its own on."""
        numbers = wp.array(worlds, dtype=wp.int32, device=self._device)
        values = wp.array(rows.reshape(len(worlds), -1), dtype=wp.int32, device=self._device)
        first = 0
        for (array, column), width in zip(targets, widths, strict=True):
            inputs = [values, numbers, first, column]
            wp.launch(_scatter, (len(worlds), width), inputs, [array], device=self._device)
            first += width

    def close(self) -> None:
        """Let go of the graph."""
        self._graph = None


def _accepted(model: mujoco.MjModel) -> mujoco.MjModel:
    """Return the model as warp takes it."""
    flags = mujoco.mjtDisableBit
    model.opt.disableflags &= ~int(flags.mjDSBL_AUTORESET)  # unknown to warp, which never resets
    model.opt.disableflags |= int(
        flags.mjDSBL_NATIVECCD
    )  # boxes meet as in MuJoCo's own function for two boxes
    return model


def _find(device: str | None) -> Any:
    try:
        return wp.get_preferred_device() if device is None else wp.get_device(device)
    except (ValueError, RuntimeError):
        valid = ", ".join(found.alias for found in wp.get_devices())
        raise InputError(f"device {device!r} is not here: valid are {valid}") from None


def _as_ints(array: Any) -> Any:
    """Return an array of the device as rows of whole numbers of 32 bits, one a world; memory is shared."""
    shape = (array.shape[0], array.strides[0] // 4)
    return wp.array(ptr=array.ptr, shape=shape, dtype=wp.int32, device=array.device)


def _bits(values: NDArray[Any]) -> NDArray[np.int32]:
    kind = np.int32 if values.dtype.kind == "i" else np.float32
    return np.ascontiguousarray(values, dtype=kind).view(np.int32).ravel()


def _bad(values: Array) -> NDArray[np.bool_]:
    return np.any(~(np.abs(values) < _TOO_LARGE), axis=1)
