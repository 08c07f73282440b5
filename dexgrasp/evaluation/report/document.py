"""A report as blocks, and its two forms: markdown beside its plots, and one HTML page that needs no other file."""

import base64
import html
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from dexgrasp.runs.text import markdown_table


@dataclass(frozen=True)
class Heading:
    """A title, level 1 to 3."""

    words: str
    level: int = 2


@dataclass(frozen=True)
class Paragraph:
    """Words."""

    words: str


@dataclass(frozen=True)
class Lines:
    """A list of short lines."""

    lines: Sequence[str]


@dataclass(frozen=True)
class Commands:
    """What to type."""

    lines: Sequence[str]


@dataclass(frozen=True)
class TableBlock:
    """A table; cells but the first of a row are numbers unless `words`."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    words: bool = False


@dataclass(frozen=True)
class FigureBlock:
    """A plot: its file's stem, what it shows, and what draws it as "svg" or "png"."""

    name: str
    caption: str
    draw: Callable[[str], bytes]


@dataclass(frozen=True)
class Clip:
    """A recording, mp4, and what it shows."""

    path: Path
    caption: str


@dataclass(frozen=True)
class ClipsBlock:
    """Recordings side by side."""

    clips: Sequence[Clip]


Block: TypeAlias = Heading | Paragraph | Lines | Commands | TableBlock | FigureBlock | ClipsBlock


def as_markdown(blocks: Sequence[Block]) -> str:
    """Return markdown; figures are the files `<name>.png` beside it."""
    return "\n\n".join(_markdown(block) for block in blocks) + "\n"


def _markdown(block: Block) -> str:
    if isinstance(block, Heading):
        return f"{'#' * block.level} {block.words}"
    if isinstance(block, Paragraph):
        return block.words
    if isinstance(block, Lines):
        return "\n".join(f"- {line}" for line in block.lines)
    if isinstance(block, Commands):
        return "```\n" + "\n".join(block.lines) + "\n```"
    if isinstance(block, TableBlock):
        return markdown_table(
            block.header, [[cell.replace("|", "\\|") for cell in row] for row in block.rows]
        )
    if isinstance(block, ClipsBlock):
        return "\n".join(f"- [{clip.caption}](videos/{clip.path.name})" for clip in block.clips)
    return f"![{block.caption}]({block.name}.png)"


def as_html(title: str, blocks: Sequence[Block]) -> str:
    """Return one page with its style and its plots in it."""
    body = "\n".join(_html(block) for block in blocks)
    return _PAGE.format(title=html.escape(title), style=_STYLE, body=body)


def _html(block: Block) -> str:
    if isinstance(block, Heading):
        return f"<h{block.level}>{html.escape(block.words)}</h{block.level}>"
    if isinstance(block, Paragraph):
        return f"<p>{html.escape(block.words)}</p>"
    if isinstance(block, Lines):
        return "<ul>" + "".join(f"<li>{html.escape(line)}</li>" for line in block.lines) + "</ul>"
    if isinstance(block, Commands):
        return "<pre>" + html.escape("\n".join(block.lines)) + "</pre>"
    if isinstance(block, TableBlock):
        return _html_table(block)
    if isinstance(block, ClipsBlock):
        return '<div class="clips">' + "".join(map(_html_clip, block.clips)) + "</div>"
    picture = base64.b64encode(block.draw("svg")).decode()
    words = html.escape(block.caption)
    return (
        f'<figure><img src="data:image/svg+xml;base64,{picture}" alt="{words}">'
        f"<figcaption>{words}</figcaption></figure>"
    )


def _html_clip(clip: Clip) -> str:
    content = base64.b64encode(clip.path.read_bytes()).decode()
    return (
        f'<figure><video controls muted loop preload="metadata" src="data:video/mp4;base64,{content}"></video>'
        f"<figcaption>{html.escape(clip.caption)}</figcaption></figure>"
    )


def _html_table(block: TableBlock) -> str:
    def line(cells: Sequence[str], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{html.escape(cell.strip())}</{tag}>" for cell in cells) + "</tr>"

    head, body = line(block.header, "th"), "".join(line(row, "td") for row in block.rows)
    kind = ' class="words"' if block.words else ""
    return f'<div class="wide"><table{kind}><thead>{head}</thead><tbody>{body}</tbody></table></div>'


_STYLE = """
body { font: 16px/1.5 system-ui, "Segoe UI", "DejaVu Sans", sans-serif; color: #1d2530; background: #fff;
       max-width: 72rem; margin: 0 auto; padding: 1.5rem 1.25rem 4rem; }
h1 { font-size: 1.7rem; margin: 0 0 .5rem; } h2 { font-size: 1.25rem; margin: 2.4rem 0 .6rem;
     border-bottom: 1px solid #d8dee6; padding-bottom: .25rem; } h3 { font-size: 1.05rem; margin: 1.6rem 0 .5rem; }
p, ul { max-width: 46rem; } pre { background: #f4f6f9; padding: .8rem 1rem; overflow-x: auto; border-radius: 6px;
     font-size: .82rem; } .wide { overflow-x: auto; margin: .6rem 0 1rem; }
table { border-collapse: collapse; font-size: .86rem; font-variant-numeric: tabular-nums; }
th, td { padding: .32rem .7rem; text-align: right; white-space: nowrap; border-bottom: 1px solid #e6eaf0; }
th { font-weight: 600; color: #4a5667; border-bottom: 2px solid #c9d1db; }
th:first-child, td:first-child, .words th, .words td { text-align: left; }
.words td:last-child { white-space: normal; min-width: 16rem; }
tbody tr:hover { background: #f6f8fb; } figure { margin: 1rem 0; } img { max-width: 100%; height: auto; }
.clips { display: grid; grid-template-columns: repeat(auto-fill, minmax(15rem, 1fr)); gap: .4rem 1rem; }
video { width: 100%; border-radius: 6px; background: #e9edf2; } figcaption { font-size: .82rem; color: #5b6778; }
@media (max-width: 40rem) { body { font-size: 15px; padding: 1rem .8rem 3rem; } }
"""

_PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>{style}</style>
</head>
<body>
{body}
</body>
</html>
"""
