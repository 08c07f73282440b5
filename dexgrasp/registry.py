"""Agents by name."""

import ast
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
    "constant": "dexgrasp.agents.constant:ConstantAgent",
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


def agent_sources(name: str) -> list[Path]:
    """Return the files that an agent `package.module:Class` rests on.

    They are its module, the modules of the same folder that it imports, and files that these name in their text, as
    weights: nothing is run for it, so a name that is put together is not seen.
    """
    module = name.partition(":")[0]
    if ":" not in name or name.endswith(".zip"):
        return []
    _look_here()
    try:
        spec = importlib.util.find_spec(module)
    except (ImportError, ValueError):  # make_agent says what is wrong with the name
        return []
    first = Path(spec.origin) if spec and spec.origin else None
    if not first or not first.is_file():
        return []
    own = module.partition(".")[0] in ("dexgrasp", "dexgrasp_env")  # all of which is hashed already
    found: dict[Path, None] = {}
    left = [first]
    while left:
        if (path := left.pop()) not in found:
            found[path] = None
            left += [] if own or path.suffix != ".py" else named_files(path)
    return list(found)


def named_files(source: Path) -> list[Path]:
    """Return the modules beside a Python file that it imports, and the files that its text names."""
    try:
        tree = ast.parse(source.read_bytes())
    except (SyntaxError, ValueError):  # importing it says what is wrong
        return []
    roots, modules, texts = [source.parent], list[str](), list[str]()
    while (roots[-1] / "__init__.py").is_file():  # of a package
        roots.append(roots[-1].parent)
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            modules += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            whole = node.module or ""
            modules += [whole, *(f"{whole}.{alias.name}".strip(".") for alias in node.names)]
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            texts.append(node.value)
    own = [root for root in roots if root.name not in ("site-packages", "dist-packages")]
    stems = [root / name.replace(".", "/") for root in own for name in modules if name]
    tried = [path for stem in stems for path in (stem.with_suffix(".py"), stem / "__init__.py")]
    tried += [base / text for text in texts if 0 < len(text) < 256 for base in (Path.cwd(), roots[0])]
    return [path for path in tried if os.path.isfile(path)]


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
