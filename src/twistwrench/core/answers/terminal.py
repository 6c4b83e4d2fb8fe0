"""Blocks of an answer as text in the width of a terminal, with colours or without."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from io import StringIO
from typing import Any, TextIO

from rich import box, table
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
from rich.measure import Measurement
from rich.padding import Padding
from rich.segment import Segment
from rich.text import Text
from rich.tree import Tree

from ..colours import Style, terminal_style
from ..text import visible
from .blocks import Aligned, Block, Branch, Cell, Column, Headline, Level, Line, More, Piece, Remark, Table
from .shown_blocks import shown_blocks


class _Output(Console):
    """Console that escapes control characters, never truncates lines, and exits on a broken pipe."""

    def render(self, renderable: Any, options: Any = None) -> Any:
        for segment in super().render(renderable, options):
            yield segment if segment.control else Segment(visible(segment.text), segment.style)

    def on_broken_pipe(self) -> None:
        raise

    def print(self, *objects: Any, **options: Any) -> None:
        if any(isinstance(text, Text) and text.no_wrap for text in objects):  # Rich joins texts, and forgets it
            options = {"no_wrap": True, "overflow": "ignore", **options}
        super().print(*objects, **{"crop": False, **options})


def console() -> Console:
    """Console with the terminal's width; for files and pipes the width is COLUMNS or 80 characters."""
    return _Output(highlight=False)


_PLAIN_WIDTH, _MIN_WIDTH = 80, 40
"""Width of reports as text; least width of equations."""
MOST_LINES = 45
"""Lines of a short form at 80 columns."""
_ROWS = (10, 8, 6, 4, 3, 2)
"""Rows of a long table, fewer until the report fits."""


def as_text(blocks: Iterable[Block]) -> str:
    """Short form of a report in 80 columns, without colours."""
    return _plain(short_form(blocks, ".print(every=True)")).rstrip("\n")


def _plain(blocks: Iterable[Block]) -> str:
    """Blocks in 80 columns, without colours."""
    output = _Output(width=_PLAIN_WIDTH, file=StringIO(), highlight=False, color_system=None)
    with output.capture() as captured:
        _print(blocks, output)
    return captured.get()


def print_blocks(blocks: Iterable[Block], *, every: bool = False, file: TextIO | None = None) -> None:
    """Print a report in the width of the terminal, with colours where it has some."""
    output, hint = _Output(file=file, highlight=False), ".print(every=True)"
    _print(shown_blocks(blocks, every=True, hint=hint) if every else short_form(blocks, hint), output)


def short_form(blocks: Iterable[Block], hint: str) -> list[Block]:
    """Blocks of the short form, the same in every width: the most complete of at most 45 lines."""
    for shown in _short_forms(list(blocks), hint):
        if _plain(shown).count("\n") <= MOST_LINES:
            break
    return shown


def _short_forms(blocks: list[Block], hint: str) -> Iterator[list[Block]]:
    """Short forms, the most complete first: all rows, fewer rows, then without the last tables."""
    yield shown_blocks(blocks, every=False, hint=hint)
    for rows in _ROWS:
        yield shown_blocks(blocks, every=False, hint=hint, rows=rows)
    tables = sum(map(_is_short_table, blocks))
    for count in range(max(tables - 1, 1), 0, -1):
        first_tables = _with_first_tables(blocks, count)
        for rows in _ROWS:
            yield shown_blocks(first_tables, every=False, hint=hint, rows=rows, uncut_rows=rows)


def _is_short_table(block: Block) -> bool:
    """True for the tables and trees of the short form."""
    return isinstance(block, Table | Branch) and block.level <= Level.SHORT


def _with_first_tables(blocks: list[Block], count: int) -> list[Block]:
    """Blocks with so many tables; a last line names the others."""
    kept, titles = list[Block](), list[str]()
    for block in blocks:
        if not _is_short_table(block) or count > 0:
            count -= _is_short_table(block)
            kept.append(block)
        elif isinstance(block, Table):
            titles.append(re.split(r"[:,(]", block.title)[0].strip())
        else:
            titles.append("tree")
    if titles:
        kept.append(More(", ".join(titles)))
    return kept


def _print(blocks: Iterable[Block], output: Console) -> None:
    for block in blocks:
        output.print(renderable(block, output))


def renderable(block: Block, output: Console) -> RenderableType:
    """Rich renderable of a block; columns have their narrow form if the table would be too wide."""
    if isinstance(block, Table):
        tight = TerminalTable(block)
        tight.padding = (0, 0)
        width = Measurement.get(output, output.options.update(max_width=_UNBOUNDED_WIDTH), tight).maximum
        return TerminalTable(block, narrow=width > output.width)
    if isinstance(block, Branch):
        return _tree(block)
    if isinstance(block, Aligned):
        return _aligned_text(block, output.width)
    text = _text(block)
    if isinstance(block, Headline | Line) and block.whole:
        text.no_wrap = True
    if isinstance(block, Line) and block.indent:
        return Padding(text, (0, 0, 0, block.indent))
    return text


def _aligned_text(block: Aligned, width: int) -> Text:
    """Title in bold below a blank line, and the rows."""
    width = max(width, _MIN_WIDTH)
    title = "".join(f"\n{line}" for line in block.title_lines(width))
    rows = "\n".join(block.lines(width))
    between = "\n" if title and rows else ""
    return Text.assemble((title, terminal_style(Style.STRONG)), between, rows)


def _text(words: Headline | Remark | More | Cell) -> Text:
    if isinstance(words, str):
        return Text(words)
    if len(words.pieces) == 1 and not isinstance(words.pieces[0], str):  # style of the whole cell
        text, style = words.pieces[0]
        return Text(text, style=terminal_style(style))
    return Text.assemble(*map(_rich_piece, words.pieces))


def _rich_piece(piece: Piece) -> str | tuple[str, str]:
    if isinstance(piece, str):
        return piece
    return (piece[0], terminal_style(piece[1]))


def _tree(content: Branch, parent: Tree | None = None) -> Tree:
    label = _text(content.label)
    tree = Tree(label) if parent is None else parent.add(label)
    for branch in content.branches:
        _tree(branch, tree)
    return tree


# ── Tables: words at the left, numbers at the right

_UNBOUNDED_WIDTH = 10_000
"""Width in characters larger than any table."""
_MIN_PIECE_WIDTH = 8
"""Minimum number of characters per piece of a folded name."""


class TerminalTable(table.Table):
    """Table with one rule below its heads and a title on one line; text is not interpreted as markup."""

    def __init__(self, content: Table, *, narrow: bool = False) -> None:
        title = None
        if content.title:
            title = Text(content.title, style=terminal_style(content.style), no_wrap=True, overflow="ignore")
        super().__init__(box=box.SIMPLE_HEAD, title=title, title_justify="left", pad_edge=False)
        columns = list(content.columns)
        if narrow:
            columns = [column.narrow or column for column in content.columns if not column.wide_only]
        self._folding: list[list[Text]] = []
        """Cells of the foldable columns."""
        cells: list[list[Text]] = []
        for column in columns:
            texts = [_text(column.show(value)) for value in column.values]
            self._add(column, texts)
            cells.append(texts)
            if column.words and not column.whole:
                self._folding.append(texts)
        for row, style in zip(zip(*cells, strict=True), content.styles, strict=True):
            self.add_row(*row, style=terminal_style(style))

    def _add(self, column: Column, texts: list[Text]) -> None:
        # Rich's option for unbroken cells would take all width from the other columns.
        for text in texts:
            text.no_wrap = column.whole or None
        if column.whole:
            lines = "\n".join(text.plain for text in texts).split("\n")
            widths = [cell_len(line) for line in lines]
        else:
            pieces = " ".join(text.plain for text in texts).split()
            widths = [min(cell_len(piece), _MIN_PIECE_WIDTH) for piece in pieces]
        if column.min_width is not None:
            widths.append(column.min_width)
        elif not column.words:
            widths.append(max(map(cell_len, column.head.split()), default=0))
        self.add_column(
            Text(column.head),
            justify="left" if column.words else "right",
            overflow="fold" if column.words else "ellipsis",
            style=terminal_style(column.style),
            min_width=max(widths, default=None),
        )

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Render the table; in narrow consoles without padding, and only then with names folded at their separators."""
        excess = self._excess(console, options)
        if excess > 0:
            self.padding = (0, 0)
            excess = self._excess(console, options)
        if excess > 0:
            self._fold_names(excess)
        yield from super().__rich_console__(console, options)

    def _fold_names(self, excess: int) -> None:
        """Fold names in the widest columns, as little as makes the table narrower by the excess, but no part of a name."""
        columns = [texts for texts in self._folding if texts]
        longest = [
            max(cell_len(line) for text in texts for line in text.plain.splitlines() or [""]) for texts in columns
        ]
        longest_part = [max(cell_len(part) for text in texts for part in _parts(text.plain)) for texts in columns]
        widths = longest
        for width in range(max(longest, default=0), 0, -1):
            widths = [max(part, min(whole, width)) for whole, part in zip(longest, longest_part, strict=True)]
            if sum(longest) - sum(widths) >= excess:
                break
        for texts, width in zip(columns, widths, strict=True):
            for text in texts:
                text.plain = _fold(text.plain, width)

    def _excess(self, console: Console, options: ConsoleOptions) -> int:
        """Characters by which the table is wider than the console."""
        return Measurement.get(console, options.update(max_width=_UNBOUNDED_WIDTH), self).maximum - options.max_width


def _parts(name: str) -> list[str]:
    """Parts of a name, each with its trailing separator."""
    return re.findall(r"[^_\-./\s]*[_\-./]|[^_\-./\s]+", name) or [""]


def _fold(name: str, width: int) -> str:
    """Break a name between its parts into lines of at most this width."""
    if cell_len(name) <= width or " " in name:
        return name
    lines = [""]
    for part in _parts(name):
        if lines[-1] and cell_len(lines[-1] + part) > width:
            lines.append("")
        lines[-1] += part
    return "\n".join(lines)
