"""How the CVAE is trained; no torch is needed to say it."""

from dataclasses import dataclass, field

from dexgrasp.planning.decoder import NetworkSettings


@dataclass(frozen=True)
class TrainingSettings:
    """How the CVAE is trained.

    Attributes:
        epochs: of 50 steps each.
        seed: of weights, batches and splits.
        clouds: a step.
        grasps: on each cloud.
        rate: of Adam at first; constant for the first half, then down to 2 % in a straight line.
        kl_weight: reached after `warm_up` of the steps.
        warm_up: share of the steps.
        held_out_object: kept apart, None for none.
        held_out_poses: whether a rest pose of every other object is kept apart.
        threads: of torch on the CPU; results differ in the last bits with it.
        network: sizes.
    """

    epochs: int = 150
    seed: int = 0
    clouds: int = 8
    grasps: int = 128
    rate: float = 1e-3
    kl_weight: float = 0.05
    warm_up: float = 0.2
    held_out_object: str | None = None
    held_out_poses: bool = True
    threads: int = 1
    network: NetworkSettings = field(default_factory=NetworkSettings)
