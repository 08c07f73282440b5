"""Lines of trials.jsonl as tests want them."""


def row(agent="a", name="soda", trial=0, success=False, **rest):
    values = {
        "agent": agent, "object": name, "trial": trial, "scene_seed": trial, "success": success, "stable": success,
        "reason": None if success else "dropped", "planning_seconds": 1.0 + trial, "details": {}, "error": None,
    }  # fmt: skip
    return values | rest
