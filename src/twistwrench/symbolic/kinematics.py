"""Where bodies are, from the model's numbers: the one place where joints become rotations and places.

Works over any arithmetic: sums of products in :mod:`.trig_sum`, SymPy expressions, floats.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..model.model import Body
from .parameters import BodyEntries, Entry

Array = NDArray[Any]

__all__ = ["Arithmetic", "joint_motion", "numbers_of"]


class Arithmetic(Protocol):
    """What kinematics needs of the things it calculates with."""

    def number(self, entry: Entry) -> Any:
        """A number of the model, or its symbol."""

    def coordinate(self, k: int) -> Any:
        """The k-th coordinate itself."""

    def cosine_sine(self, k: int, rate: float, offset: float) -> tuple[Any, Any]:
        """Of ``rate`` times the k-th coordinate plus ``offset``."""


def numbers_of(arithmetic: Arithmetic, entries: Any) -> Array:
    """An array of entries in this arithmetic."""
    array = np.empty(np.shape(entries), object)
    for place in np.ndindex(array.shape):
        entry = entries
        for k in place:
            entry = entry[k]
        array[place] = arithmetic.number(entry)
    return array


def joint_motion(arithmetic: Arithmetic, body: Body, entries: BodyEntries) -> tuple[Array, Array]:
    """R (3, 3) and p (3,), pose of a body's frame in its parent's; MR eq. 3.51 and 3.88."""
    R0, p0 = exact(body.placement[:3, :3]), numbers_of(arithmetic, entries.place)
    joint, k = body.joint, body.v_index
    if joint.kind == "floating":
        cs = [arithmetic.cosine_sine(k + n, 1.0, 0.0) for n in (3, 4, 5)]
        R = _turn(np.eye(3)[2], *cs[0]) @ _turn(np.eye(3)[1], *cs[1]) @ _turn(np.eye(3)[0], *cs[2])
        p = np.array([arithmetic.coordinate(k + n) for n in range(3)], object)
    elif joint.kind == "rotor":  # a body of revolution looks the same however it has turned: its frame stays behind
        R, p = exact(np.eye(3)), numbers_of(arithmetic, (Entry(0.0),) * 3)
    elif joint.kind == "planar":
        normal, e1, e2 = joint.axes[0, :3], joint.axes[1, 3:], joint.axes[2, 3:]
        R = _turn(normal, *arithmetic.cosine_sine(k + 2, 1.0, 0.0))
        p = exact(e1) * arithmetic.coordinate(k) + exact(e2) * arithmetic.coordinate(k + 1)
    else:
        R, p = _screw(arithmetic, body, entries)
    return R0 @ R, p0 + R0 @ p


def _screw(arithmetic: Arithmetic, body: Body, entries: BodyEntries) -> tuple[Array, Array]:
    w, v = body.joint.axes[0, :3], body.joint.axes[0, 3:]
    k, rate = body.v_index, float(np.linalg.norm(w))
    rate = 1.0 if abs(rate - 1.0) < 1e-15 else rate
    x = exact(body.ratio) * arithmetic.coordinate(k) + exact(body.offset)
    if rate == 0.0:
        return exact(np.eye(3)), exact(v) * x
    w = w / rate
    R = _turn(w, *arithmetic.cosine_sine(k, rate * body.ratio, rate * body.offset))
    at, pitch = numbers_of(arithmetic, entries.point), arithmetic.number(entries.pitch)
    return R, at - R @ at + exact(w) * (pitch * (exact(rate) * x))


def _turn(w: Array, cosine: Any, sine: Any) -> Array:
    """Rodrigues' formula about a unit vector, sorted so that axis-aligned ones fold to four entries."""
    along = np.outer(w, w)
    W = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    return exact(along) + exact(np.eye(3) - along) * cosine + exact(W) * sine


def exact(values: Any) -> Any:
    """Floats as Python numbers, whole ones as integers, so that 0 and ±1 leave nothing behind in SymPy."""
    if np.ndim(values) == 0:
        x = float(values)
        return int(x) if x.is_integer() else x
    array = np.empty(np.shape(values), object)
    for place in np.ndindex(array.shape):
        array[place] = exact(np.asarray(values)[place])
    return array
