"""Sources of proposals by their names; learned ones: latents decoded, put on the surface, judged, each in one batch."""

from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.random import Generator

from dexgrasp.geometry.target import GraspTarget
from dexgrasp.planning.decoder import CROPPED, PALM, SCALE, Decoder, centre_of, read_decoder
from dexgrasp.planning.proposals import (
    LEAST_DISTANCE,
    Proposals,
    ProposalSource,
    SurfaceProposals,
    fits,
    most_robust,
)
from dexgrasp.planning.settings import PlannerSettings
from dexgrasp_env.arrays import Array, Mask, unit
from dexgrasp_env.assets import asset_path
from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.robot.cell import default_cell
from dexgrasp_env.robot.robot import Hand, Robot

_NO_CLOSURE, _NO_SURFACE = "no_closure_proposal", "no_surface_above_table"


class CvaeProposals(ProposalSource):
    """Fingertips decoded from latents, each assigned to its finger."""

    def __init__(self, weights: Path | None = None, ranked: bool = True) -> None:
        """Prepare; weights are read at the first use.

        Args:
            weights: of `dexgrasp train cvae`; the shipped ones by default.
            ranked: judge closure, drop proposals without it, best first; False leaves them as they are drawn.

        Raises:
            InputError: without weights.
        """
        self._path, self._ranked = weights or shipped_weights(), ranked

    def check_hand(self, hand: Hand) -> None:
        """Refuse a hand that the weights have not learned; those that say none are of ours."""
        learned = _decoder(self._path).hand or default_cell().robot.hand.stamp
        if hand.stamp != learned:
            raise InputError(
                f"the weights {self._path.name} are of the hand {learned}, not of {hand.stamp}: valid are proposals "
                "from the surface"
            )

    def propose(self, target: GraspTarget, settings: PlannerSettings, rng: Generator) -> Proposals:
        """Return up to `settings.triples` proposals; the same for the same generator."""
        if target.top <= CROPPED:
            return Proposals.none(_NO_SURFACE)
        tips, palms = decode(_decoder(self._path), target, 1024, rng)
        contacts, normals, usable = on_surface(tips, target, settings)
        contacts, normals, palms = contacts[usable], normals[usable], palms[usable]
        if not len(contacts):
            return Proposals.none(_NO_SURFACE)
        chosen = np.arange(len(contacts))[: settings.triples]
        if self._ranked:
            chosen = most_robust(contacts, normals, target, settings)
        if not len(chosen):
            return Proposals.none(_NO_CLOSURE)
        return Proposals(contacts[chosen], normals[chosen], assigned=True, palms=palms[chosen])


def decode(decoder: Decoder, target: GraspTarget, count: int, rng: Generator) -> tuple[Array, Array]:
    """Return fingertips (count, n, 3) m and poses (count, 4, 4) of the palm, world frame, of latents drawn."""
    points, normals = hull_cloud(target, 2 * decoder.settings.points, rng)
    if not len(points):  # next to nothing stands out of the table
        points, normals = target.distance.triangles[:1, 0], np.array([[0.0, 0.0, 1.0]])
    centre = centre_of(points)
    cloud = np.concatenate([SCALE * (points - centre), normals], axis=1).astype(np.float32)
    latent = rng.standard_normal((count, decoder.settings.latent)).astype(np.float32)
    grasps = decoder.decode(decoder.feature(cloud), latent).astype(float)
    palms = np.tile(np.eye(4), (count, 1, 1))
    palms[:, :3, 3] = grasps[:, -PALM:-6] / SCALE + centre
    palms[:, :3, :3] = _rotations(grasps[:, -6:-3], grasps[:, -3:])
    return grasps[:, :-PALM].reshape(count, -1, 3) / SCALE + centre, palms


def _rotations(x: Array, y: Array) -> Array:
    """Return rotations (K, 3, 3) from their first two columns, made orthogonal."""
    x = unit(x)
    y = unit(y - (x * y).sum(1, keepdims=True) * x)
    return np.stack([x, y, np.cross(x, y)], axis=-1)


def hull_cloud(target: GraspTarget, count: int, rng: Generator) -> tuple[Array, Array]:
    """Return about `count` points (N, 3) m of the hull above the table and their normals, even shares of the area.

    Plain sampling will do where a maximum over points is all that is taken, and costs a tenth of blue noise.
    """
    triangles = target.distance.triangles if target.is_convex else np.asarray(target.hull.triangles)
    sides = triangles[:, 1:] - triangles[:, :1]
    normal = np.cross(sides[:, 0], sides[:, 1])
    doubled = np.linalg.norm(normal, axis=1)
    share = np.cumsum(doubled) / doubled.sum()
    face = np.minimum(np.searchsorted(share, (np.arange(count) + rng.random(count)) / count), len(share) - 1)
    u = rng.random((count, 2))
    u = np.where(u.sum(1, keepdims=True) > 1.0, 1.0 - u, u)
    points = triangles[face, 0] + u[:, :1] * sides[face, 0] + u[:, 1:] * sides[face, 1]
    seen = points[:, 2] > CROPPED
    return points[seen], (normal / np.maximum(doubled, 1e-12)[:, None])[face[seen]]


def on_surface(tips: Array, target: GraspTarget, settings: PlannerSettings) -> tuple[Array, Array, Mask]:
    """Put fingertips (K, 3, 3) on the surface.

    Returns:
        Contacts (K, 3, 3), normals (K, 3, 3) as a fingertip feels them (smooth over edges), and which are usable: above
        the table, apart from each other, clear of neighbours, and on what was seen.
    """
    flat = tips.reshape(-1, 3)
    away, out = target.distance.distance_gradient(flat)
    centres = flat + (settings.tip_height - away)[:, None] * out
    distance, normals = target.distance.distance_gradient(centres)
    contacts = (centres - distance[:, None] * normals).reshape(tips.shape)
    usable = contacts[..., 2].min(1) > settings.table_clearance
    usable &= centres.reshape(tips.shape)[..., 2].min(1) > settings.tip_radius + settings.clearance
    sides = np.linalg.norm(contacts - np.roll(contacts, 1, axis=1), axis=-1)
    usable &= (sides.min(1) > LEAST_DISTANCE) & fits(centres, normals, target, settings).reshape(-1, 3).all(1)
    usable &= target.was_seen(contacts).all(1)
    return contacts, normals.reshape(tips.shape), usable


def shipped_weights() -> Path:
    """Return the weights that come with the package.

    Raises:
        InputError: if they are not there.
    """
    try:
        return asset_path("weights", "cvae.safetensors")
    except FileNotFoundError:
        raise InputError("the CVAE's weights are not there: train them with `dexgrasp train cvae`") from None


_decoder = lru_cache(maxsize=4)(read_decoder)


class LearnedFirst(ProposalSource):
    """Proposals of the network for convex objects, which it was made for; where there are none, of the surface."""

    def __init__(self) -> None:
        """Prepare.

        Raises:
            InputError: without the network's weights.
        """
        self._learned, self._surface = CvaeProposals(), SurfaceProposals()

    def propose(self, target: GraspTarget, settings: PlannerSettings, rng: Generator) -> Proposals:
        """Return proposals; the reason for none is the surface's."""
        if target.is_convex:
            found = self._learned.propose(target, settings, rng)
            # It knows no neighbours and no request: where they leave little of what it says, the surface has more.
            narrow = target.neighbours or target.narrowed
            if len(found.contacts) > (settings.triples // 2 if narrow else 0):
                return found
        return self._surface.propose(target, settings, rng)


SOURCES = {"auto": LearnedFirst, "surface": SurfaceProposals, "cvae": CvaeProposals}


def make_source(name: str, robot: Robot | None = None) -> ProposalSource:
    """Return a source of proposals by its name; of a hand that the network has not learned, `auto` is the surface.

    Args:
        name: of the source.
        robot: whose hand is to grasp; ours by default.

    Raises:
        InputError: for an unknown name, for `auto` and `cvae` without weights, or for `cvae` of another hand.
    """
    if name not in SOURCES:
        raise unknown_name("proposals", name, SOURCES)
    source = SOURCES[name]()
    if robot is not None:
        if name == "auto" and robot.hand.stamp != default_cell().robot.hand.stamp:
            return SurfaceProposals()
        source.check_hand(robot.hand)
    return source
