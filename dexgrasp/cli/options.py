"""Options that several commands share."""

import argparse
import math
import os
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeVar

from dexgrasp_env.errors import InputError

if TYPE_CHECKING:
    from dexgrasp.runs.pool import Backend

Number = TypeVar("Number", int, float)


def number(kind: type[Number], holds: Callable[[Number], bool], words: str) -> Callable[[str], Number]:
    """Return a parser of the numbers that hold; `words` say in a message which these are."""

    def parse(text: str) -> Number:
        try:
            value = kind(text)
        except ValueError:
            pass
        else:
            if holds(value):
                return value
        raise argparse.ArgumentTypeError(f"{text!r} is not {words}")

    return parse


positive_int = number(int, lambda value: value >= 1, "a whole number above 0")
natural_int = number(int, lambda value: value >= 0, "a whole number from 0 on")
positive_float = number(float, lambda value: 0.0 < value < math.inf, "a positive number")
share = number(float, lambda value: 0.0 < value < 1.0, "a number between 0 and 1")


def add_seed(parser: argparse.ArgumentParser, of: str = "of everything") -> None:
    """Add `--seed`; `of` says what it is of."""
    parser.add_argument("--seed", type=natural_int, default=0, metavar="S", help=f"{of} (default 0)")


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add `--json`."""
    parser.add_argument(
        "--json", action="store_true", help="print one JSON object on stdout and nothing else there"
    )


def add_mesh(parser: argparse.ArgumentParser) -> None:
    """Add `--mesh-scale` and `--mesh-mass`, which apply to mesh files alone."""
    parser.add_argument(
        "--mesh-scale", type=positive_float, default=1.0, metavar="F",
        help="factor from the mesh file's unit to metres: 0.001 for millimetres (default 1)",
    )  # fmt: skip
    parser.add_argument(
        "--mesh-mass",
        type=positive_float,
        default=None,
        metavar="KG",
        help="mass of the mesh (default: by its volume)",
    )


def check_mesh_options(args: argparse.Namespace, targets: Sequence[str]) -> None:
    """Refuse options of meshes where there is none.

    Raises:
        InputError: naming the options.
    """
    from dexgrasp_env.objects.load import has_own_size

    given = args.mesh_scale != 1.0 or args.mesh_mass is not None
    if given and all(has_own_size(target) for target in targets):
        raise InputError(
            f"--mesh-scale and --mesh-mass are of mesh files alone: {targets[0]!r} has a size and a mass of its own"
        )


def picture_size(text: str) -> tuple[int, int]:
    """Parse WIDTHxHEIGHT as rows and columns."""
    width, _, height = text.lower().partition("x")
    size = positive_int(height) if height else 0, positive_int(width)
    if not all(16 <= side <= 4096 and side % 2 == 0 for side in size):
        raise argparse.ArgumentTypeError(f"{text!r} is not a size like 640x480: even numbers from 16 to 4096")
    return size


def add_film(parser: argparse.ArgumentParser) -> None:
    """Add `--camera` and `--size`, of videos."""
    parser.add_argument(
        "--camera", metavar="CAMERA", default="grasp",
        help="of the video: grasp (close to the hand, following it), front (the whole cell), or a depth camera "
        "(default grasp)",
    )  # fmt: skip
    parser.add_argument(
        "--size", type=picture_size, default=(480, 640), metavar="WxH",
        help="of the video, pixels (default 640x480)",
    )  # fmt: skip


def add_scene(parser: argparse.ArgumentParser) -> None:
    """Add `--mount`, `--friction` and `--cell`."""
    parser.add_argument(
        "--mount", metavar="MOUNT", help="how the hand sits on the arm's flange: palm_normal, fingers_along"
    )
    parser.add_argument(
        "--friction", type=positive_float, metavar="MU", help="sliding friction coefficient (default 0.7)"
    )
    add_cell(parser)


def add_cell(parser: argparse.ArgumentParser) -> None:
    """Add `--cell`."""
    parser.add_argument(
        "--cell", metavar="CELL.yaml", default=os.environ.get("DEXGRASP_CELL"),
        help="robot, table, mounts, limits, gains, torques and cameras of your cell, or a robot alone "
        "(default: $DEXGRASP_CELL, else the simulated one)",
    )  # fmt: skip


def add_jobs(parser: argparse.ArgumentParser) -> None:
    """Add `--workers`, `--backend` and `--address`."""
    from dexgrasp.runs.pool import BACKENDS

    parser.add_argument(
        "--workers", type=positive_int, default=1, metavar="W",
        help="processes (default 1); what comes out does not depend on it",
    )  # fmt: skip
    parser.add_argument(
        "--backend", choices=BACKENDS, default=BACKENDS[0],
        help=f"where it runs: processes of this machine, or ray, tasks on a cluster (default {BACKENDS[0]})",
    )  # fmt: skip
    parser.add_argument(
        "--address", metavar="A",
        help="with --backend ray: the cluster, auto or host:port (default a new one here, of --workers processes)",
    )  # fmt: skip


def backend_of(args: argparse.Namespace) -> "Backend":
    """Return where the options of `add_jobs` say that it runs.

    Raises:
        InputError: for an address without Ray, or Ray without its extra.
    """
    from dexgrasp.runs.pool import Backend

    if args.address is not None and args.backend != "ray":
        raise InputError("--address is of a Ray cluster: add --backend ray")
    return Backend(args.backend, args.workers, args.address)
