"""Base classes of commands: the fields of a dataclass are the options, `Answer` is the result.

A field's annotation is the validation of an option, its default the option's, and its line under `Attributes:` the
help; nothing is declared twice. `Annotated` may add text, which names the option (`"--from"`) or its value (`"DIR"`),
and a mapping: further keywords of argparse, and `instead_of` (path of an option that this one excludes), `of` (option
without which this one would have no effect, and is refused), `variable` (environment variable that gives the default).
A field that is itself a dataclass, such as the settings of a function of the library, adds its own fields: all, those
that a tuple names, or all but those of a set.
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
"""Field that is a positional argument."""
Folder = Annotated[Path, "DIR"]
File = Annotated[Path, "FILE"]
Seed = Annotated[Natural, "S"]
Scale = Annotated[Positive, "F"]


@dataclass(frozen=True)
class Answer:
    """Result of a command.

    Attributes:
        content: JSON of `--json`; its schema is 1 unless it states another.
        text: for people, as text or lines; empty for nothing.
        code: exit code; True, for a negative result, is 1.
        failure: error of writing files, raised after the result has been printed.
    """

    content: Fields
    text: str | Sequence[str]
    code: int = 0
    failure: OSError | None = None

    def show(self, as_json: bool) -> int:
        """Print the result and return the exit code."""
        if as_json:
            print(json.dumps(jsonable({"schema": 1, **self.content}), indent=2, allow_nan=False))
        elif self.text:
            print(self.text if isinstance(self.text, str) else "\n".join(self.text))
        if self.failure is not None:
            raise self.failure
        return int(self.code)


@dataclass_transform(kw_only_default=True, frozen_default=True)
class Options:
    """Base of groups of options: every subclass is made a frozen dataclass."""

    def __init_subclass__(cls) -> None:
        dataclass(frozen=True, kw_only=True)(cls)

    def given(self, *names: str) -> list[str]:
        """Return the options, as they are typed, of those named fields that differ from their defaults."""
        known = type(self).__dataclass_fields__  # type: ignore[attr-defined]
        return [f"--{name.replace('_', '-')}" for name in names if getattr(self, name) != known[name].default]


class Script(Options):
    """Program with options: a file of `scripts/` (see `run_script`), or a command."""

    def run(self) -> Answer | int:
        """Run the program; return the result to print, or the exit code alone."""
        raise NotImplementedError


class Command(Script):
    """Command; the first paragraph of its docstring is its description, what follows until `Attributes:` the epilog.

    Attributes:
        json: print one JSON object on stdout and nothing else there.
    """

    json: bool = False


def check_mesh_options(targets: Sequence[str], settings: Any) -> None:
    """Refuse `mesh_scale` and `mesh_mass` of settings where no target is a mesh.

    Raises:
        InputError: naming the options.
    """
    from dexgrasp_env.objects.load import has_own_size

    if (settings.mesh_scale, settings.mesh_mass) != (1.0, None) and all(map(has_own_size, targets)):
        raise InputError(
            f"--mesh-scale and --mesh-mass are of mesh files alone: {targets[0]!r} has a size and a mass of its own"
        )


class CellOptions(Options):
    """Your cell.

    Attributes:
        robot: file of your cell (robot, table, mounts, limits, gains, torques and cameras), or of a robot alone, or
            the name of one of ours, see dexgrasp robot list (default: the simulated cell; on the command line
            $DEXGRASP_CELL, where it is set).
    """

    robot: CellFile = None

    @property
    def cell(self) -> "Cell":
        """Cell that `robot` and, where there is one, `mount` name.

        Raises:
            InputError: for a file that is no cell or robot.
        """
        from dexgrasp_env.robot.cell import make_cell

        return make_cell(self.robot, getattr(self, "mount", None))


class SceneOptions(CellOptions):
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
        """Keywords of `gym.make` for the scene."""
        names = ("robot", "mount", "friction", "mesh_scale", "mesh_mass")
        return {name: getattr(self, name) for name in names}
