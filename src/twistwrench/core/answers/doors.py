"""Pictures of answers, which are drawn above this package."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .answer import Answer
    from .page import Picture, Viewer


def pictures_of(answer: Answer) -> Iterable[Picture]:
    """Pictures of the page of an answer; none if matplotlib is not installed."""
    from ...viz.answers import pictures_of

    return pictures_of(answer)


def viewer_of(answer: Answer) -> Viewer | None:
    """Robot of an answer that can be moved; None if it cannot be shown."""
    from ...viz.answers import viewer_of

    return viewer_of(answer)


def plot(answer: Answer, kind: str | Path | None, path: str | Path | None) -> Any:
    """Draw a kind of picture of an answer."""
    from ...viz.answers import plot

    return plot(answer, kind, path)
