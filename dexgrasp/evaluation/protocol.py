"""Protocols: settings that agents are scored under, and the seeds that give all of them the same scenes."""

import hashlib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dexgrasp.agent import Agent
from dexgrasp_env.arrays import Fields
from dexgrasp_env.assets import asset_path
from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.objects.load import seed_name
from dexgrasp_env.yaml_file import parse_yaml, read_yaml

AGENT_KEYS = ("obs_mode", "control_mode", "observe", "reward_mode", "frame_skip", "action_scale", "hold")
"""Settings of the environment that an agent may choose; all others belong to the protocol."""


@dataclass(frozen=True)
class PublishedResult:
    """Published successes of agents on the same trials of a protocol.

    Attributes:
        objects: names, sets or files, with spaces between.
        trials: of each agent.
        agents: successes by name.
        command: that made them.
        counts: criterion of success: `held`, or `clean`, where no neighbour moved either.
    """

    objects: str
    trials: int
    agents: Mapping[str, int]
    command: str
    counts: str = "held"


SHOWN = {
    "floor": ("constant", "hardcoded"), "planner": ("bilevel", "bilevel_tracking"), "learned": ("bc_cloud", "bc", "rl")
}  # fmt: skip
"""Agents whose results are shown, by kind: every baseline of `floor`, and the best of each other kind."""


@dataclass(frozen=True)
class Protocol:
    """One way of scoring.

    Attributes:
        name: what summaries call it.
        description: one line for people.
        scene: settings of `gym.make` that make the scenes.
        env_id: the registered environment; its time limit and success criterion apply.
        figures: successes of agents, published with the protocol.
    """

    name: str
    description: str
    scene: Fields = field(default_factory=dict)
    env_id: str = "DexGrasp/Lift-v2"
    figures: tuple[PublishedResult, ...] = ()

    @property
    def places(self) -> bool:
        """Flag: the task brings objects to a goal."""
        return self.env_id.startswith(("DexGrasp/Place", "DexGrasp/Clear"))

    @property
    def floor_line(self) -> str:
        """Published results of the baselines as a line; empty where there are none."""
        floor = self.shown("floor")
        return f"floor of {self.name} on {self.figures[0].objects}: {floor}" if floor else ""

    def shown(self, kind: str) -> str:
        """Return the published results of a kind of `SHOWN` as text; empty where there are none."""
        found = [
            (one.agents[name] / one.trials, f"{name} {one.agents[name]} of {one.trials} {one.counts}")
            for name in SHOWN[kind]
            for one in self.figures
            if name in one.agents
        ]
        best = found if kind == "floor" else sorted(found, reverse=True)[:1]
        return ", ".join(text for _, text in best)


DEFAULT_PROTOCOL = "lift"
OTHER_PHYSICS = "lift@warp"
"""Protocol in another engine, which is reported but averaged into no other figure."""

_CONTENT = read_yaml(asset_path("protocols.yaml"))
_FIGURES = read_yaml(asset_path("figures.yaml"))


def _figures(name: str) -> tuple[PublishedResult, ...]:
    return tuple(PublishedResult(**figure) for figure in _FIGURES.get(name, ()))


PROTOCOLS: dict[str, Protocol] = {
    name: Protocol(name, **words, figures=_figures(name)) for name, words in _CONTENT["protocols"].items()
}
"""Protocols by name. No agent is told under which it acts."""

FAMILIES: dict[str, Fields] = _CONTENT["families"]
"""Families of protocols by NAME, for NAME@NUMBER; the number is a setting of their scenes."""


def _of_family(stem: str, number: float) -> Protocol:
    words = FAMILIES[stem]
    scene = {words["setting"]: number}
    if "steps" in words:
        scene["max_episode_steps"] = words["steps"] * number
    name, description = f"{stem}@{number:g}", words["description"].format(f"{number:g}")
    return Protocol(name, description, scene, words["env_id"], _figures(name))


PROTOCOLS |= {
    one.name: one for stem, words in FAMILIES.items() for one in (_of_family(stem, n) for n in words["usual"])
}

GROUPS: dict[str, tuple[str, ...]] = {name: tuple(own) for name, own in _CONTENT["groups"].items()}
"""Groups of protocols, and of groups that stand before them; the rate is the mean of theirs."""


def get_protocol(name: str) -> Protocol:
    """Return a protocol by name.

    Raises:
        InputError: naming the valid ones.
    """
    stem, _, number = name.partition("@")
    if name not in PROTOCOLS and stem in FAMILIES:
        with suppress(ValueError):
            return _of_family(stem, float(number) if "." in number else int(number))
    if name not in PROTOCOLS:
        raise unknown_name("protocol", name, protocol_names())
    return PROTOCOLS[name]


def protocol_names() -> list[str]:
    """Return every name that `--protocol` takes."""
    return [*PROTOCOLS, *GROUPS]


def parts(name: str) -> tuple[str, ...]:
    """Return the protocols that a name stands for: itself, or the members of a group.

    Raises:
        InputError: for an unknown name.
    """
    if name in GROUPS:
        return tuple(part for member in GROUPS[name] for part in parts(member))
    return (get_protocol(name).name,)


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
    words = np.frombuffer(digest, "<u4", count=4).tolist()
    return TrialSeeds(*np.random.SeedSequence([seed, trial, *words]).generate_state(2).tolist())


def agent_settings(name: str, agent: Agent, preset: Mapping[str, Any] | None = None) -> Fields:
    """Return the environment settings that an agent asks for.

    Args:
        name: of the agent, for messages.
        agent: whose settings are asked.
        preset: registered keywords of the environment, for agents that adapt to them (`settings_in`).

    Raises:
        InputError: if it asks for a setting that belongs to the protocol.
    """
    asked = agent.settings_in(preset) if preset and hasattr(agent, "settings_in") else agent.env_settings
    for key in asked:
        if key not in AGENT_KEYS:
            raise InputError(
                f"agent {name!r} asks for env_settings {key!r}, which the protocol decides: "
                f"valid are {', '.join(AGENT_KEYS)}"
            )
    return dict(asked)


def agent_keywords(given: Mapping[str, Any] | Sequence[str], known: Fields, source: object) -> Fields:
    """Return keywords of `gym.make` that an agent was trained with: those known, and those given.

    Args:
        given: a mapping, or words `KEY=VALUE`.
        known: keywords that are certain.
        source: what says so.

    Raises:
        InputError: for a key that is not an agent's to choose, a value that is no YAML or contradicts what is known,
            or a repeated key.
    """
    found = Fields(given) if isinstance(given, Mapping) else Fields()
    for word in () if isinstance(given, Mapping) else given:
        key, equals, value = word.partition("=")
        if not equals or key in found:
            raise InputError(f"--env-kwargs {word!r}: valid is KEY=VALUE, each key once")
        try:
            found[key] = parse_yaml(value)
        except ValueError as error:
            raise InputError(f"--env-kwargs {word!r} has no value of YAML ({error})") from None
    for key, value in found.items():
        if key not in AGENT_KEYS:
            raise unknown_name("--env-kwargs key", key, AGENT_KEYS)
        if known.get(key, value) != value:
            raise InputError(f"{source} says {key}={known[key]}, which {key}={value} contradicts")
    return known | found
