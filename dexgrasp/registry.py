"""Agents by name."""

import importlib
import importlib.util
import os
import sys
from pathlib import Path
from typing import Any

from dexgrasp.agent import Agent, complete
from dexgrasp.runs.policy_folder import is_policy, policy_files
from dexgrasp_env.errors import InputError, unknown_name

AGENTS: dict[str, str] = {
    "random": "dexgrasp.agents.random:RandomAgent",
    "hardcoded": "dexgrasp.agents.hardcoded:HardcodedAgent",
    "hardcoded_completed": "dexgrasp.agents.hardcoded:HardcodedCompletedAgent",
    "cvae": "dexgrasp.agents.ablations:CvaeAgent",
    "cvae_kinematics": "dexgrasp.agents.ablations:CvaeKinematicsAgent",
    "bilevel": "dexgrasp.agents.bilevel:BilevelAgent",
    "bilevel_alone": "dexgrasp.agents.bilevel:AloneAgent",
    "bc": "dexgrasp.agents.learned:BcAgent",
    "bc_cloud": "dexgrasp.agents.learned:BcCloudAgent",
    "rl": "dexgrasp.agents.learned:RlAgent",
}
"""Name -> module and class; imported when asked for, some need torch."""

_OTHER_FORMS = (
    "package.module:Class",
    "the folder of a trained policy",
    "a checkpoint's path ending in .zip",
)


def make_agent(name: str, **kwargs: Any) -> Agent:
    """Make an agent.

    Args:
        name: a key of `AGENTS`; `package.module:Class` of one's own, looked for in the current directory
            too; the folder of a policy of `dexgrasp train`; or a Stable-Baselines3 checkpoint, `path.zip` or
            `algorithm:path.zip`.
        kwargs: of the class.

    Raises:
        InputError: for an unknown name, or a class that cannot be had or is no agent.
    """
    if name in AGENTS:
        return _load(AGENTS[name])(**kwargs)
    if name.endswith(".zip"):
        return _load("dexgrasp.agents.checkpoint:CheckpointAgent")(name, **kwargs)
    if is_policy(name):
        return _load("dexgrasp.agents.learned:LearnedAgent")(name, **kwargs)
    check_name(name)
    try:
        made = _load(name)(**kwargs)
    except InputError:
        raise
    except Exception as error:  # that a user's class cannot be made is the user's to mend
        raise InputError(f"agent {name!r} cannot be made: {type(error).__name__}: {error}") from error
    return complete(name, made)


def placing_agent(name: str) -> Agent:
    """Make an agent for goals: one that commands set-points of joints has its grasp carried on to the goal.

    Raises:
        InputError: as `make_agent`.
    """
    agent = make_agent(name)
    if agent.env_settings.get("control_mode") != "joint_position":
        return agent
    return _load("dexgrasp.agents.placing:PlacingAgent")(agent)


def agent_for(name: str, friction: float | None, min_success_probability: float | None = None) -> Agent:
    """Make an agent for surfaces of some friction: one that plans grasps counts on its usual share of it.

    Args:
        name: see `make_agent`.
        friction: coefficient; None leaves the agent with what it counts on by default.
        min_success_probability: probability of being held that one that plans grasps must see in a grasp; None for any.

    Raises:
        InputError: as `make_agent`.
    """
    from dexgrasp.planning.result import PlansGrasps
    from dexgrasp.planning.settings import PlannerSettings

    agent = make_agent(name)
    if (friction is None and min_success_probability is None) or not isinstance(agent, PlansGrasps):
        return agent
    return make_agent(name, settings=PlannerSettings.of(friction, min_success_probability))


def check_name(name: str) -> str:
    """Return an agent's name, checked as far as that can be without importing anything.

    Raises:
        InputError: for a name that is neither known, nor a checkpoint, nor `module:Class`.
    """
    if name not in AGENTS and not name.endswith(".zip") and ":" not in name and not is_policy(name):
        raise unknown_name("agent", name, [*AGENTS, *_OTHER_FORMS])
    return name


def agent_files(name: str) -> list[Path]:
    """Return the files, code apart, that what an agent does rests on: of a trained policy, or of a checkpoint."""
    if is_policy(name):
        return policy_files(name)
    if name.endswith(".zip"):
        return _load("dexgrasp.agents.checkpoint:checkpoint_files")(name)
    return []


def agent_source(name: str) -> Path | None:
    """Return the file of the module that an agent `package.module:Class` is in; None where there is none."""
    if ":" not in name:
        return None
    _look_here()
    try:
        spec = importlib.util.find_spec(name.partition(":")[0])
    except (ImportError, ValueError):  # make_agent says what is wrong with the name
        return None
    path = Path(spec.origin) if spec and spec.origin else None
    return path if path and path.is_file() else None


def _load(spec: str) -> Any:
    module_name, _, attribute = spec.partition(":")
    _look_here()
    try:
        module = importlib.import_module(module_name)
    except InputError:  # it needs an extra, and says which
        raise
    except Exception as error:  # an empty or relative name, or whatever the module does when it is imported
        raise InputError(f"agent {spec!r}: module {module_name!r} cannot be imported ({error})") from error
    if not callable(found := getattr(module, attribute, None)):
        raise InputError(f"agent {spec!r}: module {module_name!r} has no class {attribute!r}")
    return found


def _look_here() -> None:
    """Add the current directory to the path of modules, as `python -m` does."""
    here = os.getcwd()
    if here not in sys.path and "" not in sys.path:
        sys.path.append(here)
