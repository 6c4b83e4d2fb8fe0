"""Frames of labelled poses, twists and wrenches: all that a sensor is told about is in {f}, or in its own axes {s}."""

from __future__ import annotations

from typing import Any

from ..errors import FrameError
from ..screws.pose import Pose
from ..screws.twist import Twist
from ..screws.wrench import Wrench

_KINDS: dict[str, type] = {"pose": Pose, "V": Twist, "dV": Twist}


def unlabelled(given: dict[str, Any], frame: str | None = None, *, turned: bool = False) -> dict[str, Any]:
    """The numbers of what is given by name, once the labels that there are agree; what has none passes untouched.

    ``pose``, ``V`` and ``dV`` are of {f}, whose name is ``frame`` where it is known. Anything else is a wrench in the
    sensor's axes {s}: those of {f}, unless the mounting is ``turned``. Raises :class:`~twistwrench.FrameError`.

    >>> unlabelled({"V": Twist([0, 0, 1, 0, 0, 0], "f"), "dV": None}, "f")["V"].tolist()
    [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    """
    own: dict[str, str] = {} if frame is None else {"the sensor": frame}
    read: dict[str, str] = {}
    plain = dict(given)
    for name, x in given.items():
        if not isinstance(x, Pose | Twist | Wrench):
            continue
        if not isinstance(x, kind := _KINDS.get(name, Wrench)):
            raise FrameError(f"{name} is a {type(x).__name__}, expected a {kind.__name__} or plain numbers.")
        plain[name] = x.matrix if isinstance(x, Pose) else x.values
        (own if name in _KINDS else read)[name] = x.of if isinstance(x, Pose) else x.frame
    if not turned:
        own, read = own | read, {}
    if len(set(own.values())) > 1:
        listed = ", ".join(f"{'pose of' if name == 'pose' else f'{name} in'} {f!r}" for name, f in own.items())
        raise FrameError(
            f"{listed}: a sensor's equation holds in one frame, that of the sensor. Move the others first, with a Pose."
        )
    for name, there in read.items():
        if there in own.values():
            raise FrameError(
                f"{name} in {there!r}: readings are in the sensor's own axes, which the mounting turns against {there!r}. "
                "Give them under a name of their own."
            )
    return plain
