"""Base of commands: options as the fields of dataclasses, an answer.

A field's annotation says what is valid, its default what holds where nothing is given, its line under `Attributes:` is
the help; nothing of an option is said a second time. `Annotated` may add, as text, what the option (`"--from"`) or its
value (`"DIR"`) is called, as a mapping what argparse is to know besides (`instead_of`: the path of an option that this
one excludes; `of`: the option without which this one would do nothing, and is refused; `variable`: of the surroundings,
whose value holds where the command line gives none). A field that is a dataclass itself, such as the settings that a
function of the library takes, brings its own fields: all, those that a tuple names, or all but those of a set.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, dataclass_transform

from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import jsonable
from dexgrasp_env.valid import CellFile, Friction, Mass, Mount, Natural, Positive

if TYPE_CHECKING:
    from dexgrasp_env.robot.cell import Cell

T = TypeVar("T")
POSITIONAL = object()
Argument = Annotated[T, POSITIONAL]
"""A field that is given by its place, not by its name."""
Folder = Annotated[Path, "DIR"]
File = Annotated[Path, "FILE"]
Seed = Annotated[Natural, "S"]
Scale = Annotated[Positive, "F"]


@dataclass(frozen=True)
class Answer:
    """Answer of a command.

    Attributes:
        content: as JSON; its schema is 1 unless it says another.
        text: for people, or lines of it; empty for nothing.
        code: exit code; the truth of "the answer is no" is one.
        failure: what went wrong afterwards, raised when the answer has been printed.
    """

    content: Fields
    text: str | Sequence[str]
    code: int = 0
    failure: OSError | None = None

    def show(self, as_json: bool) -> int:
        """Print it and return the exit code."""
        if as_json:
            print(json.dumps(jsonable({"schema": 1, **self.content}), indent=2, allow_nan=False))
        elif self.text:
            print(self.text if isinstance(self.text, str) else "\n".join(self.text))
        if self.failure is not None:
            raise self.failure
        return int(self.code)


@dataclass_transform(kw_only_default=True, frozen_default=True)
class Options:
    """Options that several commands share: every class of them is a frozen dataclass."""

    def __init_subclass__(cls) -> None:
        dataclass(frozen=True, kw_only=True)(cls)

    def given(self, *names: str) -> list[str]:
        """Return the options, as they are written, of those fields that have another value than their default."""
        known = type(self).__dataclass_fields__  # type: ignore[attr-defined]
        return [f"--{name.replace('_', '-')}" for name in names if getattr(self, name) != known[name].default]


class Script(Options):
    """Base of what runs with options: a file of `scripts/` (`run_script`) or a command."""

    def run(self) -> Answer | int:
        """Do it; return what is to be printed, or the exit code alone."""
        raise NotImplementedError


class Command(Script):
    """A command; the first lines of its docstring describe it, what follows until `Attributes:` is printed below.

    Attributes:
        json: print one JSON object on stdout and nothing else there.
    """

    json: bool = False


def check_mesh_options(targets: Sequence[str], settings: Any) -> None:
    """Refuse `mesh_scale` and `mesh_mass` of settings where there is no mesh.

    Raises:
        InputError: naming the options.
    """
    from dexgrasp_env.objects.load import has_own_size

    if (settings.mesh_scale, settings.mesh_mass) != (1.0, None) and all(map(has_own_size, targets)):
        raise InputError(
            f"--mesh-scale and --mesh-mass are of mesh files alone: {targets[0]!r} has a size and a mass of its own"
        )


class InCell(Options):
    """Your cell.

    Attributes:
        robot: file of your cell (robot, table, mounts, limits, gains, torques and cameras), or of a robot alone, or
            the name of one of ours, see dexgrasp robot list (default: the simulated cell; on the command line
            $DEXGRASP_CELL, where it is set).
    """

    robot: CellFile = None

    @property
    def cell(self) -> "Cell":
        """The cell that is meant.

        Raises:
            InputError: for a file that is none.
        """
        from dexgrasp_env.robot.cell import make_cell

        return make_cell(self.robot, getattr(self, "mount", None))


class Scene(InCell):
    """The scene.

    Attributes:
        seed: of scene and planner.
        mount: how the hand sits on the arm's flange; see dexgrasp list envs.
        friction: sliding friction coefficient (default 0.7).
        mesh_scale: factor from a mesh file's unit to metres: 0.001 for millimetres.
        mesh_mass: mass of a mesh, kg (default: by its volume).
    """

    seed: Seed = 0
    mount: Mount = None
    friction: Annotated[Friction | None, "MU"] = None
    mesh_scale: Scale = 1.0
    mesh_mass: Annotated[Mass | None, "KG"] = None

    @property
    def env_settings(self) -> Fields:
        """Keywords of `gym.make` that commands share."""
        chosen = {"robot": self.robot, "mount": self.mount, "friction": self.friction}
        given = {name: value for name, value in chosen.items() if value is not None}
        return {"mesh_scale": self.mesh_scale, "mesh_mass": self.mesh_mass} | given
