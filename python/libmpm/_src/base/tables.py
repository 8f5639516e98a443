"""Text and HTML tables for terminals, notebooks and docstrings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

__all__ = ["Tabled", "escaped", "html_table", "html_warnings", "pair_table", "text_table"]

#: Characters of an HTML cell.
_LONGEST = 160


def text_table(
    rows: Sequence[Sequence[str]], *, flush: Literal["left", "right"] = "right", ruled: bool = False
) -> str:
    """Return rows of texts, the first of them the head, in columns.

    `ruled` puts the lines of reStructuredText around head and body.
    """
    if not rows:
        return ""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    align = str.ljust if flush == "left" else str.rjust
    lines = [
        "  ".join(align(c, w) for c, w in zip(row, widths, strict=True)).rstrip() for row in rows
    ]
    if ruled:
        rule = "  ".join("=" * w for w in widths)
        lines = [rule, lines[0], rule, *lines[1:], rule]
    return "\n".join(lines)


def pair_table(rows: Sequence[tuple[str, str]], width: int = 0) -> str:
    """Return names and texts in two columns, a line each; the first at least `width` wide."""
    width = max([width, *(len(name) for name, _ in rows)])
    return "\n".join(f"{name:<{width}} {text}" for name, text in rows)


def escaped(text: str) -> str:
    """Return a text for HTML; `html` has thousands of names and is loaded where it is needed."""
    from html import escape

    return escape(text)


def html_table(rows: Sequence[Sequence[Any]], head: Sequence[Any] = ()) -> str:
    """Return an HTML table; all texts are escaped, long ones cut."""

    def cell(item: Any, tag: str) -> str:
        text = str(item)
        text = text if len(text) <= _LONGEST else text[: _LONGEST - 1] + "…"
        return f"<{tag}>{escaped(text)}</{tag}>"

    lines = [] if not head else [f"<tr>{''.join(cell(c, 'th') for c in head)}</tr>"]
    lines += [f"<tr>{''.join(cell(c, 'td') for c in row)}</tr>" for row in rows]
    return f"<table>{''.join(lines)}</table>"


def html_warnings(texts: Sequence[str]) -> str:
    """Return a paragraph for each warning."""
    return "".join(f"<p><b>warning:</b> {escaped(text)}</p>" for text in texts)


class Tabled:
    """What terminals and notebooks show as a table, the rows of `_rows`, the first the head."""

    def _rows(self) -> Sequence[tuple[str, ...]]:
        raise NotImplementedError

    def __repr__(self) -> str:
        """Return the table as text for a terminal."""
        return text_table(self._rows())

    def _repr_html_(self) -> str:
        """Return the table for Jupyter."""
        head, *rows = self._rows()
        return html_table(rows, head)
