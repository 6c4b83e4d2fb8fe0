"""Where bodies are, from the model's numbers: the one place where joints become rotations and places.

Works over any arithmetic: sums of products in :mod:`.trig_sum`, SymPy expressions, floats.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from ..joints.chart import CosineSine, exact, exact_rodrigues
from ..model.model import Body
from ..typing import Array
from .symbols import BodyEntries, Entry


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
    joint, first = body.joint, body.v_index
    if not joint.moves_body:
        R, p = exact(np.eye(3)), numbers_of(arithmetic, (Entry(0.0),) * 3)
    elif joint.nv == 1:
        R, p = _screw(arithmetic, body, entries)
    else:
        R, p = joint.chart_pose(chart_waves(arithmetic, body), lambda k: arithmetic.coordinate(first + k))
    return R0 @ R, p0 + R0 @ p


def chart_waves(arithmetic: Arithmetic, body: Body) -> CosineSine:
    """Cosine and sine of the entries of a joint's chart."""
    return lambda k: arithmetic.cosine_sine(body.v_index + k, 1.0, 0.0)


def _screw(arithmetic: Arithmetic, body: Body, entries: BodyEntries) -> tuple[Array, Array]:
    w, v = body.joint.axes[0, :3], body.joint.axes[0, 3:]
    k, rate = body.v_index, float(np.linalg.norm(w))
    rate = 1.0 if abs(rate - 1.0) < 1e-15 else rate
    x = exact(body.ratio) * arithmetic.coordinate(k) + exact(body.offset)
    if rate == 0.0:
        return exact(np.eye(3)), exact(v) * x
    w = w / rate
    R = exact_rodrigues(w, *arithmetic.cosine_sine(k, rate * body.ratio, rate * body.offset))
    at, pitch = numbers_of(arithmetic, entries.point), arithmetic.number(entries.pitch)
    return R, at - R @ at + exact(w) * (pitch * (exact(rate) * x))
