"""Argument checks of labelled vectors in a body's equations: kinds as they must be, and one frame for all of them."""

from __future__ import annotations

from typing import Any

from ..core import arguments
from ..errors import FrameError
from ..screws.pose import Pose
from ..screws.twist import Twist
from ..screws.wrench import Wrench
from ..typing import Array

_KINDS: dict[str, type[Twist | Wrench | Pose]] = {"F": Wrench, "wrench": Wrench, "T0": Pose}
"""What each argument is, if labelled; all others are twists and their rates."""


def common_frame(known: str | None = None, **given: Any) -> str | None:
    """The body's frame that the labelled ones among ``given`` name, a pose by the frame it is of; None where none does.

    ``known`` is the frame as far as it is known already. Raises FrameError for two frames, and for one kind in another's
    place. What has no label is passed over.
    """
    frames = {} if known is None else {"the body": known}
    for name, x in given.items():
        if isinstance(x, Twist | Wrench | Pose):
            kind = _KINDS.get(name, Twist)
            if not isinstance(x, kind):
                raise FrameError(f"{name} is a {kind.__name__}, not a {type(x).__name__}.")
            frames[f"{name} = {x.symbol}" if isinstance(x, Pose) else name] = x.of if isinstance(x, Pose) else x.frame
    if len(set(frames.values())) > 1:
        listed = ", ".join(f"{name} {'of' if '=' in name else 'in'} {frame!r}" for name, frame in frames.items())
        raise FrameError(f"{listed}: a body's equations hold in one frame. Move one first, with a Pose between them.")
    return next(iter(frames.values()), None)


def numbers(**vectors: Any) -> list[Array]:
    """The numbers (..., 6), those of labelled twists and wrenches once their kinds and frames are found to agree."""
    common_frame(**vectors)
    return [arguments.real(x, name, 6) for name, x in vectors.items()]
