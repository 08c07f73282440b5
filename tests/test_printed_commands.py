"""Commands that are printed can be pasted, whatever blanks and signs names have."""

import shlex

from foreign_parts import foreign_hand

from dexgrasp.cli.main import main


def pasted(text):
    """Return the words of each command in a text, as a shell takes them."""
    return [shlex.split(line[line.index("dexgrasp ") :]) for line in text.splitlines() if "dexgrasp " in line]


def test_a_file_of_a_robot_is_tested_by_the_command_that_is_printed(tmp_path, capsys):
    out = tmp_path / "our lab's #2.yaml"
    assert main(["robot", "make", "--hand", str(foreign_hand(tmp_path)), "--out", str(out)]) == 0
    assert pasted(capsys.readouterr().out) == [["dexgrasp", "robot", "check", str(out)]]


def test_a_trajectory_is_checked_by_the_command_that_is_printed(tmp_path, capsys):
    assert main(["plan", "soda", "--out", str(tmp_path)]) == 0
    capsys.readouterr()
    out = tmp_path / "it's out #1"
    assert main(["export", str(tmp_path / "grasp.json"), "--format", "csv", "--out", str(out)]) == 0
    (words,) = pasted(capsys.readouterr().out)
    assert words == ["dexgrasp", "check", str(out)]
    assert main(words[1:]) == 0
