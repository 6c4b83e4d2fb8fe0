"""Card of an answer in a notebook: word and sentence, one picture, one table; HTML without scripts."""

from __future__ import annotations

import html
import math
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
_WIDTH = 640
"""Width of the picture, in pixels."""
_HEIGHT = 150
"""Height of the picture, in pixels, without its margin above."""
# Margins of the plot inside the picture, in pixels.
_LEFT_MARGIN = 42
_RIGHT_MARGIN = 6
_TOP_MARGIN = 4
_BOTTOM_MARGIN = 18
_HALF_DIGIT_HEIGHT = 4
"""Half the height of digits, in pixels."""
_MIN_TOP_SHARE = 1.1
"""Smallest share at the top of the plot, which is above the limit."""
_TOP_SPACE = 1.05
"""Share at the top of the plot, in units of the largest share."""
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
    all_blocks = shown_blocks(answer.blocks(), every=False, hint="")
    blocks = [block for block in all_blocks if block != ""]  # no empty lines
    headline_parts = [html_of(block) for block in blocks if isinstance(block, Headline)]
    lower_blocks = [block for block in blocks if not isinstance(block, Headline)]
    shares = answer.shares()
    parts = [f'<p class="kind">{_short_name(answer.subject)}</p>', *headline_parts]
    if shares is not None and np.isfinite(shares.values).any():
        parts.append(shares_svg(shares))
    selected_blocks = _select_blocks(lower_blocks)
    parts += map(block_html, selected_blocks)
    omitted_blocks = [block for block in lower_blocks if block not in selected_blocks]
    if omitted_blocks:
        parts.append(f'<p class="kind">{_count_text(omitted_blocks)} more: .print(), .to_html("report.html")</p>')
    text = f'<div class="twistwrench">{_STYLE}{"".join(parts)}</div>'
    if len(text.encode()) > _MAX_BYTES:
        subject_and_headline = "".join(parts[:2])
        text = f'<div class="twistwrench">{_STYLE}{subject_and_headline}</div>'
    return text


def _select_blocks(blocks: Sequence[Block]) -> list[Block]:
    """Blocks below the picture of a card: lines before the first table, this table, and the first notes after it."""
    tables = [k for k, block in enumerate(blocks) if isinstance(block, Table)]
    if not tables:
        return list(blocks[:_MAX_LINES])
    first_table = tables[0]  # index
    lines = blocks[:first_table]
    notes = [block for block in blocks[first_table + 1 :] if not isinstance(block, Table)]
    return [*lines[:_MAX_LINES], blocks[first_table], *notes[:_MAX_NOTES]]


def _count_text(blocks: Sequence[Block]) -> str:
    """Text with the numbers of tables and of other blocks: "1 table and 2 notes"."""
    table_count = sum(isinstance(block, Table) for block in blocks)
    counts = {"table": table_count, "note": len(blocks) - table_count}
    texts = []
    for name, count in counts.items():
        if count == 1:
            texts.append(f"1 {name}")
        elif count > 1:
            texts.append(f"{count} {name}s")
    return " and ".join(texts)


def html_of(block: Block) -> str:
    """HTML of a headline: a paragraph for each of its lines, the first paragraph in larger letters."""
    texts = paragraphs(block)
    if not texts:
        texts = [""]
    first, *others = texts
    return f'<p class="headline">{first}</p>' + "".join(f"<p>{text}</p>" for text in others)


def _short_name(text: str) -> str:
    """HTML of a name, cut to its maximum length."""
    if len(text) > _MAX_NAME_LENGTH:
        text = f"{text[:_MAX_NAME_LENGTH]}…"
    return html.escape(visible(text))


def shares_svg(shares: Shares) -> str:
    """SVG of the share of its limit over time, a curve for each joint. The limit is a line; the largest curve is coloured.

    A long motion is divided into blocks of equally many rows. A curve shows the maximum of each block at its mean time.
    """
    time = shares.time
    rows_per_block = max(1, math.ceil(len(time) / _MAX_POINTS))
    blocks = [slice(k, k + rows_per_block) for k in range(0, len(time), rows_per_block)]
    values = np.nan_to_num(shares.values, nan=-1.0)  # below every share: nan has no maximum
    block_maxima = np.array([values[block].max(axis=0) for block in blocks])
    block_times = np.array([time[block].mean() for block in blocks])
    has_limit = (block_maxima >= 0).any(axis=0)
    top_share = max(_MIN_TOP_SHARE, _TOP_SPACE * float(block_maxima.max()))
    elapsed = block_times - block_times[0]
    duration = float(elapsed[-1])
    if duration == 0.0:  # a single block
        duration = 1.0
    plot_width = _WIDTH - _LEFT_MARGIN - _RIGHT_MARGIN
    plot_height = _HEIGHT - _BOTTOM_MARGIN
    x = _LEFT_MARGIN + plot_width * elapsed / duration
    x_texts = x.round(1).tolist()

    def y_of(share: Array | float) -> Any:
        """Height of a share in the picture, in pixels from the top; a list for an array."""
        y = plot_height * (1.0 - np.asarray(share) / top_share) + _TOP_MARGIN
        return y.round(1).tolist()

    maxima = block_maxima.max(axis=0)
    worst_joint = int(np.argmax(np.where(has_limit, maxima, -1.0)))
    other_joints = [joint for joint in np.flatnonzero(has_limit).tolist() if joint != worst_joint]
    curves = []
    for joint in [*other_joints, worst_joint]:  # the last curve is drawn above the others
        y_texts = y_of(block_maxima[:, joint])
        points = " ".join(f"{px},{py}" for px, py in zip(x_texts, y_texts, strict=True))
        style = Style.QUIET
        line_width = 1.0
        if joint == worst_joint:
            style = limit_style(float(maxima[joint]))
            line_width = 1.8
        colour = COLOURS[style].plot
        curves.append(f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="{line_width}"/>')
    y_limit = y_of(1.0)
    y_near = y_of(NEAR_LIMIT)
    texts = [  # digits are centred on their line
        f'<text x="2" y="{y_limit + _HALF_DIGIT_HEIGHT}">100 %</text>',
        f'<text x="2" y="{y_of(0.0) + _HALF_DIGIT_HEIGHT}">0</text>',
        f'<text x="{_LEFT_MARGIN}" y="{_HEIGHT}">{number(time[0])} s</text>',
        f'<text x="{_WIDTH - _RIGHT_MARGIN}" y="{_HEIGHT}" text-anchor="end">{number(time[-1])} s · '
        f"share of the limit of each joint, {_short_name(shares.names[worst_joint])} marked</text>",
    ]
    x_ends = f'x1="{_LEFT_MARGIN}" x2="{_WIDTH}"'
    limit_lines = [
        f'<line {x_ends} y1="{y_limit}" y2="{y_limit}" stroke="currentColor"/>',
        f'<line {x_ends} y1="{y_near}" y2="{y_near}" stroke="currentColor" stroke-dasharray="2 4"/>',
    ]
    return (
        f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT + _TOP_MARGIN}" role="img" '
        'aria-label="Share of the limit of each joint over time" '
        f'font-size="11" fill="currentColor">{"".join(limit_lines)}{"".join(curves)}{"".join(texts)}</svg>'
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
