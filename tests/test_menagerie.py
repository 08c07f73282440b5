"""The choice of the robot's looks: names are checked, and what cannot be shown says so."""

import mujoco
import pytest

from dexgrasp_env.errors import InputError
from dexgrasp_env.robot import menagerie
from dexgrasp_env.robot.model import robot_spec


def test_primitives_are_the_default():
    assert robot_spec(visuals="primitives").to_xml() == robot_spec().to_xml()


def test_unknown_visuals():
    with pytest.raises(InputError, match=r"visuals 'photo'.*primitives, menagerie"):
        robot_spec(visuals="photo")


def test_an_absent_package_is_named_with_its_remedy(monkeypatch):
    monkeypatch.setattr(menagerie, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"pip install mujoco-menagerie.*'primitives'") as error:
        robot_spec(visuals="menagerie")
    assert "\n" not in str(error.value)


def test_a_present_package_is_not_asked_for_again(monkeypatch):
    monkeypatch.setattr(menagerie, "find_spec", lambda name: mujoco.__spec__)
    with pytest.raises(InputError, match=r"is installed, but .*'primitives'") as error:
        robot_spec(visuals="menagerie")
    assert "pip install" not in str(error.value)
