"""Batches of grasps for training: splits that share no contact triple, augmentation, draws by seed and step."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dexgrasp.data.dataset.dataset import PoseGrasps
from dexgrasp.learning.cvae.settings import TrainingSettings
from dexgrasp.planning.decoder import CROPPED, SCALE, centre_of
from dexgrasp_env.arrays import Array, Index, Mask, Single, unit
from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.poses import about_z, quat_to_matrix


@dataclass(frozen=True, eq=False)
class PoseSplit:
    """Grasps of one rest pose in one split, in the rest frame.

    Attributes:
        cloud: (N, 6) points, m, and normals.
        tips: (n, g, 3) m, contacts of the first two or three fingers of a grasp.
        palm: (n, 3) m, positions.
        rotation: (n, 3, 3) of the palm.
    """

    cloud: Array
    tips: Array
    palm: Array
    rotation: Array

    def __len__(self) -> int:
        """Return the number of grasps."""
        return len(self.tips)


class Batch(NamedTuple):
    """Arrays in network units: clouds (C, N, 6), grasps (C, G, 3 g + 9), latent noise (C, G, latent); float32."""

    cloud: Single
    grasp: Single
    noise: Single


def split(poses: list[PoseGrasps], settings: TrainingSettings) -> dict[str, list[PoseSplit]]:
    """Split a dataset; only grasps that bear some load (`load` >= 0) are used.

    The rest pose of an object that is held out is the last but one.

    Raises:
        InputError: for an unknown object, or a split without grasps to train or to test on.
    """
    objects = list(dict.fromkeys(p.name for p in poses))
    if settings.held_out_object not in (None, *objects):
        raise unknown_name("held-out object", settings.held_out_object, objects)
    names = ("train", "test", "held_out_poses", "held_out_object")
    out: dict[str, list[PoseSplit]] = {name: [] for name in names}
    for pose in poses:
        of_object = [p.pose for p in poses if p.name == pose.name]
        good = pose.grasps["load"] >= 0
        if pose.name == settings.held_out_object:
            out["held_out_object"].append(_take(pose, good))
        elif settings.held_out_poses and len(of_object) > 2 and pose.pose == sorted(of_object)[-2]:
            out["held_out_poses"].append(_take(pose, good))
        else:
            test = _tested(pose, settings.seed)
            out["train"].append(_take(pose, good & ~test))
            out["test"].append(_take(pose, good & test))
    out = {name: [p for p in parts if len(p)] for name, parts in out.items()}
    if not out["train"] or not out["test"]:
        raise InputError("the dataset has too few grasps that hold to train and test on: generate more")
    return out


def _tested(pose: PoseGrasps, seed: int) -> Mask:
    """Return a mask of the grasps in the test split: those of 5 % of the triples, in any order of fingers."""
    unique, inverse = np.unique(np.sort(pose.grasps["triple"], axis=1), axis=0, return_inverse=True)
    return (np.random.default_rng([seed, pose.pose]).random(len(unique)) < 0.05)[inverse.ravel()]


def _take(pose: PoseGrasps, mask: Mask) -> PoseSplit:
    g, cloud = pose.grasps, pose.scene["cloud"].astype(float)
    return PoseSplit(
        cloud[cloud[:, 2] > CROPPED], g["contacts"][mask][:, :3].astype(float), g["palm_position"][mask].astype(float),
        quat_to_matrix(g["palm_quat_wxyz"][mask].astype(float)),
    )  # fmt: skip


def training_batch(poses: list[PoseSplit], step: int, settings: TrainingSettings) -> Batch:
    """Return the batch of a step, which depends on seed and step only."""
    rng = np.random.default_rng([settings.seed, 7, step])
    root = np.sqrt([len(p) for p in poses])  # rare rest poses count more than their share
    chosen = rng.choice(len(poses), settings.clouds, p=root / root.sum())
    made = [_augmented(poses[k], rng, settings.grasps, settings.network.points) for k in chosen]
    return _batch(made, rng.standard_normal((settings.clouds, settings.grasps, settings.network.latent)))


def test_batches(poses: list[PoseSplit], settings: TrainingSettings) -> list[Batch]:
    """Return a batch for each rest pose, of at most 128 grasps, with a fixed random yaw and no other augmentation."""
    batches = []
    for k, pose in enumerate(poses):
        rng = np.random.default_rng([settings.seed, 11, k])
        at = rng.permutation(len(pose))[:128]
        chosen = rng.permutation(len(pose.cloud))[: settings.network.points]
        made = _made(pose, at, chosen, about_z(rng.uniform(-np.pi, np.pi)), np.ones(3))
        batches.append(_batch([made], np.zeros((1, len(at), settings.network.latent))))
    return batches


def _augmented(pose: PoseSplit, rng: np.random.Generator, grasps: int, points: int) -> tuple[Array, Array]:
    """Augment: yaw, scaling by up to 12 % an axis, resampling, occlusion of one side, noise of points and normals."""
    at = rng.integers(len(pose), size=grasps)
    stretch = rng.uniform(0.88, 1.12, 3)
    keep = _visible(pose.cloud, rng)
    chosen = rng.choice(keep, points, replace=len(keep) < points)
    cloud, grasp = _made(pose, at, chosen, about_z(rng.uniform(-np.pi, np.pi)), stretch)
    cloud[:, :3] += SCALE * rng.uniform(0.0, 0.0015) * rng.standard_normal((points, 3))
    cloud[:, 3:] += rng.uniform(0.0, 0.1) * rng.standard_normal((points, 3))
    return cloud, grasp


def _visible(cloud: Array, rng: np.random.Generator) -> Index:
    """Return indices of visible points: in half of the cases up to a quarter, on one side, is left out."""
    if rng.random() < 0.5:
        return np.arange(len(cloud))
    direction = about_z(rng.uniform(-np.pi, np.pi))[0]
    order = np.argsort(cloud[:, :3] @ direction, kind="stable")
    return order[: int(len(cloud) * rng.uniform(0.75, 1.0))]


def _made(pose: PoseSplit, at: Index, chosen: Index, R: Array, stretch: Array) -> tuple[Array, Array]:
    points = (pose.cloud[chosen, :3] * stretch) @ R.T
    normals = unit(pose.cloud[chosen, 3:] / stretch) @ R.T
    centre = centre_of(points)
    tips = (pose.tips[at] * stretch) @ R.T - centre
    # The palm keeps its distance to the fingertips: the hand does not stretch.
    palm = (pose.palm[at] + pose.tips[at].mean(1) * (stretch - 1.0)) @ R.T - centre
    rotation = R @ pose.rotation[at]
    grasp = np.concatenate(
        [SCALE * tips.reshape(len(at), -1), SCALE * palm, rotation[:, :, 0], rotation[:, :, 1]], axis=1
    )
    return np.concatenate([SCALE * (points - centre), normals], axis=1), grasp


def _batch(made: list[tuple[Array, Array]], noise: Array) -> Batch:
    arrays = (*map(np.stack, zip(*made, strict=True)), noise)
    return Batch(*(array.astype(np.float32) for array in arrays))
