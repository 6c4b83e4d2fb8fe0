"""The door of a simulation: it is prepared, goes, and whatever ends it, what was computed is given."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import SimulationError
from .closed_system import Loops
from .contact import JointStops, Plane
from .events import Event
from .preparation import prepare
from .result import SimulationResult
from .run import Run
from .user_functions import Function

if TYPE_CHECKING:
    from ..robot import Robot


def simulate(
    robot: Robot,
    q0: ArrayLike | None = None,
    dq0: ArrayLike | None = None,
    duration: float = 1.0,
    dt: float = 1e-3,
    *,
    method: str = "dopri5",
    tau: ArrayLike | Function | None = None,
    controller: Function | None = None,
    wrench_on_robot: Mapping[str, Any] | None = None,
    friction: bool = False,
    creep: float | None = None,
    contacts: Plane | JointStops | Iterable[Plane | JointStops] = (),
    limits: str | None = None,
    events: Event | Function | Iterable[Event | Function] = (),
    rtol: float = 1e-8,
    atol: float = 1e-10,
    max_step: float | None = None,
    every: int = 1,
    progress: Callable[[float], None] | None = None,
    loops: Loops | None = None,
) -> SimulationResult:
    """Simulation of a robot from one state; see :meth:`twistwrench.Robot.simulate`.

    Parameters
    ----------
    robot : Robot
    q0 : (nq,) array_like, optional, configuration at the start; None: neutral
    dq0 : (nv,) array_like, optional, velocities at the start [rad/s, m/s]; None: at rest
    duration : float [s]
    dt : float, a state every so often [s]
    method : str, the integrator
    tau : (nv,) array_like or function of (t, q, dq), optional, joint torques [N m, sliding joints: N]
    controller : function of (t, q, dq), optional, asked every ``dt``
    wrench_on_robot : {frame: (6,) or function of (t, q, dq)}, optional, (m, f) in that frame [N m, N]
    friction : bool, count the friction of the joints
    creep : float, optional, joint velocity below which friction is eased off [rad/s, m/s]
    contacts : Plane and JointStops, one or several
    limits : "stop" or None; ``"stop"`` ends where a joint reaches a limit
    events : Event or function of (t, q, dq), one or several
    rtol, atol : float, tolerances of dopri5
    max_step : float, optional, the longest step of dopri5 [s]
    every : int, keep one state in so many
    progress : callable, optional, told the share done, from 0 to 1
    loops : Loops, optional, constraints to keep to, those of :meth:`twistwrench.ClosedRobot.simulate`

    Returns
    -------
    result : SimulationResult

    Raises
    ------
    SimulationError
        A step is unstable, or a controller fails; all that was computed is in ``.result``.
    ShapeError, ValueRangeError, UnknownNameError
        An argument is invalid.
    SingularMassMatrixError
        A joint moves nothing with inertia, so that M has no inverse.

    Examples
    --------
    >>> import twistwrench as tw
    >>> simulate(tw.robots.pendulum(), [1.0], [0.0], duration=0.1).completed
    True
    """
    run = prepare(
        robot, q0, dq0, duration, dt, method=method, tau=tau, controller=controller, wrench_on_robot=wrench_on_robot,
        friction=friction, creep=creep, contacts=contacts, limits=limits, events=events, rtol=rtol, atol=atol,
        max_step=max_step, every=every, progress=progress, loops=loops,
    )  # fmt: skip
    return carried_out(run)


def carried_out(run: Run) -> SimulationResult:
    """The result of a run that is prepared. What ends it early has all up to there in its ``.result``."""
    try:
        with np.errstate(all="ignore"):  # what a step too long makes of the numbers is found and said
            run.go()
            run.judge()
    except SimulationError as problem:
        with np.errstate(all="ignore"):
            run.judge()
        problem.result = run.result(str(problem), completed=False)
        raise
    except KeyboardInterrupt as interrupt:
        interrupt.result = run.result("interrupted", completed=False)  # type: ignore[attr-defined]
        raise
    return run.result(run.stopped or f"reached the end, {run.end:.6g} s", completed=not run.stopped)
