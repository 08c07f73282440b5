"""Text of a robot's description with all that it names, for hashes: a robot is another one where any of it changes."""

import re
from pathlib import Path

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
    """Return the file that a URDF calls a mesh: of a package, or relative to the URDF, sought upwards.

    Args:
        name: that the URDF states.
        path: of the URDF.
    """
    package, _, rest = (
        name.removeprefix("package://").partition("/") if "package://" in name else ("", "", name)
    )
    rest = rest.removeprefix("file://")
    for folder in path.resolve().parents:
        for place in (folder / package / rest, folder / rest):
            if place.is_file():
                return place
    return None
