"""Summary of a folder of demonstrations, and replay of its actions."""

from itertools import groupby, islice
from pathlib import Path
from typing import Any

import gymnasium as gym

from dexgrasp.data.demonstrations.generate import read_about
from dexgrasp.data.demonstrations.hdf5_formats import read_episodes
from dexgrasp.data.demonstrations.rollout import Demonstration
from dexgrasp.data.demonstrations.settings import ENV_ID, DemoSettings
from dexgrasp.runs.progress import Show, silent
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.scene.constants import CONTROL_PERIOD


def summary(folder: Path) -> Fields:
    """Return counts and settings of the demonstrations in a folder.

    Raises:
        InputError: if there are none, or not all yet.
    """
    about = read_about(folder)
    settings = about["settings"]
    figures: Fields = {
        "schema": about["schema"],
        "complete": bool(about.get("complete")),
        **{key: settings[key] for key in ("agent", "seed", "obs_mode", "control_mode", "observe", "noise")},
        "objects": len(settings["objects"]),
    }
    if not about.get("complete"):
        return figures
    figures |= {key: about[key] for key in ("tried", "episodes", "kept", "failures")}
    if "minari" in about["formats"]:
        steps = [len(episode) for episode in read_episodes(folder)]
        figures |= {"steps": sum(steps), "seconds_an_episode": CONTROL_PERIOD * sum(steps) / len(steps)}
    return figures


def replay_all(
    folder: Path, number: int | None = None, progress: Show = silent, robot: str | None = None
) -> Fields:
    """Replay recorded actions from their scenes, and count those that succeed again, at whichever step.

    Args:
        folder: of the demonstrations.
        number: of episodes, from the first; None for all.
        progress: called with the number of episodes done and in all.
        robot: path of the cell's file, where it has moved.

    Raises:
        InputError: if there are none.
    """
    about = read_about(folder)
    if not about.get("complete"):
        raise InputError(f"{folder} is not complete: the same `dexgrasp demos generate` command goes on")
    settings = DemoSettings.of_json(about["settings"], robot)
    total = min(number or about["episodes"], about["episodes"])
    failed: list[Fields] = []
    done = 0
    for target, episodes in groupby(islice(read_episodes(folder), total), lambda e: e.about["target"]):
        env = gym.make(ENV_ID, objects=[target], **settings.env_arguments, disable_env_checker=True)
        for episode in episodes:
            if not _succeeds(env, episode):
                failed.append({"episode": done, **{k: episode.about[k] for k in ("object", "scene_seed")}})
            done += 1
            progress(done, total)
        env.close()
    return {"schema": 1, "replayed": total, "successes": total - len(failed), "failed": failed}


def _succeeds(env: gym.Env[Any, Any], episode: Demonstration) -> bool:
    env.reset(seed=episode.about["scene_seed"])
    for action in episode.actions:
        _, _, terminated, truncated, info = env.step(action)
        if info["is_success"] or terminated or truncated:
            return bool(info["is_success"])
    return False
