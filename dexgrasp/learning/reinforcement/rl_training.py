"""Training by PPO or SAC of Stable-Baselines3 on the features of our environments."""

from dataclasses import asdict
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from dexgrasp.data.demonstrations.resets import DemoResets
from dexgrasp.learning.reinforcement.rl_policy import RlPolicy
from dexgrasp.learning.reinforcement.settings import RlSettings
from dexgrasp.learning.training.checkpoint import Trainables
from dexgrasp.learning.training.loop import RunOptions, Training
from dexgrasp.runs.weights import write_policy
from dexgrasp_env.arrays import Fields
from dexgrasp_env.extras import from_extra
from dexgrasp_env.valid import checked

with from_extra():
    import torch
    from stable_baselines3 import PPO, SAC
    from stable_baselines3.common.vec_env import VecMonitor

    from dexgrasp.learning.imitation.bc_network import layer_arrays
    from dexgrasp.learning.reinforcement.sb3_vec_env import SB3VecEnv


class RlTraining(Training):
    """Training in rounds, each of which resets the environments from a seed of its own.

    A round depends on the learned parameters and its number only, so checkpoints hold no state of environments.
    """

    model: Any

    @checked
    def __init__(self, settings: RlSettings, out: Path, options: RunOptions = RunOptions()) -> None:
        """Read demonstrations, where there are any.

        Args:
            settings: of the training.
            out: folder of the policy, an agent by its path.
            options: where it runs.

        Raises:
            InputError: no usable demonstrations, or no such device.
        """
        super().__init__(settings, settings.rounds, out, options)
        self._resets = DemoResets(settings.resets) if settings.resets else None
        self._envs: Any = None

    def build(self) -> None:
        """Make environments and algorithm."""
        s, arguments = self.settings, self.settings.env_arguments
        if s.backend == "warp" and self.device.type == "cpu":
            arguments["device"] = "cpu"
        envs = SB3VecEnv(s.env_id, s.num_envs, ("is_success",), **arguments)
        if self._resets:
            self._resets.attach(envs.envs)
        self._envs = VecMonitor(envs)
        # Of a round all episodes count, which are fewer than its steps.
        common: Fields = {
            "gamma": s.gamma, "seed": s.seed, "device": self.device, "stats_window_size": s.round_steps,
        }  # fmt: skip
        if s.algorithm == "sac":
            self.model = SAC(
                "MlpPolicy", self._envs, learning_rate=s.learning_rate, buffer_size=s.buffer_size,
                learning_starts=s.learning_starts, gradient_steps=s.gradient_steps,
                policy_kwargs={"net_arch": list(s.net_arch)}, **common,
            )  # fmt: skip
        else:
            _, n_steps = s.rollouts
            self.model = PPO(
                "MlpPolicy", self._envs, learning_rate=s.learning_rate, n_steps=n_steps, n_epochs=s.n_epochs,
                batch_size=max(n_steps * s.num_envs // 4, 2), target_kl=s.target_kl,
                policy_kwargs={"net_arch": list(s.net_arch), "log_std_init": s.log_std_init}, **common,
            )  # fmt: skip

    def close(self) -> None:
        """Close the environments, where there are any."""
        if self._envs:
            self._envs.close()

    def parts(self) -> Trainables:
        """Return networks, optimisers and single tensors of the algorithm, and its replay buffer."""
        modules, tensors = self.model._get_torch_save_params()
        learned = {name: attrgetter(name)(self.model) for name in (*modules, *tensors)}
        rows = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
        kept = rows if self._buffer else ()
        return learned | {f"buffer.{name}": torch.from_numpy(getattr(self._buffer, name)) for name in kept}

    def learn(self) -> Fields:
        """Learn from the episodes of a round."""
        s, model = self.settings, self.model
        if self._resets:
            self._resets.go_on(**self._resets.progress)
        if s.log_std_final is not None:
            done = min(model.num_timesteps / s.steps, 1.0)
            with torch.no_grad():
                model.policy.log_std.fill_((1.0 - done) * s.log_std_init + done * s.log_std_final)
        words = np.random.SeedSequence([s.seed, 1, self.state.epoch]).generate_state(1)
        model.set_random_seed(int(words[0]) >> 1)
        model._last_obs = model.ep_info_buffer = None  # begin anew
        model.learn(s.round_steps, reset_num_timesteps=False, log_interval=None)
        row: Fields = {"steps": model.num_timesteps}
        if model.ep_info_buffer:
            returns = [float(episode["r"]) for episode in model.ep_info_buffer]
            row |= {"return": np.mean(returns), "training_success": np.mean(model.ep_success_buffer)}
        return row | ({"front": self._resets.front} if self._resets else {})

    def write(self) -> None:
        """Write the policy."""
        seen = self._envs.get_attr("settings")[0]
        about = {
            "kind": RlPolicy.kind,
            "algorithm": self.settings.algorithm,
            "env": {key: getattr(seen, key) for key in ("obs_mode", "control_mode", "hold")},
            "robot": seen.cell.robot.stamp,
            "training": self.state.origin("stable-baselines3", settings=asdict(self.settings)),
        }
        write_policy(self.out, about, layer_arrays("actor", _mean_action(self.model)))

    def note(self) -> Fields:
        """Return the algorithm's counters, and the progress of the reverse curriculum."""
        counts = [getattr(owner, name) for owner, name in self._counters()]
        return {"counters": counts, "resets": self._resets and self._resets.progress}

    def restore(self, note: Fields) -> None:
        """Restore the state of `note`."""
        for (owner, name), count in zip(self._counters(), note["counters"], strict=True):
            setattr(owner, name, count)
        if self._resets:
            self._resets.go_on(**note["resets"])

    def _counters(self) -> list[tuple[Any, str]]:
        own = [(self.model, "num_timesteps"), (self.model, "_n_updates")]
        return own + ([(self._buffer, "pos"), (self._buffer, "full")] if self._buffer else [])

    @property
    def _buffer(self) -> Any:
        return getattr(self.model, "replay_buffer", None)


def _mean_action(model: Any) -> list[torch.nn.Module]:
    """Return the layers from features to the mean action."""
    if isinstance(model, PPO):
        return [*model.policy.mlp_extractor.policy_net, model.policy.action_net]
    return [*model.actor.latent_pi, model.actor.mu]
