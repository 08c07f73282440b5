"""Physics of many environments by mujoco_warp, on a GPU or on the processor, as one graph."""

from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array, Index
from dexgrasp_env.errors import InputError
from dexgrasp_env.extras import from_extra
from dexgrasp_env.scene.merged import MergedScene, filled
from dexgrasp_env.tasks.simulation import PhysicsState, Simulation, warning_mask
from dexgrasp_env.tasks.warp_memory import ScatterQueue, columns, find_device

if TYPE_CHECKING:
    from dexgrasp_env.tasks.episodes import Episodes

with from_extra():
    import mujoco_warp as mjw
    import warp as wp

_ROWS = 128  # of constraints that a world has room for: random actions reach 87
_CONTACTS = 32  # a world, all worlds together: random actions have 24
_MORE_ROWS, _MORE_CONTACTS = 64, 16  # for each neighbour
_STATE = ("qpos", "qvel", "ctrl", "qacc_warmstart")
_LOADED = (*_STATE, "sensordata")
_READ = ("qpos", "qvel", "sensordata")
_OVERFLOW = mjw.OverflowType
_TOO_LARGE = 1e10  # mjMAXVAL


_BAD_POSITION, _BAD_VELOCITY = warning_mask("BADQPOS"), warning_mask("BADQVEL")
_FULL_ROWS, _FULL_CONTACTS = warning_mask("CNSTRFULL"), warning_mask("CONTACTFULL")
_ROWS_OVER = int(_OVERFLOW.NEFC | _OVERFLOW.NJMAX_NNZ)
_CONTACTS_OVER = int(
    _OVERFLOW.BROADPHASE
    | _OVERFLOW.NARROWPHASE
    | _OVERFLOW.CCD
    | _OVERFLOW.EPA_HORIZON
    | _OVERFLOW.CONTACT_MATCH
)


@wp.func
def _bad(values: wp.array[float]) -> bool:
    bad = wp.bool(False)
    for k in range(len(values)):
        bad = bad or not wp.abs(values[k]) < _TOO_LARGE
    return bad


@wp.kernel(enable_backward=False)
def _warn(
    qpos: wp.array2d[float], qvel: wp.array2d[float], overflow: wp.array[int], warnings: wp.array[int]
) -> None:
    """Write the warnings of a control step, one bit each."""
    i = wp.tid()
    found = wp.int32(0)
    if _bad(qpos[i]):
        found |= _BAD_POSITION
    if _bad(qvel[i]):
        found |= _BAD_VELOCITY
    if overflow[i] & _ROWS_OVER != 0:
        found |= _FULL_ROWS
    if overflow[i] & _CONTACTS_OVER != 0:
        found |= _FULL_CONTACTS
    warnings[i] = found


@wp.kernel(enable_backward=False)
def _keep_most(most: wp.array2d[float], now: wp.array2d[float]) -> None:
    """Write the larger of the two to both."""
    i, k = wp.tid()
    most[i, k] = wp.max(most[i, k], now[i, k])
    now[i, k] = most[i, k]


class WarpPhysics:
    """States of N environments, advanced together on a device; it is used as `BatchPhysics` is.

    Every world advances at each step, those too whose episode is over. A world whose numbers go wrong, or that meets
    more contacts or constraints than there is room for, is told with MuJoCo's warnings.

    Attributes:
        device: that it runs on.
        data: there.
        rows: (N, frame_skip, n) set-points there.
        push: (N, 3) forces on the objects there.
        warnings: (N,) of the last step there.
    """

    def __init__(self, episodes: "Episodes") -> None:
        """Prepare for episodes, none of which has begun.

        Raises:
            InputError: if there is no device of the name that the settings have.
        """
        settings, scenes = episodes.settings, list(episodes.simulations.values())
        number, neighbours = len(episodes.slots), episodes.neighbours
        self.device = find_device(settings.device)
        objects = [scene.object for scene in scenes]
        around = list(settings.load_objects(episodes.around).values())
        self._merged = MergedScene(objects, settings.cell, around, neighbours, episodes.furniture)
        self._scenes = [scenes[0]] * number
        self._graph: Any = None
        model, flags = self._merged.model, mujoco.mjtDisableBit
        model.opt.disableflags &= ~int(flags.mjDSBL_AUTORESET)  # unknown to warp, which never resets
        # Boxes are to meet as in MuJoCo's own function for two boxes.
        model.opt.disableflags |= int(flags.mjDSBL_NATIVECCD)
        example = self._merged.fields(objects[:1], scenes[0].base)
        worlds = max(number, 2)  # warp looks for absent meshes only where they differ between worlds
        with wp.ScopedDevice(self.device):
            self._model = mjw.put_model(model, batch_sizes=dict.fromkeys(example, worlds))
            self._model.opt.warn_overflow = 0  # it is read at every step instead
            self.data = mjw.make_data(
                model,
                nworld=number,
                nconmax=_CONTACTS + neighbours * _MORE_CONTACTS,
                njmax=_ROWS + neighbours * _MORE_ROWS,
            )
            self._touches = wp.zeros((number, neighbours), dtype=float)
            self._controls = wp.zeros((settings.frame_skip, number, model.nu), dtype=float)
            self.warnings = wp.zeros(number, dtype=int)
        self.rows = self._controls.transpose((1, 0, 2))
        self.push = columns(self.data.xfrc_applied, 6 * scenes[0].body, 3, float)
        fields = [
            columns(getattr(self._model, name), self._merged.first_column(name), value.size)
            for name, value in example.items()
        ]
        self._queue = ScatterQueue(fields + [columns(getattr(self.data, name)) for name in _LOADED])
        self._touched = columns(self.data.sensordata, model.nsensordata - neighbours, neighbours, float)
        self._absent = {name: np.zeros(getattr(self.data, name).shape[1]) for name in _LOADED}
        self._absent["qpos"] = model.qpos0
        self._host = PhysicsState(*(np.zeros(getattr(self.data, name).shape) for name in _READ))
        self._known, self.peak_forces = True, np.zeros(number)

    @property
    def current(self) -> PhysicsState:
        """The present state, also of neighbours that a scene has not."""
        self._queue.send()
        if not self._known:
            for name, values in zip(_READ, self._host, strict=True):
                values[:] = getattr(self.data, name).numpy()
            self._known = True
        return self._host

    def load(self, i: int, simulation: Simulation) -> None:
        """Make environment `i` what a scene holds now: model, state and sensors; the device hears of it at a step.

        Raises:
            InputError: for an object with meshes of another size than its own: worlds share them.
        """
        if simulation.variation.size != 1.0 and any(part.kind == "mesh" for part in simulation.object.parts):
            raise InputError(
                f"backend='warp' scales no meshes, and {simulation.object.name} has some: "
                "leave randomisation size out"
            )
        fields = self._merged.fields((simulation.object, *simulation.neighbours), simulation.model)
        state = {name: filled(self._absent[name], getattr(simulation.data, name)) for name in _LOADED}
        self._queue.put(i, *fields.values(), *state.values())
        self._scenes[i] = simulation
        for name, values in zip(_READ, self._host, strict=True):
            values[i] = state[name]

    def state(self, i: int) -> Array:
        """Return the full integration state of environment `i`."""
        self._queue.send()
        simulation = self._scenes[i]
        mujoco.mj_resetData(simulation.model, simulation.data)
        self._fetch(i, simulation)
        return simulation.get_state()

    def _fetch(self, i: int, simulation: Simulation) -> None:
        for name in _STATE:
            own = getattr(simulation.data, name)
            own[:] = getattr(self.data, name).numpy()[i, : len(own)]

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
        self.rows.assign(rows)
        self.push.assign(data.xfrc_applied[None, simulation.body, :3])
        bits = self.step(rows, None, np.arange(1))
        self._fetch(0, simulation)
        data.sensordata[:] = self.current.sensors[0, : len(data.sensordata)]
        return int(bits[0])

    def step(self, rows: Array, push: Array | None, which: NDArray[np.intp]) -> Index:
        """Advance all by one control step, as `rows` and `push` of the device say, whatever is given here.

        Returns:
            (N,) warnings that came up, one bit each.
        """
        self._queue.send()
        if self._graph is None:
            self._capture()
        wp.capture_launch(self._graph)
        self._known = False
        return self.warnings.numpy()

    def _capture(self) -> None:
        """Record the control step: what it launches is compiled, or found compiled, in a step that is undone."""
        before = [getattr(self.data, name).numpy().copy() for name in _STATE]
        state = [self.data.qpos, self.data.qvel, self.data.overflow]
        with wp.ScopedDevice(self.device):
            mjw.step(self._model, self.data)
            wp.launch(_warn, len(self._scenes), state, [self.warnings])
            with wp.ScopedCapture() as capture:
                self.data.overflow.zero_()
                self._touches.zero_()
                for k in range(len(self._controls)):
                    wp.copy(self.data.ctrl, self._controls[k])
                    mjw.step(self._model, self.data)
                    wp.launch(_keep_most, self._touches.shape, [self._touches, self._touched])
                wp.launch(_warn, len(self._scenes), state, [self.warnings])
        self._graph = capture.graph
        for name, value in zip(_STATE, before, strict=True):
            getattr(self.data, name).assign(value)

    def close(self) -> None:
        """Free the graph."""
        self._graph = None
