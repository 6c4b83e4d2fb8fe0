"""Argument validation and start of a simulation of one state."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.arguments import positive, whole
from ..core.errors import ShapeError, SimulationError, ValueRangeError
from ..core.numbers import printed
from ..core.quadrature import probe_spacing
from ..core.text import argument
from ..core.typing import Array
from ..mechanics.model.couplings import refuse_couplings
from ..mechanics.model.limits import NONE_GIVEN
from .callback_steps import CallbackSteps
from .compiled_steps import CompiledSteps
from .contact import JointStops, Plane, PlaneContact, StopContact
from .events import Event, EventDetector, PositionLimits
from .forces import (
    ControlLaw,
    DryFrictionStep,
    EasedFriction,
    Function,
    System,
    creep_of_samples,
    easing_remark,
    require_arguments,
    torque_law,
    wrench_laws,
)
from .methods.adaptive import Stepper, run_adaptive
from .methods.schemes import ADAPTIVE, Scheme, SemiImplicit, scheme_of
from .methods.trial_steps import TrialSteps
from .result import SimulationResult
from .run import Run

if TYPE_CHECKING:
    from ..robot import Robot
    from ..robot.doors import ConstrainedRobot
    from .methods.closed_steps import Loops

MAX_STATES = 10**8
"""Largest number of states of a result."""
_STEP_TOLERANCE = 1e-9
"""Relative difference of two lengths of a step that is a rounding error."""


def build_run(
    robot: Robot,
    q0: ArrayLike | None,
    dq0: ArrayLike | None,
    duration: float,
    dt: float,
    *,
    method: str | None,
    tau: ArrayLike | Function | None,
    controller: Function | None,
    wrench_on_robot: Mapping[str, Any] | None,
    friction: bool,
    creep: float | None,
    contacts: Plane | JointStops | Iterable[Plane | JointStops],
    limits: str | None,
    events: Event | Function | Iterable[Event | Function],
    rtol: float,
    atol: float,
    max_step: float | None,
    every: int,
    progress: Callable[[float], None] | None,
    loops: Loops | None,
) -> Run:
    """Prepared run, from the arguments of :meth:`twistwrench.Robot.simulate`."""
    method = ADAPTIVE if method is None else method
    if robot.nv == 0:
        raise ValueRangeError(f"nothing to simulate: robot {robot.name!r} has no joint that moves.")
    every = whole(every, "every")
    n, end = _count_steps(duration, dt, every)
    h = end / n
    constant_torques, law = torque_law(tau, robot.nv)
    robot_contacts = _contacts(robot, contacts)
    forces: dict[str, Any] = {"tau": law, "wrenches": wrench_laws(robot, wrench_on_robot), "contacts": robot_contacts}
    system = System(robot, **forces) if loops is None else loops.system_under(**forces)
    system.held = constant_torques
    scheme = scheme_of(method, system)
    y0 = _start(robot, system, q0, dq0)
    if loops is not None:
        scheme = loops.scheme_on(scheme)
        loops.begin(y0)
    remarks = _remarks_at_start(robot_contacts, y0[: robot.nq], h, dt)
    friction = arguments.flag(friction, "friction")
    remarks += _set_friction(system, scheme, y0, h, method=method, tau=tau, friction=friction, creep=creep, loops=loops)
    watched_events = _check_events(events)
    position_limits = _position_limits(robot, limits, y0)
    run = Run(robot, system, scheme, y0, end, n, every=int(every), remarks=remarks, method=method)
    run.friction = friction
    if watched_events or robot_contacts or position_limits is not None:
        run.detector = EventDetector(watched_events, system.split, position_limits, robot_contacts)
    if controller is not None:
        meaning = ", a torque for each velocity"
        run.controller = ControlLaw.from_function(controller, "the controller", (robot.nv,), meaning)
        run.constant = constant_torques
    tolerances = (positive(rtol, "rtol"), positive(atol, "atol"))
    default_step = h if robot_contacts else np.inf  # longer steps could miss a contact
    longest_step = _longest_step(max_step, method, h, default_step)
    if progress is not None:
        require_arguments(progress, "progress", ("the share done, from 0 to 1",))
        run.tick = lambda t: progress(min(t / end, 1.0))
    run.go = partial(_take_steps, run, tolerances, longest_step, loops)
    return run


def _remarks_at_start(robot_contacts: list[PlaneContact | StopContact], q0: Array, h: float, dt: float) -> list[str]:
    """Remarks on a step h other than dt, and on contact points that start in the ground."""
    remarks = []
    if abs(h - dt) > _STEP_TOLERANCE * dt:
        remarks.append(f"states {printed(h)} s apart, not {printed(dt)} s, so that a whole number fills it")
    for contact in robot_contacts:
        if isinstance(contact, PlaneContact):
            remark = contact.remark_at_start(q0)
            if remark:
                remarks.append(remark)
    return remarks


def _longest_step(max_step: float | None, method: str, h: float, default: float) -> float:
    """Largest step of the adaptive method [s]; raises ValueRangeError if it is below the step h of another method."""
    if max_step is None:
        return default
    longest_step = positive(max_step, "max_step", "s", infinite=True)
    if method != ADAPTIVE and longest_step < h * (1.0 - _STEP_TOLERANCE):
        raise ValueRangeError(
            f"max_step is {printed(longest_step)} s, and steps of method {method!r} are {printed(h)} s each. Take a smaller "
            f"dt, and {argument('every')} to keep fewer states; max_step is for {argument('method', ADAPTIVE)}."
        )
    return longest_step


def _take_steps(run: Run, tolerances: tuple[float, float], longest_step: float, loops: Loops | None) -> None:
    """Take all steps of a run, compiled as far as possible; ``tolerances`` are rtol and atol of adaptive steps."""
    rtol, atol = tolerances
    options = (rtol, atol, longest_step, probe_spacing(run.h, run.end), run.end)
    if run.method == ADAPTIVE and loops is not None:
        run_adaptive(run, loops.stepper(*options))
    elif run.method == ADAPTIVE:
        trials = TrialSteps.build(run.system, tolerances)
        run_adaptive(run, Stepper(run.system, *options, trials=trials))
    else:
        run.compiled = _compile_steps(run, loops)
        run.take_fixed_steps()


def _compile_steps(run: Run, loops: Loops | None) -> CompiledSteps | None:
    """Compiled steps of a run; None if they cannot be compiled, or if events or a controller observe constrained steps."""
    steps_class: type[CompiledSteps] = CompiledSteps
    if loops is not None:
        if run.detector is not None or run.controller is not None:
            return None
        steps_class = loops.steps
    elif run.system.functions:
        steps_class = CallbackSteps
    return steps_class.build(run.system, run.method, run.scheme.order, run.h)


def _set_friction(
    system: System,
    scheme: Scheme,
    y0: Array,
    h: float,
    *,
    method: str,
    tau: Any,
    friction: bool,
    creep: float | None,
    loops: Loops | None,
) -> list[str]:
    """Set the system's friction in the form that the method requires; returns remarks on the friction."""
    robot = system.robot
    has_friction = bool(friction and robot.model.friction.any)
    gains = _rate_gains(tau, robot.nv)
    remarks = []
    if friction and not has_friction:
        remarks.append(NONE_GIVEN)
    if isinstance(scheme, SemiImplicit):
        if has_friction:
            refuse_couplings(robot.model, f"friction by method {method!r}")
        if creep is not None:
            raise ValueRangeError(
                f"creep is {arguments.value_text(creep)}, and method {method!r} eases no friction: it stops joints and "
                "holds them. Leave creep out."
            )
        if has_friction or gains is not None:
            system.dry_friction = DryFrictionStep(robot, h, friction=has_friction, gains=gains)
    elif has_friction:
        if creep is not None:
            speeds = np.full(robot.nv, positive(creep, "creep", "rad/s or m/s"))
        else:
            robot.engine.require_invertible()
            step = 0.0 if method == ADAPTIVE else h  # adaptive steps have no fixed length
            speeds = creep_of_samples(robot, y0[: robot.nq], step, {})
        system.friction = EasedFriction(robot, speeds)
        remark = easing_remark(robot.model, speeds)
        if remark and loops is not None:
            # The last clause recommends semi-implicit steps, but these ease the friction of closed robots too.
            remark, _, _ = remark.rpartition("; ")
        if remark:
            remarks.append(remark)
    return remarks


def _rate_gains(tau: Any, nv: int) -> Array | None:
    """Velocity gains (nv,) of a torque law, to be treated implicitly; None for torques without gains."""
    if not callable(tau):
        return None
    gains = getattr(tau, "rate_gains", None)
    if gains is None:
        return None
    finite_gains = arguments.finite(arguments.one(gains, "rate_gains", nv), "rate_gains", nv)
    return np.array(finite_gains, float)


def _count_steps(duration: float, dt: float, every: int) -> tuple[int, float]:
    """Number of steps, and validated duration [s]."""
    length = positive(duration, "duration", "s")
    h = positive(dt, "dt", "s")
    if not length / h < MAX_STATES * every:
        raise ValueRangeError(
            f"a duration of {printed(length)} s with a dt of {printed(h)} s, one in {every} kept, makes more than "
            f"{printed(MAX_STATES, 1)} states. Take a larger dt, or keep fewer with every."
        )
    n = max(1, math.ceil(length / h * (1.0 - 1e-12)))  # round-off adds no step
    return n, length


def _start(robot: Robot, system: System, q0: ArrayLike | None, dq0: ArrayLike | None) -> Array:
    """Initial state: q0 with unit quaternions, and dq0; the default is the neutral configuration at rest."""
    y = np.zeros(system.size)
    y[: robot.nq] = robot.neutral
    if q0 is not None:
        y[: robot.nq] = _initial_values(q0, "q0", robot.coordinate_names)
    if dq0 is not None:
        y[system.moving] = _initial_values(dq0, "dq0", robot.model.velocity_names)
    for quaternion in robot.model.quaternions:
        largest_entry = float(np.abs(y[quaternion]).max())
        if largest_entry == 0.0:
            raise ValueRangeError(
                "q0 has a quaternion of zeros, which is not a rotation; the identity is (1, 0, 0, 0)."
            )
        y[quaternion] /= largest_entry  # scaled first: the square may overflow or underflow
    system.manifold.normalise(y[: robot.nq])
    return y


def _initial_values(values: ArrayLike, name: str, names: tuple[str, ...]) -> Array:
    """Validated q0 or dq0 of one state, (n,), finite."""
    n = len(names)
    try:
        shape = np.shape(values) if isinstance(values, np.ndarray | list | tuple) else ()
    except ValueError:  # ragged; reported below
        shape = ()
    if len(shape) > 1:
        raise ShapeError(
            f"{name} has shape {shape}; a simulation starts from one state, shape ({n},). robot.simulate_batch takes many."
        )
    return arguments.finite(arguments.one(values, name, n, names=names), name, n)


def _contacts(robot: Robot, contacts: Any) -> list[PlaneContact | StopContact]:
    """Contacts of the robot with its surfaces and stops; raises ValueRangeError for other arguments."""
    if isinstance(contacts, Plane | JointStops):
        contacts = [contacts]
    if isinstance(contacts, str) or not isinstance(contacts, Iterable):
        raise ValueRangeError(f"contacts is {contacts!r}, and must be a Plane, JointStops, or a list of them.")
    surfaces = list(contacts)
    for surface in surfaces:
        if not isinstance(surface, Plane | JointStops):
            raise ValueRangeError(
                f"contacts has {surface!r}, and takes tw.simulation.Plane and tw.simulation.JointStops."
            )
    robot_contacts: list[PlaneContact | StopContact] = []
    for surface in surfaces:
        if isinstance(surface, Plane):
            robot_contacts.append(PlaneContact(robot, surface))
        else:
            robot_contacts.append(StopContact(robot, surface))
    return robot_contacts


def _check_events(events: Any) -> list[Event]:
    """Events as a list; a function becomes an event with its name."""
    if isinstance(events, Event) or callable(events):
        events = [events]
    if isinstance(events, str) or not isinstance(events, Iterable):
        raise ValueRangeError(
            f"events is {events!r}, and must be an Event, a function of (t, q, dq), or a list of them."
        )
    named_events = []
    for event in events:
        if isinstance(event, Event):
            named_events.append(event)
        else:
            named_events.append(Event(event, getattr(event, "__name__", "event")))
    return named_events


def _position_limits(robot: Robot, limits: str | None, y0: Array) -> PositionLimits | None:
    """Position limits that end the simulation; None if ``limits`` is None."""
    if limits is None:
        return None
    if not isinstance(limits, str) or limits != "stop":
        raise ValueRangeError(
            f"limits is {arguments.value_text(limits)}; choose 'stop', which ends the simulation where a joint reaches "
            "a limit, or None. For stops that push back, contacts=tw.simulation.JointStops(stiffness=…)."
        )
    position_limits = PositionLimits.from_robot(robot)
    outside = position_limits.outside_text(y0[: robot.nq])
    if outside:
        raise ValueRangeError(f"limits='stop', and q0 is outside already: {outside}. Start inside.")
    return position_limits


def simulate_robot(robot: Robot | ConstrainedRobot, *start: Any, **options: Any) -> SimulationResult:
    """Result of :meth:`twistwrench.Robot.simulate`; a robot with constraints satisfies them after each step."""
    if robot.constraints:
        from .closed import simulate_closed

        return simulate_closed(cast("ConstrainedRobot", robot), *start, **options)
    return run_to_end(build_run(cast("Robot", robot), *start, **options, loops=None))


def run_to_end(run: Run) -> SimulationResult:
    """Result of a prepared run; an exception that ends the run early has the motion so far in ``.result``."""
    try:
        with np.errstate(all="ignore"):  # overflow in unstable steps is detected and reported
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
    if run.stopped:
        return run.result(run.stopped, completed=False)
    return run.result(f"reached the end, {printed(run.end)} s", completed=True)
