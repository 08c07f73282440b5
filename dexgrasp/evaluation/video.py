"""Videos of trials."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray

from dexgrasp.agent import Env
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.scene.constants import CONTROL_PERIOD
from dexgrasp_env.valid import Rule

_EVERY = 2  # control steps from picture to picture: drawing takes longer than everything else


def _size(value: tuple[int, int]) -> tuple[int, int]:
    rows, columns = value
    if not all(16 <= side <= 4096 and side % 2 == 0 for side in value):
        raise ValueError
    return rows, columns


def _size_of(text: str) -> tuple[int, int]:
    columns, rows = text.lower().split("x")
    return int(rows), int(columns)


_SIZE = Rule("a size like 640x480: even numbers from 16 to 4096", _size, _size_of)


@dataclass(frozen=True)
class VideoSettings:
    """Settings of videos.

    Attributes:
        camera: grasp, close to the hand and following it, front, the whole cell, or a depth camera of the cell.
        size: width x height, pixels; rows and columns in Python (default 640x480).
    """

    camera: Annotated[str, "CAMERA"] = "grasp"
    size: Annotated[tuple[int, int], _SIZE, "WxH"] = (480, 640)

    @property
    def env_settings(self) -> Fields:
        """Keywords of `gym.make`."""
        return {"render_mode": "rgb_array", "render_camera": self.camera, "render_size": self.size}


class Video:
    """Writes the environment's renderings as an mp4 in real time, ten frames a second.

    Rendering does not change the simulation: a recorded trial ends like an unrecorded one. The file appears once it is
    complete.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._part = path.with_suffix(".part.mp4")
        self._writer: Any = None
        self._steps = 0

    def add(self, env: Env) -> NDArray[np.uint8] | None:
        """Count a control step; render, append and return a frame (H, W, 3) where one is due, else None."""
        import imageio.v2 as imageio

        self._steps += 1
        if self._steps % _EVERY != 1:
            return None
        if self._writer is None:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            fps = round(1 / (_EVERY * CONTROL_PERIOD))
            self._writer = imageio.get_writer(
                self._part, fps=fps, codec="libx264", quality=7, macro_block_size=8
            )
        picture = np.asarray(env.render())
        self._writer.append_data(picture)
        return picture

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Finish the file, or remove it after an exception."""
        if self._writer is None:
            return
        self._writer.close()
        if kind is None:
            self._part.replace(self.path)
        else:
            self._part.unlink(missing_ok=True)


def require_rendering() -> None:
    """Check that videos can be rendered, before the first trial.

    Raises:
        InputError: with the remedy, where nothing renders.
    """
    from dexgrasp_env.rendering import rendering_fault

    if fault := rendering_fault():
        raise InputError(f"--video: {fault} (see `dexgrasp doctor`)")
