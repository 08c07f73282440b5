"""SIGINT and SIGTERM: always exit code 3, never a traceback, what was finished is kept."""

import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest
from processes import typed
from tables import table

SIGNALS = (signal.SIGINT, signal.SIGTERM)


def start(*command, **kwargs):
    return subprocess.Popen(
        [sys.executable, *command], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **kwargs
    )


def script(tmp_path, code):
    """A process that runs `code` as a command does, and says "ready" when the signal may come."""
    (tmp_path / "swallows.py").write_text("import time\ntry:\n    print('ready', flush=True)\n    time.sleep(3)\n"
                                          "except BaseException:\n    print('swallowed', flush=True)\n")  # fmt: skip
    path = tmp_path / "command.py"
    head = """
    import sys, time
    from dexgrasp.runs import interrupt
    import dexgrasp.cli.main as main
    def ready(): print("ready", flush=True)
    def command(arguments):
    """
    tail = "\nmain._run = command\nsys.argv = ['dexgrasp']\nsys.exit(main.main())\n"
    path.write_text(textwrap.dedent(head) + textwrap.indent(textwrap.dedent(code), "    ") + tail)
    return start(str(path), cwd=tmp_path, env={**os.environ, "PYTHONPATH": os.getcwd()})


def tell(process, number):
    """Wait until it is ready, send the signal, return exit code and what was printed."""
    assert process.stdout.readline() == "ready\n"
    process.send_signal(number)
    out, error = process.communicate(timeout=30)
    assert "Traceback" not in error, error
    return process.returncode, out, error


@pytest.mark.parametrize("number", SIGNALS)
def test_imports_cannot_swallow_it(number, tmp_path):
    code, out, _ = tell(script(tmp_path, """
        try:
            import swallows
            time.sleep(5)
        except KeyboardInterrupt:
            print("summed up")
            return 3
    """), number)  # fmt: skip
    assert (code, out) == (3, "summed up\n")


def test_saving_is_not_cut_in_two(tmp_path):
    code, out, _ = tell(script(tmp_path, """
        try:
            with interrupt.held():
                ready(); time.sleep(0.5); print("saved", flush=True)
            time.sleep(5)
            print("went on")
        except KeyboardInterrupt:
            return 3
    """), signal.SIGTERM)  # fmt: skip
    assert (code, out) == (3, "saved\n")


def test_what_is_swallowed_is_asked_for_again(tmp_path):
    code, _, error = tell(script(tmp_path, """
        class Hides:
            def __del__(self): ready(); time.sleep(1)
        Hides()
        time.sleep(20)
    """), signal.SIGINT)  # fmt: skip
    assert code == 3
    assert "Exception ignored" not in error


def test_the_second_signal_ends_it_at_once(tmp_path):
    process = script(tmp_path, "with interrupt.held(): ready(); time.sleep(25)")
    assert process.stdout.readline() == "ready\n"
    process.send_signal(signal.SIGINT)
    time.sleep(1.5)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=5)
    assert process.returncode == 3


def test_a_finished_command_is_not_undone(tmp_path):
    code, _, _ = tell(script(tmp_path, "import atexit; atexit.register(lambda: (ready(), time.sleep(1)))\nreturn 1"),
                      signal.SIGTERM)  # fmt: skip
    assert code == 1


def catches(process):
    """Whether the process has its handlers: before, Python itself is starting."""
    try:
        lines = Path(f"/proc/{process.pid}/status").read_text().splitlines()
    except OSError:
        return False
    caught = next((int(line.split()[1], 16) for line in lines if line.startswith("SigCgt")), 0)
    return bool(caught >> (signal.SIGTERM - 1) & 1)


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="no /proc here")
@pytest.mark.parametrize("module", ["dexgrasp.cli.main", "dexgrasp_env"])
def test_start_up_at_many_moments(module):
    for k, delay in enumerate((0.0, 0.1, 0.5)):
        process = start("-m", module, "plan", "pear", "--seed", "1")
        while not catches(process) and process.poll() is None:
            time.sleep(0.001)
        time.sleep(delay)
        process.send_signal(SIGNALS[k % 2])
        _, error = process.communicate(timeout=60)
        assert process.returncode == 3, error
        assert "Traceback" not in error


@pytest.mark.parametrize(("words", "work"), table("interrupted"))
def test_long_commands_say_what_is_kept(words, work, tmp_path, monkeypatch, capsys):
    pytest.importorskip("stable_baselines3")

    def stopped(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(work, stopped)
    assert typed(f"{words} --out {tmp_path / 'out'}") == 3
    said = capsys.readouterr().err
    assert f"dexgrasp {words.split()[0]}: interrupted; " in said
    assert f"kept in {tmp_path / 'out'}: the same command goes on from there" in said
