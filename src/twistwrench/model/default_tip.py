"""The tip: the frame that is meant when none is named."""

from __future__ import annotations

from ..errors import UnknownNameError
from .model import Model


def default_tip(model: Model) -> str | None:
    """The last leaf in document order on the last moving body, where the moving joints form one chain; else None."""
    if any(body.parent != i - 1 for i, body in enumerate(model.bodies)):
        return None
    last = len(model.bodies) - 1
    return next((name for name in reversed(model.leaves) if model.frames[name].body == last), None)


def check_tip(model: Model, tip: str | None) -> str | None:
    """``tip`` if the model has such a frame, the default for None; raises :class:`~twistwrench.UnknownNameError`."""
    if tip is None:
        return default_tip(model)
    if tip not in model.all_frames:
        raise UnknownNameError.of("frame", tip, model.all_frames)
    return tip
