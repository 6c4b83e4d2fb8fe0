"""How far work of several steps has come, as one share from 0 to 1."""

from __future__ import annotations

from collections.abc import Callable, Sequence


class Steps:
    """Steps of known weight, one after the other; ``progress`` is told the share of all that is done, None tells nobody."""

    def __init__(self, progress: Callable[[float], None] | None, weights: Sequence[float]) -> None:
        self._progress = progress
        self._left = [w / sum(weights) for w in weights]
        self._begin = self._end = 0.0

    def next(self, size: int | None = None) -> Callable[[float], None] | None:
        """Begin the next step; what is to be told the share of it that is done, or, of ``size``, each portion done."""
        self.skip(1)
        if self._progress is None:
            return None
        begin, end, progress = self._begin, self._end, self._progress
        done = 0.0

        def tell(share: float) -> None:
            progress(begin + (end - begin) * min(share, 1.0))

        def add(portion: float) -> None:
            nonlocal done
            done += portion
            tell(done / size if size else 1.0)

        return tell if size is None else add

    def skip(self, count: int) -> None:
        """Pass over steps."""
        for _ in range(count):
            self._begin, self._end = self._end, self._end + self._left.pop(0)

    def done(self) -> None:
        """All is done, whatever was left."""
        if self._progress is not None:
            self._progress(1.0)
