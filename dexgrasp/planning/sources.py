"""Sources of proposals by their names."""

from dexgrasp.planning.proposals import (
    ConvexOnly,
    FirstProposals,
    ProposalSource,
    SurfaceProposals,
    UniformProposals,
)
from dexgrasp_env.errors import unknown_name

SOURCES = ("auto", "surface", "cvae", "uniform")


def make_source(name: str) -> ProposalSource:
    """Return a source of proposals by its name.

    Raises:
        InputError: for an unknown name, or for `cvae` without its weights.
    """
    if name == "surface":
        return SurfaceProposals()
    if name == "uniform":
        return UniformProposals()
    if name in ("cvae", "auto"):
        from dexgrasp.planning.cvae_source import CvaeProposals

        learned = CvaeProposals()
        return learned if name == "cvae" else FirstProposals(ConvexOnly(learned), SurfaceProposals())
    raise unknown_name("proposals", name, SOURCES)
