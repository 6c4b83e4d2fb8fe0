"""Closed robots: constrained dynamics, integration and projection in one traced program, with results.

Simulations and rollouts take the same steps. The state consists of q and dq, the constraint errors removed so far, and,
in simulations, the works done.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from ..compiler.ir.loops import Scan, Source
from ..compiler.ir.tracer import trace
from ..compiler.runtime.gufunc import owner_of
from ..core import arguments
from ..core.errors import SimulationError, UnknownNameError, ValueRangeError
from ..core.numbers import printed, residual
from ..core.typing import Array
from ..mechanics.algorithms.constraints import Constraint, constrained_dynamics, independent_constraints, with_gaps
from ..mechanics.algorithms.friction import largest, positive, smallest
from ..mechanics.algorithms.kinematics import add
from ..mechanics.algorithms.loop_closure import MIN_PIVOT, LoopRows, needs_singular_values, project_state
from ..mechanics.model.model import Model
from ..mechanics.model.parameters import moves_joints
from ..robot.constraint_methods import MAX_CLOSED_GAP
from ..robot.constraints.closures import some_configurations
from ..robot.constraints.tolerances import gap_units, require_met
from ..robot.engine import compile_form
from .adaptive import Stepper
from .compiled_steps import COMPILED_METHODS, TABLEAUS, CompiledSteps, Ports, StepPlan, acts_by_itself
from .forces import WORKS, System
from .preparation import build_run, run_to_end
from .result import SimulationResult
from .rollout import Rollout, build_rollout, rollout_of_tree
from .rollout_gradient import computed, room_for
from .rollout_inputs import Inputs, cleaned
from .schemes import ADAPTIVE, Scheme

if TYPE_CHECKING:
    from ..robot.doors import ConstrainedRobot

WIDEST, FASTEST, OPEN, PIVOT, GOOD = range(5)
"""Loop-closure state passed between steps with q and dq: largest gap [rad or m] and gap rate before projection, largest
gap after it, smallest relative pivot of A M⁻¹ A', and 1 as long as all steps end on the constraints."""
KEPT = 5
SMALL, SHRUNK = 1e-2, 0.25
"""Relative pivot that counts as small; and ratio to the previous pivot at which its root has halved, so that another such
step would reach or pass the singular configuration."""


@dataclass(frozen=True)
class ClosedStep(StepPlan):
    """Step on constraints, without numerical values."""

    loops: LoopRows = field(default_factory=lambda: LoopRows((), ()))
    usual: tuple[float, ...] = ()
    """Typical size of each pivot of A M⁻¹ A'."""
    allowed: tuple[float, ...] = ()
    """Largest gap of each position row after a step, rad or m."""

    @property
    def key(self) -> tuple[Any, ...]:
        """Cache key: plans of one robot with equal keys share a program."""
        return "closed step", super().key, self.loops

    @property
    def state(self) -> Ports:
        """Names and shapes of the parts of the state."""
        q, dq, *work = super().state
        return [q, dq, ("kept", (KEPT,)), *work]

    @property
    def eases(self) -> bool:
        """True: every method smooths friction."""
        return self.friction

    @cached_property
    def _held(self) -> tuple[Constraint, ...]:
        return independent_constraints(self.loops.constraints, self.loops.independent)

    def recurrence(self) -> Scan:
        """Loop of steps, and the sources of its inputs."""
        parts = [name for name, _ in self.state]
        program = trace(self._step, [*self.state, *self.given], [*parts, *self._reports])
        fed = [Source("state", k) for k in range(len(parts))] + [Source("given")] * len(self.given)
        return Scan(program, tuple(fed), visible=len(parts))

    # ── on symbols ──

    def _step(self, q: Array, dq: Array, passed: Array, *rest: Any) -> tuple[Array, ...]:
        """One step by :class:`.schemes.RungeKutta` or :class:`.schemes.SemiImplicit`, and projection onto the constraints."""
        start, (h, *given) = (q, dq, *rest[: self.works]), rest[self.works :]
        first, tau, _ = self._rates(q, q, dq, given)
        if self.method in TABLEAUS:
            a, b, _, _, _ = TABLEAUS[self.method].numbers
            stages = [first]
            for i in range(1, len(b)):
                q_i, dq_i = _along(start[:2], h, a[i], stages)
                stages.append(self._rates(q_i, q_i, dq_i, given)[0])
            q1, dq1, *work = _along(start, h, b, stages)
        else:
            dq1, *work = [x + h * rate for x, rate in zip(start[1:], first[1:], strict=True)]
            q1 = add(self.model, q, h * dq1)
        _, plant, _ = self._models(given)
        q1, dq1, *left = project_state(plant, q1, dq1, self.loops.constraints, self.loops.independent)
        return q1, dq1, self._passed_on(passed, *left), *work, *[first[1]] * self.works, *[tau] * self.says_torques

    def _accelerations(self, plant: Model, angles: Array, dq: Array, force: Array, inputs: dict[str, Array]) -> Array:
        return constrained_dynamics(plant, angles, dq, force, self._pushed(inputs), self._held)[0]

    def _passed_on(self, before: Array, gaps: Array, rates: Array, after: Array, pivots: Array) -> Array:
        """Loop-closure state for the next step; :func:`lost` evaluates it."""
        pivot: Any = smallest(pivots / np.array(self.usual), np.inf)
        beyond = after / np.array(self.allowed) if self.allowed else after
        gone = (1.0 - positive(SMALL - pivot) * positive(SHRUNK * before[PIVOT] - pivot)) * (
            1.0 - positive(MIN_PIVOT - pivot)
        )
        good = before[GOOD] * gone * (1.0 - positive(largest(beyond, 0.0) - 1.0))
        said = largest(gaps, before[WIDEST]), largest(rates, before[FASTEST]), largest(after, before[OPEN]), pivot, good
        return np.array(said, object)


def _along(start: Sequence[Array], h: Any, weights: Array, stages: Sequence[Sequence[Array]]) -> list[Array]:
    """Step x + h Σ w_i k_i of each part of the state."""
    return [
        x + h * sum(float(w) * stage[part] for w, stage in zip(weights, stages, strict=False) if w)
        for part, x in enumerate(start)
    ]


def lost(pivot: Array, earlier: Array | float) -> Array:
    """True if the constraints lose rank after a step or in the next, by the smallest pivots after and before it."""
    return ~(pivot >= MIN_PIVOT) | ((pivot < SMALL) & (pivot < SHRUNK * earlier))


# ── Closed system: rates of constrained dynamics, steps projected onto the constraints

# q̈ and λ of  τ = M q̈ + h + A'λ,  A q̈ + (dA/dt) dq = 0       (MR section 8.7)
#
# determine the acceleration only. After each step q and dq are projected: see
# :mod:`twistwrench.mechanics.algorithms.loop_closure`.

CLOSED_METHODS = (ADAPTIVE, "rk4", "semi_implicit", "euler")
"""Methods that only evaluate rates; the variational ones support open robots only."""


class Loops:
    """Constraints of a closed robot in a simulation, and the constraint errors that its steps left."""

    def __init__(self, closed: ConstrainedRobot) -> None:
        self.closed, robot = closed, closed.open()
        self.with_gap = with_gaps(closed.constraints)
        self.kept = independent_constraints(closed.constraints, closed.independent)
        self._nq = robot.nq
        self._moving = slice(robot.nq, robot.nq + robot.nv)
        self._units = gap_units(closed)
        self._sizes = closed.sizes[list(closed.independent)] ** 2
        self._project = robot.engine.cache(("projection", closed.constraints, closed.independent), self._compiled)
        self.dynamics = robot.kernel("constrained_dynamics", constraints=self.kept)
        self.widest = self.fastest = 0.0
        """Largest gap [rad or m] and largest gap rate [rad/s, m/s] after a step, before projection."""
        self.system: ClosedSystem
        """Forces on the robot, set later."""

    # ── parts of a run ──

    steps: type[CompiledSteps]
    """Compiled steps on the constraints."""

    def system_under(self, **acting: Any) -> ClosedSystem:
        """Closed system under torques, wrenches and contacts."""
        return ClosedSystem(self, **acting)

    def scheme_on(self, scheme: Scheme) -> ClosedScheme:
        """One-step method whose steps end on the constraints."""
        return ClosedScheme(scheme, self)

    def stepper(self, *options: float) -> ClosedStepper:
        """Adaptive method whose steps end on the constraints."""
        return ClosedStepper(self, *options)

    # ── projections ──

    def _compiled(self) -> Any:
        closed, robot = self.closed, self.closed.open()

        def program(q: Array, dq: Array) -> tuple[Array, ...]:
            return project_state(robot.model, q, dq, closed.constraints, closed.independent)

        names = ["q", "dq", "before", "rates", "after", "pivots"]
        doc = f"States of {robot.name} near its constraints, brought onto them, compiled."
        return compile_form(trace(program, [("q", (robot.nq,)), ("dq", (robot.nv,))], names), "projection", doc)

    def effort(self, stages: int) -> float:
        """Approximate operations of a step with this number of stages; inf if nothing is compiled."""
        owners = owner_of(self._project), owner_of(self.dynamics)
        return sum(n * owner.cost if owner else np.inf for n, owner in zip((1, stages), owners, strict=True))

    def begin(self, y: Array) -> None:
        """Project the first state onto the constraints, in place; raises ConstraintError if it is far from them."""
        q, dq = y[: self._nq], y[self._moving]
        require_met(self.closed, q, dq)
        with np.errstate(all="ignore"):  # the inverse may not exist
            smallest = self.smallest(y)
        if not smallest >= MIN_PIVOT:
            raise ValueRangeError(
                "q0 is a singular configuration: the constraints lose rank there, and no motion goes on from it in one way "
                f"only. closed.rank(q0) is {int(self.closed.rank(q))}, usually {len(self.closed.independent)}: start elsewhere."
            )
        self.onto(0.0, y)
        self.widest = self.fastest = 0.0

    def smallest(self, y: Array) -> Array:
        """Smallest relative pivot of A M⁻¹ A', of states (..., size); 0 if the constraints lose rank."""
        return np.asarray(self.projected(y[..., : self._nq], y[..., self._moving])[-1])

    def projected(self, q: Array, dq: Array) -> tuple[Array, Array, Array]:
        """Projected q (..., nq) and dq (..., nv), and the smallest relative pivot (...)."""
        q, dq, *_, pivots = self._project(q, dq)
        return q, dq, (pivots / self._sizes).min(axis=-1, initial=np.inf)

    def step(self, t: float, h: float, y: Array, y1: Array) -> None:
        """Project the state after a step from y at t onto the constraints, in place."""
        if not np.isfinite(y1).all():  # reported by the check of the step
            return
        smallest = self.onto(t + h, y1)
        if not smallest >= SMALL and lost(np.array(smallest), self.smallest(y)):
            raise SimulationError(
                f"at t = {printed(t + h, 9)} s the constraints lose rank: {', '.join(self.closed.row_names)} hold the "
                "robot in fewer directions at a singular configuration, from which the motion may go on in several ways. "
                "Change the mechanism or the motion so that it stays away, or take a smaller dt where it only comes near."
            )

    def step_of(self, plan: StepPlan) -> ClosedStep:
        """Step of a plan, on the constraints."""
        options = {each.name: getattr(plan, each.name) for each in fields(StepPlan)}
        rows = LoopRows(self.closed.constraints, self.closed.independent)
        usual, allowed = (tuple(x.tolist()) for x in (self._sizes, MAX_CLOSED_GAP * self._units))
        return ClosedStep(**options, loops=rows, usual=usual, allowed=allowed)

    def note(self, gap: float, rate: float) -> None:
        """Record the largest gap and gap rate that a step left."""
        self.widest, self.fastest = max(self.widest, float(gap)), max(self.fastest, float(rate))

    def onto(self, t: float, y: Array) -> float:
        """Project a state onto the constraints, in place; returns the smallest relative pivot."""
        q, dq, before, rates, after, pivots = self._project(y[: self._nq], y[self._moving])
        gap = float(np.abs(before).max(initial=0.0))
        if not np.abs(after / self._units).max(initial=0.0) <= MAX_CLOSED_GAP:
            found, left = self.closed.settled(y[None, : self._nq], MAX_CLOSED_GAP)
            if not (left[0] <= MAX_CLOSED_GAP and gap <= 1.0):
                raise SimulationError(
                    f"at t = {printed(t, 9)} s the loops cannot be closed again: the step left a gap of {printed(gap, 3)} "
                    f"(rad or m), and {printed(left[0], 3)} remains. Take a smaller dt."
                )
            q, dq, _, rates, _, pivots = self._project(found[0], y[self._moving])
        y[: self._nq], y[self._moving] = q, dq
        self.note(gap, np.abs(rates).max(initial=0.0))
        return float((pivots / self._sizes).min(initial=np.inf))


class ClosedSystem(System):
    """Closed robot and the forces on it: y' = f(t, y)."""

    takes_many = False

    def __init__(self, loops: Loops, **acting: Any) -> None:
        super().__init__(loops.closed.open(), **acting)
        self.done = slice(self.size - len(WORKS), self.size)
        """Slice of the works in a state."""
        self.loops, loops.system = loops, self

    def rates(self, t: float, y: Array, out: Array) -> None:
        """Write f(t, y) into ``out``."""
        self.evaluations += 1
        q, dq, powers = y[: self.nq], y[self.moving], out[-4:]
        powers[:] = 0.0
        self.manifold.rates(q, dq, out[: self.nq])
        out[self.moving] = self.loops.dynamics(q, dq, self.forces(t, q, dq, powers))[0]

    def allowed_velocities(self, y: Array) -> Array:
        """Velocities (..., nv) projected onto the constraints, as at the end of a step."""
        with np.errstate(all="ignore"):  # states may be NaN
            return self.loops.projected(y[..., : self.nq], y[..., self.moving])[1]

    def multipliers(self, times: Array, q: Array, dq: Array, tau: Array) -> Array:
        """Multipliers λ (n, k) of states under torques tau and all other forces; wrench callbacks are called again."""
        if not len(times):
            return np.zeros((0, len(self.loops.closed.sizes)))
        total = self.total(times, q, dq, tau)
        _, lam, pivots = self.loops.dynamics(q, dq, total)
        closed = self.loops.closed
        if len(closed.independent) == len(closed.sizes) and not needs_singular_values(pivots, closed.sizes).any():
            return np.asarray(lam)
        return np.asarray(closed.forward_dynamics(q, dq, total).lam)


class ClosedScheme:
    """One-step method whose steps end on the constraints."""

    def __init__(self, scheme: Scheme, loops: Loops) -> None:
        self.scheme, self.loops = scheme, loops
        self.order, self.quadrature, self.lagging = scheme.order, scheme.quadrature, scheme.lagging

    def step(self, t: float, y: Array, h: float, rate: Array, /) -> Array:
        """State a time ``h`` later."""
        y1 = self.scheme.step(t, y, h, rate)
        self.loops.step(t, h, y, y1)
        return y1


class ClosedStepper(Stepper):
    """Dormand–Prince method whose steps and dense output are projected onto the constraints."""

    def __init__(self, loops: Loops, *rest: float) -> None:
        super().__init__(loops.system, *rest)
        self.loops = loops

    def step(self, t: float, y: Array, rate: Array, until: float) -> tuple[float, Array]:
        """Time and state after one accepted step, not beyond ``until``."""
        t1, y1 = super().step(t, y, rate, until)
        self.loops.step(t, t1 - t, y, y1)
        return t1, y1

    def between(self, times: Array) -> Array:
        """States (m, size) at times (m,) within the last step."""
        states = super().between(times)
        for t, y in zip(times.tolist(), states, strict=True):
            self.loops.onto(t, y)
        return states


# ── Compiled steps under constant torques and wrenches

LARGEST = 30_000
"""Largest number of operations of a compiled step; compilation takes a second or two, more than most simulations."""
BLOCK = 2000
"""Steps between two checks for a keyboard interrupt: about 10 ms."""


class ClosedSteps(CompiledSteps):
    """Steps of one method under the constant torques and wrenches of a closed system."""

    loops: Loops

    @classmethod
    def build(cls, system: System, method: str, order: int, h: float) -> ClosedSteps | None:
        """Compiled steps; None if there are callbacks or contacts, or a step is too long to compile."""
        if not isinstance(system, ClosedSystem) or method not in COMPILED_METHODS:
            return None
        if system.functions or system.contacts or not acts_by_itself(system):
            return None
        loops, robot = system.loops, system.robot
        plan = loops.step_of(StepPlan.from_system(system, method))
        if not (effort := loops.effort(plan.stages)) <= LARGEST:
            return None
        doc = f"Steps of {robot.name} on its constraints, compiled: {method}."
        kernel = robot.engine.cache(plan.key, lambda: compile_form(plan.recurrence(), "closed steps", doc))
        found = cls(system, plan, order, h, kernel, effort)
        found.most, found.loops = BLOCK, loops
        return found

    def advance(self, y: Array, steps: int, h: float | None = None) -> tuple[Array, Array, Array]:
        """Advance as :meth:`.CompiledSteps.advance`; states are NaN from the first step that ends off the constraints."""
        s, loops = self.system, self.loops
        lengths = np.full(steps, self.h if h is None else h)
        batch = (*y.shape[:-1], steps)
        states, kept, ddq = (
            np.empty((*y.shape[:-1], steps + 1, s.size)),
            np.empty((*batch, KEPT)),
            np.empty((*batch, s.nv)),
        )
        states[..., 0, :] = y
        Y = states[..., 1:, :]
        begun = np.zeros((*y.shape[:-1], KEPT))
        begun[..., PIVOT], begun[..., GOOD] = loops.smallest(y), 1.0
        q, dq, work = self.cuts
        given = [np.broadcast_to(x[..., None, :], (*x.shape[:-1], steps, x.shape[-1])) for x in self.inputs()]
        with np.errstate(all="ignore"):
            self.kernel(
                y[..., q], y[..., dq], begun, y[..., work], lengths, *given,
                out=(Y[..., q], Y[..., dq], kept, Y[..., work], ddq),
            )  # fmt: skip
        good = kept[..., GOOD] > 0.5
        Y[~good] = np.nan
        if h is None and good.any():
            last = kept[int(good.sum()) - 1]
            loops.note(last[WIDEST], last[FASTEST])
        s.evaluations += self.stages * steps
        return states, ddq, np.empty((*batch, 0))


Loops.steps = ClosedSteps

# ── Simulations and rollouts of closed robots, with constraint forces and constraint drift


@dataclass(frozen=True, eq=False, repr=False)
class ClosedSimulation(SimulationResult):
    """Simulated motion of a closed robot. Files do not store the fields in addition to :class:`SimulationResult`."""

    row_names: tuple[str, ...] = ()
    """Names of the entries of lam."""
    lam: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """(n, k) N m or N, λ of each state, exerted by the robot on its constraints."""
    gap: Array = field(default_factory=lambda: np.zeros(0))
    """(n,) rad or m, largest gap of the loops in each state."""
    gap_before: float = 0.0
    """rad or m, largest gap after a step, before the projection removed it."""
    slip_before: float = 0.0
    """rad/s or m/s, largest rate A dq after a step, before the projection removed it."""

    @classmethod
    def _from_result(cls, found: SimulationResult, closed: ConstrainedRobot, loops: Loops | None) -> Self:
        """Result with its constraint forces and errors; ``loops`` is None if no row is constrained."""
        known = {f.name: getattr(found, f.name) for f in fields(SimulationResult) if f.init}
        known |= {"row_names": closed.row_names, "gap": np.abs(closed.gaps(found.q)).max(axis=-1, initial=0.0)}
        if loops is None:
            return cls(**known, lam=np.zeros((len(found), len(closed.sizes))))
        lam = loops.system.multipliers(found.times, found.q, found.dq, found.tau)
        return cls(**known, lam=lam, gap_before=loops.widest, slip_before=loops.fastest)

    def __repr__(self) -> str:
        held = f"gap {residual(self.gap.max(initial=0.0))}, before projection {residual(self.gap_before)}"
        return f"{super().__repr__()[:-1]}; {held}>"


def simulate_closed(
    closed: ConstrainedRobot, q0: Any, *start: Any, method: str | None, **given: Any
) -> ClosedSimulation:
    """Simulation from one state; see :meth:`twistwrench.Robot.simulate`."""
    method = "rk4" if method is None else method
    if method not in CLOSED_METHODS:
        raise UnknownNameError.from_choices("method", method, CLOSED_METHODS)
    loops = Loops(closed) if closed.independent else None
    if q0 is None:
        q0 = some_configurations(closed, closed.open().neutral)[0]
    try:
        found = run_to_end(build_run(closed.open(), q0, *start, method=method, loops=loops, **given))
    except (SimulationError, KeyboardInterrupt) as problem:
        if isinstance(result := getattr(problem, "result", None), SimulationResult):
            problem.result = ClosedSimulation._from_result(result, closed, loops)  # type: ignore[union-attr]
        raise
    return ClosedSimulation._from_result(found, closed, loops)


# ── Rollouts of closed robots, each step projected onto the constraints


@dataclass(frozen=True, eq=False, repr=False)
class ClosedRollout(Rollout):
    """Rollout of a closed robot: motions of any batch shape, with their constraint errors."""

    gap: Array = field(default_factory=lambda: np.zeros(()))
    """(...) rad or m, largest gap of the loops after any step."""
    gap_before: Array = field(default_factory=lambda: np.zeros(()))
    """(...) rad or m, largest gap after a step, before the projection removed it."""
    slip_before: Array = field(default_factory=lambda: np.zeros(()))
    """(...) rad/s or m/s, largest rate A dq after a step, before the projection removed it."""
    lost_from: Array = field(default_factory=lambda: np.zeros(()))
    """(...) s, first stored time at which the constraints had lost rank or could not be satisfied; inf if they hold throughout.
    States from there on are NaN, because the motion is not unique."""

    def __repr__(self) -> str:
        gaps = (float(np.max(x, initial=0.0)) for x in (self.gap, self.gap_before))
        return f"{super().__repr__()[:-1]}; gap {residual(next(gaps))}, before projection {residual(next(gaps))}>"


def rollout_closed(
    closed: ConstrainedRobot, *start: Any, gradients: bool, out: tuple[Array, ...] | None, **given: Any
) -> ClosedRollout:
    """Motions from q0 (..., nq) and dq0 (..., nv); see :meth:`twistwrench.Robot.rollout`."""
    robot = closed.open()
    if arguments.flag(gradients, "gradients") or out is not None:
        raise ValueRangeError(
            "gradients and out are for rollouts of open robots; leave them out where loops are closed."
        )
    if not closed.independent:
        plain = rollout_of_tree(robot, *start, gradients=False, out=None, **given)
        none = np.zeros(plain.batch)
        known = {name: getattr(plain, name) for name in Rollout.__dataclass_fields__}
        return ClosedRollout(**known, gap=none, gap_before=none, slip_before=none, lost_from=none + np.inf)
    loops = Loops(closed)
    inputs = cleaned(robot, *start, **given, step_of=loops.step_of)
    if moves_joints(robot.model, inputs.plan.parameters):
        raise ValueRangeError(
            f"parameters={inputs.plan.parameters!r} move joints, and with them where the loops close. Close a robot of each "
            "geometry by itself; inertias, payloads and friction may vary."
        )
    inputs = _begun(loops, inputs)
    q, dq, kept, *tau = computed(robot, inputs, room_for(inputs, None))
    lost = ~(kept[..., GOOD] > 0.5)
    q[lost], dq[lost] = np.nan, np.nan
    last = np.maximum((~lost).sum(axis=-1) - 1, 0)  # last state on the constraints
    end = np.take_along_axis(kept, last[..., None, None], axis=-2)[..., 0, :]
    lost_from = np.where(lost.any(axis=-1), inputs.times[np.argmax(lost, axis=-1)], np.inf)
    if lost.any():
        first = np.unravel_index(int(np.argmin(lost_from)), inputs.batch) if inputs.batch else ()
        where = f", first {tuple(map(int, first))}" if inputs.batch else ""
        remark = (
            f"{np.isfinite(lost_from).sum()} of the motions lose rank of their constraints or leave them{where} before "
            f"{printed(float(lost_from[first]))} s; their states after that are NaN"
        )
        inputs = replace(inputs, remarks=(*inputs.remarks, remark))
    gaps = {"gap": end[..., OPEN], "gap_before": end[..., WIDEST], "slip_before": end[..., FASTEST]}
    return build_rollout(ClosedRollout, robot, inputs, q, dq, tau, **gaps, lost_from=lost_from)


def _begun(loops: Loops, given: Inputs) -> Inputs:
    """Inputs with initial states projected onto the constraints, and the initial loop-closure state."""
    closed = loops.closed
    # float64, since loops are closed to 1e-12.
    q, dq, *rest = (x.astype(float, copy=False) for x in given.arrays)
    require_met(closed, q, dq)
    with np.errstate(all="ignore"):
        q, dq, pivot = loops.projected(q, dq)
    if not (pivot >= MIN_PIVOT).all():
        row = int(np.argmin(pivot))
        where = f" (motion {row} of the batch)" if pivot.ndim else ""
        raise ValueRangeError(
            f"q0 is a singular configuration{where}: the constraints lose rank there, and no motion goes on from it in one "
            "way only. Start elsewhere."
        )
    passed = np.zeros((*pivot.shape, KEPT))
    passed[..., PIVOT], passed[..., GOOD] = pivot, 1.0
    return replace(given, arrays=[q, dq, passed, *rest], ranks=[1, *given.ranks], dtype=np.float64)
