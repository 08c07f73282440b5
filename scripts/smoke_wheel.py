"""Try an installed wheel: run by .ci/run with the Python of an empty environment, outside the checkout.

The environment has the wheel's declared dependencies and nothing else, so a file or a dependency that was left out
shows here. With no argument it is the plain installation: environments step, and the planner says which extra it
needs. With `[planner]` a grasp is planned, without torch. With `names` it is tried beside openai-agents, whose package
is the top-level `agents`. Prints a line for each thing tried; the first that fails ends it.
"""

import importlib
import importlib.util
import json
import pkgutil
import subprocess
import sys
from importlib.metadata import files, packages_distributions, version
from pathlib import Path


def main() -> None:
    """Try everything."""
    trials = {
        "": (import_all, check_home, step_environment, miss_the_planner),
        "[planner]": (import_all, plan_without_torch),
        "names": (keep_names_apart,),
    }
    for trial in trials["".join(sys.argv[1:])]:
        print(f"smoke: {trial.__name__}: {trial()}", flush=True)


def check_home() -> str:
    """Both packages come from this environment, at one version, with their assets."""
    import dexgrasp
    import dexgrasp_env
    from dexgrasp_env.assets import asset_path

    for package in (dexgrasp_env, dexgrasp):
        assert Path(package.__path__[0]).is_relative_to(sys.prefix), f"{package.__path__} is not the wheel's"
    assert dexgrasp_env.__version__ == version("dexgrasp")
    assert asset_path("robot", "shells").is_relative_to(sys.prefix)
    return dexgrasp_env.__version__


def import_all() -> str:
    """Every module imports, but those that need an extra."""
    import dexgrasp
    import dexgrasp_env

    walks = (pkgutil.walk_packages(own.__path__, f"{own.__name__}.") for own in (dexgrasp_env, dexgrasp))
    names = [module.name for walk in walks for module in walk if not module.name.endswith("__main__")]
    without = [name for name in names if not _imports(name)]
    return f"{len(names)} modules, {len(without)} of them need an extra: {' '.join(without) or 'none'}"


def _imports(name: str) -> bool:
    from dexgrasp_env.extras import MissingExtraError, missing_extra

    try:
        importlib.import_module(name)
    except ImportError as error:
        if not isinstance(error, MissingExtraError) and missing_extra(error) is None:
            raise
        return False
    return True


def step_environment() -> str:
    """`gym.make` works, and a step of it."""
    import gymnasium as gym

    env = gym.make("DexGrasp/Lift-v2", objects="sugar_box", obs_mode="pointcloud")
    observation, info = env.reset(seed=0)
    assert info["is_success"] is False
    assert env.observation_space.contains(observation)
    _, reward, _, _, _ = env.step(env.action_space.sample())
    env.close()
    assert "torch" not in sys.modules
    return f"reward {float(reward):.3f}, {int(observation['cloud_mask'].sum())} points seen"


def miss_the_planner() -> str:
    """The console script answers, and says in one line which extra planning needs."""
    assert said("--version").split() == ["dexgrasp", version("dexgrasp")]
    subprocess.run([sys.executable, "-m", "dexgrasp_env", "--help"], check=True, capture_output=True)
    assert said("list", "agents")
    objects = json.loads(said("list", "objects", "--json"))["objects"]
    for extra, command in (("learning", "train cvae --data a --out b"), ("planner", "plan sugar_box")):
        line = said(*command.split(), code=2)
        assert f"pip install 'dexgrasp[{extra}]'" in line, line
    return f"{len(objects)} objects; {line}"


def plan_without_torch() -> str:
    """A grasp is planned and verified, and a wrong name is answered in one line."""
    wrong = said("plan", "no_such_object", code=2)
    assert wrong.startswith("dexgrasp plan: unknown object"), wrong
    plan = json.loads(said("plan", "sugar_box", "--json", "--out", "plan"))
    assert plan["success"], plan
    assert plan["certificate"]["holds"], plan
    assert said("verify", "plan/grasp.json")
    assert importlib.util.find_spec("torch") is None
    return f"sugar_box planned in {plan['planning_seconds']:.2f} s"


def keep_names_apart() -> str:
    """`agents` is openai's, `dexgrasp.agents` ours, and no file of ours lies under the other's name."""
    from dexgrasp.agents.baselines import RandomAgent

    ours = [str(file) for file in files("dexgrasp") or ()]
    assert not [file for file in ours if file.startswith("agents/")], ours
    assert RandomAgent.__module__ == "dexgrasp.agents.baselines"
    owners = packages_distributions().get("agents", [])
    if owners:
        import agents

        assert owners == ["openai-agents"], owners
        assert agents.Agent.__module__.startswith("agents."), agents.Agent
    return f"{len(ours)} files installed, `agents` is of {' '.join(owners) or 'nobody'}"


def said(*words: str, code: int = 0) -> str:
    """Run the console script, which is to end with a code; return what it printed, of a refusal the last line."""
    script = Path(sys.executable).with_name("dexgrasp")
    done = subprocess.run([script, *words], capture_output=True, text=True)
    assert done.returncode == code, f"{words} exited {done.returncode}:\n{done.stdout}{done.stderr}"
    assert "Traceback" not in done.stderr, done.stderr
    return done.stderr.splitlines()[-1] if code else done.stdout


if __name__ == "__main__":
    main()
