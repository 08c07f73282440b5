"""Settings of the CVAE's training, without torch."""

from dataclasses import dataclass, field
from typing import Annotated

from dexgrasp.planning.decoder import NetworkSettings
from dexgrasp_env.valid import Count, Natural, Positive, Share


@dataclass(frozen=True)
class TrainingSettings:
    """Settings of the CVAE's training.

    Attributes:
        epochs: of 50 steps each.
        seed: of weights, batches and splits.
        clouds: a step.
        grasps: on each cloud.
        learning_rate: of Adam at first; constant for the first half, then down to 2 % in a straight line.
        kl_weight: of the KL term; reached after `kl_warm_up` of the steps.
        kl_warm_up: share of the steps.
        wrench_layer: add the residual of Eq. 4 at the decoded contacts, differentiated by an OptNet layer, to the loss.
        wrench_weight: of that residual.
        held_out_object: an object that is tested on and not trained on.
        held_out_poses: whether a rest pose of every other object is kept apart.
        threads: of torch on the CPU; the last bits depend on it.
        network: sizes.
    """

    epochs: Count = 150
    seed: Natural = 0
    clouds: Count = 8
    grasps: Count = 128
    learning_rate: Positive = 1e-3
    kl_weight: Annotated[Positive, "W"] = 0.05
    kl_warm_up: Share = 0.2
    wrench_layer: bool = False
    wrench_weight: Positive = 0.1
    held_out_object: Annotated[str | None, "NAME"] = None
    held_out_poses: bool = True
    threads: Count = 1
    network: NetworkSettings = field(default_factory=NetworkSettings)
