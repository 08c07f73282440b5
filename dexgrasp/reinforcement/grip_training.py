"""Teaching a clone a firmer grip by reinforcement."""

from dexgrasp.reinforcement.grip import Grip
from dexgrasp.reinforcement.rounds import Rounds
from dexgrasp_env.arrays import Fields
from dexgrasp_env.extras import from_extra

with from_extra():
    from stable_baselines3 import PPO

    from dexgrasp.reinforcement.grip_env import GripVecEnv


class GripTraining(Rounds):
    """Training of corrections of a clone's grip."""

    kind, counted, won = Grip.kind, "episodes", "training_held"

    def environments(self) -> GripVecEnv:
        """Make the environments."""
        s = self.settings
        assert self.clone, "a grip is a clone's"
        return GripVecEnv(
            s.env_id, s.num_envs, self.clone, s.alike, objects=list(s.objects),
            max_episode_steps=s.episode_steps, randomisation={"friction": s.friction, "mass": s.mass}, **self.env,
        )  # fmt: skip

    def learner(self) -> PPO:
        """Make the learner."""
        s = self.settings
        return PPO(
            "MlpPolicy", self.envs, n_steps=s.round_episodes, n_epochs=s.passes, target_kl=s.divergence,
            batch_size=max(2, s.round_steps // 2), learning_rate=s.rate,
            policy_kwargs={"net_arch": [s.hidden, s.hidden], "log_std_init": s.spread}, seed=s.seed,
            device=self.place,
        )  # fmt: skip

    def policy(self) -> tuple[Fields, Fields]:
        """Return what a `Grip` reads."""
        return {}, {}
