"""Videos of trials."""

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from dexgrasp_env.errors import InputError
from dexgrasp_env.scene.constants import CONTROL_PERIOD


class Video:
    """Collects what the environment renders and writes it as mp4 in real time.

    Pictures only read the simulation: a recorded trial ends like an unrecorded one.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._writer: Any = None

    def add(self, env: gym.Env[Any, Any]) -> None:
        """Render and append a picture."""
        import imageio.v2 as imageio

        if self._writer is None:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            fps = round(1 / CONTROL_PERIOD)
            self._writer = imageio.get_writer(
                self.path, fps=fps, codec="libx264", quality=7, macro_block_size=8
            )
        self._writer.append_data(np.asarray(env.render()))

    def close(self) -> None:
        """Finish the file."""
        if self._writer is not None:
            self._writer.close()


def check_rendering() -> None:
    """Fail before the first trial rather than in it.

    Raises:
        InputError: with the remedy, where nothing renders.
    """
    from dexgrasp_env.rendering import rendering_fault

    fault = rendering_fault()
    if fault is not None:
        raise InputError(f"--video: {fault} (see `dexgrasp doctor`)")
