"""Tables as text, aligned for a terminal."""

from collections.abc import Callable, Sequence

Cells = Sequence[Sequence[str]]


def text_table(header: Sequence[str], rows: Cells) -> str:
    """Return columns aligned with spaces: the first to the left, the others to the right."""
    return _table(header, rows, [str.ljust] + [str.rjust] * (len(header) - 1))


def left_table(header: Sequence[str], rows: Cells) -> str:
    """Return columns aligned to the left, for words."""
    return _table(header, rows, [str.ljust] * len(header))


def _table(header: Sequence[str], rows: Cells, align: Sequence[Callable[[str, int], str]]) -> str:
    widths = [max(map(len, column)) for column in zip(header, *rows, strict=True)]
    lines = [header, ["-" * width for width in widths], *rows]
    return "\n".join(
        "  ".join(put(cell, w) for put, cell, w in zip(align, cells, widths, strict=True)).rstrip()
        for cells in lines
    )


def seconds_words(value: float) -> str:
    """Return seconds with two decimals, below a tenth with two digits: planning takes hundredths."""
    return f"{value:.2f}" if value >= 0.1 or value < 5e-4 else f"{value:#.2g}"
