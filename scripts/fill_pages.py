"""Write the parts of docs/ that come from the code, so that pages can be read in the repository.

    python scripts/fill_pages.py

`docs/_extensions/from_code.py` says how a page marks the places; a test holds every page against the code.
"""

import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parents[1] / "docs"
sys.path.insert(0, str(DOCS / "_extensions"))
from from_code import filled  # noqa: E402


def stale() -> dict[Path, str]:
    """Return the pages that no longer show what the code says, each with what it should be."""
    now = {path: filled(path.read_text()) for path in DOCS.rglob("*.md")}
    return {path: text for path, text in now.items() if path.read_text() != text}


if __name__ == "__main__":
    for page, text in stale().items():
        page.write_text(text)
