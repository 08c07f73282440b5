"""Physics of many environments by mujoco_warp, on a GPU or on the processor, as one graph."""

from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array, Arrays, Index
from dexgrasp_env.errors import InputError
from dexgrasp_env.extras import from_extra
from dexgrasp_env.scene.merged import MergedScene
from dexgrasp_env.tasks.simulation import PhysicsState, Simulation, warning_mask

if TYPE_CHECKING:
    from dexgrasp_env.tasks.episodes import Episodes

with from_extra():
    import mujoco_warp as mjw
    import warp as wp

    wp.config.log_level = wp.LOG_ERROR  # that there is no GPU is said by `find_device`, to who asks for one

ROWS, CONTACTS = 128, 32
"""Room of a world for constraints, of which random actions reach 87, and contacts, of which they have 24."""
_STATE = ("qpos", "qvel", "ctrl", "qacc_warmstart")


class WarpPhysics:
    """States of N environments, advanced together on a device; it is used as `BatchPhysics` is.

    Every world advances at each step, those too whose episode is over. A world whose numbers go wrong, or that meets
    more contacts or constraints than there is room for, is told with MuJoCo's warnings.
    """

    def __init__(self, episodes: "Episodes") -> None:
        """Prepare for episodes, none of which has begun.

        Raises:
            InputError: if there is no device of the name that the settings have.
        """
        settings, scenes = episodes.settings, list(episodes.simulations.values())
        number = len(episodes.slots)
        self._device = find_device(settings.device)
        objects = [scene.object for scene in scenes]
        self._merged = MergedScene(objects, settings.cell)
        self._scenes, self._body, self._graph = [scenes[0]] * number, scenes[0].body, None
        model, flags = self._merged.model, mujoco.mjtDisableBit
        model.opt.disableflags &= ~int(flags.mjDSBL_AUTORESET)  # unknown to warp, which never resets
        # Boxes are to meet as in MuJoCo's own function for two boxes.
        model.opt.disableflags |= int(flags.mjDSBL_NATIVECCD)
        fields = self._merged.fields(objects[0], scenes[0].base)
        worlds = max(number, 2)  # warp looks for absent meshes only where they differ between worlds
        with wp.ScopedDevice(self._device):
            self._model = mjw.put_model(model, batch_sizes=dict.fromkeys(fields, worlds))
            self._model.opt.warn_overflow = 0  # it is read at every step instead
            self._data = mjw.make_data(model, nworld=number, nconmax=CONTACTS, njmax=ROWS)
            self._controls = wp.zeros((settings.frame_skip, number, model.nu), dtype=float)
        self._fields: Arrays = {name: np.stack([value] * worlds) for name, value in fields.items()}
        self._host: Arrays = {}
        """Physics of now on the host, unless `_stepped`; the device has it unless `_loaded`."""
        self._stepped = self._loaded = True
        self.peak_forces = np.zeros(number)

    @property
    def current(self) -> PhysicsState:
        """The present state."""
        self._fetch()
        return PhysicsState(self._host["qpos"], self._host["qvel"], self._host["sensordata"])

    def _fetch(self) -> None:
        if self._stepped:
            names = *_STATE, "sensordata"
            self._host = {name: getattr(self._data, name).numpy().astype(float) for name in names}
            self._stepped = False

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
        self._fetch()
        for name, value in self._merged.fields(simulation.object, simulation.model).items():
            self._fields[name][i] = value
        for name, values in self._host.items():
            values[i] = getattr(simulation.data, name)
        self._scenes[i], self._loaded = simulation, True

    def _send(self) -> None:
        for there, values in ((self._model, self._fields), (self._data, self._host)):
            for name, value in values.items():
                getattr(there, name).assign(value)
        self._loaded = False

    def state(self, i: int) -> Array:
        """Return the full integration state of environment `i`."""
        simulation = self._scenes[i]
        mujoco.mj_resetData(simulation.model, simulation.data)
        self._give_back(i, simulation)
        return simulation.get_state()

    def _give_back(self, i: int, simulation: Simulation) -> None:
        self._fetch()
        for name in _STATE:
            getattr(simulation.data, name)[:] = self._host[name][i]

    def advance(self, simulation: Simulation, rows: Array) -> Index:
        """Advance the one environment that there is from what a scene holds, and have the scene hold what is then.

        Of applied forces only that on the object counts.

        Args:
            simulation: the scene.
            rows: (1, frame_skip, n) set-points of the physics steps, rad.

        Returns:
            (1,) warnings that came up, one bit each.
        """
        self.load(0, simulation)
        bits = self.step(rows, simulation.data.xfrc_applied[None, self._body, :3], np.arange(1))
        self._give_back(0, simulation)
        simulation.data.sensordata[:] = self._host["sensordata"][0]
        return bits

    def step(self, rows: Array, push: Array | None, which: NDArray[np.intp]) -> Index:
        """Advance all by one control step; see `Physics`."""
        if self._loaded:
            self._send()
        if push is not None:
            forces = np.zeros((len(push), self._merged.model.nbody, 6), np.float32)
            forces[:, self._body, :3] = push
            self._data.xfrc_applied.assign(forces)
        self._controls.assign(np.ascontiguousarray(rows.swapaxes(0, 1), np.float32))
        if self._graph is None:
            self._capture()
            self._send()  # what is recorded has been launched once
        self._data.overflow.zero_()
        wp.capture_launch(self._graph)
        self._stepped = True
        return self._warnings()

    def _capture(self) -> None:
        """Record the control step; it is launched once before, which compiles it."""
        with wp.ScopedDevice(self._device):
            mjw.step(self._model, self._data)
            with wp.ScopedCapture() as capture:
                for k in range(len(self._controls)):
                    wp.copy(self._data.ctrl, self._controls[k])
                    mjw.step(self._model, self._data)
        self._graph = capture.graph

    def _warnings(self) -> Index:
        self._fetch()
        overflow = self._data.overflow.numpy()
        of_rows = int(mjw.OverflowType.NEFC | mjw.OverflowType.NJMAX_NNZ)
        most = 1e10  # mjMAXVAL
        found = {
            "BADQPOS": ~(np.abs(self._host["qpos"]) < most).all(axis=1),
            "BADQVEL": ~(np.abs(self._host["qvel"]) < most).all(axis=1),
            "CNSTRFULL": overflow & of_rows != 0,
            "CONTACTFULL": overflow & ~of_rows != 0,
        }
        return sum(
            (warning_mask(name) * over for name, over in found.items()), np.zeros(len(overflow), np.int64)
        )

    def close(self) -> None:
        """Free the graph."""
        self._graph = None


def find_device(device: str | None) -> Any:
    """Return a device as warp names it; None: a GPU where there is one.

    Raises:
        InputError: if there is none of that name.
    """
    try:
        return wp.get_preferred_device() if device is None else wp.get_device(device)
    except (ValueError, RuntimeError):
        valid = ", ".join(found.alias for found in wp.get_devices())
        raise InputError(f"device {device!r} is not here: valid are {valid}") from None
