"""Several videos side by side in one small film, an animated WebP for a page.

    dexgrasp evaluate --agents bilevel --objects lego castle --trials 1 --protocol presented --video 1 --out runs/film
    python scripts/film.py docs/images/film.webp runs/film/videos/*.mp4

Videos are laid out row by row, each scaled to the width of its cell; one that ends earlier stands still.
"""

import argparse
from pathlib import Path

import imageio.v2 as imageio
import numpy as np
from numpy.typing import NDArray
from PIL import Image

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


def main(argv: list[str] | None = None) -> None:
    """Write the film."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path, help="a .webp file")
    parser.add_argument("videos", type=Path, nargs="+")
    parser.add_argument("--columns", type=int, default=5)
    parser.add_argument("--width", type=int, default=200, help="pixels of one video (default 200)")
    parser.add_argument("--step", type=int, default=3, help="every how manieth frame (default 3)")
    parser.add_argument("--speed", type=float, default=2.0, help="times as fast (default 2)")
    options = parser.parse_args(argv)
    size = (options.width, options.width * 3 // 4)
    film = tile([read_frames(path, size, options.step) for path in options.videos], options.columns)
    duration = round(1000 * options.step / (_RATE * options.speed))
    film[0].save(
        options.out, save_all=True, append_images=film[1:], duration=duration, loop=0, quality=60, method=4
    )
    print(f"wrote {options.out}, {len(film)} frames, {options.out.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
