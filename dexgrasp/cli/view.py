"""`dexgrasp view`: a grasp in the browser, from the approach to the hold."""

from pathlib import Path
from typing import Annotated

from dexgrasp.cli.command import Answer, Argument, Command, File, SceneOptions
from dexgrasp.cli.output import note
from dexgrasp.cli.plan import plan_target
from dexgrasp.runs.folder import make_folder
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import write_atomically
from dexgrasp_env.valid import Count


class View(Command, SceneOptions):
    """Look at a grasp: on a local server, or as one self-contained page.

    examples:
      dexgrasp view pear                                  plan, then look at it in the browser
      dexgrasp view grasps/pear/grasp.json --html pear.html
      dexgrasp view runs/tables                           grasps of an evaluation side by side, failures first

    Shown are the robot, the object, the hull that was planned on, contacts, friction cones and forces. The motion is
    the planned one, drawn without physics. The page of --html is self-contained; no GL library is needed here.

    Attributes:
        target: an object to plan for, a grasp file, or an evaluation.
        html: write a page instead of serving one.
        port: of the server.
    """

    target: Argument[Annotated[str, "TARGET|GRASP.json|RUN"]]
    html: File | None = None
    port: Annotated[Count, "P"] = 8080

    def run(self) -> Answer | int:
        """Plan a grasp or read some, then serve or write the page."""
        from dexgrasp.evaluation.store import kept_grasps
        from dexgrasp.grasp.file import read_grasp, record_of
        from dexgrasp.viewer.page import page, serve
        from dexgrasp.viewer.playback import playback_of
        from dexgrasp_env.perception.scene import Scene

        path, cell = Path(self.target), self.cell
        if self.html is not None:
            if self.given("port"):
                raise InputError("--port is of a server: --html writes a page instead")
            make_folder(self.html.parent)
        if path.is_dir() or (path.suffix.lower() == ".json" and path.is_file()):
            if idle := self.given("seed", "mount", "friction", "mesh_scale", "mesh_mass"):
                raise InputError(f"{', '.join(idle)} would change nothing: {path} has a grasp already")
            files = kept_grasps(path)[:6] if path.is_dir() else [path]  # side by side
            playbacks = [playback_of(read_grasp(file, cell)) for file in files]
        else:
            look, found = plan_target(self.target, "bilevel", self)
            (identity, pose), seen = look.subject, Scene.of_observation(look.observation).target.points
            if not found.success:
                note(f"{identity.name}: no grasp ({found.reason}), so there is nothing to show")
            playbacks = [
                playback_of(record_of(content, cell=cell), seen)
                for content in found.contents(identity, "bilevel", pose)
            ]
        if not playbacks:
            return 1
        if self.html is None:
            note(f"showing {playbacks[0].title} at http://127.0.0.1:{self.port} (Ctrl-C ends it)")
            serve(playbacks, self.port)
            return 0
        write_atomically(self.html, page(playbacks).encode())
        note(f"wrote {self.html}")
        return Answer({"file": self.html, "films": [shown.title for shown in playbacks]}, "")
