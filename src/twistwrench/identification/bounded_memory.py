"""Things that are made once and kept while there is room for them; those used longest ago go first."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

Made = TypeVar("Made")


class BoundedMemory(Generic[Made]):
    """What was made, by its key, up to so many bytes, and the last one whatever it takes.

    Room is made beforehand for one more as large as the largest.

    Parameters
    ----------
    most : int [bytes]
    size : callable, bytes that one takes

    Examples
    --------
    >>> kept = BoundedMemory(10, len)
    >>> [kept.of(key, lambda n=key: "x" * n) for key in (2, 4, 4, 5)], sorted(kept.keys)
    (['xx', 'xxxx', 'xxxx', 'xxxxx'], [4, 5])
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
        if key in self._made:
            found = self._made.pop(key)
        else:
            self._keep_below(self._most - max(map(self._size, self._made.values()), default=0), 0)
            found = make()
        self._made[key] = found
        self._keep_below(self._most, 1)
        return found

    def _keep_below(self, most: int, fewest: int) -> None:
        while len(self._made) > fewest and sum(map(self._size, self._made.values())) > most:
            self._made.pop(next(iter(self._made)))
