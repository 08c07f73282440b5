"""Check built pages for content that a browser would load from outside, and for links that lead nowhere.

python scripts/check_site.py out/site
"""

import re
import sys
from pathlib import Path
from urllib.parse import unquote, urlsplit

from lxml import html

CSS_LOADS = re.compile(r"""(?:url\(|@import)\s*["']?\s*((?:https?:)?//[^"')\s]+)""")
LINKS_ONLY = {"canonical", "next", "prev", "search", "index"}  # rel of <link> that loads nothing


def faults(site: Path) -> list[str]:
    """Return what is wrong with the pages and style sheets of a folder, one line each."""
    found = []
    for file in sorted(site.rglob("*.html")):
        page = html.document_fromstring(file.read_text(encoding="utf-8"))
        for element, _, url, _ in page.iterlinks():
            parts = urlsplit(url)
            of_a_link = element.tag == "a" or element.get("rel") in LINKS_ONLY
            if parts.netloc or parts.scheme:
                if parts.scheme != "data" and not of_a_link:
                    found.append(f"{file}: loads {url} from outside")
            elif parts.path and not (file.parent / unquote(parts.path)).exists():
                found.append(f"{file}: {url} leads nowhere")
    for file in sorted(site.rglob("*.css")):
        urls = CSS_LOADS.findall(file.read_text(encoding="utf-8"))
        found += [f"{file}: loads {url} from outside" for url in urls]
    return found


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    pages = list(folder.rglob("*.html"))
    lines = faults(folder)
    print("\n".join([*lines, f"{len(pages)} pages, {len(lines)} faults"]))
    sys.exit(bool(lines) or not pages)
