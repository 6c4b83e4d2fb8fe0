"""Lists of names in a sentence, cut short where they are long: the one place of how that reads."""

from __future__ import annotations

from collections.abc import Iterable

MOST = 12
"""Names that are listed where no other count is asked for."""


def listed(items: Iterable[object], most: int = MOST, between: str = ", ") -> str:
    """The first items, and how many more there are.

    >>> listed(["elbow", "wrist"]), listed("abcde", 2), listed("abcde", 2, "; ")
    ('elbow, wrist', 'a, b and 3 more', 'a; b; and 3 more')
    """
    texts = [*map(str, items)]
    more = len(texts) - most
    tail = f"{between.rstrip().strip(',')} and {more} more" if more > 0 else ""
    return between.join(texts[:most]) + tail
