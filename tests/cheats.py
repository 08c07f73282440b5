"""What looks like lifting and is none, against honest grasps: as docs/environments/lift.md sums up.

python tests/cheats.py --seed 5 --trials 5 [--objects all20] [--presets Lift LiftPushed]
"""

import sys

import gymnasium as gym
import numpy as np
from tables import table

from dexgrasp.agent import public_info
from dexgrasp.cli.command import Script
from dexgrasp.cli.commands import run_script
from dexgrasp.evaluation.protocol import TrialSeeds
from dexgrasp.evaluation.trial import run_trial
from dexgrasp.registry import make_agent
from dexgrasp_env.objects.load import resolve_targets
from dexgrasp_env.robot.cell import default_cell
from dexgrasp_env.tasks.control import normalise
from dexgrasp_env.valid import Count, Natural

PRESETS = ("Lift", "LiftUpright", "LiftSlippery", "LiftPushed", "LiftOneView")
_HOVER = 0.07  # m, from where on nothing more is commanded: the arm goes on to 9 cm
_OBJECT = "gelatin_box"
ROBOT = default_cell().robot
HOME = ROBOT.home
UPTURNED = table("upturned")
"""Posture with the open palm up, high above the table, the thumb aside, and the pose of an object on the palm."""


def make(preset, objects=_OBJECT, **kwargs):
    """Return a preset, version 2, as planners of set-points want it."""
    looks = {"obs_mode": "pointcloud", "control_mode": "joint_position", "observe": "reset"}
    return gym.make(f"DexGrasp/{preset}-v2", objects=objects, disable_env_checker=True, **(looks | kwargs))


def play(env, actions):
    """Play a running episode to its end; return the sum of rewards, whether it was ever solved, and all infos."""
    total, infos = 0.0, []
    for action in actions:
        _, reward, terminated, truncated, info = env.step(action)
        total += float(reward)
        infos.append(info)
        if terminated or truncated:
            break
    return total, any(info["is_success"] for info in infos), infos


def grasp(env, seed, agent, stop):
    """An agent's actions until `stop`, then none: the set-points stay."""
    inner = env.unwrapped
    observation, info = env.reset(seed=seed)
    actor = make_agent(agent)
    actor.seed(seed)
    actor.reset(observation, public_info(env, info))

    def actions():
        """Yield the cheat's actions."""
        stopped = False
        while True:
            stopped = stopped or stop(inner)
            yield (
                normalise(inner.targets, ROBOT).astype(np.float32)
                if stopped
                else actor.act(inner.observe()[0])
            )

    return actions()


def put(inner, q, pose, velocity=0.0):
    """Make the episode one in which the robot stands at `q` and the object is at `pose`, with a speed upwards."""
    state = inner.get_state()
    state.physics[1:24], state.physics[24:31] = q, pose
    state.physics[31:60] = 0.0
    state.physics[31 + 25] = velocity
    state.commands[:] = q
    inner.set_state(state)


def hover(env, seed):
    """Grasp and lift, but not as far as counts: pushes never begin."""
    return grasp(env, seed, "hardcoded", lambda inner: inner.observe()[1]["object_height"] > _HOVER)


def press(env, seed):
    """Grasp and stay on the table: wedged between hand and table."""
    inner = env.unwrapped
    held = [0]

    def stop(_):
        """Whether the hand has held for more than 8 control steps."""
        held[0] += inner.observe()[1]["is_grasped"]
        return held[0] > 8

    return grasp(env, seed, "hardcoded", stop)


def pin(env, seed):
    """Press the object onto the table from above with the open hand."""
    env.reset(seed=seed)
    inner = env.unwrapped

    def actions():
        """Yield the cheat's actions."""
        while True:
            palm, at = inner.data.site("palm"), inner.data.body("object").xpos
            tips = np.mean([inner.data.site(f"{f}_tip").xpos for f in ("thumb", "index", "middle")], axis=0)
            over = 0.5 * (tips + palm.xpos)
            action = np.zeros(22, np.float32)
            action[:2] = np.clip((at - over)[:2] / 0.025, -1, 1)
            action[2] = 0.0 if inner.observe()[1]["stage"] == "touched" else -0.2
            action[6:] = normalise(HOME, ROBOT)[7:]
            yield action

    return actions()


def tray(env, seed, curled=0.0):
    """Lay the object on the upturned open hand."""
    env.reset(seed=seed)
    inner = env.unwrapped
    q = np.array(UPTURNED["joints"])
    put(inner, q, UPTURNED["object"])
    end = q.copy()
    for first in (7, 11, 15):
        end[first + 1 : first + 4] += curled

    def actions():
        """Yield the cheat's actions."""
        for share in np.linspace(0.0, 1.0, 40):
            yield normalise(q + share * (end - q), ROBOT).astype(np.float32)
        while True:
            yield normalise(end, ROBOT).astype(np.float32)

    return actions()


def fist(env, seed):
    """Clasp the object between three fingers and the palm, without the thumb."""
    return tray(env, seed, 1.2)


def throw(env, seed):
    """Send the object up at 3 m/s, again and again."""
    env.reset(seed=seed)
    inner = env.unwrapped
    pose = inner.data.qpos[23:30].copy()
    pose[:3] += [0.0, 0.15, 0.05]

    def actions():
        """Yield the cheat's actions."""
        while True:
            put(inner, HOME, pose, 3.0)
            for _ in range(8):
                yield normalise(HOME, ROBOT).astype(np.float32)

    return actions()


CHEATS = {"hover": hover, "press": press, "pin": pin, "tray": tray, "fist": fist, "throw": throw}


def cheat(preset, name, seed=0):
    """Play a cheat in a preset; return what `play` does."""
    env = make(preset, control_mode="ee_delta" if name == "pin" else "joint_position")
    result = play(env, CHEATS[name](env, seed))
    env.close()
    return result


def honest(preset, objects, trials, seed, agent="bilevel"):
    """Return the sums of rewards of the episodes that an agent solves, up to there."""
    actor = make_agent(agent)
    returns = []
    for target in objects:
        env = make(preset, target, **(dict(actor.env_settings) | {"obs_mode": "pointcloud"}))
        outcomes = [run_trial(env, actor, TrialSeeds(seed + trial, trial))[0] for trial in range(trials)]
        returns += [outcome.total_reward for outcome in outcomes if outcome.success]
        env.close()
    return returns


class Table(Script):
    """Prints the table."""

    seed: Natural = 5
    trials: Count = 5
    objects: str = "all20"
    presets: tuple[str, ...] = PRESETS

    def run(self):
        print("|", " | ".join(["preset", *CHEATS, "least success of bilevel", "successes"]), "|")
        for preset in self.presets:
            played = {name: [cheat(preset, name, seed)[:2] for seed in range(2)] for name in CHEATS}
            cheats = [max(total for total, solved in runs if not solved) for runs in played.values()]
            returns = honest(preset, resolve_targets([self.objects]), self.trials, self.seed)
            cells = [f"{value:.1f}" for value in (*cheats, min(returns))]
            print("|", " | ".join([f"`{preset}-v2`", *cells, str(len(returns))]), "|", flush=True)
        return 0


if __name__ == "__main__":
    sys.exit(run_script(Table))
