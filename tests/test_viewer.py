"""The viewer's playback and page."""

import numpy as np
import pytest
from robots import CELL

from dexgrasp.grasp.file import record_of
from dexgrasp.viewer.playback import palm_poses, playback_of


@pytest.fixture(scope="module")
def playback(contents):
    return playback_of(record_of(contents["pear"] | {"agent": "a.b:<Firm>"}), np.zeros((4, 3)))


def test_the_object_rests_until_it_is_lifted_and_then_follows_the_palm(playback):
    poses, first = (
        playback.object_poses,
        len(playback.states) - len(playback.record.script.phases[1].setpoints),
    )
    assert np.array_equal(poses[first - 1], poses[0])
    in_palm = np.linalg.inv(palm_poses(playback.states, CELL)) @ poses
    assert np.abs(in_palm[-1] - in_palm[first]).max() < 1e-12
    assert poses[-1, 2, 3] - poses[0, 2, 3] == pytest.approx(0.14, abs=0.01)


def test_the_page_is_whole_and_fetches_nothing(playback):
    pytest.importorskip("viser")
    from dexgrasp.viewer.page import page

    text = page([playback, playback])
    assert text.count("a.b:&lt;Firm&gt;") == 2
    assert "__VISER_EMBED_DATA__" in text
    assert 'src="http' not in text
    assert 'href="http' not in text
