"""Learn Place-v2 by hindsight: SAC, goals relabelled, episodes begun along demonstrations of a grasp.

    dexgrasp demos generate --objects tomato_soup_can --agent hardcoded --episodes 24 --seed 7 --out runs/can
    python scripts/hindsight.py --demos runs/can --out runs/hindsight

An action has four numbers: a step of the palm and how much the hand closes, carried out over five control steps. The
policy sees the object's pose (`obs_mode="state"`). Writes `curve.json`, `curve.png` and `policy.zip`; with
`--scripted` a few lines act in that space, which says whether it can do the task at all.
"""

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from gymnasium import spaces
from matplotlib.figure import Figure
from numpy.random import Generator
from numpy.typing import NDArray
from stable_baselines3 import SAC, HerReplayBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.vec_env import VecEnvWrapper

from dexgrasp.cli.command import Folder, Script
from dexgrasp.cli.commands import run_script
from dexgrasp.data.demonstrations.resets import DemoResets
from dexgrasp.evaluation.statistics import wilson_interval
from dexgrasp.learning.reinforcement.grasp_space import SIZE, GraspSpace
from dexgrasp.learning.reinforcement.sb3_vec_env import SB3VecEnv
from dexgrasp_env.arrays import Array
from dexgrasp_env.poses import quat_to_matrix
from dexgrasp_env.tasks.constants import PALM_STEP
from dexgrasp_env.tasks.observations import key_sizes
from dexgrasp_env.valid import Count, Natural

ENV_ID = "DexGrasp/Place-v2"
HELD = 5  # control steps of an action
PALM, CLOSING = 0.03, 0.5  # m a step, at most, along each axis; share of half the hand's way
AHEAD = 0.05  # m that the palm's set-point may be from the palm
TILT = 0.5  # of the palm, as `GraspSpace` has it: thumb up by 0.2 rad
WHOLE, SHORT = 300, 200  # control steps of an episode: where it is judged, where it is learned from
SEEN = 29  # numbers of an observation
FARTHEST = 5.0  # that one of them counts, from 0
U, V, ABOVE, LEAST_Z = 0.010, -0.028, 0.045, 0.137  # m, where `hardcoded` puts the palm
USUAL, LATER = 0.3, 0.7  # share of usual episodes to learn from: at first, and once demonstrations are solved
SHARES = 0.9, 0.6, 0.3, 0.0  # of demonstrations, where episodes begin that are judged
Act = Callable[[dict[str, Any]], NDArray[Any]]


class Macro(VecEnvWrapper):
    """N episodes in `ee_delta`, acted in by steps of the palm (m / `PALM`) and of closing (/ `CLOSING`), (N, 4)."""

    def __init__(self, objects: str, number: int, steps: int) -> None:
        settings = {"control_mode": "ee_delta", "max_episode_steps": steps, "threads": 1}
        inner = SB3VecEnv(ENV_ID, number, ("is_success",), objects=objects, **settings)
        parts = dict(inner.observation_space.spaces)  # type: ignore[attr-defined]
        parts["observation"] = spaces.Box(-np.inf, np.inf, (SEEN,), np.float32)
        actions = spaces.Box(-1.0, 1.0, (4,), np.float32)
        super().__init__(inner, spaces.Dict(parts), actions)
        self.inner, self.robot = inner, inner.envs.settings.cell.robot
        self.place, self.closed = np.zeros((number, 3)), np.zeros(number)
        self.space: GraspSpace | None = None

    def reset(self) -> dict[str, Any]:
        """Begin all episodes anew."""
        self.raw = self.inner.reset()
        state = self.state(self.raw)
        self.space = GraspSpace(self.robot, state)
        self._begin(np.arange(self.num_envs), state)
        return self.seen(self.raw, slice(None))

    def step_async(self, actions: NDArray[Any]) -> None:
        """Note where palms and hands are to be."""
        palm = self.state(self.raw)["palm_pose"][:, :3]
        self.place = np.clip(self.place + PALM * actions[:, :3], palm - AHEAD, palm + AHEAD)
        self.closed = np.clip(self.closed + CLOSING * actions[:, 3], -1.0, 1.0)

    def step_wait(self) -> Any:
        """Go there; an episode that ends on the way ends the step, and what follows it waits."""
        over = np.zeros(self.num_envs, bool)
        infos: list[dict[str, Any]] = [{"is_success": False} for _ in range(self.num_envs)]
        ends = {key: np.zeros_like(value) for key, value in self.raw.items()}
        for _ in range(HELD):
            self.inner.step_async(self._towards())
            self.raw, _, done, told = self.inner.step_wait()
            for i in np.flatnonzero(~over).tolist():
                infos[i] = told[i] | {"is_success": bool(infos[i]["is_success"] | told[i]["is_success"])}
            for i in np.flatnonzero(done & ~over).tolist():
                last = {key: value[None] for key, value in told[i]["terminal_observation"].items()}
                infos[i]["terminal_observation"] = {k: v[0] for k, v in self.seen(last, [i]).items()}
                for key, value in last.items():
                    ends[key][i] = value[0]
            if done.any():
                self._begin(np.flatnonzero(done), self.state(self.raw))
            over |= done
        final = {key: np.where(over[:, None], ends[key], value) for key, value in self.raw.items()}
        goals = final["achieved_goal"], final["desired_goal"]
        rewards = self.inner.env_method("compute_reward", *goals, {}, indices=[0])[0]
        return self.seen(self.raw, slice(None)), rewards.astype(np.float32), over, infos

    def _towards(self) -> NDArray[np.float32]:
        state, asked = self.state(self.raw), np.zeros((self.num_envs, SIZE))
        asked[:, 4], asked[:, 5:] = TILT, self.closed[:, None]
        assert self.space is not None
        moves = self.space.env_actions(asked, state)
        moves[:, :3] = np.clip(0.5 * (self.place - state["palm_pose"][:, :3]) / PALM_STEP, -0.8, 0.8)
        return moves

    def _begin(self, rows: NDArray[Any], state: dict[str, Array]) -> None:
        """Take up the places and closings at which episodes begin."""
        assert self.space is not None
        firsts = {key: value[rows] for key, value in state.items()}
        self.space.begin(rows, firsts)
        self.place[rows] = firsts["palm_pose"][:, :3]
        meant = firsts | {"joint_positions": firsts["joint_targets"]}
        self.closed[rows] = np.clip(self.space.look(meant, rows)[:, 5:].mean(axis=1), -1.0, 1.0)

    def state(self, raw: dict[str, Any]) -> dict[str, Array]:
        """Return what the environment's row holds, (N, n) by key."""
        sizes = key_sizes("state", self.robot)
        ends = np.cumsum(list(sizes.values()))[:-1]
        return dict(zip(sizes, np.split(raw["observation"].astype(float), ends, axis=1), strict=True))

    def seen(self, raw: dict[str, Any], rows: Any) -> dict[str, Any]:
        """Return observations with rows (N, `SEEN`): dm and numbers of about 1."""
        s, assigned = self.state(raw), self.place[rows]
        palm, centre = s["palm_pose"][:, :3], s["object_pose"][:, :3]
        tips = s["fingertip_positions"].reshape(len(palm), -1, 3) - centre[:, None]
        forces = np.linalg.norm(s["fingertip_forces"].reshape(len(palm), -1, 3), axis=2)
        assert self.space is not None
        facing = quat_to_matrix(s["palm_pose"][:, 3:])[:, :2, 2]
        upright = quat_to_matrix(s["object_pose"][:, 3:])[:, 2, 2:]
        hand = self.space.look(s, rows)[:, 5:]
        parts = [
            10 * (palm - centre),
            10 * (assigned - palm),
            10 * tips[:, [0, 1, 3]].reshape(len(palm), -1),
            facing,
            upright,
            np.tanh(forces[:, [0, 1, 3]] / 5),
            hand,
            self.closed[rows][:, None],
            10 * palm[:, 2:],
            s["object_velocity"][:, :3],
            10 * centre[:, 2:] - 0.5,
        ]
        return raw | {"observation": np.concatenate(parts, axis=1).astype(np.float32)}


class Relative(BaseFeaturesExtractor):
    """What is seen, the way left to the goal in dm, and what the hand does and is to do there."""

    def __init__(self, space: spaces.Dict) -> None:
        super().__init__(space, SEEN + 5)

    def forward(self, seen: dict[str, torch.Tensor]) -> torch.Tensor:
        """Return (B, `SEEN` + 5)."""
        way = 10 * (seen["desired_goal"] - seen["achieved_goal"])[:, :3]
        hands = [seen[key][:, 3:] for key in ("achieved_goal", "desired_goal")]
        return torch.cat([seen["observation"], way, *hands], dim=1).clamp(-FARTHEST, FARTHEST)


class Normed(torch.nn.Module):
    """What a layer answers, normed and cut off at 0: values do not grow without bounds beyond what was seen."""

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Return (B, n)."""
        return torch.relu(torch.nn.functional.layer_norm(x, x.shape[-1:]))


def judge(env: Macro, act: Act, begin: list[dict[str, Any]], seed: int) -> list[dict[str, Any]]:
    """Play whole episodes, one for each of the options, with seeds from `seed` on; say whether they were solved."""
    rows: list[dict[str, Any]] = []
    for first in range(0, len(begin), env.num_envs):
        env.inner.seed(seed + first)
        env.inner.set_options([begin[k % len(begin)] for k in range(first, first + env.num_envs)])
        seen = env.reset()
        held, high = seen["desired_goal"][:, 3] > 0.5, seen["achieved_goal"][:, 2].copy()
        over, solved = np.zeros(env.num_envs, bool), np.zeros(env.num_envs, bool)
        for _ in range(WHOLE // HELD):
            found, _, done, infos = env.step(act(seen))
            seen = cast(dict[str, Any], found)
            solved |= ~over & np.array([info["is_success"] for info in infos])
            over |= done
            high = np.where(over, high, np.maximum(high, seen["achieved_goal"][:, 2]))
        rows += [
            {"solved": bool(solved[i]), "held": bool(held[i]), "top": float(high[i])}
            for i in range(min(env.num_envs, len(begin) - first))
        ]
    return rows


def by_hand(env: Macro) -> Act:
    """Return a few lines that act: over the object, down, close, up and to the goal, down and open."""
    phase = np.zeros(env.num_envs, int)
    since = np.zeros(env.num_envs, int)

    def act(seen: dict[str, Any]) -> NDArray[Any]:
        """Return actions (N, 4)."""
        s = env.state(env.raw)
        palm, goal, actions = s["palm_pose"][:, :3], seen["desired_goal"], np.zeros((env.num_envs, 4))
        facing = quat_to_matrix(s["palm_pose"][:, 3:])[:, :2, 2]
        facing /= np.linalg.norm(facing, axis=1, keepdims=True)
        R, size = quat_to_matrix(s["object_pose"][:, 3:]), s["object_size"]
        x, y = facing.T
        aside = [U * x - V * y, U * y + V * x, 0.5 * (np.abs(R[:, 2]) * size).sum(axis=1)]
        over = s["object_pose"][:, :3] + np.column_stack(aside)
        for i, (x, y, z, hand) in enumerate(goal):
            way, shut = np.array([x, y, z]) - s["object_pose"][i, :3], -1.0
            high = over[i] + [0, 0, 0.15]
            low = np.array([*over[i, :2], max(over[i, 2] + ABOVE, LEAST_Z)])
            if phase[i] == 0:
                move = high - palm[i]
            elif phase[i] == 1:
                move = low - palm[i]
            else:
                move, shut = (np.zeros(3) if phase[i] == 2 else way), float(phase[i] < 5)
                if phase[i] == 3:
                    move = np.array([0, 0, 0.1])
                elif phase[i] == 4 and hand < 0.5 and np.hypot(*way[:2]) > 0.015:
                    move = way * [1, 1, 0]
                elif phase[i] == 5:
                    shut, move = -1.0, np.array([0, 0, 0.05 * (since[i] > 3)])
            near = np.linalg.norm(move - (env.place[i] - palm[i])) < 0.012
            since[i] += 1
            done = (near, near, since[i] > 3, since[i] > 2, near and hand < 0.5, False)[phase[i]]
            if done or (phase[i] < 2 and since[i] > 16):
                phase[i], since[i] = phase[i] + 1, 0
            left = move - (env.place[i] - palm[i])
            actions[i] = [*np.clip(left / PALM, -1, 1), np.clip((shut - env.closed[i]) / CLOSING, -1, 1)]
        return actions

    return act


def rates(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return how many were solved, of all and by what the goal asks of the hand, with 95 % Wilson intervals."""
    kinds = {"all": rows, "held": [r for r in rows if r["held"]], "free": [r for r in rows if not r["held"]]}
    return {
        name: {
            "solved": (k := sum(r["solved"] for r in part)),
            "n": len(part),
            "interval": wilson_interval(k, len(part)) if part else None,
        }
        for name, part in kinds.items()
    } | {"lifted_5cm": sum(r["top"] > 0.1 for r in rows)}


def share_starts(resets: DemoResets, share: float, number: int, rng: Generator) -> list[dict[str, Any]]:
    """Return options of episodes that begin at a share of demonstrations; their goals are where these end."""
    drawn = [resets.states[rng.integers(len(resets.states))] for _ in range(number)]
    return [{"state": states[min(int(share * len(states)), len(states) - 1)]} for states in drawn]


def draw(curve: list[dict[str, Any]], path: Path) -> None:
    """Draw what is solved over the actions learned from: as usual, and begun along demonstrations."""
    figure = Figure((6.0, 3.3), layout="constrained")
    axis = figure.subplots()
    steps = [point["steps"] for point in curve]
    lines = {"as usual": [point["usual"]["all"] for point in curve]} | {
        f"from {share} of a demonstration": [point["along"][str(share)]["policy"] for point in curve]
        for share in SHARES
    }
    for label, rated in lines.items():
        axis.plot(steps, [r["solved"] / r["n"] for r in rated], lw=1, marker=".", label=label)
    axis.set(xlabel="actions of 250 ms", title="share solved", ylim=(0.0, 1.05))
    axis.grid(alpha=0.3)
    axis.legend(fontsize=7)
    figure.savefig(path, dpi=100)


class Judged(BaseCallback):
    """Judges the policy every so many steps, notes it in `curve.json`, draws it, and ends training by the clock."""

    def __init__(self, env: Macro, resets: DemoResets, told: "Hindsight") -> None:
        super().__init__()
        self.own, self.resets, self.told = env, resets, told
        self.curve: list[dict[str, Any]] = []
        self.began, self.next = time.time(), told.every

    def act(self, seen: dict[str, Any]) -> NDArray[Any]:
        """Return what the policy does without exploring, (N, 4)."""
        return self.model.predict(seen, deterministic=True)[0]

    def look(self, number: int, seed: int) -> dict[str, Any]:
        """Return what `number` usual episodes and half as many from each share come to."""
        rng, half = np.random.default_rng(seed), max(number // 2, self.own.num_envs)
        point = {"steps": self.num_timesteps, "seconds": time.time() - self.began, "front": self.resets.front}
        usual = judge(self.own, self.act, [{}] * number, seed)
        along = {}
        for share in SHARES:
            starts = share_starts(self.resets, share, half, rng)
            both = (rates(judge(self.own, act, starts, seed))["all"] for act in (self.act, self.still))
            along[str(share)] = dict(zip(("policy", "still"), both, strict=True))
        return point | {"usual": rates(usual), "along": along}

    def still(self, seen: dict[str, Any]) -> NDArray[Any]:
        """Return actions (N, 4) that do nothing: what a beginning is worth by itself."""
        return np.zeros((self.own.num_envs, 4))

    def note(self, number: int) -> None:
        """Judge, and keep curve and policy."""
        rng = np.random.default_rng([self.told.seed, 1, len(self.curve)])
        self.curve.append(self.look(number, int(rng.integers(10**6, 10**9))))
        content = {"schema": 1, "settings": self.told.settings, "curve": self.curve}
        (self.told.out / "curve.json").write_text(json.dumps(content, indent=1, default=str) + "\n")
        draw(self.curve, self.told.out / "curve.png")
        self.model.save(self.told.out / "policy.zip")
        last = self.curve[-1]
        told = {share: [rate["solved"] for rate in both.values()] for share, both in last["along"].items()}
        point = {k: last[k] for k in ("steps", "seconds", "front")}
        print(json.dumps(point), last["usual"]["all"]["solved"], told)

    def _on_step(self) -> bool:
        if self.resets.front == 0.0:
            self.resets.whole = LATER  # what is left to learn is how usual episodes begin
        if self.num_timesteps >= self.next:
            self.next += self.told.every
            self.note(self.told.trials)
        return time.time() - self.began < 60 * self.told.minutes


class Hindsight(Script):
    """Trains and judges.

    Attributes:
        demos: folder of demonstrations of the object.
        steps: actions, of 250 ms each, to learn from.
        minutes: after which training ends in any case.
        every: actions from one judgement to the next.
        trials: usual episodes of each.
        final: usual episodes of the last.
        vector: episodes beside each other.
        scripted: judge `by_hand` instead.
    """

    demos: Folder = Path("runs/can")
    out: Folder = Path("runs/hindsight")
    object: str = "tomato_soup_can"
    seed: Natural = 0
    steps: Count = 100_000
    minutes: float = 60.0
    every: Count = 10_000
    trials: Count = 20
    final: Count = 50
    vector: Count = 10
    scripted: bool = False

    @property
    def settings(self) -> dict[str, Any]:
        """What is noted beside the curve."""
        names = "object", "seed", "steps", "minutes", "every", "trials", "final", "vector"
        return {name: getattr(self, name) for name in names} | {
            "held": HELD,
            "palm": PALM,
            "closing": CLOSING,
        }

    def run(self) -> int:
        torch.set_num_threads(1)
        self.out.mkdir(parents=True, exist_ok=True)
        look = Macro(self.object, self.vector, WHOLE)
        if self.scripted:
            print(json.dumps(rates(judge(look, by_hand(look), [{}] * self.final, self.seed))))
            return 0
        env = Macro(self.object, self.vector, SHORT)
        resets = DemoResets(self.demos, whole=USUAL).attach(env.inner.envs)
        network = {"net_arch": [128, 128], "features_extractor_class": Relative, "activation_fn": Normed}
        model = SAC(
            "MultiInputPolicy",
            env,
            replay_buffer_class=HerReplayBuffer,
            seed=self.seed,
            device="cpu",
            replay_buffer_kwargs={"n_sampled_goal": 4, "goal_selection_strategy": "future"},
            policy_kwargs=network,
            learning_rate=1e-3,
            gamma=0.95,
            batch_size=256,
            buffer_size=300_000,
            ent_coef=0.02,  # learned, it grows without bounds, and values after it
            learning_starts=2000,
            train_freq=1,
            gradient_steps=self.vector,
        )
        judged = Judged(look, resets, self)
        model.learn(self.steps, callback=judged)
        judged.note(self.final)
        print(json.dumps(judged.curve[-1]))
        return 0


if __name__ == "__main__":
    sys.exit(run_script(Hindsight))
