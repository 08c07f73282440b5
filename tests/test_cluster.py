"""Trials on a local Ray cluster of two nodes, one of which is lost in the middle."""

import pytest
from refusals import refused

from dexgrasp.evaluation.evaluate import evaluate
from dexgrasp.evaluation.settings import EvaluationSettings
from dexgrasp.evaluation.store import read_rows
from dexgrasp.runs.pool import Backend, run_pool

ray = pytest.importorskip("ray")
SETTINGS = EvaluationSettings.of(["random"], ["sugar_box", "pear"], trials=4)
TIMES = ("seconds", "planning_seconds")


@pytest.fixture
def cluster(monkeypatch):
    """Two nodes of one processor each."""
    from ray.cluster_utils import Cluster

    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    yield cluster
    ray.shutdown()
    cluster.shutdown()


def timeless(rows):
    """Trials by what they are of, times aside."""
    return {(row["object"], row["trial"]): {k: v for k, v in row.items() if k not in TIMES} for row in rows}


@pytest.mark.slow
def test_a_lost_node_loses_nothing_and_doubles_nothing(cluster, tmp_path, monkeypatch):
    second = cluster.add_node(num_cpus=1)
    finished = []

    def losing(*arguments):
        for row in run_pool(*arguments):
            finished.append(row)
            if len(finished) == 2:
                cluster.remove_node(second, allow_graceful=False)
            yield row

    monkeypatch.setattr("dexgrasp.evaluation.evaluate.run_pool", losing)
    spread = evaluate(SETTINGS, tmp_path / "ray", backend=Backend("ray", 2, cluster.address))
    monkeypatch.undo()
    alone = evaluate(SETTINGS, tmp_path / "one")
    rows = read_rows(tmp_path / "ray")
    assert len(rows) == len(finished) == 8
    assert timeless(rows) == timeless(read_rows(tmp_path / "one"))
    assert spread["agents"]["random"]["by_object"] == alone["agents"]["random"]["by_object"]


def test_no_cluster_is_one_line(tmp_path):
    with refused(r"no Ray cluster at '127\.0\.0\.1:1'"):
        evaluate(SETTINGS, tmp_path, backend=Backend("ray", 1, "127.0.0.1:1"))
