"""Sources of proposals by their names."""

from numpy.random import Generator

from dexgrasp.planning.cvae_source import CvaeProposals
from dexgrasp.planning.proposals import Proposals, ProposalSource, SurfaceProposals
from dexgrasp.planning.settings import PlannerSettings
from dexgrasp.shape.target import GraspTarget
from dexgrasp_env.errors import unknown_name
from dexgrasp_env.robot.cell import default_cell
from dexgrasp_env.robot.robot import Robot


class LearnedFirst(ProposalSource):
    """What the network proposes for convex objects, which it was made for; where that is nothing, the surface."""

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
            # It knows no neighbours: where they leave little of what it says, the surface has more.
            if len(found.contacts) > (settings.triples // 2 if target.neighbours else 0):
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
    if robot is not None and name == "auto" and robot.hand.stamp != default_cell().robot.hand.stamp:
        return SurfaceProposals()
    if robot is not None:
        source.check_hand(robot.hand)
    return source
