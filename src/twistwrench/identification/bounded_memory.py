"""Things that are made once and kept while there is room for them; those used longest ago go first."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

Made = TypeVar("Made")


class BoundedMemory(Generic[Made]):
    """What was made, by its key, up to so many bytes, and the two last used whatever they take.

    Parameters
    ----------
    most : int [bytes]
    size : callable, bytes that one takes

    Examples
    --------
    >>> kept = BoundedMemory(10, len)
    >>> [kept.of(key, lambda n=key: "x" * n) for key in (4, 5, 6)], sorted(kept.keys)
    (['xxxx', 'xxxxx', 'xxxxxx'], [5, 6])
    """

    def __init__(self, most: int, size: Callable[[Made], int]) -> None:
        self._most, self._size = most, size
        self._made: dict[Hashable, Made] = {}

    @property
    def keys(self) -> list[Hashable]:
        """Of what is kept, the last used last."""
        return list(self._made)

    def of(self, key: Hashable, make: Callable[[], Made]) -> Made:
        """What is kept under the key, or is made now."""
        found = self._made.pop(key) if key in self._made else make()
        self._made[key] = found
        while len(self._made) > 2 and sum(map(self._size, self._made.values())) > self._most:
            self._made.pop(next(iter(self._made)))
        return found
