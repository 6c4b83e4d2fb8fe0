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
        """Segments of Rich, with control characters of their texts as escapes."""
        for segment in super().render(renderable, options):
            text = visible(segment.text)
            if segment.control or text == segment.text:  # Rich's own codes, or nothing to escape
                yield segment
            else:
                yield Segment(text, segment.style)

    def on_broken_pipe(self) -> None:
        """Raise the error again, so that the command ends with its exit code; Rich would exit with another one."""
        raise  # called while the error is handled

    def print(self, *objects: Any, **options: Any) -> None:
        """Print without cutting lines, and without wrapping if a text is marked ``no_wrap``."""
        must_not_wrap = any(isinstance(text, Text) and text.no_wrap for text in objects)
        if must_not_wrap:  # Rich joins the texts, and loses their mark
            options = {"no_wrap": True, "overflow": "ignore", **options}
        super().print(*objects, **{"crop": False, **options})


def console() -> Console:
    """Console with the terminal's width; for files and pipes the width is COLUMNS or 80 characters."""
    return _Output(highlight=False)


_TEXT_WIDTH = 80
"""Width of reports as text [columns]."""
_MIN_EQUATION_WIDTH = 40
"""Least width of equations [columns]."""
MAX_LINES = 45
"""Maximum number of lines of a short form at 80 columns."""
_ROW_COUNTS = (10, 8, 6, 4, 3, 2)
"""Numbers of rows of a long table that are tried, one after the other, until the report fits."""


def as_text(blocks: Iterable[Block]) -> str:
    """Short form of a report in 80 columns, without colours."""
    output = _plain_output()
    with output.capture() as captured:
        _print(short_form(blocks, ".print(every=True)"), output)
    return captured.get().rstrip("\n")


def _plain_output() -> _Output:
    """Console of 80 columns without colours, for text that is captured."""
    return _Output(width=_TEXT_WIDTH, file=StringIO(), highlight=False, color_system=None)


def print_blocks(blocks: Iterable[Block], *, every: bool = False, file: TextIO | None = None) -> None:
    """Print a report in the width of the terminal, with colours if the terminal has some; with ``every`` in full."""
    output = _Output(file=file, highlight=False)
    hint = ".print(every=True)"
    if every:
        shown = shown_blocks(blocks, every=True, hint=hint)
    else:
        shown = short_form(blocks, hint)
    _print(shown, output)


def short_form(blocks: Iterable[Block], hint: str) -> list[Block]:
    """Blocks of the short form: the most complete one of at most 45 lines, or else the shortest.

    Lines are counted at 80 columns, so the form is the same at every width. The ``hint`` says how to see everything.
    """
    output = _plain_output()
    for form in _short_forms(list(blocks), hint):
        if _fits_on_a_screen(form, output):
            break
    return form


def _fits_on_a_screen(blocks: Iterable[Block], output: _Output) -> bool:
    """True if blocks have at most 45 lines; those behind the 45th are not counted."""
    line_count = 0
    for block in blocks:
        with output.capture() as captured:
            output.print(renderable(block, output))
        line_count += captured.get().count("\n")
        if line_count > MAX_LINES:
            return False
    return True


def _short_forms(blocks: list[Block], hint: str) -> Iterator[list[Block]]:
    """Short forms, the most complete first: with all rows, with fewer rows, without the last tables."""
    yield shown_blocks(blocks, every=False, hint=hint)
    for row_count in _ROW_COUNTS:
        yield shown_blocks(blocks, every=False, hint=hint, rows=row_count)
    table_count = sum(map(_is_short_table, blocks))
    largest_reduced_count = max(table_count - 1, 1)
    for reduced_count in range(largest_reduced_count, 0, -1):
        blocks_with_first_tables = _with_first_tables(blocks, reduced_count)
        for row_count in _ROW_COUNTS:
            yield shown_blocks(blocks_with_first_tables, every=False, hint=hint, rows=row_count, uncut_rows=row_count)


def _is_short_table(block: Block) -> bool:
    """True for a table or tree of the short form."""
    return isinstance(block, Table | Branch) and block.level <= Level.SHORT


def _with_first_tables(blocks: list[Block], count: int) -> list[Block]:
    """Blocks without the tables and trees after the first ``count``; a last line names the omitted ones."""
    remaining_blocks = list[Block]()
    omitted_titles = list[str]()
    table_count = 0  # so far
    for block in blocks:
        is_short_table = _is_short_table(block)
        if is_short_table:
            table_count += 1
        if not is_short_table or table_count <= count:
            remaining_blocks.append(block)
        elif isinstance(block, Table):
            omitted_titles.append(block.title)
        else:
            omitted_titles.append("tree")
    if omitted_titles:
        remaining_blocks.append(More(", ".join(omitted_titles)))
    return remaining_blocks


def _print(blocks: Iterable[Block], output: Console) -> None:
    """Print blocks one below the other."""
    for block in blocks:
        output.print(renderable(block, output))


def renderable(block: Block, output: Console) -> RenderableType:
    """Rich renderable of a block; a table has its narrow columns if it is too wide even without padding."""
    if isinstance(block, Table):
        table_without_padding = TerminalTable(block)
        table_without_padding.padding = (0, 0)
        is_too_wide = table_without_padding.excess_width(output, output.options) > 0
        return TerminalTable(block, narrow=is_too_wide)
    if isinstance(block, Branch):
        return _rich_tree(block)
    if isinstance(block, Aligned):
        return _aligned_text(block, output.width)
    text = _rich_text(block)
    if isinstance(block, Headline | Line) and block.whole:
        text.no_wrap = True
    if isinstance(block, Line) and block.indent:
        return Padding(text, (0, 0, 0, block.indent))
    return text


def _aligned_text(block: Aligned, width: int) -> Text:
    """Title in bold below a blank line, and the rows."""
    width = max(width, _MIN_EQUATION_WIDTH)
    title = "".join(f"\n{line}" for line in block.title_lines(width))
    rows = "\n".join(block.lines(width))
    separator = "\n" if title and rows else ""
    return Text.assemble((title, terminal_style(Style.STRONG)), separator, rows)


def _rich_text(content: Headline | Remark | More | Cell) -> Text:
    """Rich text of a block or cell; a single styled piece gives its style to the whole text."""
    if isinstance(content, str):
        return Text(content)
    if len(content.pieces) == 1 and not isinstance(content.pieces[0], str):
        text, style = content.pieces[0]
        return Text(text, style=terminal_style(style))
    return Text.assemble(*map(_rich_piece, content.pieces))


def _rich_piece(piece: Piece) -> str | tuple[str, str]:
    """Piece of a text for Rich: text, or text with the terminal's style."""
    if isinstance(piece, str):
        return piece
    text, style = piece
    return (text, terminal_style(style))


def _rich_tree(content: Branch, parent: Tree | None = None) -> Tree:
    """Rich tree of a branch and all its branches, added to the tree ``parent`` if there is one."""
    label = _rich_text(content.label)
    tree = Tree(label) if parent is None else parent.add(label)
    for branch in content.branches:
        _rich_tree(branch, tree)
    return tree


# ── Tables: columns of words are left-aligned, columns of numbers right-aligned

_UNBOUNDED_WIDTH = 10_000
"""Width in characters larger than any table."""
_MIN_PIECE_WIDTH = 8
"""Upper bound of the least width of a column of words, in characters; longer names are folded."""


class TerminalTable(table.Table):
    """Rich table with one rule below its heads and a title on one line; text is not interpreted as markup."""

    def __init__(self, content: Table, *, narrow: bool = False) -> None:
        title = None
        if content.heading:
            title = Text(content.heading, style=terminal_style(content.style), no_wrap=True, overflow="ignore")
        super().__init__(box=box.SIMPLE_HEAD, title=title, title_justify="left", pad_edge=False)
        columns = list(content.columns)
        if narrow:
            columns = [column.narrow or column for column in content.columns if not column.wide_only]
        self._foldable_columns: list[list[Text]] = []
        """Cells of each column whose names may be folded."""
        cells_of_columns: list[list[Text]] = []
        for column in columns:
            texts = [_rich_text(column.show(value)) for value in column.values]
            self._add(column, texts)
            cells_of_columns.append(texts)
            if column.words and not column.whole:
                self._foldable_columns.append(texts)
        rows = zip(*cells_of_columns, strict=True)
        for row, style in zip(rows, content.styles, strict=True):
            self.add_row(*row, style=terminal_style(style))

    def _add(self, column: Column, texts: list[Text]) -> None:
        """Add a column with the least width at which its cells can be read."""
        # Cells that stay whole are marked one by one: Rich's option for a column would take all width from the others.
        for text in texts:
            text.no_wrap = column.whole or None  # None: as Rich has it by default
        if column.whole:
            lines = "\n".join(text.plain for text in texts).split("\n")  # of all cells
            widths = [cell_len(line) for line in lines]
        else:
            words = " ".join(text.plain for text in texts).split()
            widths = [min(cell_len(word), _MIN_PIECE_WIDTH) for word in words]
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
        """Render the table. If it is too wide it has no padding, and if this is not enough, names are folded."""
        excess = self.excess_width(console, options)
        if excess > 0:
            self.padding = (0, 0)
            excess = self.excess_width(console, options)
        if excess > 0:
            self._fold_names(excess)
        yield from super().__rich_console__(console, options)

    def _fold_names(self, excess: int) -> None:
        """Fold names in the widest columns between their parts, until the table is narrower by the excess or no name folds.

        Columns wider than a common width get this width, or the width of their longest part of a name if that is larger. The
        largest common width that is small enough is used.
        """
        columns = [texts for texts in self._foldable_columns if texts]
        full_widths = []
        min_widths = []
        for texts in columns:
            lines = "\n".join(text.plain for text in texts).splitlines()
            full_widths.append(max(map(cell_len, lines), default=0))
            parts = [part for text in texts for part in _name_parts(text.plain)]
            min_widths.append(max(map(cell_len, parts)))
        widths = full_widths
        for common_width in range(max(full_widths, default=0), 0, -1):
            widths = [max(least, min(full, common_width)) for full, least in zip(full_widths, min_widths, strict=True)]
            if sum(full_widths) - sum(widths) >= excess:
                break
        for texts, width in zip(columns, widths, strict=True):
            for text in texts:
                text.plain = _fold_name(text.plain, width)

    def excess_width(self, console: Console, options: ConsoleOptions) -> int:
        """Number of characters by which the table is wider than the console; negative if it fits."""
        unbounded = options.update(max_width=_UNBOUNDED_WIDTH)
        return Measurement.get(console, unbounded, self).maximum - options.max_width


def _name_parts(name: str) -> list[str]:
    """Parts of a name between _, -, . and /, each with the separator after it; one empty part for an empty name."""
    return re.findall(r"[^_\-./\s]*[_\-./]|[^_\-./\s]+", name) or [""]


def _fold_name(name: str, width: int) -> str:
    """Name broken between its parts into lines of at most this width; text with blanks is left to Rich."""
    if cell_len(name) <= width or " " in name:
        return name
    lines = [""]
    for part in _name_parts(name):
        if lines[-1] and cell_len(lines[-1] + part) > width:
            lines.append("")
        lines[-1] += part
    return "\n".join(lines)
