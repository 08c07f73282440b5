"""A playback on a viser server: meshes of robot, table and object, what was seen, and the grasp's contacts."""

from typing import TYPE_CHECKING, Any

import numpy as np

from dexgrasp.mechanics.cones import cone_edges
from dexgrasp.viewer.playback import GraspPlayback
from dexgrasp_env.poses import matrix_to_quat
from dexgrasp_env.robot.hulls import colour_of
from dexgrasp_env.robot.model import compiled_robot
from dexgrasp_env.scene.constants import TABLE_CENTRE_X, TABLE_SIZE

if TYPE_CHECKING:
    import viser

_COLOURS = ((214, 84, 60), (58, 120, 190), (60, 150, 90), (143, 90, 168), (184, 134, 11))  # of the contacts


class ViserScene:
    """One playback in a scene, at an offset so that several stand side by side."""

    def __init__(
        self, server: "viser.ViserServer", playback: GraspPlayback, name: str, offset: float
    ) -> None:
        """Draw everything at the playback's first state.

        Args:
            server: where to draw.
            playback: what.
            name: of the playback's nodes.
            offset: m along y.
        """
        import mujoco

        self.playback, self._scene, self._root = playback, server.scene, f"/{name}"
        self._model = compiled_robot(playback.record.here)
        self._data = mujoco.MjData(self._model)
        self._scene.add_frame(self._root, show_axes=False, position=(0.0, offset, 0.0))
        self._bodies = self._add_robot()
        self._object = self._scene.add_frame(f"{self._root}/object", show_axes=False)
        table = (TABLE_CENTRE_X, 0.0, -0.5 * TABLE_SIZE[2] - 0.001)
        self._scene.add_box(
            f"{self._root}/table", dimensions=TABLE_SIZE, color=(168, 140, 106), position=table
        )
        self._add_seen()
        self._add_contacts()
        self.show(0)

    def show(self, index: int) -> None:
        """Put robot and object into one state of the playback; its last stays."""
        import mujoco

        index = min(index, len(self.playback.states) - 1)
        self._data.qpos[:] = self.playback.states[index]
        mujoco.mj_kinematics(self._model, self._data)
        for body, handle in self._bodies.items():
            handle.position, handle.wxyz = self._data.xpos[body].copy(), self._data.xquat[body].copy()
        T = self.playback.object_poses[index]
        self._object.position, self._object.wxyz = T[:3, 3], matrix_to_quat(T[:3, :3])

    def _add_robot(self) -> dict[int, Any]:
        """Add every body with a shape to show; returns the handles by body."""
        from dexgrasp_env.scene.geom_mesh import geom_mesh

        handles, model = dict[int, Any](), self._model
        for geom in np.flatnonzero(model.geom_group == 2).tolist():  # group of the geoms that are shown
            mesh, body = geom_mesh(model, geom), int(model.geom_bodyid[geom])
            if mesh is not None:
                path = f"{self._root}/robot/{model.body(body).name}"
                if body not in handles:
                    handles[body] = self._scene.add_frame(path, show_axes=False)
                self._mesh(
                    f"{path}/{geom}", mesh, (255.0 * colour_of(model, geom)[:3]).astype(np.uint8),
                    position=model.geom_pos[geom], wxyz=model.geom_quat[geom],
                )  # fmt: skip
        return handles

    def _mesh(self, path: str, mesh: Any, colour: Any, **more: Any) -> None:
        self._scene.add_mesh_simple(path, mesh.vertices, mesh.faces, color=colour, **more)

    def _add_seen(self) -> None:
        """The object, or in its place what was planned on; that as a wire frame; neighbours; the cloud."""
        import trimesh

        playback, T = self.playback, self.playback.object_poses[0]
        seen = trimesh.util.concatenate([trimesh.convex.convex_hull(part) for part in playback.record.parts])
        shape = (
            seen.copy().apply_transform(np.linalg.inv(T)) if playback.object is None else playback.object.mesh
        )
        self._mesh(f"{self._root}/object/surface", shape, (222, 168, 84), flat_shading=True)
        self._mesh(
            f"{self._root}/hull planned on",
            seen,
            (90, 90, 110),
            wireframe=True,
            visible=playback.object is not None,
        )
        for k, part in enumerate(playback.record.neighbour_parts):
            self._mesh(f"{self._root}/neighbours/{k}", trimesh.convex.convex_hull(part), (150, 150, 150))
        if playback.cloud is not None:
            self._scene.add_point_cloud(f"{self._root}/cloud", playback.cloud, (40, 40, 60), point_size=0.002)

    def _add_contacts(self) -> None:
        """Contacts, forces, rays and rim of cones that open outside; in the object's frame, to move with it."""
        record, T = self.playback.record, np.linalg.inv(self.playback.object_poses[0])
        path = f"{self._root}/object/contacts"
        self._scene.add_frame(path, show_axes=False, position=T[:3, 3], wxyz=matrix_to_quat(T[:3, :3]))
        for contact, colour in zip(record.contacts, _COLOURS, strict=False):
            own, point = f"{path}/{contact.finger}", contact.point
            force = np.stack([point - 0.008 * contact.force, point])[None]  # m a newton
            self._scene.add_line_segments(f"{own}/force", force, colour, thickness=0.004)
            rim = point - 0.03 * cone_edges(contact.normal[None], record.thresholds.friction, 24)[0]  # m
            rays = np.stack([np.broadcast_to(point, rim.shape), rim], axis=1)[::3]
            rays = np.concatenate([rays, np.stack([rim, np.roll(rim, -1, axis=0)], axis=1)])
            self._scene.add_line_segments(f"{own}/cone", rays, colour, thickness=0.001)
            self._scene.add_icosphere(f"{own}/point", radius=0.004, color=colour, position=point)
