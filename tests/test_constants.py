"""The page of settings against its classes: every field has a default or is asked for, and a meaning."""

import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "docs" / "_extensions"))
from from_code import BLOCK, settings_of, settings_table  # noqa: E402

PAGE = (ROOT / "docs" / "constants.md").read_text()
CLASSES = [block["names"].strip() for block in BLOCK.finditer(PAGE) if block["kind"] == "settings"]


def test_the_page_has_the_planner_the_sensor_and_every_training():
    names = {name.partition(":")[2] for name in CLASSES}
    assert {"PlannerSettings", "SensorModel", "TrainingSettings", "BcSettings", "RlSettings"} <= names
    assert len(CLASSES) == len(names)
    assert "?" not in PAGE


@pytest.mark.parametrize("name", CLASSES)
def test_every_setting_has_a_meaning(name):
    rows = settings_of(name)
    assert rows
    assert [field for field, (_, meaning) in rows.items() if len(meaning) < 6 or "?" in meaning] == []


def test_the_table_has_the_defaults_of_the_class_and_of_what_it_inherits():
    from dexgrasp.planning.settings import PlannerSettings

    table = settings_table("dexgrasp.planning.settings:PlannerSettings")
    found = dict(re.findall(r"^\| `(\w+)` \| `(.*?)` \|", table, re.MULTILINE))
    assert {"closure_margin", "closure_aim", "firm_load"} <= found.keys()
    assert {name: str(getattr(PlannerSettings(), name)) for name in found} == found
