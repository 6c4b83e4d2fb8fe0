"""What a simulation is given, made sure of once, before anything runs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.arguments import positive, whole
from ..core.printed_numbers import printed
from ..core.probe_rule import probe_spacing
from ..errors import ShapeError, ValueRangeError
from ..model.friction import NONE_GIVEN
from ..typing import Array
from .adaptive import Stepper
from .adaptive_steps import take_adaptively
from .asked_steps import AskedSteps
from .braked_step import BrakedStep
from .closed_steps import ClosedSteps
from .closed_system import ClosedScheme, ClosedStepper, ClosedSystem, Loops
from .compiled_attempts import CompiledAttempts
from .compiled_steps import CompiledSteps
from .contact import JointStops, Plane
from .eased_friction import EasedFriction, creep_speeds, easing_remark
from .events import Event, Watch
from .forces import System, torque_law, wrench_laws
from .position_limits import PositionLimits
from .robot_contact import PlaneContact, StopContact
from .run import Run
from .schemes import ADAPTIVE, SemiImplicit, scheme_of
from .user_functions import Function, Law, require_arguments

if TYPE_CHECKING:
    from ..robot import Robot

_MOST = 10**8


def prepare(
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
    """A run that is ready to go, by the arguments of :meth:`twistwrench.Robot.simulate`."""
    method = ADAPTIVE if method is None else method
    if robot.nv == 0:
        raise ValueRangeError(f"nothing to simulate: robot {robot.name!r} has no joint that moves.")
    n, end = _steps(duration, dt, whole(every, "every"))
    h = end / n
    held, law = torque_law(tau, robot.nv)
    surfaces = _contacts(robot, contacts)
    acting: dict[str, Any] = {"tau": law, "wrenches": wrench_laws(robot, wrench_on_robot), "contacts": surfaces}
    system = System(robot, **acting) if loops is None else ClosedSystem(loops, **acting)
    system.held = held
    scheme, adapts = scheme_of(method, system), method == ADAPTIVE
    y0 = _start(robot, system, q0, dq0)
    if loops is not None:
        scheme = ClosedScheme(scheme, loops)
        loops.begin(y0)
    remarks = (
        []
        if abs(h - dt) <= 1e-9 * dt
        else [f"states {printed(h)} s apart, not {printed(dt)} s, so that a whole number fills it"]
    )
    planes = [contact for contact in surfaces if isinstance(contact, PlaneContact)]
    remarks += [said for plane in planes if (said := plane.buried(y0[: robot.nq]))]
    friction = arguments.flag(friction, "friction")
    rubs, gains = friction and robot.model.friction.any, _rate_gains(robot, tau)
    if friction and not rubs:
        remarks.append(NONE_GIVEN)
    if isinstance(scheme, SemiImplicit):
        if creep is not None:
            raise ValueRangeError(
                f"creep is {arguments.shown(creep)}, and method {method!r} eases no friction: it stops joints and holds them. "
                "Leave creep out."
            )
        if rubs or gains is not None:
            system.braked = BrakedStep(robot, h, friction=bool(rubs), gains=gains)
    elif rubs:
        system.friction = EasedFriction(robot, _creep(robot, y0, 0.0 if adapts else h, creep))
        if eased := easing_remark(robot.model, system.friction.creep):
            remarks.append(eased if loops is None else eased.rpartition("; ")[0])  # those of closed robots ease, too
    watched, stops = _events(events), _limits(robot, limits, y0)
    run = Run(robot, system, scheme, y0, end, n, every=int(every), remarks=remarks, method=method)
    if watched or surfaces or stops is not None:
        run.watch = Watch(watched, system.split, stops, surfaces)
    if controller is not None:
        run.controller = Law.of(controller, "the controller", (robot.nv,), ", a torque for each velocity")
        run.constant = held
    tolerances = (positive(rtol, "rtol"), positive(atol, "atol"))
    longest = h if surfaces else np.inf
    if max_step is not None:
        longest = positive(max_step, "max_step", "s", infinite=True)
        if not adapts and longest < h * (1.0 - 1e-9):
            raise ValueRangeError(
                f"max_step is {printed(longest)} s, and steps of method {method!r} are {printed(h)} s each. Take a smaller "
                f"dt, and every= to keep fewer states; max_step is for method={ADAPTIVE!r}."
            )
    if progress is not None:
        require_arguments(progress, "progress", ("the share done, from 0 to 1",))
        run.tick = lambda t: progress(min(t / end, 1.0))

    def go() -> None:
        if adapts:
            asked = (*tolerances, longest, probe_spacing(h, end), end)
            if loops is None:
                take_adaptively(run, Stepper(system, *asked, attempts=CompiledAttempts.of(system, tolerances)))
            else:
                take_adaptively(run, ClosedStepper(loops, *asked))
        elif loops is None:
            run.compiled = (AskedSteps if system.functions else CompiledSteps).of(system, method, scheme.order, h)
            run.fixed()
        else:
            alone = run.watch is None and controller is None
            run.compiled = ClosedSteps.of(system, method, scheme.order, h) if alone else None
            run.fixed()

    run.go = go
    return run


def _steps(duration: float, dt: float, every: int) -> tuple[int, float]:
    """How many steps, and how long all of them."""
    length, h = positive(duration, "duration", "s"), positive(dt, "dt", "s")
    if not length / h < _MOST * every:
        raise ValueRangeError(
            f"a duration of {printed(length)} s with a dt of {printed(h)} s, one in {every} kept, makes more than "
            f"{printed(_MOST, 1)} states. Take a larger dt, or keep fewer with every."
        )
    n = max(1, math.ceil(length / h * (1.0 - 1e-12)))
    return n, length


def _start(robot: Robot, system: System, q0: ArrayLike | None, dq0: ArrayLike | None) -> Array:
    y = np.zeros(system.size)
    for name, given, place, n in (("q0", q0, slice(0, robot.nq), robot.nq), ("dq0", dq0, system.moving, robot.nv)):
        if given is None:
            y[place] = robot.neutral if name == "q0" else 0.0
            continue
        shape = np.shape(given) if isinstance(given, np.ndarray | list | tuple) and not _ragged(given) else None
        if shape is not None and len(shape) > 1:
            raise ShapeError(
                f"{name} has shape {shape}; a simulation starts from one state, shape ({n},). robot.simulate_batch takes many."
            )
        names = robot.coordinate_names if name == "q0" else robot.model.velocity_names
        y[place] = arguments.finite(arguments.one(given, name, n, names=names), name, n)
    for mine in robot.model.quaternions:
        largest = float(np.abs(y[mine]).max())
        if largest == 0.0:
            raise ValueRangeError("q0 has a quaternion of zeros, which is no rotation; none is (1, 0, 0, 0).")
        y[mine] /= largest  # before it is squared: its square may be more or less than floats hold
    system.manifold.normalise(y[: robot.nq])
    return y


def _ragged(given: Any) -> bool:
    try:
        np.asarray(given)
    except ValueError:
        return True
    return False


def _rate_gains(robot: Robot, tau: Any) -> Array | None:
    """-∂τ/∂dq of a law that tells it, (nv,)."""
    told = getattr(tau, "rate_gains", None) if callable(tau) else None
    if told is None:
        return None
    return np.array(arguments.finite(arguments.one(told, "rate_gains", robot.nv), "rate_gains", robot.nv), float)


def _creep(robot: Robot, y0: Array, h: float, asked: float | None) -> Array:
    """The speeds below which dry friction is eased off, (nv,)."""
    if asked is not None:
        return np.full(robot.nv, positive(asked, "creep", "rad/s or m/s"))
    friction = robot.model.friction
    robot.engine.require_invertible()
    return creep_speeds(robot.mass_matrix(y0[: robot.nq]), np.maximum(friction.static, friction.coulomb), h)


def _contacts(robot: Robot, given: Any) -> list[PlaneContact | StopContact]:
    listed = [given] if isinstance(given, Plane | JointStops) else given
    if isinstance(listed, str) or not isinstance(listed, Iterable):
        raise ValueRangeError(f"contacts is {given!r}, and must be a Plane, JointStops, or a list of them.")
    found: list[PlaneContact | StopContact] = []
    for one in listed:
        if isinstance(one, Plane):
            found.append(PlaneContact(robot, one))
        elif isinstance(one, JointStops):
            found.append(StopContact(robot, one))
        else:
            raise ValueRangeError(f"contacts has {one!r}, and takes tw.simulation.Plane and tw.simulation.JointStops.")
    return found


def _events(given: Any) -> list[Event]:
    listed = [given] if isinstance(given, Event) or callable(given) else given
    if isinstance(listed, str) or not isinstance(listed, Iterable):
        raise ValueRangeError(
            f"events is {given!r}, and must be an Event, a function of (t, q, dq), or a list of them."
        )
    return [e if isinstance(e, Event) else Event(e, getattr(e, "__name__", "event")) for e in listed]


def _limits(robot: Robot, asked: str | None, y0: Array) -> PositionLimits | None:
    if asked is None:
        return None
    if not isinstance(asked, str) or asked != "stop":
        raise ValueRangeError(
            f"limits is {arguments.shown(asked)}; choose 'stop', which ends the simulation where a joint reaches a limit, or "
            "None. For stops that push back, contacts=tw.simulation.JointStops(stiffness=…)."
        )
    found = PositionLimits.of(robot)
    if outside := found.outside(y0[: robot.nq]):
        raise ValueRangeError(f"limits='stop', and q0 is outside already: {outside}. Start inside.")
    return found
