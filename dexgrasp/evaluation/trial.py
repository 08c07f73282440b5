"""Trial: an episode of one agent on one object in one scene."""

import time
import traceback
from typing import Any

import numpy as np

from dexgrasp.agent import Agent, Env, complete, public_info, renew_report, report_of
from dexgrasp.evaluation.protocol import TrialSeeds
from dexgrasp.evaluation.store import Outcome
from dexgrasp.evaluation.video import Video
from dexgrasp.grasp.probability import LEAST_FRICTION
from dexgrasp.planning.result import PlansGrasps
from dexgrasp.planning.scene_setup import Subject, subject_of
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import jsonable

NOT_HELD = {
    "untouched": "not_touched",
    "touched": "not_lifted",
    "lifted": "not_held_3s",
    "dropped": "dropped",
}
"""Last stage of an episode -> reason of the failure."""


class AgentError(Exception):
    """Exception of an agent's code; the cause is chained."""


def run_trial(
    env: Env, agent: Any, seeds: TrialSeeds, *, name: str = "", frames: Video | None = None
) -> tuple[Outcome, Fields | None]:
    """Run one episode until success or its end.

    An agent's exception or a wrong action fails the trial, not the evaluation.

    Args:
        env: of the protocol.
        agent: see `dexgrasp.agent`.
        seeds: of scene and agent.
        name: of the agent; empty for `module:Class` of it.
        frames: records a video.

    Returns:
        The outcome, and the content of a grasp file for agents that certify their grasps, else None.
    """
    name = name or f"{type(agent).__module__}:{type(agent).__name__}"
    agent = complete(name, agent)
    renew_report(agent)
    outcome, start, report_before = Outcome(), time.perf_counter(), agent.report
    subject: Subject | None = None
    try:
        observation, subject, friction = _begin(env, agent, seeds, outcome, frames)
        _go_on(env, agent, observation, outcome, frames)
    except AgentError as error:
        cause = error.__cause__ or error
        outcome.reason = f"agent_error: {type(cause).__name__}"
        explained = isinstance(cause, InputError)  # its line says what is wrong
        outcome.error = str(cause) if explained else "".join(traceback.format_exception(cause))
    # An agent that failed before it reported still bears the report of the trial before.
    if not (outcome.error and agent.report is report_before):
        report = report_of(agent)
        outcome.planning_seconds = jsonable(report.planning_seconds)
        outcome.details |= jsonable(report.details)
    outcome.seconds = time.perf_counter() - start
    # A grasp that was found at a later look is of the same pose: nothing was touched before.
    grasp = _certified(agent, name, subject) if subject else None
    said = grasp["holds_probability"] if grasp else None
    if said is not None and friction >= LEAST_FRICTION:
        outcome.details["holds_probability"] = said
    return outcome, grasp


def _begin(
    env: Env, agent: Agent, seeds: TrialSeeds, outcome: Outcome, frames: Video | None
) -> tuple[Any, Subject, float]:
    """Reset the agent on the scene and plan; return the observation, the object's pose and the scene's friction."""
    observation, info = env.reset(seed=seeds.scene)
    if frames:
        frames.add(env)
    subject = subject_of(env)
    _note_neighbours(outcome, info)
    _ask(agent.seed, seeds.agent)
    _ask(agent.reset, observation, public_info(env, info))
    return observation, subject, info["variation"]["friction"]


def _certified(agent: Agent, name: str, subject: Subject) -> Fields | None:
    """Return the planned grasp as the content of a grasp file; None for an agent without certificates."""
    if not isinstance(agent, PlansGrasps) or agent.result is None:
        return None
    contents = agent.result.contents(subject.identity, name, subject.pose)
    return contents[0] if contents else None


def _given_up(agent: Agent) -> str | None:
    """Return the reason of an agent that gave up, or None."""
    report = report_of(agent)
    return str(report.failure) if report.failure and not report.again else None


def _go_on(env: Env, agent: Agent, observation: Any, outcome: Outcome, frames: Video | None) -> None:
    outcome.reason, total = _given_up(agent), 0.0
    over = outcome.reason is not None
    while not over:
        action = _ask(agent.act, observation)
        outcome.reason = _given_up(agent)
        if outcome.reason is not None:
            return
        try:
            observation, reward, terminated, truncated, info = env.step(_numbers(action))
        except InputError as error:
            outcome.reason, outcome.error = "invalid_action", str(error)
            return
        if frames:
            frames.add(env)
        outcome.steps += 1
        total += float(reward)
        outcome.total_reward = total
        over = terminated or truncated or info["is_success"]
        _note(outcome, info)


def _numbers(action: Any) -> Any:
    try:
        return np.asarray(action, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"action is a {type(action).__name__} that is no array of numbers") from None


def _note(outcome: Outcome, info: Fields) -> None:
    outcome.success, outcome.stable = bool(info["is_success"]), bool(info["is_stable"])
    outcome.stage = info["stage"]
    undone = NOT_HELD.get(outcome.stage, outcome.stage)
    if "goal_distance" in info and outcome.stage != "untouched":
        undone = "not_at_goal"
    if info.get("is_crushed"):
        undone = "crushed"
    if "in_tray" in info:
        undone = "not_all_in_tray"
        counts = ("objects", "in_tray", "off_table", "touched")
        outcome.details |= jsonable({name: info[name] for name in counts})
    outcome.reason = None if outcome.success else info["failure"] or undone
    outcome.height, outcome.slip, outcome.tilt = (
        jsonable(info[key]) for key in ("object_height", "object_slip", "object_tilt")
    )
    outcome.warnings = info["mujoco_warnings"].split()
    _note_neighbours(outcome, info)


def _note_neighbours(outcome: Outcome, info: Fields) -> None:
    if "is_clean" in info:
        outcome.clean, outcome.moved, outcome.hit = (
            jsonable(info[key]) for key in ("is_clean", "neighbours_moved", "neighbours_hit")
        )
        outcome.hit_names = info["neighbours_hit_names"].split()


def _ask(method: Any, *arguments: Any) -> Any:
    try:
        return method(*arguments)
    except (Exception, SystemExit) as error:
        raise AgentError from error
