"""One model for scenes of many objects, as physics on a GPU wants it: what differs between them are numbers.

The bodies of the object and of its neighbours have as many geoms of each kind as any object has parts of that kind; a
world fills those that its objects need, and their meshes are chosen by number.
"""

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.arrays import Arrays, Index
from dexgrasp_env.locales import with_decimal_points
from dexgrasp_env.objects.model import ObjectModel
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.scene.build import pair_friction, scene_spec

_ABSENT = -1  # for a mesh
_SPECK, _AWAY = 1e-5, 1000.0  # m: a geom that is not used is so small, and so far from its body
_UNUSED = {
    "geom_dataid": _ABSENT, "geom_size": _SPECK, "geom_pos": [0.0, 0.0, _AWAY], "geom_quat": [1.0, 0.0, 0.0, 0.0],
    "geom_aabb": [0.0, 0.0, 0.0, _SPECK, _SPECK, _SPECK], "geom_rbound": _SPECK,
}  # fmt: skip
"""What is written of the geoms of objects, and what of those that are not used."""
_SHARED_FIELDS = (
    "body_mass", "body_inertia", "body_iquat", "body_invweight0", "body_subtreemass", "dof_invweight0",
    "actuator_gainprm", "actuator_biasprm",
)  # fmt: skip


class MergedScene:
    """The scenes of several objects in one model.

    Attributes:
        model: compiled; it has the layout of each single scene in all but the geoms, of which it has no visual ones,
            and the neighbours that a scene has not, which start far away.
        first_slot: the first geom of the object; all of them, and those of neighbours, follow it.
    """

    def __init__(
        self,
        objects: Sequence[ObjectModel],
        cell: Cell,
        around: Sequence[ObjectModel] = (),
        neighbours: int = 0,
        furniture: str = "",
    ) -> None:
        """Compile the model.

        Args:
            objects: that may be picked up.
            cell: the robot and where it stands.
            around: what neighbours may be.
            neighbours: room for so many.
            furniture: see `scene_spec`.
        """
        every = list({model.contact_hash: model for model in (*objects, *around)}.values())
        kinds = sorted({part.kind for model in every for part in model.parts})
        # Of each kind as many parts as an object has at most: those of one that has so many.
        slots = tuple(
            part
            for kind in kinds
            for part in max(([p for p in model.parts if p.kind == kind] for model in every), key=len)
        )
        self._firsts = {kind: [part.kind for part in slots].index(kind) for kind in kinds}
        first = objects[0]
        example = ObjectModel("objects", first.solid, slots, first.mass, first.inertia)
        self.model = _compile([example] * (1 + neighbours), every, cell, furniture)
        self.first_slot = int(self.model.geom("object_0").id)
        self._each = len(slots)
        self._contact = (self.model.geom_contype | self.model.geom_conaffinity) > 0
        # Objects that are loaded again are others, but of the same parts.
        self._places = {model.contact_hash: self._find(number, model) for number, model in enumerate(every)}

    def fields(self, objects: Sequence[ObjectModel], scene: mujoco.MjModel) -> Arrays:
        """Return what a world has of its own, by the names of the model's fields.

        Those of which `first_column` is not 0 are of the geoms of objects alone.

        Args:
            objects: the object and its neighbours.
            scene: their own scene, compiled, with a variation in it. Its meshes are as large as they were.
        """
        merged = self.model
        friction = float(scene.pair_friction[0, 0])
        geom_friction = merged.geom_friction.copy()
        geom_friction[self._contact, 0] = friction
        return {
            **self._fill(objects, scene),
            "geom_friction": geom_friction,
            "pair_friction": pair_friction(merged, friction),
            **{name: filled(getattr(merged, name), getattr(scene, name)) for name in _SHARED_FIELDS},
        }

    def first_column(self, field: str) -> int:
        """Return where in a row of a field, flattened, the values of `fields` begin."""
        if field not in _UNUSED:
            return 0
        return self.first_slot * getattr(self.model, field)[0].size

    def _fill(self, objects: Sequence[ObjectModel], scene: mujoco.MjModel) -> Arrays:
        written = {
            name: np.full_like(getattr(self.model, name)[self.first_slot :], value)
            for name, value in _UNUSED.items()
        }
        for k, model in enumerate(objects):
            body = f"neighbour_{k - 1}" if k else "object"
            slots, meshes = self._places[model.contact_hash]
            geoms = [scene.geom(f"{body}_{part}").id for part in range(len(slots))]
            for name, values in written.items():
                values[slots + k * self._each] = getattr(scene, name)[geoms]
            written["geom_dataid"][slots + k * self._each] = meshes
        return written

    def _find(self, number: int, model: ObjectModel) -> tuple[Index, Index]:
        """Return the slots of a body that an object's parts take, and their meshes."""
        firsts, slots, meshes = dict(self._firsts), [], []
        for k, part in enumerate(model.parts):
            slots.append(firsts[part.kind])
            firsts[part.kind] += 1
            meshes.append(self.model.mesh(_mesh_name(number, k)).id if part.kind == "mesh" else _ABSENT)
        return np.array(slots), np.array(meshes)


def filled(whole: NDArray[Any], part: NDArray[Any]) -> NDArray[Any]:
    """Return the numbers of a scene, (n, ...), and after them those of what it has not got, as `whole` has them."""
    return np.concatenate([part, whole[len(part) :]])


def _compile(
    examples: Sequence[ObjectModel], objects: Sequence[ObjectModel], cell: Cell, furniture: str
) -> mujoco.MjModel:
    spec = scene_spec(examples[0], cell, neighbours=examples[1:], furniture=furniture)
    bodies = [spec.body("object"), *(spec.body(f"neighbour_{k}") for k in range(len(examples) - 1))]
    for k, body in enumerate(bodies):
        # What falls to the floor is lost before it gets there.
        spec.add_exclude(bodyname1="world", bodyname2=body.name)
        body.pos = [k * _AWAY, 0.0, _AWAY]
    for geom in list(spec.geoms):
        if not (geom.contype or geom.conaffinity):
            spec.delete(geom)
    for number, model in enumerate(objects):
        for k, part in enumerate(model.parts):
            if part.kind == "mesh":
                vertices = np.asarray(part.vertices, dtype=np.float32).ravel()
                spec.add_mesh(name=_mesh_name(number, k), uservert=vertices)
    return with_decimal_points(spec.compile)


def _mesh_name(number: int, part: int) -> str:
    return f"part_{number}_{part}"
