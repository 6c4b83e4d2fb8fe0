"""Argument validation and start of simulations, of one state or of many."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.arguments import positive, whole
from ..core.errors import ShapeError, SimulationError, TwistWrenchError, ValueRangeError
from ..core.numbers import printed, residual
from ..core.quadrature import probe_spacing
from ..core.text import argument
from ..core.typing import Array
from ..mechanics.model.couplings import refuse_couplings
from ..mechanics.model.limits import NONE_GIVEN
from ..robot.task_space_methods import require_robot
from .adaptive import Stepper, TrialSteps, run_adaptive
from .callback_steps import CallbackSteps, use_block
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
from .result import SimulationResult
from .run import Run
from .schemes import ADAPTIVE, Scheme, SemiImplicit, scheme_of

if TYPE_CHECKING:
    from ..robot import Robot
    from ..robot.doors import ConstrainedRobot
    from .closed import Loops

_MOST = 10**8


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
    n, end = _steps(duration, dt, whole(every, "every"))
    h = end / n
    held, law = torque_law(tau, robot.nv)
    surfaces = _contacts(robot, contacts)
    acting: dict[str, Any] = {"tau": law, "wrenches": wrench_laws(robot, wrench_on_robot), "contacts": surfaces}
    system = System(robot, **acting) if loops is None else loops.system_under(**acting)
    system.held = held
    scheme = scheme_of(method, system)
    y0 = _start(robot, system, q0, dq0)
    if loops is not None:
        scheme = loops.scheme_on(scheme)
        loops.begin(y0)
    remarks = []
    if abs(h - dt) > 1e-9 * dt:
        remarks.append(f"states {printed(h)} s apart, not {printed(dt)} s, so that a whole number fills it")
    planes = [contact for contact in surfaces if isinstance(contact, PlaneContact)]
    remarks += [buried for plane in planes if (buried := plane.buried(y0[: robot.nq]))]
    friction = arguments.flag(friction, "friction")
    remarks += _friction(system, scheme, method, y0, h, tau, friction=friction, creep=creep, loops=loops)
    watched, stops = _events(events), _limits(robot, limits, y0)
    run = Run(robot, system, scheme, y0, end, n, every=int(every), remarks=remarks, method=method)
    run.friction = friction
    if watched or surfaces or stops is not None:
        run.detector = EventDetector(watched, system.split, stops, surfaces)
    if controller is not None:
        meaning = ", a torque for each velocity"
        run.controller = ControlLaw.from_function(controller, "the controller", (robot.nv,), meaning)
        run.constant = held
    tolerances, longest = (positive(rtol, "rtol"), positive(atol, "atol")), h if surfaces else np.inf
    if max_step is not None:
        longest = positive(max_step, "max_step", "s", infinite=True)
        if method != ADAPTIVE and longest < h * (1.0 - 1e-9):
            raise ValueRangeError(
                f"max_step is {printed(longest)} s, and steps of method {method!r} are {printed(h)} s each. Take a smaller "
                f"dt, and {argument('every')} to keep fewer states; max_step is for {argument('method', ADAPTIVE)}."
            )
    if progress is not None:
        require_arguments(progress, "progress", ("the share done, from 0 to 1",))
        run.tick = lambda t: progress(min(t / end, 1.0))
    run.go = partial(_go, run, tolerances, longest, loops)
    return run


def _go(run: Run, tolerances: tuple[float, float], longest: float, loops: Loops | None) -> None:
    """Take all steps of a run, compiled as far as possible."""
    system, options = run.system, (*tolerances, longest, probe_spacing(run.h, run.end), run.end)
    if run.method == ADAPTIVE and loops is not None:
        run_adaptive(run, loops.stepper(*options))
    elif run.method == ADAPTIVE:
        run_adaptive(run, Stepper(system, *options, trials=TrialSteps.build(system, tolerances)))
    else:
        steps: type[CompiledSteps] | None = CallbackSteps if system.functions else CompiledSteps
        if loops is not None:
            steps = loops.steps if run.detector is None and run.controller is None else None
        run.compiled = None if steps is None else steps.build(system, run.method, run.scheme.order, run.h)
        run.fixed()


def _friction(
    system: System,
    scheme: Scheme,
    method: str,
    y0: Array,
    h: float,
    tau: Any,
    *,
    friction: bool,
    creep: float | None,
    loops: Loops | None,
) -> list[str]:
    """Set the system's friction in the form that the method requires; returns remarks on it."""
    robot = system.robot
    rubs, remarks = friction and robot.model.friction.any, []
    gains = getattr(tau, "rate_gains", None) if callable(tau) else None
    if gains is not None:
        given = arguments.one(gains, "rate_gains", robot.nv)
        gains = np.array(arguments.finite(given, "rate_gains", robot.nv), float)
    if friction and not rubs:
        remarks.append(NONE_GIVEN)
    if isinstance(scheme, SemiImplicit):
        if rubs:
            refuse_couplings(robot.model, f"friction by method {method!r}")
        if creep is not None:
            raise ValueRangeError(
                f"creep is {arguments.value_text(creep)}, and method {method!r} eases no friction: it stops joints and "
                "holds them. Leave creep out."
            )
        if rubs or gains is not None:
            system.dry_friction = DryFrictionStep(robot, h, friction=bool(rubs), gains=gains)
    elif rubs:
        if creep is not None:
            speeds = np.full(robot.nv, positive(creep, "creep", "rad/s or m/s"))
        else:
            robot.engine.require_invertible()
            speeds = creep_of_samples(robot, y0[: robot.nq], 0.0 if method == ADAPTIVE else h, {})
        system.friction = EasedFriction(robot, speeds)
        if eased := easing_remark(robot.model, speeds):
            # Semi-implicit steps of closed robots are smoothed too.
            remarks.append(eased if loops is None else eased.rpartition("; ")[0])
    return remarks


def _steps(duration: float, dt: float, every: int) -> tuple[int, float]:
    """Number of steps and the duration."""
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
        try:
            shape = np.shape(given) if isinstance(given, np.ndarray | list | tuple) else ()
        except ValueError:  # ragged; reported below
            shape = ()
        if len(shape) > 1:
            raise ShapeError(
                f"{name} has shape {shape}; a simulation starts from one state, shape ({n},). robot.simulate_batch takes many."
            )
        names = robot.coordinate_names if name == "q0" else robot.model.velocity_names
        y[place] = arguments.finite(arguments.one(given, name, n, names=names), name, n)
    for mine in robot.model.quaternions:
        largest = float(np.abs(y[mine]).max())
        if largest == 0.0:
            raise ValueRangeError(
                "q0 has a quaternion of zeros, which is not a rotation; the identity is (1, 0, 0, 0)."
            )
        y[mine] /= largest  # scaled first: the square may overflow or underflow
    system.manifold.normalise(y[: robot.nq])
    return y


def _contacts(robot: Robot, given: Any) -> list[PlaneContact | StopContact]:
    listed = [given] if isinstance(given, Plane | JointStops) else given
    if isinstance(listed, str) or not isinstance(listed, Iterable):
        raise ValueRangeError(f"contacts is {given!r}, and must be a Plane, JointStops, or a list of them.")
    found = list(listed)
    for one in found:
        if not isinstance(one, Plane | JointStops):
            raise ValueRangeError(f"contacts has {one!r}, and takes tw.simulation.Plane and tw.simulation.JointStops.")
    return [PlaneContact(robot, one) if isinstance(one, Plane) else StopContact(robot, one) for one in found]


def _events(given: Any) -> list[Event]:
    listed = [given] if isinstance(given, Event) or callable(given) else given
    if isinstance(listed, str) or not isinstance(listed, Iterable):
        raise ValueRangeError(
            f"events is {given!r}, and must be an Event, a function of (t, q, dq), or a list of them."
        )
    return [e if isinstance(e, Event) else Event(e, getattr(e, "__name__", "event")) for e in listed]


def _limits(robot: Robot, given: str | None, y0: Array) -> PositionLimits | None:
    if given is None:
        return None
    if not isinstance(given, str) or given != "stop":
        raise ValueRangeError(
            f"limits is {arguments.value_text(given)}; choose 'stop', which ends the simulation where a joint reaches "
            "a limit, or None. For stops that push back, contacts=tw.simulation.JointStops(stiffness=…)."
        )
    found = PositionLimits.from_robot(robot)
    if outside := found.outside(y0[: robot.nq]):
        raise ValueRangeError(f"limits='stop', and q0 is outside already: {outside}. Start inside.")
    return found


# ── One simulation: preparation, run, and the result for any kind of end


def simulated(robot: Robot | ConstrainedRobot, *start: Any, **given: Any) -> SimulationResult:
    """Result of :meth:`twistwrench.Robot.simulate`; steps of robots with constraints end on them."""
    if robot.constraints:
        from .closed import simulate_closed

        return simulate_closed(cast("ConstrainedRobot", robot), *start, **given)
    return run_to_end(build_run(cast("Robot", robot), *start, **given, loops=None))


def run_to_end(run: Run) -> SimulationResult:
    """Result of a prepared run; an exception that ends it early holds the motion so far in ``.result``."""
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
    return run.result(run.stopped or f"reached the end, {printed(run.end)} s", completed=not run.stopped)


# ── Simulations from many states, batched if there are no callbacks


@dataclass(frozen=True, eq=False, repr=False)
class SimulationBatch:
    """Simulations from a batch of states, each of its own length. Printing it shows how many reached the end."""

    results: tuple[SimulationResult, ...]
    """One result for each state, in the order of the flattened batch."""
    shape: tuple[int, ...]
    """Shape of the batch."""

    def __getitem__(self, index: int | tuple[int, ...]) -> SimulationResult:
        places = index if isinstance(index, tuple) else (index,)
        if len(places) != len(self.shape):
            raise ValueRangeError(f"the batch has shape {self.shape}; give one index for each of its axes.")
        return self.results[int(np.arange(len(self.results)).reshape(self.shape)[places])]

    def __len__(self) -> int:
        return len(self.results)

    def __iter__(self) -> Iterator[SimulationResult]:
        return iter(self.results)

    @property
    def completed(self) -> Array:
        """True for simulations that reached the end of their duration, (...) bool."""
        return np.array([found.completed for found in self.results]).reshape(self.shape)

    @property
    def ends(self) -> Array:
        """Time of the last state of each simulation, (...) s."""
        return np.array([found.times[-1] for found in self.results]).reshape(self.shape)

    def __repr__(self) -> str:
        if not self.results:
            return "<SimulationBatch: no simulations>"
        first, done = self.results[0], int(self.completed.sum())
        said = [f"{len(self)} simulations, {done} reached the end"]
        if done < len(self):
            k = int(np.argmin(self.completed.ravel()))
            where = ", ".join(map(str, np.unravel_index(k, self.shape))) if self.shape else ""
            said.append(f"the first of the others, [{where}]: {self.results[k].stopped}")
        said.append(f"drift of energy at most {residual(np.max([found.relative_drift for found in self.results]))}")
        remarks = dict.fromkeys(remark for found in self.results for remark in found.remarks)
        said += [f"note: {remark}" for remark in list(remarks)[:3]]
        return f"<SimulationBatch of {first.robot!r}, {first.method}: {'; '.join(said)}>"


def simulate_batch(robot: Robot, *start: Any, **options: Any) -> SimulationBatch:
    """Simulations from many states; see :meth:`twistwrench.Robot.simulate_batch`."""
    require_robot(robot, "simulate_batch")
    bound = inspect.signature(robot.simulate).bind(*start, **options)
    bound.apply_defaults()
    given = bound.arguments
    q, dq, shape = _starts(robot, given.pop("q0"), given.pop("dq0"))
    progress = given.pop("progress")
    if progress is not None:
        require_arguments(progress, "progress", ("the share done, from 0 to 1",))
    runs = []
    for place, one, rates in zip(np.ndindex(shape), q, dq, strict=True):
        try:
            runs.append(build_run(robot, one, rates, **given, progress=None, loops=None))
        except TwistWrenchError as problem:
            if place == (0,) * len(shape) or "q0" not in str(problem):
                raise
            raise type(problem)(f"simulation {list(place)} of the batch: {problem}") from None
    with np.errstate(all="ignore"):  # overflow in unstable steps is detected and reported
        _advance(runs)
    results: list[SimulationResult] = []
    for run in runs:
        try:
            results.append(run_to_end(run))
        except SimulationError as problem:  # recorded in its result; the others continue
            results.append(cast("SimulationResult", problem.result))
        if progress is not None:
            progress(len(results) / len(runs))
    return SimulationBatch(tuple(results), shape)


def _starts(robot: Robot, q0: ArrayLike | None, dq0: ArrayLike | None) -> tuple[Array, Array, tuple[int, ...]]:
    """Configurations (n, nq) and velocities (n, nv) of all simulations, and the shape of the batch."""
    q = robot.neutral if q0 is None else arguments.finite(q0, "q0", robot.nq, names=robot.coordinate_names)
    dq = np.zeros(robot.nv) if dq0 is None else arguments.finite(dq0, "dq0", robot.nv, names=robot.model.velocity_names)
    try:
        shape = np.broadcast_shapes(q.shape[:-1], dq.shape[:-1])
    except ValueError:
        raise ShapeError(f"q0 has shape {q.shape} and dq0 {dq.shape}, whose batch shapes do not go together.") from None
    every = (np.broadcast_to(x, (*shape, x.shape[-1])).reshape(-1, x.shape[-1]) for x in (q, dq))
    return *every, shape  # type: ignore[return-value]


def _advance(runs: list[Run]) -> None:
    """Take the steps of all runs side by side while they are compiled, stable and not ended; then each continues alone."""
    if len(runs) < 2 or runs[0].method == ADAPTIVE or not runs[0].without_callbacks:
        return
    first = runs[0]
    made = [CompiledSteps.build(run.system, run.method, run.scheme.order, run.h) for run in runs]
    going = [(run, steps) for run, steps in zip(runs, made, strict=True) if steps is not None]
    for run, _ in going:
        run.begin()
    wide = going[0][1].side_by_side() if going else None
    while wide is not None and going and (left := first.n - going[0][0].steps):
        counted = first.system.evaluations
        given = [np.array(given) for given in zip(*(steps.inputs() for _, steps in going), strict=True)]
        states = np.array([run.last[1] for run, _ in going])
        found = wide.advance_with(states, min(max(1, wide.most // len(going)), left), first.h, given)
        first.system.evaluations = counted
        going = [both for both, *mine in zip(going, *found, strict=True) if use_block(*both, *mine)]
