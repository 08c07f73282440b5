"""Tables as text, aligned for a terminal."""

from collections.abc import Sequence


def text_table(header: Sequence[str], rows: Sequence[Sequence[str]], *, words: bool = False) -> str:
    """Return columns aligned with spaces: the first to the left, the others to the right unless they are words."""
    align = [str.ljust] + [str.ljust if words else str.rjust] * (len(header) - 1)
    widths = [max(map(len, column)) for column in zip(header, *rows, strict=True)]
    lines = [header, ["-" * width for width in widths], *rows]
    return "\n".join(
        "  ".join(put(cell, w) for put, cell, w in zip(align, cells, widths, strict=True)).rstrip()
        for cells in lines
    )


def seconds_words(value: float) -> str:
    """Return seconds with two decimals, below a tenth with two digits: planning takes hundredths."""
    return f"{value:.2f}" if value >= 0.1 or value < 5e-4 else f"{value:#.2g}"
