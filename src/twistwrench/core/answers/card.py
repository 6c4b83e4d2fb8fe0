"""Card of an answer in a notebook: word and sentence, one picture, one table; HTML without scripts."""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..colours import COLOURS, NEAR_LIMIT, Style
from ..numbers import number
from ..text import visible
from ..typing import Array
from .blocks import Block, Headline, Table, limit_style
from .page import block_html, paragraphs
from .shown_blocks import shown_blocks

if TYPE_CHECKING:
    from .answer import Answer

_MAX_BYTES = 120_000
"""Maximum number of bytes of a card."""
_MAX_NAME_LENGTH = 200
"""Maximum number of characters of a name."""
_WIDTH, _HEIGHT, _LEFT_MARGIN, _BOTTOM_MARGIN = 640, 150, 42, 18
"""Size of the picture, and its margins, in pixels."""
_MAX_POINTS = 240
"""Maximum number of points of a curve."""
_MAX_LINES = 8
"""Maximum number of lines of a card above its table, or without one."""
_MAX_NOTES = 4
"""Maximum number of notes below the table of a card."""


@dataclass(frozen=True, eq=False)
class Shares:
    """Shares of limits over time, the picture of a card."""

    time: Array
    """(n,) times [s]."""
    values: Array
    """(n, joints) shares of the limits; nan without a limit."""
    names: Sequence[str]
    """Joints."""


def card(answer: Answer) -> str:
    """HTML of the card of an answer, at most 120 kB."""
    blocks = [block for block in shown_blocks(answer.blocks(), every=False, hint="") if block != ""]
    head = [html_of(block) for block in blocks if isinstance(block, Headline)]
    below = [block for block in blocks if not isinstance(block, Headline)]
    shares = answer.shares()
    parts = [f'<p class="kind">{_short_name(answer.subject)}</p>', *head]
    if shares is not None and np.isfinite(shares.values).any():
        parts.append(shares_svg(shares))
    selected = _select_blocks(below)
    parts += map(block_html, selected)
    omitted = [block for block in below if block not in selected]
    if omitted:
        parts.append(f'<p class="kind">{_count_text(omitted)} more: .print(), .to_html("report.html")</p>')
    text = f'<div class="twistwrench">{_STYLE}{"".join(parts)}</div>'
    if len(text.encode()) > _MAX_BYTES:
        text = f'<div class="twistwrench">{_STYLE}{"".join(parts[:2])}</div>'
    return text


def _select_blocks(blocks: Sequence[Block]) -> list[Block]:
    """Blocks below the picture of a card: the lines before the first table, the table, and the first notes after it."""
    tables = [k for k, block in enumerate(blocks) if isinstance(block, Table)]
    if not tables:
        return list(blocks[:_MAX_LINES])
    first = tables[0]
    notes = [block for block in blocks[first + 1 :] if not isinstance(block, Table)]
    return [*blocks[:first][:_MAX_LINES], blocks[first], *notes[:_MAX_NOTES]]


def _count_text(blocks: Sequence[Block]) -> str:
    """Numbers of tables and of other blocks."""
    tables = sum(isinstance(block, Table) for block in blocks)
    counts = {"table": tables, "note": len(blocks) - tables}
    return " and ".join(f"{count} {name}{'s' * (count > 1)}" for name, count in counts.items() if count)


def html_of(block: Block) -> str:
    """HTML of the headline, one paragraph a line."""
    first, *others = paragraphs(block) or [""]
    return f'<p class="headline">{first}</p>' + "".join(f"<p>{text}</p>" for text in others)


def _short_name(text: str) -> str:
    if len(text) > _MAX_NAME_LENGTH:
        text = f"{text[:_MAX_NAME_LENGTH]}…"
    return html.escape(visible(text))


def shares_svg(shares: Shares) -> str:
    """Curve of the share of its limit of each joint, with the limit as a line; the largest is in its colour."""
    time, values, names = shares.time, shares.values, shares.names
    step = max(1, -(-len(time) // _MAX_POINTS))
    blocks = [slice(k, k + step) for k in range(0, len(time), step)]
    peaks = np.array([np.nanmax(np.nan_to_num(values[block], nan=-1.0), axis=0) for block in blocks])
    centres = np.array([time[block].mean() for block in blocks])
    known = (peaks >= 0).any(axis=0)
    top = max(1.1, 1.05 * float(peaks.max()))
    span = float(centres[-1] - centres[0]) or 1.0
    x = (_LEFT_MARGIN + (_WIDTH - _LEFT_MARGIN - 6) * (centres - centres[0]) / span).round(1).tolist()

    def height(share: Array | float) -> Any:
        return ((_HEIGHT - _BOTTOM_MARGIN) * (1.0 - np.asarray(share) / top) + 4).round(1).tolist()

    worst = int(np.argmax(np.where(known, peaks.max(axis=0), -1.0)))
    joints = [k for k in np.flatnonzero(known).tolist() if k != worst]
    lines = []
    for k in [*joints, worst]:  # the largest last, above the others
        points = " ".join(f"{a},{b}" for a, b in zip(x, height(peaks[:, k]), strict=True))
        style, width = (limit_style(float(peaks[:, k].max())), 1.8) if k == worst else (Style.QUIET, 1.0)
        colour = COLOURS[style].plot
        lines.append(f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="{width}"/>')
    limit = height(1.0)
    near = height(NEAR_LIMIT)
    texts = [
        f'<text x="2" y="{limit + 4}">100 %</text>',
        f'<text x="2" y="{height(0.0) + 4}">0</text>',
        f'<text x="{_LEFT_MARGIN}" y="{_HEIGHT}">{number(shares.time[0])} s</text>',
        f'<text x="{_WIDTH - 6}" y="{_HEIGHT}" text-anchor="end">{number(shares.time[-1])} s · '
        f"share of the limit of each joint, {_short_name(names[worst])} marked</text>",
    ]
    rules = [
        f'<line x1="{_LEFT_MARGIN}" x2="{_WIDTH}" y1="{limit}" y2="{limit}" stroke="currentColor"/>',
        f'<line x1="{_LEFT_MARGIN}" x2="{_WIDTH}" y1="{near}" y2="{near}" stroke="currentColor" stroke-dasharray="2 4"/>',
    ]
    return (
        f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT + 4}" role="img" aria-label="Share of the limit of each joint over time" '
        f'font-size="11" fill="currentColor">{"".join(rules)}{"".join(lines)}{"".join(texts)}</svg>'
    )


def _style() -> str:
    """Style sheet of the card; a notebook's dark theme or a dark screen gets light text."""
    light = "".join(f".twistwrench .{style} {{ color: {colour.light} }}" for style, colour in COLOURS.items())
    dark = "".join(f".twistwrench .{style} {{ color: {colour.dark} }}" for style, colour in COLOURS.items())
    return (
        "<style>.twistwrench { font: 14px/1.45 system-ui, sans-serif; max-width: 46rem } "
        ".twistwrench p { margin: 0.25rem 0 } .twistwrench .headline { font-size: 1.1rem } "
        ".twistwrench .strong { font-weight: 650 } .twistwrench .kind { opacity: 0.7; font-size: 0.85rem } "
        ".twistwrench svg { display: block; width: 100%; max-width: 640px; height: auto } "
        ".twistwrench figure { margin: 0.5rem 0 } .twistwrench td, .twistwrench th { text-align: right; padding: 0.1rem 0.6rem "
        "0.1rem 0; font-variant-numeric: tabular-nums } .twistwrench .word, .twistwrench caption { text-align: left } "
        ".twistwrench caption { font-weight: 600; padding: 0.2rem 0; white-space: nowrap } "
        ".twistwrench .scroll { overflow-x: auto } "
        ".twistwrench th, .twistwrench .number, .twistwrench .whole { white-space: nowrap } "
        f"{light}@media (prefers-color-scheme: dark) {{ {dark} }}</style>"
    )


_STYLE = _style()
