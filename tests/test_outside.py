"""Sets of objects that nobody built for the planner: `outside-1000`, a kitchen, folders of meshes."""

import hashlib
import io
import json

import pytest
import trimesh
from project_scripts import load_script

from dexgrasp.cli.commands import run_script
from dexgrasp_env.objects.sets import read_set

object_sets = load_script("object_sets")
HASHES = json.loads(object_sets.HASHES.read_text())


@pytest.mark.parametrize("number", [0, 1, 2, 3, 4, 5, 502, 507, 999])
def test_a_shape_is_the_frozen_one_and_a_closed_solid(number):
    solid, kind, mass = object_sets.shape(number)
    content = object_sets.solid_obj(solid)
    assert hashlib.sha256(content).hexdigest()[:16] == HASHES[f"outside-{number:04d}"], kind
    mesh = trimesh.load(io.BytesIO(content), file_type="obj", process=False)
    assert mesh.is_watertight
    assert mesh.volume > 0.0
    assert 0.022 - 1e-4 <= mesh.extents.min() <= mesh.extents.max() <= 0.13 + 1e-4
    assert 0.02 <= mass <= 0.5


def test_what_lies_in_a_kitchen_is_frozen(tmp_path):
    assert run_script(object_sets.Kitchen, [str(tmp_path)]) == 0
    flat, handled, wide = (read_set(str(tmp_path / f"{kind}.json")) for kind in object_sets.KITCHEN)
    assert (len(flat), len(handled), len(wide)) == (19, 8, 10)
    for member in (*flat.values(), *handled.values(), *wide.values()):
        assert trimesh.load(member.mesh, process=False).is_watertight, member.name
