"""Tables as text: aligned for a terminal, or markdown."""

from collections.abc import Sequence

Cells = Sequence[Sequence[str]]


def text_table(header: Sequence[str], rows: Cells) -> str:
    """Return columns aligned with spaces: the first to the left, the others to the right."""
    widths = _widths(header, rows)

    def line(cells: Sequence[str]) -> str:
        first, *rest = (
            cell.ljust(w) if i == 0 else cell.rjust(w)
            for i, (cell, w) in enumerate(zip(cells, widths, strict=True))
        )
        return "  ".join([first, *rest]).rstrip()

    return "\n".join([line(header), "  ".join("-" * width for width in widths), *map(line, rows)])


def left_table(header: Sequence[str], rows: Cells) -> str:
    """Return columns aligned to the left, for words."""
    widths = _widths(header, rows)
    lines = [header, ["-" * width for width in widths], *rows]
    return "\n".join(
        "  ".join(cell.ljust(w) for cell, w in zip(cells, widths, strict=True)).rstrip() for cells in lines
    )


def markdown_table(header: Sequence[str], rows: Cells) -> str:
    """Return a markdown table."""
    ruler = ["---", *["---:"] * (len(header) - 1)]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in [header, ruler, *rows])


def seconds_words(value: float) -> str:
    """Return seconds with two decimals, below a tenth with two digits: planning takes hundredths."""
    return f"{value:.2f}" if value >= 0.1 or value < 5e-4 else f"{value:#.2g}"


def _widths(header: Sequence[str], rows: Cells) -> list[int]:
    return [max(len(row[i]) for row in [header, *rows]) for i in range(len(header))]
