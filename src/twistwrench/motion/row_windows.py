"""A stream of rows, cut into overlapping windows: bounded memory for what needs a row's neighbours."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from ..typing import Array


def windows(blocks: Iterable[Array], core: int, margin: int) -> Iterator[tuple[Array, slice]]:
    """Windows of up to ``core`` rows that follow one another, with up to ``margin`` more rows on either side.

    Yields the rows of each window and the slice of them that is the core. Cores begin at multiples of ``core`` whatever
    the sizes of ``blocks``; the last may be longer than the others by up to ``margin``, so that it is no mere scrap.
    """
    held: list[Array] = []
    count = begin = 0  # rows held, and where among them the next core begins
    for block in blocks:
        held.append(block)
        count += len(block)
        while count >= begin + core + margin:
            rows = np.concatenate(held)
            yield rows[: begin + core + margin], slice(begin, begin + core)
            drop = max(0, begin + core - margin)
            held, count, begin = [rows[drop:]], count - drop, begin + core - drop
    if count > begin:
        yield np.concatenate(held), slice(begin, count)
