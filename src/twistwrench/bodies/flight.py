"""Free motion of one rigid body, and how far its invariants drifted.

The body is integrated in principal axes at its centre of mass, where it turns and travels independently. The state is
the pose and the *spatial* momentum: without a wrench the momentum is a constant, not something to integrate, the centre of
mass moves on a straight line, and only the rotation takes steps (:mod:`twistwrench.bodies.splitting`). A wrench acts as
impulses between half steps of free motion, each an implicit midpoint rule in the momentum, so that the whole stays
symmetric, the orders of the compositions hold for wrenches that depend on velocity too, and work is exactly the gain of energy.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.probe_rule import probe_spacing
from ..errors import InertiaError, ValueRangeError
from ..lie import se3
from .flight_arguments import WrenchLaw, called, constant, six, steps
from .flight_integration import FreeBody, adaptive, pushed, torque_free
from .flight_probes import Unseen
from .flight_record import Flight
from .inertia import SpatialInertia
from .labelled_arguments import common_frame
from .splitting import COMPOSITIONS

_STAGES = 3.0
"""Steps of DOP853 in spacings of the probes: its stages are nowhere further apart than 0.27 of a step."""


def fly(
    inertia: SpatialInertia,
    T0: ArrayLike,
    V0: ArrayLike,
    duration: float,
    dt: float,
    wrench: ArrayLike | WrenchLaw | None = None,
    *,
    order: int = 4,
    tolerance: float | None = None,
    every: int = 1,
) -> Flight:
    """Free motion of a body from pose T0 (4, 4) and body twist V0 (6,).

    Parameters
    ----------
    T0, V0: may be labelled, a Pose of {b} and a Twist in {b}.
    duration, dt: s; ``dt`` is shortened so that a whole number of steps fills the duration: 0.3 s becomes 0.25 s in 1 s.
    wrench: in {b}: constant (6,), or a function ``wrench(t, T, V)`` of time, T_sb and V_b; none is torque-free flight. It may
        be labelled, or give a labelled one; T and V are plain arrays.
    order: 2, 4 or 6: the error of the motion falls as that power of dt. A body with two equal moments moves exactly.
    tolerance: relative error per step; given, the steps are SciPy's DOP853 and adapt, and ``dt`` only spaces the record.
        The spatial momentum of torque-free flight stays exact, the energy slowly drifts.
    every: keep one state in so many, and the last.

    A wrench that is a function is asked at further times within each step, eight at least, less than ``dt`` and a thousandth
    of the duration apart; with a tolerance, steps are short enough for that. A shorter pulse may be missed. Steps that were
    shortened, in which the body turns by more than 1 rad, in which the wrench changes unseen, or that lose more than 1 % of the
    energy, are said in ``flight.remarks`` and wherever a flight or its drift is printed. No warning is raised.

    Raises
    ------
    ShapeError, ValueRangeError: for arguments of the wrong shape, not finite, a T0 that is not a pose, or a function that
        does not take (t, T, V).
    FrameError: for labels that name two body frames, or a twist for a wrench.
    InertiaError: for a body without inertia about some axis.
    """
    moments, axes = inertia.principal()
    if not (inertia.mass > 0 and moments[0] > 1e-14 * moments[2]):
        raise InertiaError(
            f"a body of mass {inertia.mass:g} kg with principal moments {moments.tolist()} kg m² has no definite rotation. "
            "Give it mass, and some thickness."
        )
    body = FreeBody(float(inertia.mass), moments, se3.pose(axes, inertia.com))
    n = steps(duration, dt, every)
    h = float(duration) / n
    if arguments.number(order, "order") not in COMPOSITIONS:
        raise ValueRangeError(f"order {order} is not available; choose one of {sorted(COMPOSITIONS)}.")
    if tolerance is not None and not 1e-13 <= arguments.number(tolerance, "tolerance") <= 1e-2:
        raise ValueRangeError(f"tolerance is {tolerance}, and must be between 1e-13 and 1e-2.")
    frame = common_frame(T0=T0, V0=V0, wrench=wrench)
    pose = arguments.pose(arguments.finite(arguments.one(T0, "T0", 4, 4), "T0", 4, 4), "T0")
    start = body.state(pose, six("V0", V0))
    kept = np.append(np.arange(0, n, every), n)
    law = None if wrench is None else called(wrench, frame) if callable(wrench) else constant(wrench)
    spacing = probe_spacing(h, float(duration)) if callable(wrench) else np.inf
    unseen = Unseen(COMPOSITIONS[order], h, spacing)
    if tolerance is not None:
        rows = adaptive(body, start, kept * h, law, tolerance, _STAGES * spacing)
    elif law is None:
        rows = torque_free(body, start, h, n, every, COMPOSITIONS[order])
    else:
        rows = pushed(body, start, h, n, every, COMPOSITIONS[order], law, unseen)
    q, p, l, f, impulse, work = rows
    T, V = body.motion(q, p, l, f)
    P = inertia @ V
    energy = 0.5 * np.einsum("ij,ij->i", V, P)
    exact = law is None and np.diff(moments).min() <= 1e-6 * moments[2]
    turn = 0.0 if exact or tolerance is not None else h * float(np.linalg.norm(V[:, :3], axis=-1).max())
    momentum = se3.Ad(se3.inverse(T)).T @ P
    said = unseen.remark(
        max(float(np.abs(f).max()), float(np.abs(impulse[:, 3:]).sum(axis=-1).max())), float(np.abs(l).max())
    )
    return Flight(kept * h, T, V, momentum, energy, impulse, work, float(dt), h, turn, said)
