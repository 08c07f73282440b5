"""What all tests share."""

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
    from dexgrasp.verify.verify import verify

    def run(content):
        path = tmp_path / "grasp.json"
        write_grasp(path, content)
        return {c.name: c for c in verify(read_grasp(path))}

    return run
