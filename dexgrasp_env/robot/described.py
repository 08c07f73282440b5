"""What a description in MJCF says, for hashes: a robot is another one where any of it changes."""

import re
from pathlib import Path

_INCLUDED = re.compile(r"""<include\s+file\s*=\s*["']([^"']+)""")


def described(mjcf: Path) -> str:
    """Return what a description in MJCF says, then what it includes; MuJoCo says what is wrong with it."""
    texts, left = dict[Path, str](), [mjcf]
    while left:
        path = left.pop()
        if path not in texts and path.is_file():
            texts[path] = path.read_text("utf-8", "replace")
            left += [mjcf.parent / name for name in _INCLUDED.findall(texts[path])]
    return "".join(texts.values())
