"""One model for scenes of many objects, as physics on a GPU wants it: what differs between them are numbers.

The body of the object has as many geoms of each kind as any object has parts of that kind; a world fills those that its
object needs, and its meshes are chosen by number.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.objects.model import ObjectModel
from dexgrasp_env.objects.parts import ContactPart
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.scene.build import scene_spec

_ABSENT = -1  # for a mesh
_SPECK, _AWAY = 1e-5, 1000.0  # m: a geom that is not used is so small, and so far from its body
_GEOM_FIELDS = ("geom_dataid", "geom_size", "geom_pos", "geom_quat", "geom_aabb", "geom_rbound")
_SHARED_FIELDS = (
    "body_mass", "body_inertia", "body_iquat", "body_invweight0", "body_subtreemass", "dof_invweight0",
    "actuator_gainprm", "actuator_biasprm",
)  # fmt: skip


class _Places(NamedTuple):
    """Of an object's parts: geoms of its own scene, slots of the merged one, and meshes there."""

    geoms: NDArray[np.int64]
    slots: NDArray[np.int64]
    meshes: NDArray[np.int64]


class MergedScene:
    """The scenes of several objects in one model.

    Attributes:
        model: compiled; it has the layout of each single scene in all but the geoms, of which it has no visual ones.
        first_slot: the first geom of the object; all of them follow it.
    """

    def __init__(self, objects: Sequence[ObjectModel], cell: Cell) -> None:
        self._numbers = {model: number for number, model in enumerate(objects)}
        self._places: dict[ObjectModel, _Places] = {}
        kinds = sorted({part.kind for model in objects for part in model.parts})
        slots = tuple(part for kind in kinds for part in self._examples(kind))
        self._firsts = {kind: [part.kind for part in slots].index(kind) for kind in kinds}
        first = objects[0]
        example = ObjectModel("objects", first.solid, slots, first.mass, first.inertia)
        self.model = _compile(example, objects, cell)
        self.first_slot = int(self.model.geom("object_0").id)
        self._slots = slice(self.first_slot, self.first_slot + len(slots))
        self._contact = (self.model.geom_contype | self.model.geom_conaffinity) > 0

    def _examples(self, kind: str) -> list[ContactPart]:
        """Return as many parts of a kind as an object has at most: those of one that has so many."""
        every = [[part for part in model.parts if part.kind == kind] for model in self._numbers]
        return max(every, key=len)

    def fields(self, model: ObjectModel, scene: mujoco.MjModel) -> dict[str, NDArray[Any]]:
        """Return what a world of one object has of its own, by the names of the model's fields.

        Those of which `first_column` is not 0 are of the object's geoms alone.

        Args:
            model: the object.
            scene: its own scene, compiled, with a variation in it. Its meshes are as large as they were.
        """
        merged = self.model
        friction = float(scene.pair_friction[0, 0])
        geom_friction, pair_friction = merged.geom_friction.copy(), merged.pair_friction.copy()
        geom_friction[self._contact, 0] = friction
        pair_friction[:, :2] = friction
        return {
            **self._fill(model, scene),
            "geom_friction": geom_friction,
            "pair_friction": pair_friction,
            **{name: getattr(scene, name) for name in _SHARED_FIELDS},
        }

    def first_column(self, field: str) -> int:
        """Return where in a row of a field, flattened, the values of `fields` begin."""
        if field not in _GEOM_FIELDS:
            return 0
        values = getattr(self.model, field)
        return self.first_slot * (values.size // len(values))

    def _fill(self, model: ObjectModel, scene: mujoco.MjModel) -> dict[str, NDArray[Any]]:
        places = self._places.get(model) or self._find(model, scene)
        self._places[model] = places
        filled: dict[str, NDArray[Any]] = {}
        for name in _GEOM_FIELDS:
            filled[name] = self._unused(name)
            filled[name][places.slots] = getattr(scene, name)[places.geoms]
        filled["geom_dataid"][places.slots] = places.meshes
        return filled

    def _find(self, model: ObjectModel, scene: mujoco.MjModel) -> "_Places":
        number, firsts = self._numbers[model], dict(self._firsts)
        slots, meshes = [], []
        for k, part in enumerate(model.parts):
            slots.append(firsts[part.kind])
            firsts[part.kind] += 1
            mesh = part.kind == "mesh"
            meshes.append(self.model.mesh(_mesh_name(number, k)).id if mesh else _ABSENT)
        geoms = [scene.geom(f"object_{k}").id for k in range(len(model.parts))]
        return _Places(np.array(geoms), np.array(slots), np.array(meshes))

    def _unused(self, name: str) -> NDArray[Any]:
        values: NDArray[Any] = getattr(self.model, name)[self._slots].copy()
        if name == "geom_dataid":
            values[:] = _ABSENT
        elif name == "geom_pos":
            values[:] = [0.0, 0.0, _AWAY]
        elif name == "geom_aabb":
            values[:] = [0.0, 0.0, 0.0, _SPECK, _SPECK, _SPECK]
        elif name != "geom_quat":
            values[:] = _SPECK
        return values


def _compile(example: ObjectModel, objects: Sequence[ObjectModel], cell: Cell) -> mujoco.MjModel:
    spec = scene_spec(example, cell)
    spec.add_exclude(
        bodyname1="world", bodyname2="object"
    )  # what falls to the floor is lost before it gets there
    for geom in list(spec.geoms):
        if not (geom.contype or geom.conaffinity):
            spec.delete(geom)
    for number, model in enumerate(objects):
        for k, part in enumerate(model.parts):
            if part.kind == "mesh":
                vertices = np.asarray(part.vertices, dtype=np.float32).ravel()
                spec.add_mesh(name=_mesh_name(number, k), uservert=vertices)
    return spec.compile()


def _mesh_name(number: int, part: int) -> str:
    return f"part_{number}_{part}"
