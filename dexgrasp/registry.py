"""Agents by name."""

import importlib
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from dexgrasp.agent import Agent, complete
from dexgrasp.runs.reading import files_read
from dexgrasp.runs.weights import is_policy
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.files import jsonable
from dexgrasp_env.valid import NAMED, check

AGENTS: dict[str, str] = {
    "random": "dexgrasp.agents.baselines:RandomAgent",
    "hardcoded": "dexgrasp.agents.hardcoded:HardcodedAgent",
    "hardcoded_completed": "dexgrasp.agents.hardcoded:HardcodedCompletedAgent",
    "constant": "dexgrasp.agents.baselines:ConstantAgent",
    "cvae": "dexgrasp.agents.ablations:CvaeAgent",
    "cvae_kinematics": "dexgrasp.agents.ablations:CvaeKinematicsAgent",
    "bilevel": "dexgrasp.agents.bilevel:BilevelAgent",
    "bilevel_tracking": "dexgrasp.agents.tracking:TrackingAgent",
    "bilevel_alone": "dexgrasp.agents.bilevel:AloneAgent",
    "bc": "dexgrasp.agents.learned:BcAgent",
    "bc_cloud": "dexgrasp.agents.learned:BcCloudAgent",
    "rl": "dexgrasp.agents.learned:RlAgent",
}
"""Name -> module and class; imported when asked for, some need torch."""

_KINDS: dict[str, Callable[[str], bool]] = {
    "dexgrasp.agents.remote:RemoteAgent": lambda name: is_server(name),
    "dexgrasp.agents.checkpoint:CheckpointAgent": lambda name: name.endswith(".zip"),
    "dexgrasp.agents.lerobot:LeRobotAgent": lambda name: name.startswith("lerobot:"),
    "dexgrasp.agents.learned:LearnedAgent": is_policy,
}
"""Class of agents that are named by an address, a file or a folder -> which names are of it."""
_READ: dict[str, set[Path]] = {}
"""User's agent -> files that importing and making it has read in this process."""


def make_agent(name: str | os.PathLike[str], **kwargs: Any) -> Agent:
    """Make an agent.

    Args:
        name: a key of `AGENTS`; `package.module:Class` of one's own, looked for in the current directory
            too; the folder of a policy of `dexgrasp train`; a Stable-Baselines3 checkpoint, `path.zip` or
            `algorithm:path.zip`; `lerobot:` and the folder of a policy of LeRobot; or the address of a policy server,
            `ws://HOST:PORT`.
        kwargs: of the class.

    Raises:
        InputError: for an unknown name, or a class that cannot be imported or made, or is no agent.
    """
    name = str(check("agent", name, NAMED))
    if name in AGENTS:
        return _load(AGENTS[name])(**kwargs)
    if kind := _kind(name):
        return _load(kind)(name, **kwargs)
    check_name(name)
    found = set[Path]()
    try:
        with files_read(found):
            make = _load(name)
            module = sys.modules[name.partition(":")[0]]  # read before, where another agent is of it
            if file := getattr(module, "__file__", None):
                found.add(Path(file))
            return complete(name, make(**kwargs))
    except InputError:
        raise
    except (Exception, SystemExit) as error:  # that a class of theirs cannot be made is the user's to mend
        raise InputError(f"agent {name!r} cannot be made: {type(error).__name__}: {error}") from error
    finally:
        _READ.setdefault(name, set()).update(found)


def placing_agent(name: str, env_id: str = "DexGrasp/Place-v2", **kwargs: Any) -> Agent:
    """Make an agent for tasks with goals; one of joint set-points is wrapped so that it carries its object there.

    Args:
        name: see `make_agent`.
        env_id: of the task: Place, or Clear, in which objects are grasped one after the other.
        **kwargs: of the class.

    Raises:
        InputError: as `make_agent`.
    """
    agent = make_agent(name, **kwargs)
    if agent.env_settings.get("control_mode") != "joint_position":
        return agent
    kind = "ClearingAgent" if env_id.startswith("DexGrasp/Clear") else "PlacingAgent"
    return _load(f"dexgrasp.agents.placing:{kind}")(agent)


def check_name(name: str) -> str:
    """Check the form of an agent's name, without importing anything, and return it.

    Raises:
        InputError: for a name that is neither known, nor a checkpoint, nor `module:Class`.
    """
    if name not in AGENTS and ":" not in name and not _kind(name):
        forms = [
            "package.module:Class",
            "the folder of a trained policy",
            "a checkpoint's path ending in .zip",
            "the address of a policy server, ws://HOST:PORT",
            "lerobot:FOLDER",
        ]
        raise unknown_name("agent", name, [*AGENTS, *forms])
    return name


def is_server(name: str) -> bool:
    """Return True for the address of a policy server."""
    return name.startswith(("ws://", "wss://"))


def server_identity(name: str) -> Fields:
    """Return the metadata of a policy server as JSON.

    Raises:
        InputError: where no server answers.
    """
    agent: Any = make_agent(name)
    agent.close()
    return dict(jsonable(agent.metadata))


def agent_files(name: str) -> list[Path]:
    """Return the files that an agent depends on: those of a policy or checkpoint, or those read to make it.

    For a user's wrapper, `module:Class`, as for an agent, these include its module and what that imports.
    """
    if kind := _kind(name):
        return [path for path in _load(kind).files(name) if path.is_file()]
    if ":" in name and name not in _READ:
        with suppress(InputError):  # whoever makes it for a trial says what is wrong
            make_agent(name)
    return sorted(_READ.get(name, ()))


def _kind(name: str) -> str:
    """Return the class of `_KINDS` that a name is of; empty for other names."""
    return next((kind for kind, fits in _KINDS.items() if fits(name)), "")


def _load(spec: str) -> Any:
    module_name, _, attribute = spec.partition(":")
    if "" not in sys.path:  # the current folder, where `python -c` looks too
        sys.path.append("")
    try:
        module = importlib.import_module(module_name)
    except InputError:  # it needs an extra, and says which
        raise
    except (Exception, SystemExit) as error:  # an empty or relative name, or whatever the module does
        raise InputError(f"agent {spec!r}: module {module_name!r} cannot be imported ({error})") from error
    if not callable(found := getattr(module, attribute, None)):
        raise InputError(f"agent {spec!r}: module {module_name!r} has no class {attribute!r}")
    return found
