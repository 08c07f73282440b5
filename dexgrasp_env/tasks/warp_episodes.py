"""Progress of N episodes on the device beside their physics, by numba's functions as warp compiles them."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.arrays import Array, Mask, Single
from dexgrasp_env.errors import InputError
from dexgrasp_env.extras import from_extra
from dexgrasp_env.tasks import kernel, set_points
from dexgrasp_env.tasks.control import action_size, check_finite
from dexgrasp_env.tasks.records import EPISODE, INFO_COLUMNS
from dexgrasp_env.tasks.warp_functions import as_warp
from dexgrasp_env.tasks.warp_memory import ScatterQueue, as_struct, columns, numbers_of

if TYPE_CHECKING:
    from dexgrasp_env.tasks.episodes import Episodes

with from_extra():
    import warp as wp

_advance, _judge, _observe = as_warp(set_points.advance), as_warp(kernel.judge), as_warp(kernel.observe)
_FAILURE = INFO_COLUMNS.index("failure")
_NAMES = EPISODE.names or ()
_ROW = np.dtype([(name, numbers_of(EPISODE[name]), EPISODE[name].shape) for name in _NAMES])
"""A record in numbers of 32 bits."""
_PROGRESS = list(_NAMES[_NAMES.index("elapsed") :])
"""What the kernels write."""


@wp.kernel(enable_backward=False)
def _set_points(
    records: Any,
    commands: wp.array3d[float],
    actions: wp.array2d[float],
    control: Any,
    rows: wp.array3d[float],
    push: wp.array2d[float],
) -> None:
    i = wp.tid()
    _advance(records, i, commands[i], actions[i], control, rows[i], push[i])


@wp.kernel(enable_backward=False)
def _conclude(
    records: Any, qpos: wp.array2d[float], qvel: wp.array2d[float], sensors: wp.array2d[float],
    commands: wp.array3d[float], warnings: wp.array[int], noise: wp.array2d[float], rules: Any,
    told: wp.array2d[float], rewards: wp.array[float], seen: wp.array2d[float],
) -> None:  # fmt: skip
    i = wp.tid()
    rewards[i] = _judge(records, i, qpos[i], qvel[i], sensors[i], warnings[i], rules, told[i])
    _observe(records, i, qpos[i], qvel[i], sensors[i], commands[i][0], noise[i], rules, seen[i])


class WarpEpisodes:
    """The progress of all episodes: the host begins them, and is told what came of each step."""

    def __init__(self, episodes: "Episodes", physics: Any, tensors: bool) -> None:
        """Prepare for episodes, none of which has begun.

        Args:
            episodes: on the host.
            physics: theirs, a `WarpPhysics`.
            tensors: whether observations and actions are torch's.

        Raises:
            InputError: if torch does not know the device.
        """
        self._host, self._physics, self._tensors = episodes, physics, tensors
        if tensors and physics.device.is_cuda:
            with from_extra():
                import torch
            if not torch.cuda.is_available():
                raise InputError("tensors=True on a GPU wants a torch that was built for CUDA")
        number, robot = len(episodes.records), episodes.settings.cell.robot
        with wp.ScopedDevice(physics.device):
            self._rows = wp.zeros((number, _ROW.itemsize // 4), dtype=wp.int32)
            self._commands = wp.zeros(episodes.commands.shape, dtype=float)
            self._actions = wp.zeros(
                (number, action_size(episodes.settings.control_mode, robot)), dtype=float
            )
            self._noise = wp.zeros((number, robot.dof), dtype=float)
            self._told = wp.zeros(episodes.info_columns.shape, dtype=float)
            self.rewards = wp.zeros(number, dtype=float)
            self.seen = wp.zeros((number, episodes.width), dtype=float)
            self._records = as_struct("Records", {name: self._field(name) for name in _NAMES})
            self._rules = as_struct("Rules", episodes.rules._asdict())
            self._control = as_struct("Control", episodes.control._asdict())
        self._queue = ScatterQueue(
            [columns(array) for array in (self._rows, self._commands, self._told, self.seen)]
        )
        self._known = True

    def _field(self, name: str) -> Any:
        assert _ROW.fields is not None
        kind, offset = _ROW.fields[name][:2]
        whole = columns(self._rows, offset // 4, kind.itemsize // 4, wp.dtype_from_numpy(kind.base))
        return whole if kind.shape else whole[:, 0]

    def load(self, i: int, seen: Single | None = None) -> None:
        """Tell the device of episode `i` as the host has it, and of what is observed in it, by default nothing."""
        host = self._host
        seen = np.zeros(self.seen.shape[1], np.float32) if seen is None else seen
        row = host.records[i : i + 1].astype(_ROW).view(np.int32)
        self._queue.put(i, row, host.commands[i], host.info_columns[i], seen)

    def send(self) -> None:
        """Send what was loaded, so that the device's arrays are current."""
        self._queue.send()

    def set_points(self, actions: Any) -> None:
        """Move the set-points of all by actions (N, m), numpy's or a tensor; the physics are given them.

        Raises:
            InputError: for actions that are not finite.
        """
        self.send()
        if self._tensors:
            actions = actions.detach().float().contiguous()
            if not actions.isfinite().all():
                check_finite(actions.cpu().numpy())
            wp.copy(self._actions, wp.from_torch(actions))
        else:
            check_finite(actions)
            self._actions.assign(actions)
        physics = self._physics
        inputs = [self._records, self._commands, self._actions, self._control, physics.rows, physics.push]
        wp.launch(_set_points, len(self._host.records), inputs, device=physics.device)
        self._host.records["elapsed"] += 1
        self._known = False

    def conclude(self, noise: Array | None) -> Any:
        """Advance, reward and observe all after a step, and tell the host what it tells others.

        Args:
            noise: (N, n) rad, of the joint sensors; None for none.

        Returns:
            Observations (N, m), `rows`.
        """
        physics, host = self._physics, self._host
        if noise is not None:
            self._noise.assign(noise)
        data = physics.data
        inputs = [
            self._records, data.qpos, data.qvel, data.sensordata, self._commands, physics.warnings, self._noise,
            self._rules, self._told, self.rewards, self.seen,
        ]  # fmt: skip
        wp.launch(_conclude, len(host.records), inputs, device=physics.device)
        host.info_columns[:], host.rewards[:] = self._told.numpy(), self.rewards.numpy()
        host.records["failure"] = host.info_columns[:, _FAILURE]
        return self.rows()

    def rows(self) -> Any:
        """Return the observations (N, m) of now: a copy, or where tensors are wanted one that shares memory."""
        self.send()
        return wp.to_torch(self.seen) if self._tensors else self.seen.numpy()

    def told_tensors(self, waiting: NDArray[np.intp], *flags: Mask) -> tuple[Any, ...]:
        """Return rewards (N,) that share memory, none of those that waited for a reset, and flags, as tensors."""
        rewards = wp.to_torch(self.rewards)
        rewards[waiting] = 0.0
        return rewards, *(rewards.new_tensor(flag, dtype=bool) for flag in flags)

    def fetch(self) -> None:
        """Copy records and commands of the device to the host."""
        self.send()
        if not self._known:
            self._host.commands[:] = self._commands.numpy()
            records = self._rows.numpy().view(_ROW)[:, 0].astype(EPISODE)
            self._host.records[_PROGRESS] = records[_PROGRESS]
            self._known = True
