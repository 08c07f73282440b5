"""`dexgrasp list`: objects, environments, agents, protocols."""

import os
from pkgutil import resolve_name
from typing import Annotated, Any

from dexgrasp.cli.command import Answer, Argument, CellOptions, Command
from dexgrasp.cli.output import columns, record_table
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.valid import hints, one_of


def list_objects() -> list[Fields]:
    """Return the catalogue: name, sets, shape, size [mm], mass [g], and a flag for approximate ones."""
    from dexgrasp_env.objects.catalogue import CATALOGUE, OBJECT_SETS
    from dexgrasp_env.objects.load import load_object

    return [
        {
            "name": name,
            "sets": [s for s, members in OBJECT_SETS.items() if name in members],
            "shape": spec.shape,
            "size_mm": [round(1000 * side) for side in load_object(name).extents],
            "mass_g": round(1000 * spec.mass),
            "approximate": spec.approximate,
        }
        for name, spec in CATALOGUE.items()
    ]


def list_envs() -> list[Fields]:
    """Return the registered environments, the choices of their arguments, and published results on them."""
    import gymnasium as gym

    from dexgrasp.evaluation.protocol import PROTOCOLS, SHOWN
    from dexgrasp_env.robot.cell import default_cell

    return [
        {
            "id": id, "max_episode_steps": spec.max_episode_steps, "preset": spec.kwargs,
            **_modes(resolve_name(str(spec.entry_point))), "mount": default_cell().mounts,
            **{
                name: ", ".join(filter(None, map(protocol.shown, SHOWN)))
                for name, protocol in PROTOCOLS.items() if protocol.env_id == id and protocol.figures
            },
        }
        for id, spec in sorted(gym.registry.items())
        if id.startswith("DexGrasp/")
    ]  # fmt: skip


def _modes(env: Any) -> Fields:
    """Return the modes that a class of environments takes, by argument."""
    known, names = hints(env.settings_type), ("obs_mode", "control_mode", "reward_mode")
    return {name: rule.choices for name in names if (rule := known[name].rule)}


def list_agents() -> list[Fields]:
    """Return the agents: name, observation and control mode, and summary."""
    from dexgrasp.registry import AGENTS

    return [{"name": name} | _describe(spec) for name, spec in AGENTS.items()]


def list_protocols() -> list[Fields]:
    """Return the protocols: name, environment, description, and published results."""
    from dexgrasp.evaluation.protocol import GROUPS, PROTOCOLS, SHOWN
    from dexgrasp.evaluation.scoring.protocols import GRASP_PROTOCOLS

    return [
        {"name": name, "env": env, "description": text}
        | {kind: PROTOCOLS[name].shown(kind) if name in PROTOCOLS else "" for kind in SHOWN}
        for name, env, text in (
            *((name, protocol.env_id, protocol.description) for name, protocol in PROTOCOLS.items()),
            *((name, "", f"the mean of {', '.join(of)}") for name, of in GROUPS.items()),
            *((name, "grasp files", protocol.summary) for name, protocol in GRASP_PROTOCOLS.items()),
        )
    ]


def _describe(spec: str) -> Fields:
    try:
        agent = resolve_name(spec)
    except ImportError as error:
        return {"obs_mode": None, "control_mode": None, "summary": f"not available here: {error}"}
    modes = {key: agent.env_settings.get(key) for key in ("obs_mode", "control_mode")}
    return modes | {"summary": (agent.__doc__ or "").strip().partition("\n")[0]}


_LISTS = {"objects": list_objects, "envs": list_envs, "agents": list_agents, "protocols": list_protocols}


class List(Command, CellOptions):
    """List what there is.

    examples:
      dexgrasp list objects            the catalogue with sizes, masses and sets
      dexgrasp list envs --json        ids and what gym.make accepts
      dexgrasp list envs --robot leap.yaml    and what a robot's actions and observations are
      dexgrasp list agents
      dexgrasp list protocols          how `evaluate` and `score` score

    Attributes:
        what: what to list.
    """

    what: Argument[Annotated[str, one_of(_LISTS)]]

    def run(self) -> Answer:
        """List the objects, environments, agents or protocols."""
        from dexgrasp_env.objects.catalogue import OBJECT_SETS
        from dexgrasp_env.objects.sets import MESH_SUFFIXES

        if self.what != "envs" and self.robot not in (None, os.environ.get("DEXGRASP_CELL")):
            raise InputError(
                f"--robot would change nothing: only `list envs` makes use of it, not {self.what}"
            )
        rows = _LISTS[self.what]()
        if self.what == "envs":
            from dexgrasp_env.tasks.control import CONTROL_MODES, action_size
            from dexgrasp_env.tasks.observations import key_sizes

            robot = self.cell.robot
            own = {
                "robot": robot.name, "joints": robot.joints, "fingers": [finger.name for finger in robot.hand.fingers],
                "control_mode": {mode: action_size(mode, robot) for mode in CONTROL_MODES},
                "observations": key_sizes("state", robot),
            }  # fmt: skip
            text = "\n\n".join("\n".join(columns(row)) for row in [*rows, own])
            return Answer({"envs": rows, "robot": own}, text)
        if self.what != "objects":
            return Answer({self.what: rows}, record_table(rows))
        sets = "; ".join(f"{name} ({len(members)})" for name, members in OBJECT_SETS.items())
        kinds = ", ".join(suffix[1:] for suffix in MESH_SUFFIXES)
        meshes = f"A mesh file ({kinds}) or a set file (json) does wherever an object is named."
        return Answer(
            {"objects": rows, "sets": OBJECT_SETS}, f"{record_table(rows)}\n\nSets: {sets}\n{meshes}"
        )
