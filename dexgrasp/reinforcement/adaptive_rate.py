"""A rate of Adam that follows how far updates change a policy, as RSL-RL has it."""

from dexgrasp_env.extras import from_extra

with from_extra():
    from stable_baselines3 import PPO

_FACTOR, _LEAST, _MOST = 1.5, 1e-5, 1e-2
_AIM = 0.01


class AdaptiveRate:
    """A schedule of Stable-Baselines3: up after updates below half of a KL divergence, down after those past twice.

    The first update after `learn` has begun keeps the rate: nothing but `now` has to be kept between rounds.
    """

    model: PPO | None = None
    """That learns with it, once it is made."""

    def __init__(self, first: float, aim: float | None) -> None:
        """Begin with a rate; `aim` is the divergence that an update should come to."""
        self.now, self._aim = first, aim or _AIM

    def __call__(self, left: float) -> float:
        """Return the rate of the next update; `left`, the share of the training that is left, plays no part."""
        # It is asked more than once an update: what an update came to counts once.
        known = self.model.logger.name_to_value.pop("train/approx_kl", None) if self.model else None
        if known and known > 2.0 * self._aim:
            self.now = max(self.now / _FACTOR, _LEAST)
        elif known and 0.0 < known < 0.5 * self._aim:
            self.now = min(self.now * _FACTOR, _MOST)
        return self.now
