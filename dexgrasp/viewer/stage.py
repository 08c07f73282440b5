"""A film on a viser server: meshes of robot, table and object, what was seen, and the grasp's contacts."""

from typing import TYPE_CHECKING, Any

import numpy as np

from dexgrasp.viewer.film import Film, robot_model
from dexgrasp_env.arrays import Array
from dexgrasp_env.poses import matrix_to_quat
from dexgrasp_env.scene.constants import TABLE_CENTRE_X, TABLE_SIZE

if TYPE_CHECKING:
    import viser

_COLOURS = ((214, 84, 60), (58, 120, 190), (60, 150, 90), (143, 90, 168), (184, 134, 11))  # of the contacts
_TABLE = (168, 140, 106)
_OBJECT, _HULL, _CLOUD = (222, 168, 84), (90, 90, 110), (40, 40, 60)
_FORCE_SCALE = 0.008  # m a newton
_CONE = 0.03  # m, height of the cones that are drawn


class Stage:
    """One film in a scene, at an offset so that several stand side by side."""

    def __init__(self, server: "viser.ViserServer", film: Film, name: str = "", offset: float = 0.0) -> None:
        """Draw everything at the film's first state.

        Args:
            server: where to draw.
            film: what.
            name: prefix of the nodes, for several films on one server.
            offset: m along y.
        """
        self.film, self._scene, self._root = film, server.scene, f"/{name or 'grasp'}"
        self._model, self._data = robot_model(film.cell)
        self._scene.add_frame(self._root, show_axes=False, position=(0.0, offset, 0.0))
        self._bodies = self._add_robot()
        self._object = self._add_object()
        self._add_table()
        self._add_seen()
        self._add_contacts()
        self.show(0)

    def show(self, index: int) -> None:
        """Put robot and object into one state of the film."""
        import mujoco

        self._data.qpos[:] = self.film.states[index]
        mujoco.mj_kinematics(self._model, self._data)
        for body, handle in self._bodies.items():
            handle.position, handle.wxyz = tuple(self._data.xpos[body]), tuple(self._data.xquat[body])
        T = self.film.object_poses[index]
        self._object.position, self._object.wxyz = tuple(T[:3, 3]), tuple(matrix_to_quat(T[:3, :3]))

    def _add_robot(self) -> dict[int, Any]:
        """Add every body with a shape to show; returns the handles by body."""
        handles: dict[int, Any] = {}
        for body in range(1, self._model.nbody):
            parts = [g for g in range(self._model.ngeom) if self._is_shown(g, body)]
            if parts:
                path = f"{self._root}/robot/{self._model.body(body).name}"
                handles[body] = self._scene.add_frame(path, show_axes=False)
                for geom in parts:
                    self._add_geom(f"{path}/{geom}", geom)
        return handles

    def _is_shown(self, geom: int, body: int) -> bool:
        return bool(self._model.geom_bodyid[geom] == body and self._model.geom_group[geom] == 2)

    def _add_geom(self, path: str, geom: int) -> None:
        from dexgrasp_env.scene.shapes import geom_mesh

        mesh = geom_mesh(self._model, geom)
        if mesh is None:
            return
        material = int(self._model.geom_matid[geom])
        rgba = self._model.mat_rgba[material] if material >= 0 else self._model.geom_rgba[geom]
        colour = (255.0 * rgba[:3]).astype(np.uint8)
        self._scene.add_mesh_simple(
            path, mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32), color=colour,
            position=tuple(self._model.geom_pos[geom]), wxyz=tuple(self._model.geom_quat[geom]),
        )  # fmt: skip

    def _add_object(self) -> Any:
        path, T = f"{self._root}/object", self.film.object_poses[0]
        frame = self._scene.add_frame(path, show_axes=False)
        if self.film.object is not None:
            mesh = self.film.object.mesh
            vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
        else:
            mesh = _parts_mesh(self.film.parts)
            vertices, faces = (np.asarray(mesh.vertices) - T[:3, 3]) @ T[:3, :3], np.asarray(mesh.faces)
        self._scene.add_mesh_simple(
            f"{path}/surface",
            vertices.astype(np.float32),
            faces.astype(np.uint32),
            color=_OBJECT,
            flat_shading=True,
        )
        return frame

    def _add_table(self) -> None:
        x, y, z = TABLE_SIZE
        self._scene.add_box(
            f"{self._root}/table",
            dimensions=(x, y, z),
            color=_TABLE,
            position=(TABLE_CENTRE_X, 0.0, -0.5 * z - 0.001),
        )

    def _add_seen(self) -> None:
        seen = _parts_mesh(self.film.parts)
        self._scene.add_mesh_simple(
            f"{self._root}/hull planned on", np.asarray(seen.vertices, np.float32), np.asarray(seen.faces, np.uint32),
            color=_HULL, wireframe=True, visible=self.film.object is not None,
        )  # fmt: skip
        if len(self.film.cloud):
            colours = np.tile(np.array(_CLOUD, np.uint8), (len(self.film.cloud), 1))
            self._scene.add_point_cloud(
                f"{self._root}/cloud", self.film.cloud.astype(np.float32), colours, point_size=0.002
            )

    def _add_contacts(self) -> None:
        film = self.film
        # In the object's frame, so that they move with it.
        T = np.linalg.inv(film.object_poses[0])
        points, turned = film.contacts @ T[:3, :3].T + T[:3, 3], T[:3, :3].T
        normals, forces = film.normals @ turned, film.forces @ turned
        for k, (finger, colour) in enumerate(zip(film.fingers, _COLOURS, strict=False)):
            path = f"{self._root}/object/contacts/{finger}"
            tip = points[k] - _FORCE_SCALE * forces[k]
            segment = np.array([[tip, points[k]]], np.float32)
            self._scene.add_line_segments(
                f"{path}/force", segment, np.array(colour), thickness=0.004, thickness_units="world"
            )
            rays = _cone_rays(points[k], normals[k], film.friction)
            self._scene.add_line_segments(
                f"{path}/cone",
                rays.astype(np.float32),
                np.array(colour),
                thickness=0.001,
                thickness_units="world",
            )
            self._scene.add_icosphere(f"{path}/point", radius=0.004, color=colour, position=tuple(points[k]))


def _parts_mesh(parts: tuple[Array, ...]) -> Any:
    import trimesh

    return trimesh.util.concatenate([trimesh.convex.convex_hull(points) for points in parts])


def _cone_rays(contact: Array, normal: Array, friction: float, count: int = 24) -> Array:
    """Segments (2 count, 2, 3) of a friction cone drawn outside of the object: its rays and its rim."""
    from dexgrasp.physics.cones import tangent_basis

    t1, t2 = (t[0] for t in tangent_basis(normal[None]))
    angle = 2.0 * np.pi * np.arange(count) / count
    ring = contact + _CONE * (normal + friction * (np.cos(angle)[:, None] * t1 + np.sin(angle)[:, None] * t2))
    rays = np.stack([np.repeat(contact[None], count, axis=0), ring], axis=1)
    return np.concatenate([rays[::3], np.stack([ring, np.roll(ring, -1, axis=0)], axis=1)])
