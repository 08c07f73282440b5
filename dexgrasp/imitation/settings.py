"""How a policy is cloned."""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class CloneNetwork:
    """Sizes of the network.

    Attributes:
        hidden: width of the layers.
        layers: hidden layers.
        local: width of the points' features.
        cloud: width of the cloud's feature.
        chunk: set-points predicted, one a control step.
    """

    hidden: int = 512
    layers: int = 3
    local: int = 64
    cloud: int = 128
    chunk: int = 8


@dataclass(frozen=True)
class BcSettings:
    """How a policy is cloned.

    Attributes:
        view: `state`, or `cloud`: joints and one look at a cloud.
        epochs: of 200 steps each.
        seed: of weights and batches.
        episodes: a batch is drawn from.
        rows: control steps drawn of each of them.
        rate: of Adam at first; it goes down by a cosine.
        execute: control steps of a chunk that are carried out before the policy looks again.
        held_out: share of the demonstrations that the loss is tested on.
        threads: of torch on the CPU; results differ in the last bits with it.
        network: sizes.
    """

    view: str = "state"
    epochs: int = 20
    seed: int = 0
    episodes: int = 64
    rows: int = 16
    rate: float = 1e-3
    execute: int = 4
    held_out: float = 0.05
    threads: int = 1
    network: CloneNetwork = field(default_factory=CloneNetwork)
