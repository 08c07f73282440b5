"""The protocols that others publish for grasps of a floating hand.

What they share: the hand comes from the pregrasp to the grasp to the squeeze, stage by stage, and the object, pushed or
lifted or shaken, may not move further than allowed. Success rates are comparable within one protocol only. What differs
from the publications is in docs/scoring.md.
"""

from dexgrasp.scoring.protocols.base import GraspProtocol, Verdict
from dexgrasp.scoring.protocols.dexgraspbench import DexGraspBenchForceClosure, DexGraspBenchTabletop
from dexgrasp.scoring.protocols.dro import Dro
from dexgrasp.scoring.protocols.frogger import FroggerPick
from dexgrasp.scoring.protocols.get_a_grip import GetAGrip
from dexgrasp_env.errors import unknown_name

__all__ = ["GRASP_PROTOCOLS", "GraspProtocol", "Verdict", "get_grasp_protocol"]

GRASP_PROTOCOLS: dict[str, type[GraspProtocol]] = {
    protocol.name: protocol
    for protocol in (DexGraspBenchForceClosure, DexGraspBenchTabletop, FroggerPick, GetAGrip, Dro)
}
"""Every protocol for grasp files by name."""


def get_grasp_protocol(name: str) -> GraspProtocol:
    """Return a protocol by name.

    Raises:
        InputError: naming the valid ones.
    """
    if name not in GRASP_PROTOCOLS:
        raise unknown_name("protocol for grasp files", name, GRASP_PROTOCOLS)
    return GRASP_PROTOCOLS[name]()
