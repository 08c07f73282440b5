"""Scripts: each can be imported as the library is now, explains its options, and somebody is told of it."""

import pytest
from project_scripts import SCRIPTS, load_script

from dexgrasp.cli.command import Script
from dexgrasp.cli.commands import run_script

ROOT = SCRIPTS.parent
TOLD = "".join((ROOT / name).read_text() for name in ("CONTRIBUTING.md", ".ci/run"))


@pytest.mark.parametrize("name", sorted(path.stem for path in SCRIPTS.glob("*.py")))
def test_a_script_imports_and_is_named(name):
    script = load_script(name)
    assert script.__doc__
    assert name in TOLD
    for kind in vars(script).values():
        if isinstance(kind, type) and issubclass(kind, Script) and kind.__module__ == name:
            assert run_script(kind, ["--help"]) == 0
