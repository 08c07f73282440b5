"""What is not needed is not imported: where it is not installed, and where it takes seconds."""

import os

import pytest
from processes import python

EPISODE = """
import gymnasium, dexgrasp_env
env = gymnasium.make("DexGrasp/Lift-v2", objects="sugar_box")
env.reset(seed=0)
env.step(env.action_space.sample())
"""


@pytest.mark.parametrize(
    ("code", "unneeded"),
    [
        ("import dexgrasp_env", "torch numba OpenGL glfw mujoco"),
        ("import dexgrasp_env.__main__", "dexgrasp"),
        ("import dexgrasp_env.sensing.perception, dexgrasp_env.perception.picture",
         "numba torch OpenGL mujoco matplotlib"),
        (EPISODE, "torch OpenGL"),
        ("import dexgrasp; dexgrasp.make_agent", "torch numba"),
        ("from dexgrasp.mechanics import closure, internal_force, margin, ratios, wrench", "torch"),
        ("import dexgrasp.agents.learned", "torch"),
        ("from dexgrasp.cli.main import main; main(['--help'])", "mujoco numba torch trimesh scipy"),
        ("from dexgrasp.cli.main import main; assert main(['plan', 'soda']) == 0",
         "torch trimesh matplotlib OpenGL glfw"),
    ],
)  # fmt: skip
def test_what_is_not_needed_is_not_imported(code, unneeded):
    # MuJoCo itself imports OpenGL where MUJOCO_GL is set, as tests that render set it.
    clean = {key: value for key, value in os.environ.items() if key not in ("MUJOCO_GL", "PYOPENGL_PLATFORM")}
    if "'plan'" in code:
        python(code, env=clean)  # shapes that are not in the cache yet are made with trimesh
    said = python(code + "\nimport sys; print(*sys.modules)", env=clean)
    assert set(unneeded.split()) & set(said.splitlines()[-1].split()) == set()
