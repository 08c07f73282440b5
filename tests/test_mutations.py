"""No field of a grasp file can be changed unseen."""

import numpy as np
import pytest
from refusals import rejected
from tampering import FREE, changes, is_accepted

from dexgrasp.agents.bilevel import BilevelAgent
from dexgrasp.grasp.file import record_of
from dexgrasp.planning.scene_setup import look_at


@pytest.fixture(scope="module")
def content():
    agent = BilevelAgent()
    look = look_at("pear", agent)
    look.env.close()
    found = agent.plan(look.observation, look.info)
    return found.as_json(look.subject.identity, "bilevel", look.subject.pose)["grasp"]


def test_the_file_as_planned_is_verified(content):
    assert rejected(record_of(content)) == []


def test_every_field_is_checked_or_free(content):
    changed = {path[0] for path, _ in changes(content, np.random.default_rng(0))}
    without = {name for name, value in content.items() if value in (None, [])}  # no leaf to change
    assert without == {"neighbours", "table"}
    assert content.keys() == changed | without | FREE & content.keys()


def test_a_sample_of_changes_is_refused(content):
    rng = np.random.default_rng(0)
    found = list(changes(content, rng))
    chosen = [found[k] for k in rng.choice(len(found), 8, replace=False)]
    certificate = [change for change in found if change[0][0] == "certificate"][::8]
    assert [change for change in (*chosen, *certificate) if is_accepted(content, *change)] == []
