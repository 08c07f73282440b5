"""Completion scripts: bash itself is asked what it would offer."""

import shutil
import subprocess

import pytest

from dexgrasp.cli.commands import COMMANDS
from dexgrasp.cli.completion import completion_script

ASK = """
source {script}
COMP_WORDS=({words} {last}); COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1)); COMP_LINE="${{COMP_WORDS[*]}}"
_shtab_dexgrasp; printf '%s\\n' "${{COMPREPLY[@]}}"
"""


@pytest.fixture(scope="module")
def offered(tmp_path_factory):
    """A function: words typed so far, beginning of the next -> what is offered for it."""
    if shutil.which("bash") is None:
        pytest.skip("no bash here")
    folder = tmp_path_factory.mktemp("completion")
    (folder / "dexgrasp.bash").write_text(completion_script("bash"))
    (folder / "pears.stl").write_text("")

    def ask(words, last):
        text = ASK.format(script=folder / "dexgrasp.bash", words=words, last=last or '""')
        done = subprocess.run(["bash", "-c", text], capture_output=True, text=True, cwd=folder, timeout=30)
        assert done.stderr == ""
        return done.stdout.split()

    return ask


def test_every_command_is_offered(offered):
    assert set(COMMANDS) <= set(offered("dexgrasp", ""))


@pytest.mark.parametrize(
    ("words", "last", "wanted"),
    [
        ("dexgrasp plan", "pea", {"pear", "pears.stl"}),
        ("dexgrasp plan pear", "--se", {"--seed"}),
        ("dexgrasp evaluate --agents", "bil", {"bilevel", "bilevel_alone", "bilevel_tracking"}),
        (
            "dexgrasp evaluate --agents bilevel --protocol",
            "slip",
            {"slippery", "slippery@0.5", "slippery@0.35"},
        ),
        ("dexgrasp list", "pro", {"protocols"}),
        ("dexgrasp plan pear --mount", "palm", {"palm_normal"}),
        ("dexgrasp demo --camera", "gr", {"grasp"}),
    ],
)
def test_names_and_files_are_offered(offered, words, last, wanted):
    assert set(offered(words, last)) == wanted


def test_zsh_has_a_script_of_its_own():
    script = completion_script("zsh")
    assert script.startswith("#compdef dexgrasp")
    assert "mustard_bottle" in script
