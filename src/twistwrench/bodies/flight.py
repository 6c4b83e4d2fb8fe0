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
from ..core.printed_numbers import printed
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
    wrench: ArrayLike | WrenchLaw | None,
    *,
    order: int,
    tolerance: float | None,
    every: int,
) -> Flight:
    """The motion of a body by the arguments of :meth:`twistwrench.RigidBody.fly`."""
    moments, axes = inertia.principal()
    if not (inertia.mass > 0 and moments[0] > 1e-14 * moments[2]):
        raise InertiaError(
            f"a body of mass {printed(inertia.mass)} kg with principal moments {moments.tolist()} kg m² has no definite "
            "rotation. Give it mass, and some thickness."
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
