"""`dexgrasp list`: objects, environments, agents, protocols."""

import argparse
from typing import Any

from dexgrasp.cli.options import add_json

_EPILOG = """examples:
  dexgrasp list objects            the catalogue with sizes, masses and sets
  dexgrasp list envs --json        ids and what gym.make accepts
  dexgrasp list agents
  dexgrasp list protocols          how `evaluate` and `score` score"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "list",
        help="what objects, environments, agents and protocols there are",
        epilog=_EPILOG,
        description="List what there is.",
    )
    parser.add_argument("what", choices=tuple(_LISTS), help="what to list")
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Print a table, or one JSON object."""
    from dexgrasp.cli.output import print_json
    from dexgrasp.runs.text import left_table

    rows = _LISTS[args.what]()
    if args.json:
        print_json({"schema": 1, args.what: rows} | (_sets() if args.what == "objects" else {}))
        return 0
    if args.what == "envs":
        print("\n\n".join("\n".join(f"{key}: {_words(value)}" for key, value in row.items()) for row in rows))
        return 0
    print(left_table(tuple(rows[0]), [[_words(value) for value in row.values()] for row in rows]))
    if args.what == "objects":
        print("\nSets: " + "; ".join(f"{name} ({len(members)})" for name, members in _sets()["sets"].items()))
        print("A mesh file (obj, stl, ply, glb) or a set file (json) does wherever an object is named.")
    return 0


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

    import dexgrasp_env  # noqa: F401  (registers the environments)
    from dexgrasp_env.robot.cell import default_cell
    from dexgrasp_env.tasks.control import CONTROL_MODES
    from dexgrasp_env.tasks.rewards import REWARD_MODES

    choices = {
        "control_mode": list(CONTROL_MODES),
        "reward_mode": list(REWARD_MODES),
        "mount": list(default_cell().mounts),
    }
    specs = {id: spec for id, spec in sorted(gym.registry.items()) if id.startswith("DexGrasp/")}
    return [
        {
            "id": id,
            "max_episode_steps": spec.max_episode_steps,
            "preset": dict(spec.kwargs),
            "obs_mode": list(_env_type(spec.entry_point).obs_modes),
            **choices,
        }
        for id, spec in specs.items()
    ]


def _env_type(entry_point: Any) -> Any:
    from gymnasium.envs.registration import load_env_creator

    return load_env_creator(entry_point)


def list_agents() -> list[dict[str, Any]]:
    """Return the agents by name: what they observe, their summary, and whether they can be used here."""
    from dexgrasp.registry import AGENTS

    return [{"name": name, **_describe(spec)} for name, spec in AGENTS.items()]


def list_protocols() -> list[dict[str, Any]]:
    """Return the protocols: name, environment, what is special."""
    from dexgrasp.evaluation.protocol import GROUPS, PROTOCOLS, ROBUST
    from dexgrasp.scoring.protocols import GRASP_PROTOCOLS

    of_agents = [
        {"name": protocol.name, "env": protocol.env_id, "description": protocol.description}
        for protocol in PROTOCOLS.values()
    ]
    of_files = [
        {"name": name, "env": "grasp files", "description": protocol.summary}
        for name, protocol in GRASP_PROTOCOLS.items()
    ]
    made_of = [
        {"name": name, "env": "", "description": "the mean of " + ", ".join(names)}
        for name, names in (GROUPS | {"robust": ROBUST}).items()
    ]
    return of_agents + made_of + of_files


def _describe(spec: str) -> dict[str, Any]:
    import importlib

    module, _, attribute = spec.partition(":")
    try:
        agent = getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        return {"obs_mode": None, "control_mode": None, "summary": f"not available here: {error}"}
    settings = dict(getattr(agent, "env_settings", {}))
    summary = (agent.__doc__ or "").strip().partition("\n")[0]
    return {
        "obs_mode": settings.get("obs_mode"),
        "control_mode": settings.get("control_mode"),
        "summary": summary,
    }


def _words(value: Any) -> str:
    if isinstance(value, list):
        return (" x " if value and isinstance(value[0], int) else ", ").join(map(str, value))
    if isinstance(value, dict):
        return ", ".join(f"{key}={part}" for key, part in value.items()) or "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return "-" if value is None else str(value)


_LISTS = {
    "objects": list_objects,
    "envs": list_envs,
    "agents": list_agents,
    "protocols": list_protocols,
}
