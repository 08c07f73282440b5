"""Text of a robot's description with all that it names, for hashes: a robot is another one where any of it changes."""

import re
from pathlib import Path

_FILE = re.compile(r"""<(?:include|model)\b[^>]*?\bfile\s*=\s*["']([^"']+)""")


def description_text(path: Path) -> str:
    """Return what a description says, then what it includes or attaches, each file once; for hashes."""
    texts, left = dict[Path, str](), [path]
    while left:
        file = left.pop()
        if file not in texts and file.is_file():
            texts[file] = file.read_text("utf-8", "replace")
            for name in _FILE.findall(texts[file]):
                left += dict.fromkeys((file.parent / name, path.parent / name))
    return "".join(texts.values())
