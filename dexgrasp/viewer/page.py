"""Playbacks of grasps as one self-contained page, or on a live server with a slider."""

import contextlib
import io
import sys
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import jinja2

from dexgrasp.viewer.playback import GraspPlayback
from dexgrasp.viewer.viser_scene import ViserScene
from dexgrasp_env.extras import require_extra
from dexgrasp_env.scene.constants import CONTROL_PERIOD

if TYPE_CHECKING:
    import viser

_FACTS = """
<div id="facts" style="position:fixed;right:12px;top:12px;z-index:10;max-width:340px;max-height:80vh;overflow:auto;
padding:8px 12px;background:rgba(255,255,255,.88);border-radius:8px;font:13px/1.5 system-ui,sans-serif;color:#222">
{% for playback in playbacks %}<details open><summary>{{ playback.title }}</summary><table>
{% for name, value in playback.facts.items() %}<tr><td>{{ name }}</td><td>{{ value }}</td></tr>{% endfor %}
</table></details>{% endfor %}
</div>
"""
"""The certificates as a panel over the scene."""


def page(playbacks: Sequence[GraspPlayback]) -> str:
    """Return one page that plays the playbacks side by side, with a slider; nothing is fetched."""
    server = start_server(port=0, quiet=True)
    try:
        scenes, count = _side_by_side(server, playbacks)
        recording = server.get_scene_serializer()
        every = -(-count // 90)  # states of a playback that a page holds at most
        for index in range(0, count, every):
            for scene in scenes:
                scene.show(index)
            recording.insert_sleep(every * CONTROL_PERIOD)
        text = str(recording.as_html())
    finally:
        with contextlib.redirect_stdout(io.StringIO()):
            server.stop()
    facts = jinja2.Template(_FACTS, autoescape=True).render(playbacks=playbacks)
    return text.replace("</body>", facts + "</body>", 1)


def serve(playbacks: Sequence[GraspPlayback], port: int) -> None:
    """Show the playbacks on a local server until interrupted: a slider for the time, the certificates beside it."""
    server = start_server(port=port, quiet=False)
    scenes, count = _side_by_side(server, playbacks)
    slider: Any = server.gui.add_slider("step", min=0, max=count - 1, step=1, initial_value=0)
    playing = server.gui.add_checkbox("play", initial_value=True)
    for playback in playbacks:
        with server.gui.add_folder(playback.title):
            server.gui.add_markdown(
                "\n".join(f"- {name}: **{value}**" for name, value in playback.facts.items())
            )
    while True:
        for scene in scenes:
            scene.show(int(slider.value))
        time.sleep(CONTROL_PERIOD)
        if playing.value:
            slider.value = (int(slider.value) + 1) % count


def _side_by_side(
    server: "viser.ViserServer", playbacks: Sequence[GraspPlayback]
) -> tuple[list[ViserScene], int]:
    """Return the playbacks side by side, and how many states the longest has."""
    # m between playbacks that stand side by side
    scenes = [ViserScene(server, playback, f"playback {k}", -1.3 * k) for k, playback in enumerate(playbacks)]
    return scenes, max(len(playback.states) for playback in playbacks)


def start_server(port: int, quiet: bool) -> "viser.ViserServer":
    """Return a server on this machine alone, with a camera that looks at the table."""
    require_extra("viewer", "the viewer")
    import viser

    with contextlib.redirect_stdout(io.StringIO() if quiet else sys.stderr):  # it prints a banner
        server = viser.ViserServer(host="127.0.0.1", port=port, verbose=False)
    server.scene.set_up_direction("+z")
    server.initial_camera.position = (1.12, -0.72, 0.52)  # m, where one looks from
    server.initial_camera.look_at = (0.40, 0.0, 0.19)  # m
    return server
