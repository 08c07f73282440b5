"""What long work shares: workers that die, lines where no terminal is, folders of something else."""

import os
import subprocess
import sys
from concurrent.futures import wait
from functools import partial

import pytest
from refusals import refused

from dexgrasp.runs import pool, progress
from dexgrasp.runs.folder import RunFolder
from dexgrasp.runs.pool import Backend, WorkerDiedError, run_pool
from dexgrasp.runs.progress import progress_bar
from dexgrasp_env.cores import usable_cores


def doubled(task):
    return 2 * task


def killed_at(task, last):
    if task == last:
        os.kill(os.getpid(), 9)
    return task


def odd(task):
    if task % 2 == 0:
        raise ZeroDivisionError
    return task


@pytest.mark.parametrize("workers", [1, 2])
def test_every_task_is_done_whoever_does_it(workers):
    assert sorted(run_pool(doubled, range(7), Backend(workers=workers))) == [0, 2, 4, 6, 8, 10, 12]
    assert list(run_pool(doubled, [], Backend(workers=workers))) == []


def test_a_worker_that_dies_is_said():
    with pytest.raises(WorkerDiedError, match="killed"):
        list(run_pool(partial(killed_at, last=2), range(4), Backend(workers=2)))


def test_a_script_without_a_guard_runs_once_and_every_worker_has_its_limits(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        "print('runs', flush=True)\n"
        "import os, signal, time\n"
        "from dexgrasp.runs.pool import Backend, run_pool\n"
        "def limits(n):\n"
        "    time.sleep(0.5)\n"
        "    threads = os.environ['OMP_NUM_THREADS'], os.environ['NUMBA_NUM_THREADS']\n"
        "    return os.getpid(), *threads, signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ())\n"
        "found = set(run_pool(limits, range(9), Backend(workers=3)))\n"
        "print(len({one[0] for one in found}), {one[1:] for one in found})\n"
    )
    env = {key: value for key, value in os.environ.items() if not key.endswith("_NUM_THREADS")}
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True, env=env)
    share = str(max(1, usable_cores() // 3))
    assert done.stdout == f"runs\n3 {{('{share}', '{share}', True)}}\n"


def test_what_is_done_when_a_task_fails_is_had_before_that_is_said(monkeypatch):
    monkeypatch.setattr(pool, "wait", lambda waiting, return_when: wait(waiting))  # all end at once
    results = run_pool(odd, range(4), Backend(workers=2))
    assert sorted([next(results), next(results)]) == [1, 3]
    with pytest.raises(ZeroDivisionError):
        next(results)


def test_bars_of_workers_leave_nothing_behind_that_is_warned_of(tmp_path):
    script = tmp_path / "bars.py"
    script.write_text(
        "from tqdm import tqdm\n"
        "from dexgrasp.runs.pool import Backend, run_pool\n"
        "def work(n):\n"
        "    return sum(tqdm(range(n)))\n"
        "if __name__ == '__main__':\n"
        "    print(sorted(run_pool(work, [3, 4], Backend(workers=2))))\n"
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True)
    assert done.stdout == "[3, 6]\n"
    assert "leaked" not in done.stderr


def test_progress_is_lines_where_no_terminal_is(monkeypatch, capsys):
    monkeypatch.setattr(progress, "_EVERY", 0.0)
    with progress_bar("trial", "evaluate") as show:
        show(1, 4, bilevel="1/1")
    error = capsys.readouterr().err
    assert error.startswith("evaluate: trial 1 of 4, ")
    assert error.endswith(", bilevel 1/1\n")
    with progress_bar("trial", "evaluate", shown=False) as show:
        show(1, 4)
    assert capsys.readouterr().err == ""


def test_a_folder_says_what_is_different_and_what_is_in_the_way(tmp_path):
    run = RunFolder(tmp_path / "run", "run.json", "training")
    run.claim({"settings": {"seed": 1, "rate": 0.1}, "data": "a"}, complete=False).close()
    run.claim({"settings": {"seed": 1, "rate": 0.1}, "data": "a"}).close()
    with refused(r"another training.*seed: 1 there, 2 now; rate: 0.1 there, null now"):
        run.check({"settings": {"seed": 2}, "data": "a"})
    (tmp_path / "file").write_text("x")
    with refused("is a file"):
        RunFolder(tmp_path / "file", "run.json", "training").claim({})
    with refused(r"not empty and holds no training \(no run.json\)"):
        RunFolder(tmp_path, "run.json", "training").check({})
    RunFolder(tmp_path, "run.json", "training", pieces="trials.jsonl").check({})
