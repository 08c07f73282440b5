"""The command line: exit codes, one-line errors, JSON alone on standard output."""

import argparse
import json
import os
import subprocess
import sys
import textwrap

import pytest
from processes import typed
from tables import mistakes, table

from dexgrasp.cli import doctor
from dexgrasp.cli.codes import BAD_INPUT, INTERNAL_ERROR, INTERRUPTED, OK
from dexgrasp.cli.command import Answer
from dexgrasp.cli.commands import COMMANDS, make_parser
from dexgrasp.cli.main import main
from dexgrasp.cli.output import quiet
from dexgrasp_env.errors import InputError


def run(words, module="dexgrasp.cli.main", **kwargs):
    command = [sys.executable, "-m", module, *words.split()]
    return subprocess.run(command, capture_output=True, text=True, **kwargs)


@pytest.mark.parametrize(("arguments", "words"), mistakes("commands"))
def test_bad_input_is_one_line_and_2(arguments, words, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert typed(arguments) == BAD_INPUT
    line = one_line_after_notes(capsys)
    assert words in line
    assert "Traceback" not in line


def one_line_after_notes(capsys):
    captured = capsys.readouterr()
    assert captured.out == ""
    lines = [
        line
        for line in captured.err.strip().splitlines()
        if not line.startswith(("results go to", "compiling"))
    ]
    assert len(lines) == 1, lines
    return lines[0]


def test_no_command_teaches(capsys):
    assert main([]) == BAD_INPUT
    assert "examples" in capsys.readouterr().err
    assert typed("--version") == OK
    assert capsys.readouterr().out.startswith("dexgrasp ")


def test_every_command_has_help_with_its_options(capsys):
    parser = make_parser(*COMMANDS)
    found = parser._subparsers._group_actions[0].choices
    assert set(found) == set(COMMANDS)
    for name in found:
        assert typed(f"{name} --help") == OK
        assert f"dexgrasp {name}" in capsys.readouterr().out
    assert all(action.help for action in every_action(parser))


def every_action(parser):
    """Options and arguments of a parser and of those within."""
    for action in parser._actions:
        within = action.choices.values() if action.nargs == argparse.PARSER else ()
        yield from (inner for one in within for inner in every_action(one))
        if action.nargs != argparse.PARSER:
            yield action


@pytest.mark.parametrize("what", ["objects", "envs", "agents", "protocols"])
def test_list(what, capsys, printed):
    assert typed(f"list {what} --json") == OK
    assert len(printed()[what]) >= 1
    assert typed(f"list {what}") == OK
    table = capsys.readouterr().out
    known = {"objects": "sugar_box", "envs": "DexGrasp/Lift-v2", "agents": "hardcoded", "protocols": "lift"}
    assert known[what] in table


def test_module_is_the_same_command():
    done = run("list envs --json", module="dexgrasp_env")
    assert done.returncode == OK, done.stderr
    envs = {env["id"]: env for env in json.loads(done.stdout)["envs"]}
    assert envs["DexGrasp/Lift-v2"]["obs_mode"][-1] == "features"
    assert envs["DexGrasp/Place-v2"]["obs_mode"][-1] == "state+rgbd"
    assert envs["DexGrasp/LiftSlippery-v2"]["preset"] == {"friction": 0.35}


def test_evaluate_prints_json_alone(tmp_path):
    command = "evaluate --agents random agent_of_mine:Mine --objects gelatin_box --trials 1"
    (tmp_path / "agent_of_mine.py").write_text(textwrap.dedent(
        """
        import os
        class Mine:
            def reset(self, observation, info): print("I say something"); os.write(1, b"natively")
            def act(self, observation): raise RuntimeError("broken")
        """
    ))  # fmt: skip
    done = run(f"{command} --json", cwd=tmp_path)
    assert done.returncode == OK, done.stderr
    summary = json.loads(done.stdout)
    assert summary["agents"]["agent_of_mine:Mine"]["failures"] == {"agent_error: RuntimeError": 1}
    assert "I say something" in done.stderr
    assert "natively" in done.stderr
    assert done.stderr.count("RuntimeError: broken") == 1
    again = run(command, cwd=tmp_path)  # the default folder is found again, and nothing is left to do
    assert again.returncode == OK, again.stderr
    assert "gelatin_box" in again.stdout
    runs = list((tmp_path / "runs").iterdir())
    assert len(runs) == 1
    assert len((runs[0] / "trials.jsonl").read_text().splitlines()) == 2


def test_exceptions_and_interrupts(monkeypatch, capsys):
    import dexgrasp.cli.list as command

    for error, code in (
        (InputError("a\nb"), BAD_INPUT),
        (KeyboardInterrupt(), INTERRUPTED),
        (OSError("x"), INTERNAL_ERROR),
    ):
        monkeypatch.setattr(command.List, "run", lambda self, error=error: (_ for _ in ()).throw(error))
        assert typed("list objects") == code
    assert "a b\n" in capsys.readouterr().err


@pytest.mark.parametrize(("words", "code", "lines"), table("streams"))
def test_streams_may_be_closed_or_full(words, code, lines):
    # A wrong GL stops nothing that draws nothing.
    command = ["bash", "-c", f"MUJOCO_GL=foo {sys.executable} -m dexgrasp list {words}"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.returncode, done.stdout.count("\n"), done.stderr) == (code, lines, "")


def test_json_output_keeps_the_stream_clean(capfd):
    with quiet(True):
        print("noise")
        os.write(1, b"native noise")
    assert Answer({"a": float("nan")}, "text", 1).show(True) == 1
    out, error = capfd.readouterr()
    assert out == '{\n  "schema": 1,\n  "a": null\n}\n'
    assert error == "noise\nnative noise"


def test_doctor_survives_broken_backends(monkeypatch):
    monkeypatch.setattr(doctor, "_RENDER", "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)")
    findings = doctor.check_rendering()
    assert "crashes (signal 11)" in findings[0].problem
    assert findings[-1].level == "warning"
    assert "libosmesa6" in findings[-1].remedy


def test_libraries_with_their_own_check_at_exit_print_nothing(tmp_path):
    """What cycles hold of theirs is collected before the process ends; else nanobind prints a page about it."""
    script = tmp_path / "ends.py"
    script.write_text(
        textwrap.dedent(
            """
            import sys
            import dexgrasp.cli.commands as commands
            from dexgrasp.cli.main import main

            def run_command(arguments):
                import manifold3d
                cycle = [manifold3d.Manifold()]
                cycle.append(cycle)
                return 0

            commands.run_command = run_command
            sys.exit(main())
            """
        )
    )
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


def test_doctor_says_when_the_wished_backend_draws_nothing(monkeypatch):
    monkeypatch.setattr(doctor, "_renders", lambda backend: "" if backend == "egl" else "does not work")
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    for wish, level in table("gl_wishes"):
        monkeypatch.setenv("DEXGRASP_GL", wish)  # as the command line has put MUJOCO_GL aside
        assert doctor.check_rendering()[-1].level == level, wish
