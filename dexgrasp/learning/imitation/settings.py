"""Settings of behaviour cloning."""

from dataclasses import dataclass, field
from typing import Annotated

from dexgrasp_env.errors import InputError
from dexgrasp_env.valid import Count, Natural, Positive, Share, check_fields, one_of


@dataclass(frozen=True)
class BcNetSizes:
    """Sizes of the network of a policy from the state.

    Attributes:
        hidden: width of the network's layers.
        layers: hidden layers.
        chunk: set-points predicted, one a control step.
    """

    hidden: Count = 512
    layers: Count = 3
    chunk: Count = 8


@dataclass(frozen=True)
class GraspNetSizes:
    """Sizes of the network of a policy from clouds.

    Attributes:
        local: width of the points' features.
        cloud: width of the cloud's feature.
        width: of the layers after it.
        depth: how many they are.
        modes: ways to take hold along one grip, at most.
    """

    local: Count = 64
    cloud: Count = 128
    width: Count = 256
    depth: Count = 2
    modes: Count = 3


@dataclass(frozen=True)
class BcSettings:
    """Settings of behaviour cloning.

    Attributes:
        view: `state`, which is answered by the next set-points; or `cloud`: one look, answered by a grasp.
        epochs: of 200 steps each.
        seed: of weights and batches.
        episodes: a batch is drawn from.
        rows: control steps drawn of each of them (`state`).
        grips: all around an object, among which the one that was taken is to be told (`cloud`).
        learning_rate: of Adam at first; it goes down by a cosine.
        execute: control steps of a chunk that are carried out before the policy looks again (`state`).
        held_out: share of the demonstrations that the loss is tested on.
        threads: of torch on the CPU; the last bits depend on it.
        network: sizes (`state`).
        grasps: sizes (`cloud`).
    """

    view: Annotated[str, one_of(("state", "cloud"))] = "state"
    epochs: Count = 20
    seed: Natural = 0
    episodes: Count = 64
    rows: Count = 16
    grips: Count = 8
    learning_rate: Positive = 1e-3
    execute: Count = 4
    held_out: Share = 0.05
    threads: Count = 1
    network: BcNetSizes = field(default_factory=BcNetSizes)
    grasps: GraspNetSizes = field(default_factory=GraspNetSizes)

    def __post_init__(self) -> None:
        """Validate the fields and their combinations.

        Raises:
            InputError: for a value that is not valid, if more of a chunk is executed than is predicted, or settings of
                the other view are given.
        """
        check_fields(self)
        if self.view != "state" and (self.execute, self.network) != (4, BcNetSizes()):
            raise InputError(
                "hidden, chunk and execute change nothing here: valid is view state, or leave them out"
            )
        if self.execute > self.network.chunk:
            raise InputError(f"execute is {self.execute}: valid are 1 to {self.network.chunk}, the chunk")


def view_of(obs_mode: str) -> str:
    """Return the key of `bc_training.VIEWS` for an observation mode.

    Raises:
        InputError: for a mode that nothing is cloned from.
    """
    views = {"state": "state", "pointcloud": "cloud"}
    if obs_mode not in views:
        raise InputError(
            f"policies are cloned from state or pointcloud, not from {obs_mode!r}: choose another"
        )
    return views[obs_mode]
