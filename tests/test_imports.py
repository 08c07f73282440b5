"""What is not needed is not imported: where it is not installed, and where it takes seconds."""

import os

import pytest
from processes import python
from tables import table


@pytest.mark.parametrize(("code", "unneeded"), table("imports"))
def test_what_is_not_needed_is_not_imported(code, unneeded):
    # MuJoCo itself imports OpenGL where MUJOCO_GL is set, as tests that render set it.
    clean = {key: value for key, value in os.environ.items() if key not in ("MUJOCO_GL", "PYOPENGL_PLATFORM")}
    if "'plan'" in code:
        python(code, env=clean)  # shapes that are not in the cache yet are made with trimesh
    said = python(code + "\nimport sys; print(*sys.modules)", env=clean)
    assert set(unneeded.split()) & set(said.splitlines()[-1].split()) == set()
