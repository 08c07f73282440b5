"""Try an installed wheel: run by .ci/run with the Python of an empty environment, outside the checkout.

The environment has the wheel's declared dependencies and nothing else, so a file or a dependency that was left out
shows here. Prints a line for each thing tried; the first that fails ends it.
"""

import importlib
import json
import pkgutil
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from types import ModuleType
from typing import Any

EXTRAS = {"torch", "stable_baselines3", "safetensors", "tensorboard", "ray"}
"""What only the extras bring; a module that needs one may fail to import here."""

FILES = [
    ("robot", "panda.xml"),
    ("robot", "allegro.xml"),
    ("robot", "shells"),
    ("rest_poses", "sugar_box.json"),
    ("weights", "cvae.safetensors"),
]


def main() -> None:
    """Try everything."""
    for trial in (check_home, import_all, check_assets, step_environment, run_commands):
        print(f"smoke: {trial.__name__}: {trial()}", flush=True)


def check_home() -> str:
    """Both packages come from this environment, at one version."""
    import agents
    import dexgrasp_env

    for package in (dexgrasp_env, agents):
        assert Path(package.__path__[0]).is_relative_to(sys.prefix), f"{package.__path__} is not the wheel's"
    assert dexgrasp_env.__version__ == version("dexgrasp")
    return dexgrasp_env.__version__


def import_all() -> str:
    """Every module imports, but those that need an extra."""
    import agents
    import dexgrasp_env

    names = [name for package in (dexgrasp_env, agents) for name in _modules(package)]
    without = [name for name in names if not _imports(name)]
    return f"{len(names)} modules, {len(without)} of them need an extra: {' '.join(without) or 'none'}"


def _modules(package: ModuleType) -> list[str]:
    found = pkgutil.walk_packages(package.__path__, f"{package.__name__}.")
    return [module.name for module in found if not module.name.endswith("__main__")]


def _imports(name: str) -> bool:
    try:
        importlib.import_module(name)
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in EXTRAS:
            raise
        return False
    return True


def check_assets() -> str:
    """The files of assets/ are in the wheel."""
    from dexgrasp_env.assets import asset_path

    for parts in FILES:
        assert asset_path(*parts).is_relative_to(sys.prefix)
    return f"{len(list(asset_path('robot', 'shells').iterdir()))} shells of the robot"


def step_environment() -> str:
    """`gym.make` works, and a step of it."""
    import gymnasium as gym

    env = gym.make("DexGrasp/Lift-v1", objects="sugar_box", obs_mode="pointcloud")
    observation, info = env.reset(seed=0)
    assert info["is_success"] is False
    assert env.observation_space.contains(observation)
    _, reward, _, _, _ = env.step(env.action_space.sample())
    env.close()
    assert "torch" not in sys.modules
    return f"reward {float(reward):.3f}, {int(observation['cloud_mask'].sum())} points seen"


def run_commands() -> str:
    """The console script answers, plans without torch, and says in one line what is wrong."""
    script = str(Path(sys.executable).with_name("dexgrasp"))
    module = [sys.executable, "-m", "dexgrasp_env"]
    assert _output([script, "--version"]).split() == ["dexgrasp", version("dexgrasp")]
    assert _output([*module, "list", "agents"])
    objects = json.loads(_output([script, "list", "objects", "--json"]))["objects"]
    wrong = subprocess.run([script, "plan", "no_such_object"], capture_output=True, text=True)
    assert wrong.returncode == 2, wrong
    assert wrong.stderr.splitlines()[-1].startswith("dexgrasp plan: unknown object"), wrong.stderr
    plan: dict[str, Any] = json.loads(_output([script, "plan", "sugar_box", "--json"]))
    assert plan["success"], plan
    assert plan["certificate"]["holds"], plan
    return f"{len(objects)} objects; sugar_box planned in {plan['planning_seconds']:.2f} s"


def _output(command: list[str]) -> str:
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, f"{' '.join(command)} exited {done.returncode}:\n{done.stdout}{done.stderr}"
    return done.stdout


if __name__ == "__main__":
    main()
