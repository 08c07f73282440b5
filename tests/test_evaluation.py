"""Evaluations: resumed, killed, in several processes, replayed; what they are of."""

import json
import shlex
import shutil
import signal
import subprocess
import sys
import time

import pytest
from refusals import refused

from dexgrasp.cli.main import main
from dexgrasp.evaluation.evaluate import evaluate
from dexgrasp.evaluation.protocol import get_protocol
from dexgrasp.evaluation.replay import replay
from dexgrasp.evaluation.settings import EvaluationSettings
from dexgrasp.evaluation.store import read_rows
from dexgrasp.runs.pool import Backend
from dexgrasp_env.rendering import rendering_fault

SETTINGS = EvaluationSettings.of(["random"], ["sugar_box", "gelatin_box"], trials=2, seed=3)


def outcomes(folder):
    names = ("success", "reason", "stage", "steps", "height", "slip", "scene_seed")
    return {(r["agent"], r["object"], r["trial"]): [r[n] for n in names] for r in read_rows(folder)}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("finished")
    return folder, evaluate(SETTINGS, folder)


def test_summary_has_the_documented_form(finished):
    folder, summary = finished
    assert json.loads((folder / "summary.json").read_text()) == json.loads(json.dumps(summary))
    assert [summary[key] for key in ("schema", "protocol", "seed", "complete")] == [1, "lift", 3, True]
    agent = summary["agents"]["random"]
    assert {"rate", "ci95", "by_set", "planning_seconds", "constraints"} <= set(agent)
    assert (agent["trials"], agent["by_object"]["sugar_box"]) == (4, {"trials": 2, "successes": 0})
    assert set(agent["by_set"]) == {"seen", "ycb6"}
    assert sum(agent["failures"].values()) == 4 - agent["successes"]


def test_outcomes_do_not_depend_on_the_workers(finished, tmp_path):
    evaluate(SETTINGS, tmp_path, backend=Backend(workers=2))
    assert outcomes(tmp_path) == outcomes(finished[0])


def test_what_is_finished_is_not_run_again(finished, tmp_path):
    lines = (finished[0] / "trials.jsonl").read_text().splitlines(keepends=True)
    (tmp_path / "run.json").write_text((finished[0] / "run.json").read_text())
    (tmp_path / "trials.jsonl").write_text("".join(lines[:2]) + lines[2][:30])
    evaluate(SETTINGS, tmp_path)
    assert (tmp_path / "trials.jsonl").read_text().startswith("".join(lines[:2]))
    assert outcomes(tmp_path) == outcomes(finished[0])


def test_printed_commands_run_and_a_cell_is_its_content(tmp_path, monkeypatch, capsys):
    (tmp_path / "work").mkdir()
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    cell = tmp_path / "work" / "our lab.yaml"
    cell.write_text("schema: 1\nname: our lab\ntable_height: -0.04\n")
    again = ["evaluate", "--agents=random", "--objects=pear", "--trials=1", "--protocol", "lift", "heavy"]
    assert main([*again, "--out", "my run", "--robot", "our lab.yaml"]) == 0
    table = capsys.readouterr().out
    assert "heavy" in table
    assert "object" not in table.partition("why")[0]  # protocols are not averaged
    assert main([*again, "--out", "my run", "--robot", str(cell)]) == 0
    assert main(["report", "my run"]) == 0
    lines = [
        line.strip() for line in capsys.readouterr().out.splitlines() if line.strip().startswith("dexgrasp ")
    ]
    assert [shlex.split(line)[1] for line in lines] == ["evaluate", "report", "replay", "replay"]
    for line in lines:
        assert main([word for word in shlex.split(line)[1:] if word != "--video"]) == 0, line
    monkeypatch.chdir(tmp_path / "elsewhere")
    one = ["replay", str(tmp_path / "work" / "my run"), "--agent=random", "--object=pear", "--trial=0"]
    assert main([*one, "--protocol=lift"]) == 0
    moved = cell.rename(tmp_path / "moved.yaml")
    assert main([*one, "--protocol=lift"]) == 2
    assert "pass it with --robot" in capsys.readouterr().err
    assert main([*one, "--protocol=lift", "--robot", str(moved)]) == 0
    assert main([*one, "--protocol=lift", "--cell", str(moved)]) == 2
    assert "is given by --robot" in capsys.readouterr().err


def test_killed_run_keeps_what_is_finished(tmp_path):
    words = "-m dexgrasp.cli.main evaluate --agents random --objects sugar_box --trials 400 --json --workers 2 --out"
    command = [sys.executable, *words.split(), str(tmp_path / "out")]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    trials = tmp_path / "out" / "trials.jsonl"
    for _ in range(900):
        if trials.is_file() and trials.read_text().count("\n") >= 3:
            break
        time.sleep(0.1)
    process.send_signal(signal.SIGTERM)
    out, error = process.communicate(timeout=30)
    assert process.returncode == 3, error
    kept = len(read_rows(tmp_path / "out"))
    assert 3 <= kept < 400
    summary = json.loads(out)
    assert summary["complete"] is False
    assert summary["agents"]["random"]["trials"] == kept
    assert "goes on" in error


def test_identity_knows_every_file(tmp_path, monkeypatch):
    """Meshes of one name, checkpoints and the settings beside them, a path from home."""
    monkeypatch.setenv("HOME", str(tmp_path))
    for name in ("a/x.obj", "b/x.obj", "p.zip", "p.json", "q.zip"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("one")
    agents = (f"ppo:{tmp_path}/p.zip", f"{tmp_path}/q.zip")
    settings = EvaluationSettings(agents, (f"{tmp_path}/a/x.obj", "~/b/x.obj"))
    known = settings.identity()
    assert len(known["files"]) == 5
    for name in ("a/x.obj", "b/x.obj", "p.zip", "p.json", "q.zip", "q.json"):
        (tmp_path / name).write_text("two")
        changed = settings.identity()
        assert changed != known, name
        known = changed


def test_replay_is_exact(finished, tmp_path):
    folder, _ = finished
    for name in ("sugar_box", "gelatin_box"):
        again = replay(folder, "random", name, 1)
        assert again.changed == again.stale == ()
        assert again.again["height"] == again.row["height"]
    rows = read_rows(folder)
    assert all({"scene_seed", "agent_seed", "env", "protocol"} <= set(r) for r in rows)
    assert rows[0]["env"]["id"] == get_protocol("lift").env_id
    rows[0]["slip"] += 1e-9
    (tmp_path / "trials.jsonl").write_text("\n".join(map(json.dumps, rows)) + "\n")
    (tmp_path / "run.json").write_text((folder / "run.json").read_text())
    key = [rows[0][name] for name in ("agent", "object", "trial")]
    assert replay(tmp_path, *key).changed == ("slip",)
    with refused(r"hardcoded.*random"):
        replay(folder, "hardcoded", "sugar_box", 0)
    with refused("valid are 0, 1"):
        replay(folder, "random", "sugar_box", 7)


@pytest.mark.skipif(rendering_fault() is not None, reason="no GL library here")
def test_videos_of_a_finished_run(finished, tmp_path, monkeypatch):
    monkeypatch.setattr("dexgrasp.evaluation.video.Video.add", lambda self, env: write_one(self))
    shutil.copytree(finished[0], tmp_path / "run")
    evaluate(SETTINGS, tmp_path / "run", videos=1)
    films = {path.name for path in (tmp_path / "run" / "videos").iterdir()}
    assert films == {"lift-random-sugar_box-0.mp4", "lift-random-gelatin_box-0.mp4"}
    evaluate(SETTINGS, tmp_path / "run", videos="failures")
    failed = [r for r in read_rows(tmp_path / "run") if not r["success"]]
    assert len(list((tmp_path / "run" / "videos").iterdir())) == len(failed) == 4
    assert len(read_rows(tmp_path / "run")) == 4


def write_one(video):
    """Stand in for drawing, which is slow in software."""

    class Writer:
        def close(self):
            video._part.parent.mkdir(exist_ok=True)
            video._part.write_bytes(b"film")

    video._writer = Writer()


def test_every_mesh_is_looked_at_before_the_first_trial(tmp_path):
    (tmp_path / "bad.obj").write_text("v 0 0 0\n")
    settings = EvaluationSettings.of(["random"], ["sugar_box", str(tmp_path / "bad.obj")])
    with refused(r"bad\.obj"):
        evaluate(settings, tmp_path / "out")
    assert not (tmp_path / "out" / "trials.jsonl").exists()
