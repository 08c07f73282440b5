"""No field of a grasp file can be changed unseen: a short run of `scripts/judge.py`."""

import numpy as np
import pytest
from project_scripts import load_script

from dexgrasp.agents.bilevel import BilevelAgent
from dexgrasp.grasp.file import record_of
from dexgrasp.grasp.verify.verify import verify
from dexgrasp.planning.scene_setup import look_at


@pytest.fixture(scope="module")
def script():
    return load_script("judge")


@pytest.fixture(scope="module")
def content():
    agent = BilevelAgent()
    look = look_at("pear", agent)
    look.env.close()
    found = agent.plan(look.observation, look.info)
    return found.as_json(look.subject.identity, "bilevel", look.subject.pose)["grasp"]


def test_the_file_as_planned_is_verified(content):
    assert [check.name for check in verify(record_of(content)) if not check.holds] == []


def test_every_field_is_checked_or_free(content, script):
    changed = {m.path[0] for m in script.mutations(content, 1, np.random.default_rng(0))}
    without = {name for name, value in content.items() if value in (None, [])}  # no leaf to change
    assert without == {"neighbours", "table"}
    unknown = {name for name in content if name not in changed | without | set(script.FREE)}
    assert unknown == set()


def test_a_sample_of_changes_is_refused(content, script):
    rng = np.random.default_rng(0)
    found = [m for m in script.mutations(content, 1, rng) if script.matters(m)]
    chosen = [found[k] for k in rng.choice(len(found), 12, replace=False)]
    assert [m for m in chosen if script.is_accepted(content, m)] == []
