"""The completion network: what it learns from, and its training.

    python scripts/train_unseen.py views VIEWS.npz --first 5000 --objects 2000
    python scripts/train_unseen.py train VIEWS.npz assets/weights/unseen.safetensors

Views are objects of random shape, each seen by one camera, beside the whole hull: features (N, 391) and what is missing
to the support of the seen side (N, 361), cm, each once as it is and once mirrored. Two thirds of the objects are
`varied-N`, the rest convex shapes of random points; no object of the catalogue and no scan is among them. `--varied 0`
leaves out the builders that the catalogue's objects come from. Every twentieth object is held out. Training minimises
|error| / spread + log spread, so that the spread becomes the mean absolute error that the network expects of itself.
"""

import itertools
import json
import sys
from collections.abc import Iterator
from typing import Annotated

import mujoco
import numpy as np
import torch
import trimesh
from crowded_clouds import bare_table
from numpy.random import Generator
from safetensors.torch import save_file
from torch import Tensor, nn
from tqdm import tqdm

from dexgrasp.cli.command import Argument, File, Script
from dexgrasp.cli.commands import run_script
from dexgrasp.geometry.completion_network import LOG_SPREAD, OUTPUT
from dexgrasp.geometry.visible_side import UNIT, WRITTEN, VisibleSide
from dexgrasp_env.arrays import Array
from dexgrasp_env.objects.load import load_target
from dexgrasp_env.perception.pipeline import segment
from dexgrasp_env.perception.plane import Plane
from dexgrasp_env.perception.scene import Scene
from dexgrasp_env.poses import about_z
from dexgrasp_env.robot.camera import Camera
from dexgrasp_env.robot.cell import default_cell
from dexgrasp_env.sensing.raycast import RayCameras
from dexgrasp_env.sensing.sensor import SensorModel
from dexgrasp_env.valid import Count, Natural, number

_BATCH, _RATE, _DECAY, _NOISE = 256, 1.5e-3, 1e-2, 0.03  # noise in standard deviations of the features
_CELL = 0.7  # share of the cell's cameras among the cameras
_POSES, _CAMERAS = 6, 2  # of an object; of a pose
_MIRROR = np.array([1.0, -1.0, 1.0])


def random_shape(rng: Generator) -> trimesh.Trimesh:
    """Return a convex shape of 3 to 20 cm: polytope, superellipsoid, tapered prism, or the hull of two bodies."""
    kind = rng.integers(4)
    size = np.exp(rng.uniform(np.log([0.03, 0.03, 0.03]), np.log([0.1, 0.13, 0.2])))
    if kind == 0:
        points = rng.standard_normal((rng.integers(8, 40), 3))
        points *= size / 2.0 / np.linalg.norm(points, axis=1, keepdims=True) ** rng.uniform(0.5, 1.0)
    elif kind == 1:
        points, power = rng.standard_normal((500, 3)), rng.uniform(1.5, 6.0)
        points *= size / 2.0 / (np.abs(points) ** power).sum(1, keepdims=True) ** (1.0 / power)
    elif kind == 2:
        angle, taper = np.sort(rng.uniform(0.0, 2.0 * np.pi, rng.integers(3, 9))), rng.uniform(0.3, 1.0)
        base = np.stack([np.cos(angle), np.sin(angle), np.zeros(len(angle))], axis=1) * size / 2.0
        points = np.concatenate([base, base * taper + [0.0, 0.0, size[2]]])
    else:
        ball = rng.standard_normal((200, 3))
        ball /= np.linalg.norm(ball, ord=np.inf if rng.random() < 0.5 else 2, axis=1, keepdims=True)
        other = ball * size / 2.0 * rng.uniform(0.3, 1.0, 3) + size * rng.uniform(-0.5, 0.5, 3)
        points = np.concatenate([ball * size / 2.0, other])
    return trimesh.convex.convex_hull(points)


def shape_of(number: int, varied: float, rng: Generator) -> trimesh.Trimesh:
    """Return the surface of object `number`, m; with a chance of `varied` it is `varied-N`."""
    return load_target(f"varied-{number}").mesh if rng.random() < varied else random_shape(rng)


def views_of(mesh: trimesh.Trimesh, rng: Generator) -> Iterator[tuple[Scene, Array]]:
    """Yield clouds of one camera each, and the corners (V, 3) m of the whole hull, of an object at rest."""
    transforms, odds = trimesh.poses.compute_stable_poses(mesh.convex_hull, n_samples=1)
    model = _scene(mesh)
    data, sensor = mujoco.MjData(model), SensorModel.realistic()
    for _ in range(_POSES):
        chosen = transforms[rng.choice(len(odds), p=odds / odds.sum())]
        R = _yaw(rng) @ chosen[:3, :3]
        hull = mesh.convex_hull.vertices @ R.T
        middle = 0.5 * (hull.min(0) + hull.max(0))
        shift = np.array([rng.uniform(0.44, 0.60), rng.uniform(-0.12, 0.12), 0.0])
        shift -= [*middle[:2], hull[:, 2].min()]
        data.qpos[:3] = shift
        mujoco.mju_mat2Quat(data.qpos[3:7], R.ravel())
        mujoco.mj_kinematics(model, data)
        cameras = _cameras(rng)
        believed = sensor.calibrate(cameras, rng)
        depths = sensor.measure(RayCameras(model, cameras).render(data), cameras, rng)
        for k in range(len(cameras)):
            yield segment(depths[k : k + 1], believed[k : k + 1], rng), hull + shift


def example(scene: Scene, hull: Array, mirror: bool) -> tuple[Array, Array]:
    """Return features (391,) and what the support of the seen side lacks (361,), in units of `OUTPUT`."""
    side = _MIRROR if mirror else np.ones(3)
    assert scene.plane is not None
    plane = Plane(scene.plane.normal * side, scene.plane.offset, scene.plane.rms, 0)
    view = VisibleSide.of(scene.target.points * side, scene.target.normals * side, plane)
    whole = (((hull * side - view.origin) @ view.R.T / UNIT) @ WRITTEN.T).max(0)
    return view.features(), (whole - view.seen()) * UNIT / OUTPUT


def _scene(mesh: trimesh.Trimesh) -> mujoco.MjModel:
    spec = bare_table()
    spec.add_mesh(
        name="shape",
        uservert=mesh.vertices.ravel(),
        userface=mesh.faces.ravel(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )
    body = spec.worldbody.add_body(name="object")
    body.add_freejoint()
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="shape")
    return spec.compile()


def _yaw(rng: Generator) -> Array:
    return about_z(rng.uniform(0.0, 2.0 * np.pi))


def _cameras(rng: Generator) -> tuple[Camera, ...]:
    """Two of the cell's cameras, or two from anywhere above the table."""
    if rng.random() < _CELL:
        return tuple(default_cell().make_cameras()[k] for k in rng.permutation(4)[:_CAMERAS])
    found = []
    for _ in range(_CAMERAS):
        azimuth, elevation = rng.uniform(-np.pi, np.pi), np.radians(rng.uniform(22.0, 55.0))
        level = np.cos(elevation)
        way = np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])
        centre = np.array([0.52, 0.0, 0.05])
        found.append(Camera.look_at("anywhere", centre + rng.uniform(0.5, 0.9) * way, centre))
    return tuple(found)


def losses(answer: Tensor, missing: Tensor) -> tuple[Tensor, Tensor]:
    """Return the loss and the mean absolute error, cm."""
    more, log_spread = answer.chunk(2, 1)
    log_spread = log_spread.clamp(*LOG_SPREAD)
    error = (more - missing).abs()
    return (error * torch.exp(-log_spread) + log_spread).mean(), error.mean()


def train(x: Tensor, y: Tensor, held_out: Tensor, hidden: int, epochs: int) -> nn.Sequential:
    """Return the network that was trained on rows of x (N, 391), y (N, 361) that are not `held_out` (N,)."""
    sizes = [x.shape[1], hidden, hidden, hidden, 2 * y.shape[1]]
    layers = [m for a, b in itertools.pairwise(sizes) for m in (nn.Linear(a, b), nn.ReLU())]
    network = nn.Sequential(*layers[:-1])
    rows = torch.where(~held_out)[0]
    optimiser = torch.optim.AdamW(network.parameters(), weight_decay=_DECAY)
    steps = epochs * (len(rows) // _BATCH)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, _RATE, total_steps=steps)
    for epoch in range(epochs):
        for batch in rows[torch.randperm(len(rows))].split(_BATCH)[: len(rows) // _BATCH]:
            loss, _ = losses(network(x[batch] + _NOISE * torch.randn_like(x[batch])), y[batch])
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            schedule.step()
        with torch.no_grad():
            loss, error = losses(network(x[held_out]), y[held_out])
        print(f"epoch {epoch + 1}: held out loss {loss:.3f}, error {10 * error:.2f} mm", flush=True)
    return network


class Views(Script):
    """Write the examples of some objects.

    Attributes:
        varied: share of `varied-N`.
    """

    out: Argument[File]
    first: Natural = 5000
    objects: Count = 2000
    varied: Annotated[float, number(ge=0, le=1)] = 0.65

    def run(self) -> int:
        rows = []
        for k in tqdm(range(self.first, self.first + self.objects)):
            rng = np.random.default_rng([k, 77])
            for cloud, hull in views_of(shape_of(k, self.varied, rng), rng):
                if cloud.reason is None:
                    rows += [(*example(cloud, hull, mirror), k) for mirror in (False, True)]
        features, missing, objects = (np.array(column) for column in zip(*rows, strict=True))
        np.savez(
            self.out,
            features=features.astype(np.float32),
            missing=missing.astype(np.float32),
            objects=objects,
        )
        return 0


class Train(Script):
    """Train, and write the weights."""

    views: Argument[File]
    out: Argument[File]
    hidden: Count = 384
    epochs: Count = 16
    seed: Natural = 0

    def run(self) -> int:
        torch.manual_seed(self.seed)
        file = np.load(self.views)
        x, y = torch.tensor(file["features"]), torch.tensor(file["missing"])
        held_out = torch.tensor(file["objects"] % 20 == 0)
        mean, scale = x[~held_out].mean(0), x[~held_out].std(0) + 1e-3
        network = train((x - mean) / scale, y, held_out, self.hidden, self.epochs)
        arrays = {f"network.{key}": value for key, value in network.state_dict().items()}
        note = {"schema": 1, "epochs": self.epochs, "seed": self.seed, "views": len(x)}
        save_file({"mean": mean, "scale": scale} | arrays, self.out, {"dexgrasp": json.dumps(note)})
        return 0


if __name__ == "__main__":
    sys.exit(run_script({"views": Views, "train": Train}))
