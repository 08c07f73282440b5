"""Names and weights of the reward's terms; `kernel` computes them."""

REWARD_MODES = ("dense", "sparse")
WEIGHTS = {"reach": 0.2, "contact": 0.2, "lift": 0.3, "hold": 0.3}
