"""Pages name what exists, read well as plain Markdown where the README leads to them, and stay short."""

import importlib
import re
import sys
from pathlib import Path

import pytest
from markdown_it import MarkdownIt
from project_scripts import load_script

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "docs" / "_extensions"))

PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
]
FILES = [path.as_posix() for room in ("dexgrasp", "dexgrasp_env", "agents", "examples", "scripts", "tests")
         for path in (ROOT / room).rglob("*.py")]  # fmt: skip
OF_USERS = {"my_policy.py"}
SITE_ONLY = re.compile(r":::|```\{|\{\{|\{[\w:-]+\}`|^:\w+: ", re.MULTILINE)
OF_THE_SITE = {"index.md", "changelog.md"}  # the tree of all pages, and what includes CHANGELOG.md
OF_SEASONS = {
    "scripts/fetch_ycb.py",
    "scripts/outside.py",
    "scripts/kitchen.py",
}  # in notes of what was released


def named(name: str) -> bool:
    """Whether a dotted name is a module, or something in one."""
    parts = name.split(".")
    for k in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:k]))
        except ImportError:
            continue
        for part in parts[k:]:
            found = getattr(found, part, None)
        return found is not None
    return False


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_a_page_names_what_exists(page):
    text = page.read_text()
    files = set(re.findall(r"\b((?:\w+/)*\w+\.py)\b", text))
    files -= OF_USERS | (OF_SEASONS if page.name == "results.md" else set())
    assert [f for f in files if not any(path.endswith(f"/{f}") for path in FILES)] == []
    dotted = set(re.findall(r"\b(?:dexgrasp|dexgrasp_env)(?:\.[A-Za-z_]\w*)+", text))
    assert [name for name in dotted if not named(name)] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_a_page_is_read_in_one_sitting(page):
    assert len(re.findall(r"\w[\w'/-]*", page.read_text())) <= 2000


def linked(page):
    """Return the pages of this repository that a page links to."""
    tokens = [child for token in MarkdownIt().parse(page.read_text()) for child in token.children or ()]
    links = [str(token.attrGet("href")).partition("#")[0] for token in tokens if token.type == "link_open"]
    return [(page.parent / link).resolve() for link in links if link.endswith(".md") and "://" not in link]


@pytest.mark.parametrize(
    "page", [page for page in PAGES if page.name not in OF_THE_SITE], ids=lambda page: page.stem
)
def test_a_page_reads_well_as_plain_markdown(page):
    html = MarkdownIt().enable("table").render(page.read_text())
    assert SITE_ONLY.findall(page.read_text()) == []
    assert "<h1>" in html
    assert len(re.findall(r"^\|(?: ?:?-+:? ?\|)+$", page.read_text(), re.MULTILINE)) == html.count("<table>")
    for fence in re.findall(r"^ *```(.*)$", page.read_text(), re.MULTILINE):
        assert re.fullmatch(r"[\w+]*( \S+)?", fence)
    assert [link for link in linked(page) if not link.is_file()] == []


def test_pages_show_what_the_code_says():
    assert [path.name for path in load_script("fill_pages").stale()] == [], "run scripts/fill_pages.py"


@pytest.mark.parametrize("page", sorted((ROOT / "docs").rglob("*.md")), ids=lambda page: page.stem)
def test_a_page_is_on_the_site(page):
    index = (ROOT / "docs" / "index.md").read_text()
    name = page.relative_to(ROOT / "docs").with_suffix("").as_posix()
    assert name == "index" or re.search(rf"^{name}$", index, re.MULTILINE)
