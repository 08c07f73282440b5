"""What a user does wrong is told in one line."""

from contextlib import contextmanager

import pytest

from dexgrasp_env.errors import InputError


@contextmanager
def refused(words=""):
    """Expect an `InputError` of one line in which `words`, a regular expression, is found; give what was caught."""
    with pytest.raises(InputError, match=words) as caught:
        yield caught
    assert "\n" not in str(caught.value)
