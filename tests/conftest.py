"""What all tests share."""

import json
import random
from itertools import groupby

import pytest
from hypothesis import settings

# The same examples in every run, few of them, and no time limits: a loaded machine changes no verdict.
settings.register_profile("repeatable", derandomize=True, max_examples=60, deadline=None, database=None)
settings.load_profile("repeatable")


@pytest.fixture(scope="session")
def contents():
    """Grasp files as they would be written: name -> content; not to be changed."""
    from planned import plan_contents  # what a test does not ask for is not imported

    return plan_contents()


@pytest.fixture
def check(tmp_path):
    """Write a grasp file, verify it, and return check by name."""

    from dexgrasp.grasp.file import read_grasp, write_grasp
    from dexgrasp.grasp.verify.verify import verify

    def run(content):
        path = tmp_path / "grasp.json"
        write_grasp(path, content)
        return {c.name: c for c in verify(read_grasp(path))}

    return run


@pytest.fixture
def printed(capsys):
    """Return what was printed as JSON."""
    return lambda: json.loads(capsys.readouterr().out)


@pytest.fixture
def own_cache(tmp_path, monkeypatch):
    """An empty cache."""
    monkeypatch.setenv("DEXGRASP_CACHE", str(tmp_path / "cache"))


def pytest_addoption(parser):
    parser.addoption(
        "--order", type=int, metavar="SEED", help="run files, and the tests in each, in a random order"
    )


def pytest_collection_modifyitems(config, items):
    """Shuffle files, and tests within files, which share what is dear to make."""
    if config.getoption("--order") is not None:
        rng = random.Random(config.getoption("--order"))
        files = [list(tests) for _, tests in groupby(items, lambda item: item.path)]
        rng.shuffle(files)
        for tests in files:
            rng.shuffle(tests)
        items[:] = [test for tests in files for test in tests]


def pytest_terminal_summary(terminalreporter, exitstatus, config):
    if exitstatus and config.getoption("--order") is not None:
        terminalreporter.write_line(f"in this order: python -m pytest --order {config.getoption('--order')}")
