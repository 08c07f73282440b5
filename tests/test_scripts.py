"""Scripts: each can be imported as the library is now, and somebody is told of it."""

import pytest
from project_scripts import SCRIPTS, load_script

ROOT = SCRIPTS.parent
TOLD = "".join((ROOT / name).read_text() for name in ("CONTRIBUTING.md", ".ci/run", "scripts/fuzz.py"))


@pytest.mark.parametrize("name", sorted(path.stem for path in SCRIPTS.glob("*.py")))
def test_a_script_imports_and_is_named(name):
    assert load_script(name).__doc__
    assert name in TOLD
