"""A program's locale changes no number: Qt sets the user's, whose decimal sign may be a comma."""

import locale
import shutil
import subprocess

import pytest
import trimesh

from dexgrasp_env.robot.rebuilt import Description


@pytest.fixture
def french(tmp_path, monkeypatch):
    """Set a locale with decimal commas for the time of a test."""
    made = shutil.which("localedef") and subprocess.run(
        ["localedef", "-i", "fr_FR", "-f", "UTF-8", str(tmp_path / "fr_FR.UTF-8")], capture_output=True
    )
    monkeypatch.setenv("LOCPATH", str(tmp_path))
    before = locale.setlocale(locale.LC_ALL)
    try:
        locale.setlocale(locale.LC_ALL, "fr_FR.UTF-8")
    except locale.Error:
        pytest.skip(f"no French locale can be made here: {made}")
    yield
    locale.setlocale(locale.LC_ALL, before)


def test_meshes_of_a_hand_are_as_large_where_commas_are_decimal(french, tmp_path):
    trimesh.creation.box((0.02, 0.03, 0.05)).export(tmp_path / "palm.obj")
    (tmp_path / "hand.xml").write_text(
        "<mujoco><asset><mesh name='palm' file='palm.obj'/></asset>"
        "<worldbody><geom type='mesh' mesh='palm'/></worldbody></mujoco>"
    )
    model = Description(tmp_path / "hand.xml").model
    assert sorted(model.geom_aabb[0, 3:]) == pytest.approx([0.01, 0.015, 0.025])
    assert locale.localeconv()["decimal_point"] == ","
