"""One model for scenes of many objects: what a world has of its own is what its own scene has."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from robots import CELL

from dexgrasp_env.objects.load import load_object
from dexgrasp_env.robot.cell import make_cell
from dexgrasp_env.scene.merged import MergedScene
from dexgrasp_env.tasks.randomisation import Variation
from dexgrasp_env.tasks.simulation import Simulation


def test_objects_that_are_loaded_again_are_known():
    first = load_object("varied-4")
    merged = MergedScene([load_object("sugar_box"), first], CELL)
    again = replace(first, name="again")  # as members of set files are, and whatever a cache has let go
    written = [merged.fields(model, Simulation(model, CELL).model) for model in (first, again)]
    for name, values in written[0].items():
        assert_array_equal(values, written[1][name], err_msg=name)
    meshes = sum(part.kind == "mesh" for part in first.parts)
    assert (written[0]["geom_dataid"][merged.model.geom("object_0").id :] >= 0).sum() == meshes > 0


@pytest.mark.parametrize("robot", ["panda_gripper", None])
def test_pairs_have_the_friction_that_is_drawn(robot):
    model, cell = load_object("sugar_box"), make_cell(robot)
    merged, scene = MergedScene([model], cell), Simulation(model, cell)
    for friction in (0.35, 0.7, 1.2):
        scene.vary(Variation(friction=friction))
        written = merged.fields(model, scene.model)["pair_friction"]
        assert_allclose(np.unique(written, axis=0), np.unique(scene.model.pair_friction, axis=0))
