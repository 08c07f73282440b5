"""Files that a robot's description names: where they are, and its text with all of them, for hashes."""

import re
from contextlib import suppress
from pathlib import Path, PurePosixPath
from urllib.parse import unquote

from dexgrasp_env.assets import asset_path
from dexgrasp_env.files import file_hash

_FILE = re.compile(r"""\bfile(?:name)?\s*=\s*["']([^"']+)""")
_FOLDER = re.compile(r"""\b(?:mesh|texture|asset)dir\s*=\s*["']([^"']+)""")


def description_text(path: Path) -> str:
    """Return what a description says, then what it includes or attaches, and hashes of its meshes, each file once.

    Meshes of the package's own robots are left out: they change with the code alone.
    """
    texts, left, within = dict[Path, str](), [path], {"": None}
    ours = asset_path("robot") in path.parents
    while left:
        file = left.pop()
        if file in texts or not file.is_file():
            continue
        if file != path and file.suffix.lower() not in (".xml", ".mjcf", ".urdf"):
            texts[file] = "" if ours else file_hash(file)
            continue
        texts[file] = file.read_text("utf-8", "replace")
        within |= dict.fromkeys(_FOLDER.findall(texts[file]))
        folders = dict.fromkeys(root / name for root in (file.parent, path.parent) for name in within)
        for name in _FILE.findall(texts[file]):
            places = [place for folder in folders if (place := folder / name).is_file()]
            left += places or filter(None, [find_file(name, path)])
    return "".join(texts.values())


def find_file(name: str, path: Path) -> Path | None:
    """Return the file that a description calls a mesh, in whatever case of letters.

    A package, another machine's folders, or nothing comes first in its name: of what is left without the first parts,
    the longest that is found from the description's folder upwards is taken.

    Args:
        name: that the description states.
        path: of the description.
    """
    parts = PurePosixPath(unquote(name).rpartition("://")[2].replace("\\", "/")).parts
    with suppress(OSError):  # a name that no file can have
        for k in range(len(parts)):
            for folder in path.resolve().parents:
                if found := _below(folder, parts[k:]):
                    return found.resolve()  # MuJoCo names it so, where it cannot read it
    return None


def _below(folder: Path, parts: tuple[str, ...]) -> Path | None:
    """Return the file at a path below a folder, in whatever case of letters."""
    if not parts or not folder.is_dir():
        return folder if not parts and folder.is_file() else None
    place = folder / parts[0]
    if not place.exists():
        alike = (own for own in folder.iterdir() if own.name.lower() == parts[0].lower())
        place = next(alike, place)
    return _below(place, parts[1:])
