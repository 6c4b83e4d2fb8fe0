"""Steps of closed robots: constrained dynamics, integration and projection, compiled in one program or one by one.

q̈ and λ of  τ = M q̈ + h + A'λ,  A q̈ + (dA/dt) dq = 0       (MR section 8.7)

determine the acceleration only. After each step q and dq are projected: see
:mod:`twistwrench.mechanics.algorithms.loop_closure`. Simulations and rollouts take the same steps. The state consists of q,
dq and the loop-closure state; in simulations, the works done so far follow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ...compiler.ir.loops import Scan, Source
from ...compiler.ir.tracer import trace
from ...compiler.runtime.gufunc import owner_of
from ...core.errors import SimulationError, ValueRangeError
from ...core.numbers import printed
from ...core.typing import Array
from ...mechanics.algorithms.constraint_projector import MIN_PIVOT, needs_singular_values
from ...mechanics.algorithms.constraints import Constraint, constrained_dynamics, independent_constraints
from ...mechanics.algorithms.friction import largest, positive, smallest
from ...mechanics.algorithms.kinematics import add
from ...mechanics.algorithms.loop_closure import LoopRows, project_state
from ...mechanics.model.model import Model
from ...robot.constraint_methods import MAX_CLOSED_GAP
from ...robot.constraints.states import require_met
from ...robot.constraints.tolerances import gap_units
from ...robot.engine import compile_form
from ..compiled_steps import COMPILED_METHODS, TABLEAUS, CompiledSteps, Ports, StepPlan, can_compile_steps
from ..forces import WORKS, System
from .adaptive import Stepper
from .schemes import Scheme

if TYPE_CHECKING:
    from ...robot.doors import ConstrainedRobot

# Indices of the loop-closure state, which steps pass on with q and dq. Largest values are over all steps so far.
LARGEST_GAP = 0
"""Largest gap before projection [rad or m]."""
LARGEST_RATE = 1
"""Largest gap rate before projection [rad/s or m/s]."""
REMAINING_GAP = 2
"""Largest gap after projection [rad or m]."""
PIVOT = 3
"""Smallest relative pivot of A M⁻¹ A' after the last step."""
ON_CONSTRAINTS = 4
"""1 as long as all steps end on the constraints, then 0."""
LOOP_STATE_SIZE = 5
"""Number of entries of the loop-closure state."""

SMALL_PIVOT = 1e-2
"""Relative pivot below which a pivot counts as small."""
MIN_PIVOT_RATIO = 0.25
"""Ratio of a small pivot to the pivot before the step, below which the constraints lose rank. The root of the pivot is nearly
proportional to the distance from the singular configuration. It has then halved: another such step would reach or pass it."""


@dataclass(frozen=True)
class ClosedStep(StepPlan):
    """Step on constraints, without numerical values."""

    loops: LoopRows = field(default_factory=lambda: LoopRows((), ()))
    typical_pivots: tuple[float, ...] = ()
    """Typical size of each pivot of A M⁻¹ A'."""
    allowed_gaps: tuple[float, ...] = ()
    """Largest gap of each position row after a step, rad or m."""

    @property
    def key(self) -> tuple[Any, ...]:
        """Cache key: plans of one robot with equal keys share a program."""
        return "closed step", super().key, self.loops

    @property
    def state(self) -> Ports:
        """Names and shapes of the parts of the state."""
        q, dq, *work = super().state
        return [q, dq, ("kept", (LOOP_STATE_SIZE,)), *work]

    @property
    def eases(self) -> bool:
        """True if there is friction: on constraints, every method smooths it."""
        return self.friction

    @cached_property
    def _independent_constraints(self) -> tuple[Constraint, ...]:
        """Constraints without rows that depend on others."""
        return independent_constraints(self.loops.constraints, self.loops.independent)

    def recurrence(self) -> Scan:
        """Loop of steps, and the sources of its inputs."""
        part_count = len(self.state)
        result_names = [*dict(self.state), *self._reports]
        program = trace(self._step, [*self.state, *self.inputs], result_names)
        sources = [Source("state", k) for k in range(part_count)]
        sources += [Source("given")] * len(self.inputs)
        return Scan(program, tuple(sources), visible=part_count)

    def _step(self, q: Array, dq: Array, loop_state: Array, *rest: Any) -> tuple[Array, ...]:
        """One step by :class:`.schemes.RungeKutta` or :class:`.schemes.SemiImplicit`, and projection onto the constraints.

        ``rest`` are the works, if the plan has them, the step h and the inputs of the plan.
        """
        start = (q, dq, *rest[: self.works])  # rates (q̇, q̈, powers) have the same parts
        h, *inputs = rest[self.works :]
        first_rates, tau, _ = self._rates(q, q, dq, inputs)
        if self.method in TABLEAUS:
            a, b, _, _, _ = TABLEAUS[self.method].numbers
            stages = [first_rates]
            for i in range(1, len(b)):
                q_i, dq_i = _add_stages(start[:2], h, a[i], stages)
                rates, _, _ = self._rates(q_i, q_i, dq_i, inputs)
                stages.append(rates)
            q1, dq1, *work = _add_stages(start, h, b, stages)
        else:
            dq1, *work = [x + h * rate for x, rate in zip(start[1:], first_rates[1:], strict=True)]
            q1 = add(self.model, q, h * dq1)
        _, plant, _ = self._models(inputs)
        q1, dq1, *errors = project_state(plant, q1, dq1, self.loops.constraints, self.loops.independent)
        _, ddq, *_ = first_rates
        reports = [*[ddq] * self.works, *[tau] * self.returns_torques]  # each flag is 0 or 1
        return q1, dq1, self._next_loop_state(loop_state, *errors), *work, *reports

    def _accelerations(self, plant: Model, angles: Array, dq: Array, force: Array, inputs: dict[str, Array]) -> Array:
        """Accelerations (nv,) of the robot on its constraints."""
        wrenches = self._robot_wrenches(inputs)
        ddq, *_ = constrained_dynamics(plant, angles, dq, force, wrenches, self._independent_constraints)
        return ddq

    def _next_loop_state(
        self, loop_state: Array, gaps: Array, rates: Array, remaining_gaps: Array, pivots: Array
    ) -> Array:
        """Loop-closure state after a step, from the state before the step and the results of its projection.

        Conditions are factors of 0 or 1; those on the pivot are the conditions of :func:`loses_rank`.
        """
        pivot: Any = smallest(pivots / np.array(self.typical_pivots), np.inf)
        relative_gaps = remaining_gaps
        if self.allowed_gaps:
            relative_gaps = remaining_gaps / np.array(self.allowed_gaps)
        shrinks_fast = positive(SMALL_PIVOT - pivot) * positive(MIN_PIVOT_RATIO * loop_state[PIVOT] - pivot)
        keeps_rank = (1.0 - shrinks_fast) * (1.0 - positive(MIN_PIVOT - pivot))
        closes_loops = 1.0 - positive(largest(relative_gaps, 0.0) - 1.0)
        on_constraints = loop_state[ON_CONSTRAINTS] * keeps_rank * closes_loops
        next_loop_state = (
            largest(gaps, loop_state[LARGEST_GAP]),
            largest(rates, loop_state[LARGEST_RATE]),
            largest(remaining_gaps, loop_state[REMAINING_GAP]),
            pivot,
            on_constraints,
        )  # in the order of their indices
        return np.array(next_loop_state, object)


def _add_stages(start: Sequence[Array], h: Any, weights: Array, stages: Sequence[Sequence[Array]]) -> list[Array]:
    """Parts of the state x + h Σ w_i k_i; stages k_i of weight 0 add no operations."""
    end = []
    for k, x in enumerate(start):
        weighted_rates = [float(w) * stage[k] for w, stage in zip(weights, stages, strict=False) if w]
        end.append(x + h * sum(weighted_rates))
    return end


def loses_rank(pivot: Array, pivot_before: Array | float) -> Array:
    """True if the constraints lose rank in a step or in the next one, by the smallest pivots after and before the step."""
    is_singular = ~(pivot >= MIN_PIVOT)  # also true for NaN
    return is_singular | ((pivot < SMALL_PIVOT) & (pivot < MIN_PIVOT_RATIO * pivot_before))


MAX_GAP_OF_STEP = 1.0
"""Largest gap of a step [rad or m]: a step that leaves a larger one is too long, even if the loops can be closed again."""


class Loops:
    """Constraints of a closed robot in a simulation, and the constraint errors that its steps left."""

    def __init__(self, closed: ConstrainedRobot) -> None:
        robot = closed.open()
        self.closed = closed
        self._nq = robot.nq
        self._moving = slice(robot.nq, robot.nq + robot.nv)
        self._units = gap_units(closed)
        self._typical_pivots = closed.sizes[list(closed.independent)] ** 2
        key = ("projection", closed.constraints, closed.independent)
        self._project = robot.engine.cache(key, self._compile_projection)
        independent = independent_constraints(closed.constraints, closed.independent)
        self.dynamics = robot.kernel("constrained_dynamics", constraints=independent)
        self.largest_gap = 0.0
        """Largest gap after a step, before projection [rad or m]."""
        self.largest_rate = 0.0
        """Largest gap rate after a step, before projection [rad/s or m/s]."""
        self.system: ClosedSystem
        """Forces on the robot, set later."""

    steps: type[CompiledSteps]
    """Compiled steps on the constraints."""

    def system_under(self, **acting: Any) -> ClosedSystem:
        """Closed system under ``acting`` torques, wrenches and contacts, the arguments of :class:`.System`."""
        return ClosedSystem(self, **acting)

    def scheme_on(self, scheme: Scheme) -> ClosedScheme:
        """One-step method whose steps end on the constraints."""
        return ClosedScheme(scheme, self)

    def stepper(self, *options: float) -> ClosedStepper:
        """Adaptive method whose steps end on the constraints, with the options of :class:`.Stepper`."""
        return ClosedStepper(self, *options)

    def _compile_projection(self) -> Any:
        """Kernel of :func:`.project_state`."""
        closed = self.closed
        robot = closed.open()

        def projection(q: Array, dq: Array) -> tuple[Array, ...]:
            return project_state(robot.model, q, dq, closed.constraints, closed.independent)

        inputs: Ports = [("q", (robot.nq,)), ("dq", (robot.nv,))]
        result_names = ["q", "dq", "before", "rates", "after", "pivots"]
        program = trace(projection, inputs, result_names)
        doc = f"States of {robot.name} near its constraints, brought onto them, compiled."
        return compile_form(program, "projection", doc)

    def operations(self, stages: int) -> float:
        """Approximate number of operations of a step with this number of stages; inf if nothing is compiled."""
        projection = owner_of(self._project)
        dynamics = owner_of(self.dynamics)
        if not projection or not dynamics:
            return np.inf
        return projection.cost + stages * dynamics.cost

    def begin(self, y: Array) -> None:
        """Project the first state onto the constraints, in place; raises ConstraintError if it is far from them."""
        q, dq = y[: self._nq], y[self._moving]
        require_met(self.closed, q, dq)
        with np.errstate(all="ignore"):  # the inverse may not exist
            pivot = self.smallest_pivot(y)
        if not pivot >= MIN_PIVOT:
            raise ValueRangeError(
                "q0 is a singular configuration: the constraints lose rank there, and no motion goes on from it in one way "
                f"only. closed.rank(q0) is {int(self.closed.rank(q))}, usually {len(self.closed.independent)}: start elsewhere."
            )
        self.onto(0.0, y)
        self.largest_gap = self.largest_rate = 0.0

    def smallest_pivot(self, y: Array) -> Array:
        """Smallest relative pivot (...) of A M⁻¹ A' at states (..., size); 0 if the constraints lose rank."""
        _, _, pivot = self.project(y[..., : self._nq], y[..., self._moving])
        return np.asarray(pivot)

    def project(self, q: Array, dq: Array) -> tuple[Array, Array, Array]:
        """Projected q (..., nq) and dq (..., nv), and the smallest relative pivot (...)."""
        q, dq, *_, pivots = self._project(q, dq)
        relative_pivots = pivots / self._typical_pivots
        return q, dq, relative_pivots.min(axis=-1, initial=np.inf)

    def step(self, t: float, h: float, y: Array, y1: Array) -> None:
        """Project the state y1 after a step from y at t onto the constraints, in place; raises SimulationError."""
        if not np.isfinite(y1).all():  # the check of the step reports it
            return
        pivot = self.onto(t + h, y1)
        is_small = not pivot >= SMALL_PIVOT  # also for NaN
        if is_small and loses_rank(np.array(pivot), self.smallest_pivot(y)):
            raise SimulationError(
                f"at t = {printed(t + h, 9)} s the constraints lose rank: {', '.join(self.closed.row_names)} hold the "
                "robot in fewer directions at a singular configuration, from which the motion may go on in several ways. "
                "Change the mechanism or the motion so that it stays away, or take a smaller dt where it only comes near."
            )

    def step_of(self, plan: StepPlan) -> ClosedStep:
        """Step of a plan, on the constraints."""
        options = {option.name: getattr(plan, option.name) for option in fields(StepPlan)}
        return ClosedStep(
            **options,
            loops=LoopRows(self.closed.constraints, self.closed.independent),
            typical_pivots=tuple(self._typical_pivots.tolist()),
            allowed_gaps=tuple((MAX_CLOSED_GAP * self._units).tolist()),
        )

    def note(self, gap: float, rate: float) -> None:
        """Record the largest gap and gap rate that a step left."""
        self.largest_gap = max(self.largest_gap, float(gap))
        self.largest_rate = max(self.largest_rate, float(rate))

    def onto(self, t: float, y: Array) -> float:
        """Project a state onto the constraints, in place; returns the smallest relative pivot.

        Two corrections close the loops after a usual step. If they do not suffice, the loops are closed by iteration.
        """
        q, dq, gaps, rates, remaining_gaps, pivots = self._project(y[: self._nq], y[self._moving])
        gap = float(np.abs(gaps).max(initial=0.0))
        if not np.abs(remaining_gaps / self._units).max(initial=0.0) <= MAX_CLOSED_GAP:
            closed_q, largest_gaps = self.closed.settled(y[None, : self._nq], MAX_CLOSED_GAP)
            remaining_gap = largest_gaps[0]  # of the single state
            if not (remaining_gap <= MAX_CLOSED_GAP and gap <= MAX_GAP_OF_STEP):
                raise SimulationError(
                    f"at t = {printed(t, 9)} s the loops cannot be closed again: the step left a gap of {printed(gap, 3)} "
                    f"(rad or m), and {printed(remaining_gap, 3)} remains. Take a smaller dt."
                )
            q, dq, _, rates, _, pivots = self._project(closed_q[0], y[self._moving])
        y[: self._nq] = q
        y[self._moving] = dq
        self.note(gap, np.abs(rates).max(initial=0.0))
        return float((pivots / self._typical_pivots).min(initial=np.inf))


class ClosedSystem(System):
    """Closed robot and the forces on it: y' = f(t, y)."""

    takes_many = False  # states of a batch are evaluated one by one

    def __init__(self, loops: Loops, **acting: Any) -> None:
        super().__init__(loops.closed.open(), **acting)
        self.work_entries = slice(self.size - len(WORKS), self.size)
        """Entries of the works in a state."""
        self.loops = loops
        loops.system = self

    def rates(self, t: float, y: Array, out: Array) -> None:
        """Write f(t, y) into ``out``."""
        self.evaluations += 1
        q, dq = y[: self.nq], y[self.moving]
        powers = out[self.work_entries]  # written by self.forces
        powers[:] = 0.0
        self.manifold.rates(q, dq, out[: self.nq])
        force = self.forces(t, q, dq, powers)
        ddq, _, _ = self.loops.dynamics(q, dq, force)  # without λ and pivots
        out[self.moving] = ddq

    def allowed_velocities(self, y: Array) -> Array:
        """Velocities (..., nv) projected onto the constraints, as at the end of a step."""
        with np.errstate(all="ignore"):  # states may be NaN
            _, dq, _ = self.loops.project(y[..., : self.nq], y[..., self.moving])
        return dq

    def multipliers(self, times: Array, q: Array, dq: Array, tau: Array) -> Array:
        """Multipliers λ (n, k) of states under torques tau and all other forces; wrench callbacks are called again."""
        closed = self.loops.closed
        if not len(times):
            return np.zeros((0, len(closed.sizes)))
        total_force = self.total(times, q, dq, tau)
        _, lam, pivots = self.loops.dynamics(q, dq, total_force)
        all_independent = len(closed.independent) == len(closed.sizes)
        if all_independent and not needs_singular_values(pivots, closed.sizes).any():
            return np.asarray(lam)
        return np.asarray(closed.forward_dynamics(q, dq, total_force).lam)


class ClosedScheme:
    """One-step method whose steps end on the constraints."""

    def __init__(self, scheme: Scheme, loops: Loops) -> None:
        self.scheme = scheme
        self.loops = loops
        self.order = scheme.order
        self.quadrature = scheme.quadrature
        self.lagging = scheme.lagging

    def on(self, system: System) -> ClosedScheme:
        """Same method for a copy of its system."""
        return ClosedScheme(self.scheme.on(system), self.loops)

    def step(self, t: float, y: Array, h: float, rate: Array, /) -> Array:
        """State at t + ``h``, on the constraints."""
        y1 = self.scheme.step(t, y, h, rate)
        self.loops.step(t, h, y, y1)
        return y1


class ClosedStepper(Stepper):
    """Dormand–Prince method whose steps and dense output are projected onto the constraints."""

    def __init__(self, loops: Loops, *options: float) -> None:
        super().__init__(loops.system, *options)
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


MAX_OPERATIONS = 30_000
"""Largest number of operations of a compiled step; compilation takes a second or two, more than most simulations."""
STEPS_PER_CALL = 2000
"""Number of steps between two checks for a keyboard interrupt: about 10 ms."""


class ClosedSteps(CompiledSteps):
    """Steps of one method under the constant torques and wrenches of a closed system."""

    loops: Loops

    @classmethod
    def build(cls, system: System, method: str, order: int, h: float) -> ClosedSteps | None:
        """Compiled steps; None if there are callbacks or contacts, or if a step is too long to compile."""
        if not isinstance(system, ClosedSystem) or method not in COMPILED_METHODS:
            return None
        has_callbacks = bool(system.functions)
        if has_callbacks or system.contacts or not can_compile_steps(system):
            return None
        loops = system.loops
        robot = system.robot
        plan = loops.step_of(StepPlan.from_system(system, method))
        operations = loops.operations(plan.stages)
        if not operations <= MAX_OPERATIONS:
            return None
        doc = f"Steps of {robot.name} on its constraints, compiled: {method}."
        kernel = robot.engine.cache(plan.key, lambda: compile_form(plan.recurrence(), "closed steps", doc))
        steps = cls(system, plan, order, h, kernel, operations)
        steps.most = STEPS_PER_CALL
        steps.loops = loops
        return steps

    def advance(self, y: Array, steps: int, h: float | None = None) -> tuple[Array, Array, Array]:
        """Advance as :meth:`.CompiledSteps.advance`; states are NaN from the first step that ends off the constraints."""
        system = self.system
        loops = self.loops
        lengths = np.full(steps, self.h if h is None else h)
        batch_shape = (*y.shape[:-1], steps)
        states = np.empty((*y.shape[:-1], steps + 1, system.size))
        loop_states = np.empty((*batch_shape, LOOP_STATE_SIZE))
        ddq = np.empty((*batch_shape, system.nv))
        states[..., 0, :] = y
        states_after = states[..., 1:, :]  # a view
        first_loop_state = np.zeros((*y.shape[:-1], LOOP_STATE_SIZE))
        first_loop_state[..., PIVOT] = loops.smallest_pivot(y)
        first_loop_state[..., ON_CONSTRAINTS] = 1.0
        inputs = [np.broadcast_to(x[..., None, :], (*x.shape[:-1], steps, x.shape[-1])) for x in self.inputs()]
        q, dq, work = self.parts(y)
        q_after, dq_after, work_after = self.parts(states_after)
        out = (q_after, dq_after, loop_states, work_after, ddq)
        with np.errstate(all="ignore"):
            self.kernel(q, dq, first_loop_state, work, lengths, *inputs, out=out)
        on_constraints = loop_states[..., ON_CONSTRAINTS] > 0.5  # 0 or 1
        states_after[~on_constraints] = np.nan
        if h is None and on_constraints.any():  # steps of another length only estimate errors
            last_loop_state = loop_states[int(on_constraints.sum()) - 1]
            loops.note(last_loop_state[LARGEST_GAP], last_loop_state[LARGEST_RATE])
        system.evaluations += self.stages * steps
        return states, ddq, np.empty((*batch_shape, 0))


Loops.steps = ClosedSteps
