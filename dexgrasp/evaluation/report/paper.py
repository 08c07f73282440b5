"""The paper's own results: Tables 1-6 of its supplementary material, as data.

Wu, Guo, Liu, "Learning Diverse and Physically Feasible Dexterous Grasps with Generative Model and Bilevel
Optimization", CoRL 2022. Trials on the real robot; sizes and masses of the objects were not published.
"""

from collections.abc import Iterable, Mapping

TABLES = {"seen": "Table 1", "familiar": "Table 2", "novel": "Table 3"}
"""Set -> the table that reports it."""

_SEEN = ("sugar_box", "tomato_soup_can", "mustard_bottle")


def _of(names: tuple[str, ...], trials: int, *successes: int) -> dict[str, tuple[int, int]]:
    return {name: (k, trials) for name, k in zip(names, successes, strict=True)}


_FAMILIAR = ("webcam", "mask", "chips", "soda")
_NOVEL = (
    "glasses_case", "ramen", "pill_bottle", "sandwich_upright", "massage_ball", "castle", "tetrahedron",
    "hairspray_bottle", "pear", "alcohol_bottle", "condiment_bottle", "sandwich_side", "lego",
)  # fmt: skip

SUCCESSES: Mapping[str, Mapping[str, tuple[int, int]]] = {
    "bilevel": _of(_SEEN, 6, 6, 6, 5)
    | _of(_FAMILIAR, 6, 6, 6, 5, 6)
    | _of(_NOVEL, 6, 4, 6, 5, 6, 4, 6, 1, 6, 5, 6, 4, 6, 5),
    "cvae": _of(_SEEN, 6, 3, 3, 1),
    "cvae_kinematics": _of(_SEEN, 6, 6, 6, 4),
    "hardcoded": _of(_SEEN, 3, 3, 2, 3)
    | _of(_FAMILIAR, 3, 3, 3, 2, 1)
    | _of(_NOVEL, 3, 3, 3, 1, 3, 3, 0, 0, 0, 0, 1, 1, 0, 0),
}
"""Agent -> object -> (successes, trials): Tables 1-3."""


def set_successes(agent: str, members: Iterable[str]) -> tuple[int, int] | None:
    """Return (successes, trials) of a set as the paper prints it; None where it tried not all of its objects."""
    own = SUCCESSES.get(agent, {})
    counts = [own.get(name) for name in members]
    if not counts or None in counts:
        return None
    return sum(k for k, _ in filter(None, counts)), sum(n for _, n in filter(None, counts))


DISTANCES_CM: Mapping[str, tuple[float, float, float, float]] = {
    "seen": (-0.32, -0.68, -0.24, 0.08),
    "familiar": (-0.32, -0.68, -0.32, 0.00),
    "novel": (-0.32, -0.68, -0.24, 0.08),
    "overall": (-0.32, -0.68, -0.24, 0.08),
}
"""Set -> median, least, greatest, greatest violation: Table 4."""

RATIOS: Mapping[str, Mapping[str, tuple[float, float, float]]] = {
    "seen": {"force": (0.00, 0.00, 0.01), "torque": (0.01, 0.00, 0.27)},
    "familiar": {"force": (0.00, 0.00, 0.00), "torque": (0.00, 0.00, 0.00)},
    "novel": {"force": (0.00, 0.00, 0.03), "torque": (0.01, 0.00, 8.48)},
    "overall": {"force": (0.00, 0.00, 0.02), "torque": (0.01, 0.00, 2.68)},
}
"""Set -> median, 25th and 75th percentile of the force and torque ratios: Table 5."""

SECONDS: Mapping[str, Mapping[str, tuple[float, float, float]]] = {
    "seen": {
        "cvae": (0.95, 0.94, 0.97),
        "ik": (13.02, 6.64, 18.88),
        "bilevel": (1.99, 0.85, 2.90),
        "total": (14.99, 9.04, 23.60),
    },
    "familiar": {
        "cvae": (0.95, 0.93, 0.97),
        "ik": (10.91, 3.91, 21.52),
        "bilevel": (0.78, 0.50, 2.25),
        "total": (13.73, 5.49, 31.68),
    },
    "novel": {
        "cvae": (0.95, 0.93, 0.97),
        "ik": (8.07, 1.47, 20.55),
        "bilevel": (2.61, 1.05, 5.35),
        "total": (14.40, 5.59, 34.85),
    },
    "overall": {
        "cvae": (0.95, 0.93, 0.97),
        "ik": (9.81, 2.16, 20.07),
        "bilevel": (2.22, 0.82, 4.03),
        "total": (14.40, 5.67, 34.71),
    },
}
"""Set -> stage -> median, 25th and 75th percentile of seconds: Table 6."""
