"""Four moments of one failed trial for each object that an agent failed on, in one picture an object.

    python scripts/failure_pictures.py runs/robust_1000 runs/scans --agent bilevel --out docs/images/failures

The trial is the first failed one of the hardest protocol; it is made again from its seeds and filmed, the film cut into
OBJECT.jpg. Pictures that are there are kept.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from dexgrasp.evaluation.replay import replay, video_path
from dexgrasp.evaluation.store import read_rows
from dexgrasp.evaluation.video import Film
from dexgrasp_env.errors import InputError
from dexgrasp_env.objects.load import object_name

_FILM = Film(size=(240, 320))
_MOMENTS = (0.25, 0.5, 0.75, 1.0)  # of the film


def failures(rows: Sequence[Mapping[str, Any]], agent: str) -> dict[str, Mapping[str, Any]]:
    """Return a failed trial of each object: of the protocol in which it fails most often, the first."""
    failed = [row for row in rows if row["agent"] == agent and not row["success"]]
    often = Counter((row["object"], row["protocol"]) for row in failed)
    found: dict[str, Mapping[str, Any]] = {}
    for row in sorted(failed, key=lambda row: -often[row["object"], row["protocol"]]):
        found.setdefault(row["object"], row)
    return found


def strip(film: Path) -> NDArray[np.uint8]:
    """Return moments of a film side by side."""
    import imageio.v2 as imageio

    pictures = [np.asarray(picture) for picture in imageio.get_reader(film)]
    return np.hstack([pictures[round(moment * (len(pictures) - 1))] for moment in _MOMENTS])


def main(argv: list[str] | None = None) -> int:
    """Make the pictures that are not there."""
    import imageio.v2 as imageio

    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN", help="evaluations")
    parser.add_argument("--agent", default="bilevel")
    parser.add_argument("--out", type=Path, default=Path("docs/images/failures"))
    args = parser.parse_args(argv)
    args.out.mkdir(parents=True, exist_ok=True)
    found = [(run, row) for run in args.runs for row in failures(read_rows(run), args.agent).values()]
    for run, row in tqdm(found, unit="trial", file=sys.stderr):
        picture = args.out / f"{object_name(row['object'])}.jpg"
        if picture.exists():
            continue
        if not video_path(run, row).is_file():
            replay(run, args.agent, row["object"], row["trial"], protocol=row["protocol"], film=_FILM)
        imageio.imwrite(picture, strip(video_path(run, row)), quality=80)
        print(f"{picture}: {row['protocol']}, trial {row['trial']}, {row['reason']}", flush=True)
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except InputError as error:
        sys.exit(f"failure_pictures: {error}")
