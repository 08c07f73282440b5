"""Off-screen pictures: which GL is taken, what is drawn, what is said where there is none."""

import os
import subprocess
import sys
import textwrap
from pathlib import Path

import gymnasium as gym
import mujoco
import numpy as np
import pytest
from gymnasium.wrappers import RecordVideo
from gymnasium.wrappers.vector import RecordVideo as VectorRecordVideo
from processes import python
from refusals import refused
from tables import table

from dexgrasp_env import rendering
from dexgrasp_env.rendering import choose_gl, make_renderer, render, show_camera
from dexgrasp_env.robot.cell import default_cell

ROOT = Path(__file__).resolve().parents[1]
NEEDS_GL = pytest.mark.skipif(choose_gl() is None, reason="no GL library here")
SCENE = """
<mujoco>
  <worldbody>
    <light pos="0 0 2"/>
    <camera name="above" pos="0.36 0 1.5" xyaxes="1 0 0 0 1 0"/>
    <geom type="sphere" size="0.12" pos="0.36 0 0.24" rgba="1 0 0 1" group="{group}"/>
  </worldbody>
</mujoco>
"""


def scene(group=2):
    model = mujoco.MjModel.from_xml_string(SCENE.format(group=group))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


@pytest.mark.parametrize(("present", "expected"), table("libraries_of_gl"))
def test_the_first_library_that_is_there(present, expected, monkeypatch):
    def load(library):
        if library not in present:
            raise OSError(library)

    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(rendering.ctypes, "CDLL", load)
    assert choose_gl() == expected


def test_without_gl_the_remedy_is_named(monkeypatch):
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(rendering, "_loads", lambda *libraries: False)
    with refused("install libosmesa6"):
        make_renderer(scene()[0], 32, 32)


@NEEDS_GL
def test_draws_what_is_there():
    model, data = scene()
    renderer = make_renderer(model, 96, 128)
    picture = render(renderer, data, show_camera())
    assert picture.shape == (96, 128, 3)
    assert picture.dtype == np.uint8
    red = (picture[..., 0] > 60) & (picture[..., 1] < 40)
    assert 0.01 < red.mean() < 0.5
    rows, columns = np.nonzero(red)
    assert abs(rows.mean() - 48) < 8  # the camera looks at the ball
    assert abs(columns.mean() - 64) < 8
    np.testing.assert_array_equal(picture, render(renderer, data, show_camera()))
    assert ((above := render(renderer, data, "above"))[..., 0] > 60).any()
    assert not np.array_equal(above, picture)
    renderer.close()


@NEEDS_GL
def test_cameras_for_people_and_their_size():
    settings = {"objects": "sugar_box", "render_mode": "rgb_array", "render_size": [60, 80]}
    env = gym.make("DexGrasp/Lift-v2", render_camera="grasp", **settings)
    env.reset(seed=0)
    assert env.render().shape == (60, 80, 3)
    for _ in range(8):
        env.step(np.full(23, 1.0))
    camera = show_camera("grasp", env.unwrapped.data, default_cell().robot)
    assert np.linalg.norm(camera.lookat - env.unwrapped.data.site("palm").xpos) < 0.15  # it follows
    env.close()
    with refused("side_left"):
        gym.make("DexGrasp/Lift-v2", render_camera="top")
    for size in ((0, 80), "640x480", (64,), (60.0, 80.0)):
        with refused("rows and columns"):
            gym.make("DexGrasp/Lift-v2", render_size=size)


@NEEDS_GL
def test_gymnasiums_videos_are_written(tmp_path):
    pytest.importorskip("moviepy")
    settings = table("videos")
    for folder, env in (
        ("one", RecordVideo(gym.make("DexGrasp/Lift-v2", **settings), str(tmp_path / "one"))),
        (
            "many",
            VectorRecordVideo(
                gym.make_vec("DexGrasp/Lift-v2", num_envs=2, **settings), str(tmp_path / "many")
            ),
        ),
    ):
        env.reset(seed=0)
        for _ in range(5):
            env.step(env.action_space.sample())
        env.close()
        films = list((tmp_path / folder).glob("*.mp4"))
        assert films
        assert min(film.stat().st_size for film in films) > 500


@NEEDS_GL
def test_nothing_is_said_at_exit():
    """Renderers that are still open are closed before EGL is."""
    code = textwrap.dedent("""
        import gymnasium as gym, dexgrasp_env
        settings = [{"render_mode": "rgb_array", "render_size": (32, 32)}, {"obs_mode": "rgbd", "observe": "reset"}]
        envs = [gym.make("DexGrasp/Lift-v2", objects="sugar_box", **each) for each in settings]
        for env in envs:
            env.reset(seed=0)
        envs[0].render()
    """)
    done = subprocess.run([sys.executable, "-W", "ignore", "-c", code], capture_output=True, text=True)
    assert done.returncode == 0
    assert done.stderr == ""


@NEEDS_GL
def test_the_picture_of_a_state_does_not_depend_on_what_was_drawn_before():
    env = gym.make("DexGrasp/Lift-v2", objects="soda", render_mode="rgb_array")
    env.reset(seed=3)
    first = env.render()
    other = env.unwrapped.get_state()
    env.step(env.action_space.sample())
    env.render()
    env.unwrapped.set_state(other)
    assert np.array_equal(first, env.render())
    env.close()


@NEEDS_GL
def test_threads_that_draw_first_at_once_get_the_same_picture():
    code = """
        import sys, threading
        import mujoco, numpy as np
        from dexgrasp_env.rendering import make_renderer, render, show_camera
        pictures, together = [], threading.Barrier(3)
        def draw():
            model = mujoco.MjModel.from_xml_string(sys.argv[1])
            data = mujoco.MjData(model)
            mujoco.mj_forward(model, data)
            together.wait()
            pictures.append(render(make_renderer(model, 48, 64), data, show_camera()).copy())
        threads = [threading.Thread(target=draw) for _ in range(3)]
        for thread in threads: thread.start()
        for thread in threads: thread.join()
        print(len(pictures), *(np.array_equal(one, pictures[0]) for one in pictures), pictures[0].std() > 5)
    """
    env = {key: value for key, value in os.environ.items() if key not in ("MUJOCO_GL", "PYOPENGL_PLATFORM")}
    assert python(code, SCENE.format(group=2), env=env) == "3 True True True True\n"


ASYNC = """
import sys
import gymnasium as gym, dexgrasp_env
if __name__ == "__main__":
    env = gym.make("DexGrasp/Lift-v2", objects="soda", render_mode="rgb_array", render_size=(32, 32))
    env.reset(seed=0)
    env.render()
    made = {"vectorization_mode": "async", "vector_kwargs": {"context": sys.argv[1]}, "num_envs": 1}
    envs = gym.make_vec("DexGrasp/Lift-v2", objects="soda", obs_mode="rgbd", observe="reset", views=1, **made)
    try:
        print("drawn", envs.reset(seed=0)[0]["rgb"].std() > 5)
    except dexgrasp_env.InputError as error:
        print("refused", "context='spawn'" in str(error))
    envs.close(terminate=True)
"""


@NEEDS_GL
@pytest.mark.parametrize(
    ("context", "said"),
    [
        ("fork", "refused True"),
        pytest.param("forkserver", "drawn True", marks=pytest.mark.slow),
        pytest.param("spawn", "drawn True", marks=pytest.mark.slow),
    ],
)
def test_workers_draw_or_say_why_not_after_a_picture(context, said, tmp_path):
    script = tmp_path / "script.py"
    script.write_text(ASYNC)
    done = subprocess.run(
        [sys.executable, script, context],
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert said in done.stdout, done.stderr


def test_the_library_of_triton_is_loaded_before_a_gl(monkeypatch, tmp_path):
    """Two LLVMs in a process: the other way around learners crash after a picture."""
    library = tmp_path / "triton" / "_C" / "libtriton.cpython.so"
    library.parent.mkdir(parents=True)
    library.touch()
    (tmp_path / "triton" / "__init__.py").write_text("raise RuntimeError('it takes a second')")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "triton", raising=False)
    order = []

    def load(path):
        order.append(path)
        if path == str(library):
            raise OSError("no library")

    def use(backend):
        order.append(backend)
        raise RuntimeError("no GL")

    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    monkeypatch.setattr(rendering.ctypes, "CDLL", load)
    monkeypatch.setattr(rendering, "_use", use)
    rendering._load_triton.cache_clear()
    with refused("no GL"):
        make_renderer(mujoco.MjModel.from_xml_string("<mujoco/>"), 16, 16)
    assert order == [str(library), "osmesa"]
    rendering._load_triton.cache_clear()
