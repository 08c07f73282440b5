"""Lines of trials.jsonl and folders of evaluations as tests want them."""

import json


def row(agent="a", name="soda", trial=0, success=False, **rest):
    values = {
        "protocol": "lift", "agent": agent, "object": name, "trial": trial, "scene_seed": trial, "agent_seed": trial,
        "success": success, "stable": success, "reason": None if success else "dropped",
        "planning_seconds": 1.0 + trial, "details": {}, "error": None,
    }  # fmt: skip
    return values | rest


def write_run(folder, rows, **run):
    """Write what an evaluation leaves: its rows, and run.json where `run` says anything; return the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "trials.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    if run:
        (folder / "run.json").write_text(json.dumps(run))
    return folder
