"""What a user does wrong is told in one line, and what the judge of a grasp refuses by name."""

from contextlib import contextmanager

import pytest

from dexgrasp_env.errors import InputError


@contextmanager
def refused(words=""):
    """Expect an `InputError` of one line in which `words`, a regular expression, is found; give what was caught."""
    with pytest.raises(InputError, match=words or None) as caught:
        yield caught
    assert "\n" not in str(caught.value)


def rejected(record, *parts):
    """Return the names of the checks that a grasp fails, of all or of some parts of the judge."""
    from dexgrasp.grasp.verify.verify import verify  # what a test does not ask for is not imported

    return [check.name for check in verify(record, *parts) if not check.holds]
