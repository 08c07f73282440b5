"""Compiled functions: where they are kept, that they are compiled once, and by no other process."""

import errno
import importlib
import os
import pickle
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
from numba.core import caching
from processes import python

from dexgrasp_env import compiled, files

SCRIPT = """
    print("runs")
    from dexgrasp.planning import planner
    from dexgrasp_env.compiled import njit
    from dexgrasp_env.robot.cell import default_cell

    def twice(x):
        return 2 * x

    kernel = njit(twice)
    planner.Planner.plan = lambda *_: print(kernel(2.0))
    planner.compile_ahead(default_cell())
    print(len(kernel.stats.cache_misses))
"""


def test_a_script_without_a_guard_runs_once_with_an_empty_cache(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(textwrap.dedent(SCRIPT))
    env = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(Path.cwd())}
    for misses in (1, 0):
        done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True, env=env)
        assert done.stdout == f"runs\n4.0\n{misses}\n"
    kept = list((tmp_path / "cache").rglob("compiled-*"))
    assert len(kept) == 2  # the mark that a plan was made, and its lock


NOBODY = """
import os, sys
os.setgroups([]); os.setgid(54321); os.setuid(54321)
from dexgrasp_env.files import cache_dir
print(cache_dir(), os.access(cache_dir().parent, os.W_OK))
"""


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can be somebody else")
def test_a_user_without_home_and_name_has_a_cache_of_temporary_files(tmp_path):
    outside = {name: os.environ[name] for name in ("PATH", "PYTHONPATH") if name in os.environ}
    tmp_path.chmod(0o777)
    for folder in (*reversed(tmp_path.parents), tmp_path)[2:]:
        folder.chmod(folder.stat().st_mode | 0o055)
    code = "import numpy, platformdirs, dexgrasp_env.files" + NOBODY  # imported as root: a home may be closed
    said = python(
        code, env={**outside, "TMPDIR": str(tmp_path)}, cwd="/" if "PYTHONPATH" in outside else None
    )
    assert said == f"{tmp_path / 'dexgrasp-54321'} True\n"


def test_code_is_read_where_it_is_kept_and_nothing_can_be_written(monkeypatch, tmp_path, capsys):
    """An image's: compiled when it was made, with a root file system that is read-only when it runs."""
    (tmp_path / "shapes.py").write_text(
        "def tripled(x):\n    return 3 * x\n\ndef halved(x):\n    return x / 2\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    shapes = importlib.import_module("shapes")
    assert compiled.njit(shapes.tripled)(2.0) == 6.0

    def refuse(locator):
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr(caching._CacheLocator, "ensure_cache_path", refuse)
    kept, new = compiled.njit(shapes.tripled), compiled.njit(shapes.halved)
    assert kept(2.0) == 6.0
    assert sum(kept.stats.cache_hits.values()) == 1
    assert new(2.0) == 1.0
    assert compiled.code_folder() is None or compiled.code_folder().name == "__pycache__"


def test_a_folder_of_temporary_files_that_others_can_write_is_not_used(tmp_path, monkeypatch):
    monkeypatch.setattr(files.tempfile, "tempdir", str(tmp_path))
    folder = files.temporary_cache_dir()
    folder.chmod(0o777)
    with pytest.raises(PermissionError):
        files.temporary_cache_dir()


def test_nothing_is_compiled_by_plans_and_episodes_on_a_machine_that_is_warm():
    code = """
        from dexgrasp.cli.main import main
        assert main(["warmup"]) == 0
        import gymnasium as gym, dexgrasp_env
        from numba.core import event
        class Listener(event.Listener):
            def on_start(self, event): print("compiles", event.data["dispatcher"])
            def on_end(self, event): pass
        event.register("numba:compile", Listener())
        for target in ("soda", "castle"):  # convex, and of several parts
            main(["plan", target])
        env = gym.make("DexGrasp/Lift-v2", objects="soda", obs_mode="pointcloud", control_mode="ee_delta")
        env.reset(seed=0)
        env.step(env.action_space.sample())
    """
    said = python(code)
    assert "grasp found" in said
    assert "compiles" not in said


def test_constants_of_calls_make_no_versions_of_their_own():
    @compiled.njit
    def scaled(x, by):
        return by * x

    @compiled.njit
    def both(x):
        return scaled(x, 2) + scaled(x, 3) + scaled(x, int(np.rint(x)))

    assert both(2.0) == 14.0
    assert len(scaled.called.signatures) == 1
    assert not scaled.signatures  # Python has not called it: nothing is emitted for it
    assert scaled(2.0, 3) == 6.0


def test_code_that_was_kept_for_a_type_that_is_gone_is_compiled_anew(tmp_path):
    """As after an upgrade: the index cannot be read."""
    code = "from dexgrasp_env.compiled import njit\n@njit\ndef double(x):\n    return 2 * x\n"
    (tmp_path / "kernels.py").write_text(code)
    call = "from kernels import double; print(double(2))"
    assert python(call, cwd=tmp_path) == "4\n"
    (index,) = tmp_path.rglob("*.nbi")
    version = pickle.dumps(pickle.loads(index.read_bytes()))  # of numba; the rest follows it
    index.write_bytes(version + b"cno.such.module\nGone\n.")
    assert python(call, cwd=tmp_path) == "4\n"


def test_an_error_of_a_function_that_a_compiled_one_calls_is_raised():
    @compiled.njit
    def root(x):
        if x < 0.0:
            raise ValueError("no root of", x)
        return np.sqrt(x)

    @compiled.njit
    def both(x):
        return root(x) + root(x - 4.0)

    assert both(4.0) == 2.0
    with pytest.raises(ValueError, match="no root of") as error:
        both(1.0)
    assert error.value.args[1] == -3.0
