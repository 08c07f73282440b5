"""`dexgrasp list`: objects, environments, agents, protocols."""

from typing import Annotated, Any

from dexgrasp.cli.command import Answer, Argument, Command
from dexgrasp.cli.figures import record_table, shown
from dexgrasp_env.valid import one_of


def _sets() -> dict[str, Any]:
    from dexgrasp_env.objects.catalogue import OBJECT_SETS

    return {"sets": {name: list(members) for name, members in OBJECT_SETS.items()}}


def list_objects() -> list[dict[str, Any]]:
    """Return the catalogue: name, sets, shape, size mm, mass g, and whether size and mass are approximate."""
    from dexgrasp_env.objects.catalogue import CATALOGUE, OBJECT_SETS
    from dexgrasp_env.objects.load import load_object

    return [
        {
            "name": name,
            "sets": [s for s, members in OBJECT_SETS.items() if name in members],
            "shape": spec.shape,
            "size_mm": [round(1000 * float(side)) for side in load_object(name).extents],
            "mass_g": round(1000 * spec.mass),
            "approximate": spec.approximate,
        }
        for name, spec in CATALOGUE.items()
    ]


def list_envs() -> list[dict[str, Any]]:
    """Return the registered environments with the choices of their arguments."""
    import gymnasium as gym
    from gymnasium.envs.registration import load_env_creator

    import dexgrasp_env  # noqa: F401  (registers the environments)
    from dexgrasp_env.robot.cell import default_cell
    from dexgrasp_env.tasks.control import CONTROL_MODES
    from dexgrasp_env.tasks.rewards import REWARD_MODES

    types: dict[str, Any] = {
        id: load_env_creator(str(spec.entry_point))
        for id, spec in gym.registry.items() if id.startswith("DexGrasp/")
    }  # fmt: skip
    return [
        {
            "id": id, "max_episode_steps": gym.spec(id).max_episode_steps, "preset": dict(gym.spec(id).kwargs),
            "obs_mode": list(types[id].obs_modes), "control_mode": list(CONTROL_MODES),
            "reward_mode": list(REWARD_MODES), "mount": list(default_cell().mounts),
        }
        for id in sorted(types)
    ]  # fmt: skip


def list_agents() -> list[dict[str, Any]]:
    """Return the agents by name: what they observe, their summary, and whether they can be used here."""
    from dexgrasp.registry import AGENTS

    return [{"name": name, **_describe(spec)} for name, spec in AGENTS.items()]


def list_protocols() -> list[dict[str, Any]]:
    """Return the protocols: name, environment, what is special."""
    from dexgrasp.evaluation.protocol import GROUPS, PROTOCOLS, ROBUST
    from dexgrasp.scoring.protocols import GRASP_PROTOCOLS

    found = [(name, protocol.env_id, protocol.description) for name, protocol in PROTOCOLS.items()]
    found += [
        (name, "", f"the mean of {', '.join(of)}") for name, of in (GROUPS | {"robust": ROBUST}).items()
    ]
    found += [(name, "grasp files", protocol.summary) for name, protocol in GRASP_PROTOCOLS.items()]
    return [{"name": name, "env": env, "description": text} for name, env, text in found]


def _describe(spec: str) -> dict[str, Any]:
    import importlib

    module, _, attribute = spec.partition(":")
    try:
        agent = getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        return {"obs_mode": None, "control_mode": None, "summary": f"not available here: {error}"}
    settings, summary = agent.env_settings, (agent.__doc__ or "").strip().partition("\n")[0]
    return {**{key: settings.get(key) for key in ("obs_mode", "control_mode")}, "summary": summary}


def _text(what: str, rows: list[dict[str, Any]], sets: dict[str, list[str]] | None = None) -> str:
    if what == "envs":
        return "\n\n".join("\n".join(f"{key}: {shown(value)}" for key, value in row.items()) for row in rows)
    if sets is None:
        return record_table(rows)
    listed = "; ".join(f"{name} ({len(members)})" for name, members in sets.items())
    meshes = "A mesh file (obj, stl, ply, glb) or a set file (json) does wherever an object is named."
    return f"{record_table(rows)}\n\nSets: {listed}\n{meshes}"


_LISTS = {
    "objects": list_objects,
    "envs": list_envs,
    "agents": list_agents,
    "protocols": list_protocols,
}


class List(Command):
    """List what there is.

    examples:
      dexgrasp list objects            the catalogue with sizes, masses and sets
      dexgrasp list envs --json        ids and what gym.make accepts
      dexgrasp list agents
      dexgrasp list protocols          how `evaluate` and `score` score

    Attributes:
        what: what to list.
    """

    what: Argument[Annotated[str, one_of(_LISTS)]]

    def run(self) -> Answer:
        """List it."""
        rows = _LISTS[self.what]()
        sets = _sets() if self.what == "objects" else {}
        return Answer({self.what: rows} | sets, _text(self.what, rows, **sets))


COMMAND = List
