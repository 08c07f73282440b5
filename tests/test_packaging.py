import ast
import re
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions, version
from pathlib import Path

import pytest
from tables import table

import dexgrasp_env
from dexgrasp_env.extras import EXTRAS

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("dexgrasp_env", "dexgrasp", "agents")
UNIMPORTED = {
    "imageio-ffmpeg",
    "moviepy",
    "osqp",
    "rtree",
    "sb3-contrib",
    "tensorboard",
    "lxml",
    "networkx",
    "pycollada",
}
"""Used through another, or by name: imageio's videos, Gymnasium's, qpsolvers' solver, trimesh's proximity, learners,
torch's log, and what trimesh reads 3mf and dae with."""


OWNERS = table("owners")
"""Of modules that CI installs last, in no aggregate, or that are called otherwise."""


def imports_of(package):
    """Yield (file, top-level name) of every import statement, those inside functions too."""
    for file in (ROOT / package).rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Import):
                yield from ((file, alias.name.partition(".")[0]) for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and not node.level:
                yield file, node.module.partition(".")[0]


def normal(name):
    return re.sub(r"[-_.]+", "-", name).lower()


def names(requirements):
    return {normal(re.match(r"[\w.-]+", line)[0]) for line in requirements}


@pytest.fixture(scope="module")
def project():
    return tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


@pytest.fixture(scope="module")
def imported():
    """Names of the distributions that the two packages import."""
    owners = {**OWNERS, **packages_distributions()}
    modules = {name for package in PACKAGES for _, name in imports_of(package)}
    foreign = modules - set(sys.stdlib_module_names) - set(PACKAGES)
    return {normal(owners.get(module, [module])[0]) for module in foreign}


def test_version_is_the_installed_one_and_in_the_changelog():
    assert dexgrasp_env.__version__ == version("dexgrasp")
    assert f"## [{dexgrasp_env.__version__}]" in (ROOT / "CHANGELOG.md").read_text()


RUN_TIME = ("planner", "learning", "viewer", "serve", "cluster", "dm", "demos", "formats", "gpu", "lerobot")
"""Extras that the code imports; docs and dev are for developers."""


@pytest.fixture(scope="module")
def declared(project):
    """Names of what the packages may import: nothing that only the extra for developers brings."""
    extras = project["optional-dependencies"]
    return names(project["dependencies"] + [line for extra in RUN_TIME for line in extras[extra]])


def test_every_import_is_declared(declared, imported):
    assert imported <= declared


def test_every_dependency_is_used(declared, imported):
    assert declared - imported == UNIMPORTED


def test_extras_say_what_they_bring(project):
    extras = project["optional-dependencies"]
    for extra, modules in EXTRAS.items():
        brought = names(extras[extra]) - names(project["dependencies"])
        assert {normal(OWNERS.get(module, [module])[0]) for module in modules} <= brought, extra
    assert set(extras) == {*EXTRAS, "docs", "dev", "all"}
    (everything,) = extras["all"]
    assert set(everything.removeprefix("dexgrasp[").removesuffix("]").split(",")) == set(extras) - {
        "all",
        "engines",
        "gpu",
        "lerobot",
    }


WITHOUT = """
import sys
sys.modules.update(dict.fromkeys({modules!r}))  # None: as if not installed
import importlib.util
find_spec = importlib.util.find_spec
importlib.util.find_spec = lambda name, *a: None if name in {modules!r} else find_spec(name, *a)
from dexgrasp.cli.main import main
sys.exit(main({arguments!r}))
"""


@pytest.mark.parametrize(("extra", "arguments"), table("extras"))
def test_a_missing_extra_is_named_in_one_line(extra, arguments):
    modules = [module for name in extra.split() for module in EXTRAS[name]]
    code = WITHOUT.format(modules=modules, arguments=arguments)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 2, done.stderr
    assert f"pip install 'dexgrasp[{extra.split()[-1]}]'" in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_constraints_pin_every_dependency(project):
    lines = [line for line in (ROOT / "constraints.txt").read_text().splitlines() if line and line[0] != "#"]
    pinned = dict(line.split("==") for line in lines)
    extras = project["optional-dependencies"].values()
    every = [*project["dependencies"], *(line for extra in extras for line in extra)]
    assert names(every) - {normal(name) for name in pinned} == {"dexgrasp", "lerobot"}  # whose own are older
    assert (
        pinned["torch"] == "2.13.0"
    )  # without a local part: it also resolves where there is no CPU build of its own
    assert pinned["mujoco"].startswith("3.")


def test_readme_names_the_tests_that_ci_runs():
    assert "python -m pytest\n" in (ROOT / "README.md").read_text()
    assert '"$BIN/python" -m pytest -n auto --dist loadfile --order ' in (ROOT / ".ci" / "run").read_text()
