"""Protocols: what every agent is scored on, and the seeds that give all of them the same scenes."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dexgrasp.agent import Agent
from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.objects.load import seed_name

AGENT_KEYS = ("obs_mode", "control_mode", "observe", "reward_mode")
"""The settings that an agent may choose; everything else belongs to the protocol."""


@dataclass(frozen=True)
class Protocol:
    """One way of scoring.

    Attributes:
        name: what summaries call it.
        env_id: the registered environment; its time limit and success criterion apply.
        scene: settings of `gym.make` that make the scenes.
        description: one line for people.
    """

    name: str
    env_id: str
    scene: Mapping[str, Any] = field(default_factory=dict)
    description: str = ""

    @property
    def places(self) -> bool:
        """Whether it has goals that objects are brought to."""
        return self.env_id.startswith("DexGrasp/Place")


DEFAULT_PROTOCOL = "lift"

_LIFT = "DexGrasp/Lift-v2"
_LIMIT = 300  # control steps of an episode; a disturbance adds its own
_PUSHED, _SHAKEN = 80, 40  # control steps that pushes and shaking take


def _disturbed(kind: str, steps: int, size: float = 1.0) -> dict[str, Any]:
    """Settings of a scene in which the held object is disturbed, at a friction of 0.5."""
    return {"friction": 0.5, "disturbance": {"kind": kind, "size": size}, "max_episode_steps": _LIMIT + steps}


PROTOCOLS: dict[str, Protocol] = {
    protocol.name: protocol
    for protocol in (
        Protocol("lift", _LIFT, {}, "the environment as registered: 15 s, lift 10 cm, hold 3 s, friction 0.7"),
        Protocol("upright", _LIFT, {"presentation": "upright"}, "standing as built where that is stable, else at rest"),
        Protocol("slippery@0.5", _LIFT, {"friction": 0.5}, "friction 0.5"),
        Protocol("slippery@0.35", _LIFT, {"friction": 0.35}, "friction 0.35"),
        Protocol("heavy", _LIFT, {"mass": 1.5}, "1.5 times the mass"),
        Protocol(
            "pushed@0.5", _LIFT, _disturbed("pushed", _PUSHED, 0.5),
            "friction 0.5; once held, pushed 0.5 s along +-x, +-y, +-z by half the object's weight, then held 3 s",
        ),
        Protocol(
            "pushed@1", _LIFT, _disturbed("pushed", _PUSHED, 1.0),
            "the same by its whole weight; a failure where pushed@0.5 was one",
        ),
        Protocol(
            "shaken", _LIFT, _disturbed("shaken", _SHAKEN),
            "friction 0.5; once held, shaken for 2 s by joints 1 and 4 of the arm, then held 3 s",
        ),
        Protocol("one_view", _LIFT, {"views": 1}, "one camera, drawn by the scene's seed"),
        Protocol(
            "miscalibrated", _LIFT, {"calibration": {"position": 0.010, "rotation": float(np.radians(2.0))}},
            "all cameras off by the same 10 mm in a random direction, and 2 deg about a random axis at the table",
        ),
        Protocol("place", "DexGrasp/Place-v2", {}, "brought to a goal: held in the air, or put down and let go; 1 s"),
    )
}  # fmt: skip
"""Every protocol by name; a published number names the one it was made with. No agent is told which it is in."""

GROUPS: dict[str, tuple[str, ...]] = {
    "slippery": ("slippery@0.5", "slippery@0.35"),
    "pushed": ("pushed@0.5", "pushed@1"),
}
"""Protocols of two parts; the rate is the mean of the parts' rates."""

ROBUST = ("lift", "upright", "slippery", "heavy", "pushed", "shaken", "one_view", "miscalibrated")
"""What `robust` is the mean of."""


def get_protocol(name: str) -> Protocol:
    """Return a protocol by name.

    Raises:
        InputError: naming the valid ones.
    """
    if name not in PROTOCOLS:
        raise unknown_name("protocol", name, protocol_names())
    return PROTOCOLS[name]


def protocol_names() -> list[str]:
    """Return every name that `--protocol` takes."""
    return [*PROTOCOLS, *GROUPS, "robust"]


def parts(name: str) -> tuple[str, ...]:
    """Return the protocols that a name stands for: itself, or its parts.

    Raises:
        InputError: for an unknown name.
    """
    if name == "robust":
        return tuple(part for member in ROBUST for part in parts(member))
    return GROUPS[name] if name in GROUPS else (get_protocol(name).name,)


@dataclass(frozen=True)
class TrialSeeds:
    """Seeds of one trial, below 2^32: of the scene and of the agent's own randomness."""

    scene: int
    agent: int


def trial_seeds(seed: int, target: str, trial: int) -> TrialSeeds:
    """Return the seeds of trial `trial` on an object.

    They depend on nothing else: not on the agent, the other objects, the order or the number of workers.

    Args:
        seed: of the evaluation.
        target: name of the catalogue, or path of a mesh, of which the file's name counts.
        trial: number from 0 on.
    """
    digest = hashlib.sha256(seed_name(target).encode()).digest()
    words = np.frombuffer(digest[:16], dtype="<u4").tolist()
    scene, agent = np.random.SeedSequence([seed, trial, *words]).generate_state(2)
    return TrialSeeds(int(scene), int(agent))


def agent_settings(name: str, agent: Agent) -> dict[str, Any]:
    """Return the environment settings that an agent asks for.

    Raises:
        InputError: if it asks for something that is the protocol's to choose.
    """
    settings = dict(agent.env_settings)
    for key in settings:
        if key not in AGENT_KEYS:
            raise InputError(
                f"agent {name!r} asks for env_settings {key!r}, which the protocol decides: "
                f"valid are {', '.join(AGENT_KEYS)}"
            )
    return settings
