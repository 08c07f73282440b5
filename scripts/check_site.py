"""Looks through built pages for anything that a browser would load from outside, and for links that lead nowhere.

python scripts/check_site.py out/site
"""

import re
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

CSS_LOADS = re.compile(r"""(?:url\(|@import)\s*["']?\s*((?:https?:)?//[^"')\s]+)""")
LINKS_ONLY = {"canonical", "next", "prev", "search", "index"}  # rel of <link> that loads nothing


class Page(HTMLParser):
    """References of a page: what it loads, and where it leads."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.links: list[str] = []
        text = file.read_text(encoding="utf-8")
        self.loads += CSS_LOADS.findall(text)
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note what the tag loads or links to."""
        given = {key: value or "" for key, value in attrs}
        self.loads += [given[key] for key in ("src", "data") if key in given]
        if tag == "link" and given.get("rel") not in LINKS_ONLY:
            self.loads.append(given.get("href", ""))
        if tag == "a" and "href" in given:
            self.links.append(given["href"])


def faults(site: Path) -> list[str]:
    """Return what is wrong with the pages and style sheets of a folder, one line each."""
    found = []
    for file in sorted(site.rglob("*.html")):
        page = Page(file)
        found += [f"{file}: loads {url} from outside" for url in page.loads if outside(url)]
        for url in [*page.loads, *page.links]:
            parts = urlsplit(url)
            here = parts.path and not parts.scheme and not parts.netloc
            if here and not (file.parent / unquote(parts.path)).exists():
                found.append(f"{file}: {url} leads nowhere")
    for file in sorted(site.rglob("*.css")):
        found += [
            f"{file}: loads {url} from outside" for url in CSS_LOADS.findall(file.read_text(encoding="utf-8"))
        ]
    return found


def outside(url: str) -> bool:
    """Return True for a link that leaves the site."""
    parts = urlsplit(url)
    return bool(parts.netloc) or parts.scheme not in ("", "data")


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    pages = list(folder.rglob("*.html"))
    lines = faults(folder)
    print("\n".join([*lines, f"{len(pages)} pages, {len(lines)} faults"]))
    sys.exit(bool(lines) or not pages)
