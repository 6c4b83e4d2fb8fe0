"""Tables for notebooks: what ``_repr_html_`` of robots and reports gives."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from .printed_numbers import number


def html_table(title: str, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """A table with a title, if it is not empty; numbers in four digits, None as a dash, all else escaped, words to the left.

    >>> html_table("a < b", ["x"], [[0.123456], [None]])
    '<p>a &lt; b</p><table><thead><tr><th>x</th></tr></thead><tbody><tr><td>0.1235</td></tr><tr><td>–</td></tr></tbody></table>'
    """
    import html

    cells = [list(row) for row in rows]
    words = [any(isinstance(row[k], str) for row in cells) for k in range(len(header))]
    sides = [' style="text-align: left"' if word else "" for word in words]
    head = "".join(f"<th{side}>{html.escape(name)}</th>" for side, name in zip(sides, header, strict=True))
    body = "".join(
        f"<tr>{''.join(f'<td{s}>{html.escape(_said(x))}</td>' for s, x in zip(sides, row, strict=True))}</tr>"
        for row in cells
    )
    above = f"<p>{html.escape(title)}</p>" if title else ""
    return f"{above}<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _said(value: Any) -> str:
    return number(value) if value is None or isinstance(value, float) else str(value)
