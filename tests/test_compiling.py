import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
from processes import python

from dexgrasp.runs import compiling
from dexgrasp.runs.compiling import compile_ahead, ensure_compiled
from dexgrasp.runs.pool import WorkerDiedError
from dexgrasp_env import compiled

KERNELS = """
    import numpy as np
    from typing import NamedTuple
    from dexgrasp_env.compiled import njit

    class Pair(NamedTuple):
        left: np.ndarray
        right: float

    @njit
    def twice(x, by=2):
        return by * x

    @njit
    def total(pair):
        out = 0.0
        for k in range(len(pair.left)):
            out += twice(pair.left[k]) / twice(pair.right, 4)
        return out

    @njit
    def first(records):
        return records[0].size

    def rehearse():
        total(Pair(np.ones(3), 2.0))
        first(np.ones(2, [("size", "i8")]))
        raise RuntimeError("whatever was heard until here is compiled")
"""
RUN = """
    import kernels, numpy as np
    from numba.core import event

    class Listener(event.Listener):
        def on_start(self, event): print("compiles", event.data["dispatcher"])
        def on_end(self, event): pass

    event.register("numba:compile", Listener())
    print(kernels.total(kernels.Pair(np.ones(4), 2.0)), kernels.first(np.ones(2, [("size", "i8")])))
"""


@pytest.fixture
def kernels(tmp_path, monkeypatch):
    """A module of compiled functions, which only other processes import."""
    (tmp_path / "kernels.py").write_text(textwrap.dedent(KERNELS))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.syspath_prepend(tmp_path)
    return "kernels:rehearse"


def test_what_a_rehearsal_calls_is_compiled_for_other_processes(kernels, tmp_path):
    shown = []
    tasks = compile_ahead(kernels, lambda done, total, now: shown.append((done, total)), workers=2)
    assert {task.name: set(task.calls) for task in tasks} == {
        "twice": set(),
        "total": {"twice"},
        "first": set(),
    }
    assert len(tasks) == 4  # twice with its default, and with a factor
    assert shown[-1] == (4, 4)
    code = f"import sys; sys.path.insert(0, {str(tmp_path)!r})\n{textwrap.dedent(RUN)}"
    assert python(code) == "1.0 1\n"


def test_a_machine_is_made_ready_once(kernels, tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(compiling, "_cache_folder", lambda: tmp_path)
    monkeypatch.setattr(compiling, "compile_ahead", lambda rehearsal, show: asked.append(rehearsal))
    for _ in range(2):
        ensure_compiled.cache_clear()
        ensure_compiled(kernels)
    assert asked == [kernels]
    ensure_compiled.cache_clear()
    monkeypatch.setattr(compiling, "_cache_folder", lambda: Path("/proc/nowhere"))
    ensure_compiled(kernels)
    assert asked == [kernels]


def test_where_a_process_dies_functions_are_compiled_when_they_are_called(tmp_path, monkeypatch):
    def dies(rehearsal, show):
        raise WorkerDiedError

    monkeypatch.setattr(compiling, "_cache_folder", lambda: tmp_path)
    monkeypatch.setattr(compiling, "compile_ahead", dies)
    ensure_compiled.cache_clear()
    ensure_compiled("nothing:nowhere")
    assert not list(tmp_path.glob("compiled-*[!.lock]"))


def test_a_script_that_does_not_ask_for_its_name_is_not_run_again(kernels, tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        "print('runs')\nfrom dexgrasp.runs.compiling import compile_ahead\n"
        f"print(len(compile_ahead({kernels!r}, lambda *_, **__: None, workers=1)))"
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True)
    assert done.stdout == "runs\n4\n"


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
    assert len(scaled.signatures) == 1
