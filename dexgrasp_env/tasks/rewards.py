"""Names and weights of the reward's terms; `terms` computes them."""

from collections.abc import Mapping

from dexgrasp_env.errors import unknown_name
from dexgrasp_env.valid import check, number

REWARD_MODES = ("dense", "sparse")
WEIGHTS = {
    "reach": 5.0, "close": 10.0, "contact": 5.0, "squeeze": 5.0, "lift": 15.0, "hold": 10.0, "success": 50.0,
}  # fmt: skip
WEIGHTS_V1 = {"reach": 0.2, "contact": 0.2, "lift": 0.3, "hold": 0.3}


def reward_weights(version: int, given: Mapping[str, float] | None) -> dict[str, float]:
    """Return the weight of each term: that given, else the version's.

    Raises:
        InputError: for an unknown term, or a weight that is not a number from 0 on.
    """
    known = WEIGHTS if version > 1 else WEIGHTS_V1
    for term, weight in (given or {}).items():
        if term not in known:
            raise unknown_name("reward_weights key", term, known)
        check(f"reward_weights {term}", weight, number(ge=0))
    return known | dict(given or {})
