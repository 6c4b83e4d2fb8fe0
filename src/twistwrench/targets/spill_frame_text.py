"""The frame of a long program, as text: vectors read and written, constant results put in, rows of results made of it."""

from __future__ import annotations

from collections.abc import Sequence

from .lanes import RowStorer
from .llvm_text import LlvmWriter


def _at(w: LlvmWriter, home: int | str, base: str) -> str:
    """The place of a vector of the frame."""
    size = w.lanes * w.precision.bytes
    return w.at(base, home * size if isinstance(home, int) else w.new(f"mul i64 {home}, {size}"))


def load_home(w: LlvmWriter, home: int | str, base: str = "%frame") -> str:
    """A vector from its place in the frame, or behind another ``base`` in it."""
    return w.new(f"load {w.vector}, ptr {_at(w, home, base)}, align {w.lanes * w.precision.bytes}")


def store_home(w: LlvmWriter, value: str, home: int | str, base: str = "%frame") -> None:
    """A vector to its place."""
    w.do(f"store {w.vector} {value}, ptr {_at(w, home, base)}, align {w.lanes * w.precision.bytes}")


def frame_to_rows(w: LlvmWriter, base: str, columns: int, entry: int, label: str, zeros: str = "") -> str:
    """Make rows of the vectors from ``entry`` on: tiles in a loop, then the last, which ends with the row.

    Takes the label control comes from and returns the one it is in afterwards. ``zeros``: a table as :func:`zero_tiles` makes.
    """
    whole = RowStorer(w, base, columns)
    if not whole.starts:  # too narrow for tiles
        for c in range(columns):
            whole.put(c, load_home(w, entry + c))
        return label
    with w.loop(str(columns // whole.span), label) as tile:
        first = w.new(f"mul i64 {tile}, {whole.span}")
        if zeros:
            full, empty, stored = w.label("full"), w.label("empty"), w.label("stored")
            nothing = w.new(f"load i1, ptr {w.at(f'@{zeros}', tile)}, align 1")
            w.do(f"br i1 {nothing}, label %{empty}, label %{full}")
            w.begin(empty)
            place = w.at(base, w.new(f"mul i64 {first}, {w.precision.bytes}"))
            RowStorer(w, place, columns).clear()
            w.do(f"br label %{stored}")
            w.begin(full)
        _tile(w, base, columns, first, w.new(f"add i64 {first}, {entry}"))
        if zeros:
            w.do(f"br label %{stored}")
            w.begin(stored)
    label = w.after
    if columns % whole.span:
        last = columns - whole.span
        _tile(w, base, columns, str(last), w.new(f"add i64 0, {entry + last}"))
    return label


def zero_tiles(name: str, zero: Sequence[bool], span: int) -> str:
    """A table of which tiles of a row are all zeros; empty if none is."""
    tiles = [all(zero[k : k + span]) for k in range(0, len(zero) - span + 1, span)]
    if not any(tiles):
        return ""
    return f"@{name} = internal constant [{len(tiles)} x i8] [{', '.join(f'i8 {int(t)}' for t in tiles)}]"


def _tile(w: LlvmWriter, base: str, columns: int, first: str, entry: str) -> None:
    place = w.at(base, w.new(f"mul i64 {first}, {w.precision.bytes}"))
    storer = RowStorer(w, place, columns)
    for c in range(storer.span):
        storer.put(c, load_home(w, w.new(f"add i64 {entry}, {c}")))


def preparation(w: LlvmWriter, constants: Sequence[tuple[int, int, float]], name: str = "prepare") -> str:
    """Put constant entries of the results into the frame; the blocks of a call leave them alone. ``w`` is a fresh one."""
    label = "entry"
    for first, count, value in constants:
        with w.loop(str(count), label) as k:
            store_home(w, w.splat(value), w.new(f"add i64 {k}, {first}"))
        label = w.after
    body = "\n".join(w.lines)
    return f"define internal void @{name}(ptr %frame) noinline {{\nentry:\n{body}\n  ret void\n}}\n"
