"""Recipes of public robots: what `robot make` is told about a maker's file, besides the file."""

from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

from dexgrasp_env.arrays import Fields
from dexgrasp_env.assets import asset_path
from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.robot.part import NamedParts
from dexgrasp_env.robot.robot_file import read_content
from dexgrasp_env.valid import Names, Word, read


@dataclass(frozen=True)
class Recipe:
    """A recipe.

    Attributes:
        source: repository (owner/name) or maker of the description.
        file: path of it in there.
        hand: settings of the hand's file that replace what the description states; one number is for every joint.
        palm, thumb, flip: see `NamedParts`.
        why: the reason for these.
    """

    source: Word
    file: Word
    hand: Fields = field(default_factory=dict)
    palm: str | None = None
    thumb: str | None = None
    flip: Names = ()
    why: str = ""

    @property
    def named(self) -> NamedParts:
        """Parts of the hand that it names."""
        return NamedParts(self.palm, self.thumb, self.flip)

    def changed(self, entry: Fields) -> Fields:
        """Return what a hand's file says with its settings in place of those read.

        Raises:
            InputError: for a setting that hands do not have.
        """
        for key in self.hand:
            if key not in entry:
                raise unknown_name("setting of a recipe's hand", key, entry)
        return entry | self.hand


@lru_cache(maxsize=1)
def recipes() -> dict[str, Recipe]:
    """Return the recipes that come with the package, by name."""
    given: dict[str, Any] = read_content(asset_path("robot", "recipes.yaml"), "recipes")["recipes"]
    return {name: read(Recipe, entry, f"recipe {name}") for name, entry in given.items()}


def recipe_of(name: str, path: Path | None) -> Recipe:
    """Return the recipe of a name, for a file.

    Raises:
        InputError: for an unknown name, or a recipe for no file.
    """
    if name not in (known := recipes()):
        raise unknown_name("recipe", name, known)
    if path is None:
        raise InputError(f"recipe {name} is of {known[name].file} of {known[name].source}: give that file")
    return known[name]


def hint_of(path: Path) -> list[str]:
    """Return a line that names the recipe that says more of a file, if there is one."""
    last = path.resolve().parts[-2:]  # the folder tells files of common names apart
    found = [name for name, r in recipes().items() if r.why and r.hand and last == Path(r.file).parts[-2:]]
    return [f"hand: this is the file of a recipe: --recipe {found[0]}"] if found else []
