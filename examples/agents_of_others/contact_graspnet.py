"""Contact-GraspNet, from its package with weights, as an agent of the suite.

    python -m pip install torch-geometric==2.6.1 meshcat importlib-resources
    python -m pip install --no-deps cgn-pytorch
    dexgrasp evaluate --agents examples.agents_of_others.contact_graspnet:ContactGraspNet --robot panda_gripper \
        --objects all20 --trials 1

Sundermeyer, Mousavian, Triebel and Fox (2021), "Contact-GraspNet", in S. Peralta's PyTorch package `cgn-pytorch` 0.4.3
(MIT, by its metadata; the original is under NVIDIA's source code licence for research). `--no-deps` as its pins are
older than what dexgrasp needs; `torch-cluster`, which is to be compiled, is used where it is installed, else
`neighbours`. With `--seed 57001` it holds 11 of 20 [34, 74]; how much table it is shown was chosen on scenes of three
of the objects. In an environment of its own: `dexgrasp serve --agent` with the name above there, and `evaluate --agents
ws://127.0.0.1:8000` here.
"""

import importlib.util
import sys
from collections.abc import Iterator

import numpy as np
import torch

from dexgrasp.motion.to_pose import Pinch

from . import neighbours
from .two_pads import Pads, TwoPadAgent

if importlib.util.find_spec("torch_cluster") is None:
    sys.modules["torch_cluster"] = neighbours
from cgn_pytorch import from_pretrained, inference

DEPTH = 0.1034  # m from the network's frame to the middle between the pads


class ContactGraspNet(TwoPadAgent):
    """Asks the network for grasps of the object and the table beside it, and takes the surest."""

    def __init__(self) -> None:
        """Load the network."""
        self._network = from_pretrained(device="cpu")[0]

    def seed(self, seed: int) -> None:
        """Seed the network's choice of points."""
        torch.manual_seed(seed)

    def grasps(
        self, points: np.ndarray, normals: np.ndarray, plane: np.ndarray, pinch: Pinch
    ) -> Iterator[Pads]:
        """Yield the network's grasps, surest first, centred on what lies between the pads; both turns of the hand."""
        scene = np.concatenate([points, table_around(points, plane)])
        centre = scene.mean(0)
        poses, sure, _ = inference(
            self._network,
            scene - centre,
            0.1,
            gripper_depth=DEPTH,
            obj_mask=np.arange(len(scene)) < len(points),
        )
        for k in () if poses is None else np.argsort(-sure)[:40]:
            R, origin = poses[k, :3, :3].astype(float), poses[k, :3, 3] + centre
            x, y, z = ((points - origin) @ R).T
            between = x[(abs(x) < 0.05) & (abs(y) < 0.01) & (abs(z - DEPTH) < 0.012)]  # m
            if len(between) == 0 or (width := float(np.ptp(between))) > pinch.widest:
                continue
            middle = origin + R @ [0.5 * (between.min() + between.max()), 0.0, DEPTH]
            for along in (R[:, 0], -R[:, 0]):
                yield Pads(middle, R[:, 2], along, width)


def table_around(points: np.ndarray, plane: np.ndarray) -> np.ndarray:
    """Return points (M, 3) m of the table beside an object, 7 mm apart, as far as 15 cm from its middle."""
    steps = np.arange(-0.15, 0.15, 0.007)
    x, y = np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2).T + points[:, :2].mean(0)[:, None]
    table = np.stack([x, y, (plane[3] - plane[0] * x - plane[1] * y) / plane[2]], axis=1)
    beside = np.linalg.norm(table[:, None, :2] - points[None, ::2, :2], axis=-1).min(1) > 0.005  # m
    return table[beside]
