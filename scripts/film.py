"""Several videos side by side in one small film, an animated WebP for a page.

    dexgrasp evaluate --agents bilevel --objects lego castle --trials 1 --protocol presented --video 1 --out runs/film
    python scripts/film.py docs/images/film.webp runs/film/videos/*.mp4

Videos are laid out row by row, each scaled to the width of its cell; one that ends earlier stands still.
"""

import sys
from pathlib import Path

import imageio.v2 as imageio
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from dexgrasp.cli.command import Argument, File, Script
from dexgrasp.cli.commands import run_script
from dexgrasp_env.valid import Count, Positive

_RATE = 20.0  # frames a second of the videos


def read_frames(path: Path, size: tuple[int, int], step: int) -> list[NDArray[np.uint8]]:
    """Return every `step`-th frame of a video, scaled to `size` (width, height)."""
    with imageio.get_reader(path) as video:
        kept = [frame for k, frame in enumerate(video) if k % step == 0]
    return [np.asarray(Image.fromarray(frame).resize(size, Image.Resampling.LANCZOS)) for frame in kept]


def tile(videos: list[list[NDArray[np.uint8]]], columns: int) -> list[Image.Image]:
    """Return the frames of all videos side by side, `columns` in a row."""
    longest, blank = max(map(len, videos)), np.full_like(videos[0][0], 255)
    film = []
    for k in range(longest):
        cells = [frames[min(k, len(frames) - 1)] for frames in videos]
        cells += [blank] * (-len(cells) % columns)
        rows = [np.hstack(cells[row : row + columns]) for row in range(0, len(cells), columns)]
        film.append(Image.fromarray(np.vstack(rows)))
    return film


class Film(Script):
    """Writes the film.

    Attributes:
        out: a .webp file.
        width: pixels of one video.
        step: every how manieth frame.
        speed: times as fast.
    """

    out: Argument[File]
    videos: Argument[tuple[File, ...]]
    columns: Count = 5
    width: Count = 200
    step: Count = 3
    speed: Positive = 2.0

    def run(self) -> int:
        size = (self.width, self.width * 3 // 4)
        film = tile([read_frames(path, size, self.step) for path in self.videos], self.columns)
        duration = round(1000 * self.step / (_RATE * self.speed))
        film[0].save(
            self.out, save_all=True, append_images=film[1:], duration=duration, loop=0, quality=60, method=4
        )
        print(f"wrote {self.out}, {len(film)} frames, {self.out.stat().st_size / 1e6:.1f} MB")
        return 0


if __name__ == "__main__":
    sys.exit(run_script(Film))
