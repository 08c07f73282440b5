"""The command line: exit codes, one-line errors, JSON alone on standard output."""

import argparse
import errno
import functools
import json
import os
import subprocess
import sys
import textwrap

import pytest
from processes import typed

from dexgrasp.cli import doctor
from dexgrasp.cli.codes import BAD_INPUT, INTERNAL_ERROR, INTERRUPTED, OK
from dexgrasp.cli.command import Answer
from dexgrasp.cli.commands import COMMANDS, make_parser
from dexgrasp.cli.main import main
from dexgrasp.cli.output import quiet
from dexgrasp.cli.parsing import build
from dexgrasp_env.errors import InputError


def run(*arguments, module="dexgrasp.cli.main", **kwargs):
    return subprocess.run(
        [sys.executable, "-m", module, *arguments], capture_output=True, text=True, **kwargs
    )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("nonsense", "evaluate"),
        ("list objects --colour", "--colour"),
        ("evaluate --objects seen", "--agents"),
        ("evaluate --agents random --objects suger_box", "sugar_box"),
        ("evaluate --agents random --objects seen --trials 0", ">= 1"),
        ("evaluate --agents random --objects seen --protocol v9", "valid are lift"),
        (
            "evaluate --agents random --objects seen --protocol robust --friction 0.9",
            "own",
        ),
        ("evaluate --agents random --objects seen --out /dev/null/x", "cannot write"),
        ("report nowhere", "no evaluation"),
        ("check nowhere --simulator bullet", "unrecognized arguments"),
        (
            "dataset generate --objects soda --out x --mount y",
            "dexgrasp dataset --help",
        ),
        ("plan nowhere.stl", "nowhere.stl"),
        ("plan pear --agent nobody", "bilevel"),
        ("plan pear --agent hardcoded", "no certified plans"),
        ("plan pear --mesh-scale nan", "> 0"),
        ("plan", "TARGET"),
        ("plan seen", "is a set"),
        ("plan pear --mass 0.3", "are of --cloud"),
        ("plan pear --mesh-scale 0.001", "mesh files alone"),
        ("plan pear --agent os:system", "cannot be made"),
        ("verify nowhere.json", "cannot read nowhere.json"),
        ("demo --out /dev/null/x", "/dev/null/x"),
        ("plan pear --count 99999", "a whole number from 1 to 10000"),
    ],
)
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


@pytest.mark.parametrize(
    ("content", "suffix"),
    [
        (b"", ".stl"),
        (b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", ".obj"),
    ],
)
def test_bad_meshes_are_one_line_and_2(content, suffix, capsys, tmp_path, monkeypatch):
    for slow in ("check_rendering", "check_machine"):
        monkeypatch.setattr(doctor, slow, list)
    path = tmp_path / f"thing{suffix}"
    path.write_bytes(content)
    arguments = ["evaluate", "--agents", "random", "--objects", str(path), "--out", str(tmp_path / "out")]
    assert main(arguments) == BAD_INPUT
    assert "thing" in one_line_after_notes(capsys)
    assert main(["doctor", str(path)]) == 1
    assert "WRONG" in capsys.readouterr().out


def test_no_command_teaches(capsys):
    assert main([]) == BAD_INPUT
    assert "examples" in capsys.readouterr().err
    assert main(["--version"]) == OK
    assert capsys.readouterr().out.startswith("dexgrasp ")


def test_every_command_has_help_with_its_options(capsys):
    parser = make_parser(*COMMANDS)
    found = parser._subparsers._group_actions[0].choices
    assert set(found) == set(COMMANDS)
    for name in found:
        assert main([name, "--help"]) == OK
        assert f"dexgrasp {name}" in capsys.readouterr().out
    assert all(action.help for action in every_action(parser))


def every_action(parser):
    """Options and arguments of a parser and of those within."""
    for action in parser._actions:
        within = action.choices.values() if action.nargs == argparse.PARSER else ()
        yield from (inner for one in within for inner in every_action(one))
        if action.nargs != argparse.PARSER:
            yield action


@pytest.mark.parametrize(
    ("line", "field", "value"),
    [
        ("evaluate --agents a --objects pear --video failures", "video", "failures"),
        ("evaluate --agents a --objects ycb6 --protocol lift heavy", "settings.protocols", ("lift", "heavy")),
        ("evaluate --agents a --objects pear --video 1 --size 320x240", "film.size", (240, 320)),
        ("plan --cloud x.ply --object-near 1 2 3", "object_near", (1.0, 2.0, 3.0)),
        ("train ppo --objects pear --out o --hold 4", "settings.hold", 4),
        ("train bc --data d e --out o --seed 1 2", "seeds", (1, 2)),
    ],
)
def test_options_fill_the_fields_they_are_declared_by(line, field, value):
    args = make_parser(line.split()[0]).parse_args(line.split())
    command = build(args.kind, args)
    assert functools.reduce(getattr, field.split("."), command) == value


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("train bc --data d --out o --epochs 3 --minutes 4", "not allowed with"),
        ("train bc --data d --out o --execute 9", "1 to 8, the chunk"),
        ("plan pear --object-near 1 2", "expected 3"),
        ("replay runs/x --agent a --object b", "--trial"),
        ("evaluate --agents a --objects pear --size 321x240", "even numbers"),
        (
            "evaluate --agents random --objects pear --camera front",
            "--camera would change nothing without --video",
        ),
        (
            "replay runs/x --agent a --object b --trial 0 --size 64x64",
            "--size would change nothing without --video",
        ),
        ("check robot/pear --seed 3", "--seed would change nothing without --replay"),
        ("train sac --objects pear --out o --every 3", "--every would change nothing without --try-on"),
        (
            "train bc --data d --out o --view cloud --hidden 8",
            "hidden, chunk and execute change nothing here",
        ),
        ("dataset info d --robot panda_gripper", "--robot would change nothing without --verify"),
        ("doctor --mesh-scale 0.1", "--mesh-scale would change nothing without --meshes"),
        ("demo --no-video --camera front", "--camera and --size are of a video"),
        ("plan --cloud a.ply --objects --approach top --count 2", "--count, --approach would change nothing"),
        ("list agents --robot panda_gripper", "only `list envs` makes use of it"),
        ("robot make --hand allegro.yaml --palm palm --out a.yaml", "--palm would change nothing"),
        ("demos generate --objects pear --out o --observe step", "observe='step' changes nothing here"),
        ("view . --seed 1", "--seed would change nothing"),
        ("view pear --html a.html --port 9", "--port is of a server"),
    ],
)
def test_options_that_do_not_go_together_are_one_line_and_2(line, words, capsys):
    assert main(line.split()) == BAD_INPUT
    assert words in one_line_after_notes(capsys)


def test_a_bad_mujoco_gl_stops_nothing_that_draws_nothing():
    done = run("list", "agents", env={**os.environ, "MUJOCO_GL": "foo"})
    assert done.returncode == OK, done.stderr


def test_a_full_disk_is_the_users_to_mend(monkeypatch, capsys):
    import dexgrasp.cli.list as command

    def full(self):
        raise OSError(errno.ENOSPC, "No space left on device", "runs/x")

    monkeypatch.setattr(command.List, "run", full)
    assert main(["list", "objects"]) == BAD_INPUT
    assert capsys.readouterr().err == "dexgrasp list: runs/x: No space left on device\n"


@pytest.mark.parametrize("what", ["objects", "envs", "agents", "protocols"])
def test_list(what, capsys, printed):
    assert main(["list", what, "--json"]) == OK
    listed = printed()
    assert len(listed[what]) >= 1
    assert main(["list", what]) == OK
    table = capsys.readouterr().out
    known = {"objects": "sugar_box", "envs": "DexGrasp/Lift-v2", "agents": "hardcoded", "protocols": "lift"}
    assert known[what] in table


def test_module_is_the_same_command():
    done = run("list", "envs", "--json", module="dexgrasp_env")
    assert done.returncode == OK, done.stderr
    envs = {env["id"]: env for env in json.loads(done.stdout)["envs"]}
    assert envs["DexGrasp/Lift-v2"]["obs_mode"][:4] == ["state", "pointcloud", "depth", "rgbd"]
    assert "pointcloud" in envs["DexGrasp/Place-v2"]["obs_mode"]
    assert envs["DexGrasp/LiftSlippery-v2"]["preset"] == {"friction": 0.35}
    assert run("list", "nothing", module="dexgrasp_env").returncode == BAD_INPUT


def test_evaluate_prints_json_alone(tmp_path):
    command = [
        "evaluate",
        "--agents",
        "random",
        "agent_of_mine:Mine",
        "--objects",
        "gelatin_box",
        "--trials",
        "1",
    ]
    (tmp_path / "agent_of_mine.py").write_text(textwrap.dedent(
        """
        import os
        class Mine:
            def reset(self, observation, info): print("I say something"); os.write(1, b"natively")
            def act(self, observation): raise RuntimeError("broken")
        """
    ))  # fmt: skip
    done = run(*command, "--json", cwd=tmp_path)
    assert done.returncode == OK, done.stderr
    summary = json.loads(done.stdout)
    assert summary["agents"]["agent_of_mine:Mine"]["failures"] == {"agent_error: RuntimeError": 1}
    assert "I say something" in done.stderr
    assert "natively" in done.stderr
    assert done.stderr.count("RuntimeError: broken") == 1
    again = run(*command, cwd=tmp_path)  # the default folder is found again, and nothing is left to do
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
        assert main(["list", "objects"]) == code
    assert "a b\n" in capsys.readouterr().err


def test_closed_pipe_is_no_error():
    command = f"{sys.executable} -m dexgrasp.cli.main list objects | head -n 1; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True)
    assert done.stderr == ""


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


def test_doctor_knows_the_wrong_mujoco(monkeypatch):
    monkeypatch.setattr(doctor, "package_version", lambda package: "4.0.0")
    wrong = [finding for finding in doctor.check_versions() if finding.level == "error"]
    assert ["mujoco" in finding.problem for finding in wrong] == [True]


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
    for wish, level in (("foo", "error"), ("osmesa", "error"), ("EGL", "info"), ("on", "info"), ("", "info")):
        monkeypatch.setenv("DEXGRASP_GL", wish)  # as the command line has put MUJOCO_GL aside
        assert doctor.check_rendering()[-1].level == level, wish
