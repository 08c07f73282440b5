"""Where three fingertips could go: contact triples of a surface, and the interface that learned sources share."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from dexgrasp.geometry.samples import triangle_samples
from dexgrasp.physics.closure import closure_sweep
from dexgrasp.physics.margin import margins
from dexgrasp.planning.ranking import best_shared, robustness
from dexgrasp.planning.settings import PlannerSettings
from dexgrasp.shape.target import GraspTarget
from dexgrasp_env.arrays import Array

LEAST_DISTANCE = 0.03
"""m between contacts: two fingertips are wider than this."""
_ROUNDING = 1e-4  # m
_JUDGED = 30  # times as many feasible triples have their margin computed as are proposed
_NO_CLOSURE, _NO_SURFACE = "no_closure_triple", "no_surface_above_table"


@dataclass(frozen=True)
class Proposals:
    """K contact triples, best first.

    Attributes:
        contacts: (K, 3, 3) m, world frame.
        normals: (K, 3, 3) out of the object.
        assigned: whether the order is thumb, index, middle; otherwise any finger may take any contact.
        failure: why there are none.
        palms: (K, 4, 4) where the source would have the palm, world frame; None where it does not say.
    """

    contacts: Array
    normals: Array
    assigned: bool = False
    failure: str | None = None
    palms: Array | None = None

    @classmethod
    def none(cls, failure: str) -> "Proposals":
        """Return an empty set with its reason."""
        empty = np.zeros((0, 3, 3))
        return cls(empty, empty, failure=failure)


class ProposalSource(ABC):
    """A source of contact triples."""

    @abstractmethod
    def propose(self, target: GraspTarget, settings: PlannerSettings, rng: Generator) -> Proposals:
        """Return proposals for an object, best first."""


class SurfaceProposals(ProposalSource):
    """All triples of sampled surface points, judged for force closure and ranked."""

    def propose(self, target: GraspTarget, settings: PlannerSettings, rng: Generator) -> Proposals:
        """Return up to `settings.triples` triples, varied as well as good."""
        points, normals = graspable_points(target, settings, rng)
        if len(points) < 3:
            return Proposals.none(_NO_SURFACE)
        triples = closure_sweep(points, normals, settings.friction, LEAST_DISTANCE)
        if not len(triples):
            return Proposals.none(_NO_CLOSURE)
        judged = _JUDGED * settings.triples
        if len(triples) > judged:
            triples = triples[rng.choice(len(triples), judged, replace=False)]
        contacts, at = points[triples], normals[triples]
        margin = margins(contacts, at, settings.friction)[0]
        if (margin > 0.0).any():  # the sweep's pyramids reach beyond the cones
            closed = margin > 0.0
            triples, contacts, at, margin = triples[closed], contacts[closed], at[closed], margin[closed]
        chosen = best_shared(triples, robustness(contacts, at, margin, target), settings.triples)
        return Proposals(contacts[chosen], at[chosen])


def graspable_points(target: GraspTarget, settings: PlannerSettings, rng: Generator) -> tuple[Array, Array]:
    """Sample points (N, 3) m and outward normals (N, 3) that a fingertip can reach above the table.

    The normal is the gradient of the distance at the centre of the touching fingertip: smooth over edges. Where another
    part is nearer to the fingertip than the point is, it cannot touch there.
    """
    samples = triangle_samples(target.distance.triangles, settings.surface_points, rng)
    centres = samples.points + settings.tip_height * samples.normals
    above = (samples.points[:, 2] > settings.table_clearance) & (
        centres[:, 2] > settings.tip_radius + settings.clearance
    )
    distance, gradient = target.distance.distance_gradient(centres[above])
    touching = distance > settings.tip_height - _ROUNDING
    centres, distance, gradient = centres[above][touching], distance[touching], gradient[touching]
    return centres - distance[:, None] * gradient, gradient
