"""Agents by name."""

import ast
import importlib
import importlib.util
import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

from dexgrasp.agent import Agent, complete
from dexgrasp.runs.policy_folder import is_policy, policy_files
from dexgrasp.runs.reading import files_read
from dexgrasp_env.errors import InputError, unknown_name

AGENTS: dict[str, str] = {
    "random": "dexgrasp.agents.random:RandomAgent",
    "hardcoded": "dexgrasp.agents.hardcoded:HardcodedAgent",
    "hardcoded_completed": "dexgrasp.agents.hardcoded:HardcodedCompletedAgent",
    "constant": "dexgrasp.agents.constant:ConstantAgent",
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

_READ: dict[str, dict[Path, None]] = {}
"""Agent of the user's -> files that its module and making it have read in this process."""
_OTHER_FORMS = (
    "package.module:Class",
    "the folder of a trained policy",
    "a checkpoint's path ending in .zip",
    "the address of a policy server, ws://HOST:PORT",
    "lerobot:FOLDER",
)


def make_agent(name: str, **kwargs: Any) -> Agent:
    """Make an agent.

    Args:
        name: a key of `AGENTS`; `package.module:Class` of one's own, looked for in the current directory
            too; the folder of a policy of `dexgrasp train`; a Stable-Baselines3 checkpoint, `path.zip` or
            `algorithm:path.zip`; `lerobot:` and the folder of a policy of LeRobot; or the address of a policy server,
            `ws://HOST:PORT`.
        kwargs: of the class.

    Raises:
        InputError: for an unknown name, or a class that cannot be had or is no agent.
    """
    if name in AGENTS:
        return _load(AGENTS[name])(**kwargs)
    if is_server(name):
        return _load("dexgrasp.agents.remote:RemoteAgent")(name, **kwargs)
    if name.endswith(".zip"):
        return _load("dexgrasp.agents.checkpoint:CheckpointAgent")(name, **kwargs)
    if name.startswith("lerobot:"):
        return _load("dexgrasp.agents.lerobot:LeRobotAgent")(name, **kwargs)
    if is_policy(name):
        return _load("dexgrasp.agents.learned:LearnedAgent")(name, **kwargs)
    check_name(name)
    try:
        with files_read() as found:
            made = _load(name)(**kwargs)
        _READ.setdefault(name, {}).update(found)
    except InputError:
        raise
    except Exception as error:  # that a user's class cannot be made is the user's to mend
        raise InputError(f"agent {name!r} cannot be made: {type(error).__name__}: {error}") from error
    return complete(name, made)


def placing_agent(name: str, **kwargs: Any) -> Agent:
    """Make an agent for goals: one that commands set-points of joints has its grasp carried on to the goal.

    Raises:
        InputError: as `make_agent`.
    """
    agent = make_agent(name, **kwargs)
    if agent.env_settings.get("control_mode") != "joint_position":
        return agent
    return _load("dexgrasp.agents.placing:PlacingAgent")(agent)


def agent_for(
    name: str, friction: float | None, min_success_probability: float | None = None, request: Any = None
) -> Agent:
    """Make an agent for surfaces of some friction: one that plans grasps counts on its usual share of it.

    Args:
        name: see `make_agent`.
        friction: coefficient; None leaves the agent with what it counts on by default.
        min_success_probability: probability of being held that one that plans grasps must see in a grasp; None for any.
        request: a `GraspRequest` of agent `bilevel`; None for nothing.

    Raises:
        InputError: as `make_agent`.
    """
    from dexgrasp.planning.result import PlansGrasps
    from dexgrasp.planning.settings import PlannerSettings

    agent = make_agent(name)
    if (friction is None and min_success_probability is None and not request) or not isinstance(
        agent, PlansGrasps
    ):
        return agent
    asked = {"request": request} if request else {}
    return make_agent(name, settings=PlannerSettings.of(friction, min_success_probability), **asked)


def check_name(name: str) -> str:
    """Return an agent's name, checked as far as that can be without importing anything.

    Raises:
        InputError: for a name that is neither known, nor a checkpoint, nor `module:Class`.
    """
    if name not in AGENTS and not name.endswith(".zip") and ":" not in name and not is_policy(name):
        raise unknown_name("agent", name, [*AGENTS, *_OTHER_FORMS])
    return name


def is_server(name: str) -> bool:
    """Return True for the address of a policy server."""
    return name.startswith(("ws://", "wss://"))


def server_identity(name: str) -> dict[str, Any]:
    """Return what the policy server of an address says of itself.

    Raises:
        InputError: where no server answers.
    """
    return dict(_load("dexgrasp.agents.remote:server_metadata")(name))


def agent_files(name: str) -> list[Path]:
    """Return the files that what an agent does rests on: of a policy, of a checkpoint, or what making one has read."""
    if is_policy(name):
        return policy_files(name)
    if name.endswith(".zip"):
        return _load("dexgrasp.agents.checkpoint:checkpoint_files")(name)
    if name.startswith("lerobot:"):
        return _load("dexgrasp.agents.lerobot:policy_files")(name)
    if ":" in name and name not in _READ:
        with suppress(InputError):  # whoever makes it for a trial says what is wrong
            make_agent(name)
    return list(_READ.get(name, ()))


def agent_sources(name: str) -> list[Path]:
    """Return the files that an agent `package.module:Class` rests on.

    They are its module, the modules of the same folder that it imports or names, and files that these name in their
    text, as weights, with or without the folder: nothing is run for it.
    """
    module = name.partition(":")[0]
    if ":" not in name or name.endswith(".zip") or name.startswith("lerobot:") or is_server(name):
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
    modules += [
        text for text in texts if all(map(str.isidentifier, text.split(".")))
    ]  # of importlib.import_module
    stems = [root / name.replace(".", "/") for root in own for name in dict.fromkeys(modules) if name]
    tried = [path for stem in stems for path in (stem.with_suffix(".py"), stem / "__init__.py")]
    short = [text for text in dict.fromkeys(texts) if 0 < len(text) < 256 and "\0" not in text]
    bases = [Path.cwd(), roots[0]]
    bases += [base / text for text in short for base in tuple(bases) if (base / text).is_dir()]
    tried += [base / text for text in short for base in bases]
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
