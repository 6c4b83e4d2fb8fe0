"""Compiled steps of rollouts and simulations: torques, forward dynamics and integration, traced together.

The coordinates q are passed twice. The second array, ``angles``, is checked once for its magnitude, so that a whole step
can be compiled without branches.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from ..compiler.ir.loops import Scan, Source
from ..compiler.ir.program import Program
from ..compiler.ir.tracer import trace
from ..compiler.runtime.gufunc import owner_of
from ..compiler.runtime.interpreter import compiles
from ..core.typing import Array
from ..mechanics.algorithms import kinematics as integration
from ..mechanics.algorithms.contact import largest, velocity_step
from ..mechanics.algorithms.forward_dynamics import forward_dynamics
from ..mechanics.algorithms.friction import sliding_share, torque_past_eased_friction
from ..mechanics.algorithms.operational_space import clip_torques
from ..mechanics.algorithms.recursion import zeros
from ..mechanics.model.couplings import motor_velocities
from ..mechanics.model.model import Model
from ..mechanics.model.parameters import moves_joints, regrouped, with_symbolic_parameters
from ..robot.engine import compile_form
from .contact import RobotContact
from .forces import WORKS, ControlLaw, System
from .methods.tableaus import EULER, RK4, Tableau
from .torque_laws import GivenTorque, TorqueLaw

TABLEAUS = {"euler": EULER, "rk4": RK4}
"""Tableaus by method: only methods in which each stage depends on the previous stage alone."""
COMPILED_METHODS = ("semi_implicit", *TABLEAUS)
"""Methods with compiled steps, by their names in simulations."""

Ports = list[tuple[str, tuple[int, ...]]]
"""Names and shapes of the inputs or outputs of a program."""

_NUMBERS_PER_STAGE = 5
"""Number of entries in a row of :func:`stages`."""
_WEIGHT_OF_POSITIONS_AND_WORKS = 1e-30
"""Weight of squared coordinates and works in the peak of a state, so small that only their NaN shows in it."""


@dataclass(frozen=True)
class StepPlan:
    """Step of a simulation or rollout, without numerical values.

    Simulations also count works: their state is y = (q, dq, W) of :mod:`.forces`. Works are integrated by the same
    method as the motion, and a step also returns the accelerations at its start.
    """

    model: Model
    law: TorqueLaw
    method: str
    limited: bool = False
    """True if torques are clipped."""
    frames: tuple[str, ...] = ()
    """Frames at which wrenches act on the robot."""
    parameters: tuple[str, ...] = ()
    """Names of the model parameters that are inputs of a step."""
    friction: bool = False
    """True if friction acts on the joints."""
    returns_torques: bool = False
    """True if a step also returns the applied torques."""
    works: bool = False
    """True if works are integrated, as in simulations."""
    contacts: tuple[RobotContact, ...] = ()

    @classmethod
    def from_system(cls, system: System, method: str) -> Self:
        """Step of a simulation under constant torques."""
        return cls(
            system.robot.model, GivenTorque(), method, frames=tuple(system.wrenches), friction=system.rubs, works=True,
            contacts=system.contacts,
        )  # fmt: skip

    @property
    def key(self) -> tuple[Any, ...]:
        """Cache key: plans of one robot with equal keys share a program."""
        options = self.method, self.limited, self.frames, self.parameters, self.friction, self.returns_torques
        contacts = tuple(contact.key for contact in self.contacts)
        kind = "simulated step" if self.works else "rollout"
        return kind, *self.law.key, *options, contacts

    @property
    def state(self) -> Ports:
        """Names and shapes of the parts of the state passed between steps."""
        ports: Ports = [("q", (self.model.nq,)), ("dq", (self.model.nv,))]
        if self.works:
            ports.append(("work", (len(WORKS),)))
        return ports

    @property
    def _state_names(self) -> list[str]:
        """Names of the outputs with the next state; in simulations its peak comes last."""
        names = [name for name, _ in self.state]
        if self.works:
            names.append("peak")
        return names

    @property
    def eases(self) -> bool:
        """True if dry friction is smoothed at low speeds; False if it is an impulse that stops a joint."""
        return self.friction and self.method != "semi_implicit"

    @property
    def stages(self) -> int:
        """Evaluations of forward dynamics in a step."""
        return len(TABLEAUS[self.method].b) if self.method in TABLEAUS else 1

    @property
    def inputs(self) -> Ports:
        """Names and shapes of the inputs of each step, in the kernel's order; inputs of contacts come last."""
        nq, nv = self.model.nq, self.model.nv
        ports: Ports = [("dt", ())]
        for name in self.law.names:
            size = nq if name == "q_des" else nv
            ports.append((name, (size,)))
        if self.limited:
            ports.append(("torque limits", (nv,)))
        ports += [(f"wrench at {frame}", (6,)) for frame in self.frames]
        if self.eases:
            ports.append(("creep", (nv,)))
        if self.parameters:
            ports.append(("parameters", (len(self.parameters),)))
        for k, contact in enumerate(self.contacts):
            for name, value in contact.numbers.items():
                ports.append((f"{name} of contact {k}", value.shape))
        return ports

    def recurrence(self) -> Scan:
        """Loop over whole steps. In simulations the state ends with its peak: see :meth:`_with_peak`."""
        returned_states = len(self._state_names)
        if self.method in TABLEAUS:
            program, sources = self._trace_stage()
            sum_count = len(self.state)  # a sum of weighted rates for each part of the state
            rows = stages(TABLEAUS[self.method])
            return Scan(program, sources, visible=returned_states, hidden=sum_count, table=rows)
        ports = [self._angle_port, *self.state, *self.inputs]
        program = trace(self._semi_implicit, ports, [*self._state_names, *self._reports])
        sources = (*self._state_sources, *[Source("given")] * len(self.inputs))
        return Scan(program, sources, visible=returned_states)

    def one_stage(self) -> Scan:
        """Loop over Runge–Kutta stages: sums are states; start of the step and row of the tableau are inputs."""
        program, stage_sources = self._trace_stage()
        sources = [source if source.kind == "state" else Source("given") for source in stage_sources]
        sum_count = len(self.state)
        return Scan(program, tuple(sources), visible=len(self._state_names) + sum_count)

    def _trace_stage(self) -> tuple[Program, tuple[Source, ...]]:
        """Program of a stage, and the sources of its inputs."""
        part_count = len(self.state)
        starts: Ports = [(f"{name} at start", shape) for name, shape in self.state]
        sums: Ports = [(f"{name} sum", shape) for name, shape in self.state]
        tableau_row = ("stage", (_NUMBERS_PER_STAGE,))
        ports: Ports = [self._angle_port, *self.state, *starts, *sums, tableau_row, *self.inputs]
        first_sum_index = len(self._state_names)  # among the outputs
        sources = [*self._state_sources]
        sources += [Source("start", k) for k in range(part_count)]
        sources += [Source("state", first_sum_index + k) for k in range(part_count)]
        sources += [Source("stage"), *[Source("given")] * len(self.inputs)]
        names = [*self._state_names, *dict(sums), *self._reports]
        return trace(self._stage, ports, names), tuple(sources)

    @property
    def _angle_port(self) -> tuple[str, tuple[int, ...]]:
        """Input of the angles, which has the shape of q."""
        return "angles", (self.model.nq,)

    @property
    def _state_sources(self) -> list[Source]:
        """Sources of angles and state of a program: angles and q are the same array."""
        return [Source("state", 0), *(Source("state", k) for k in range(len(self.state)))]

    @property
    def _reports(self) -> list[str]:
        """Names of the outputs that are evaluated at the start of a step."""
        names = []
        if self.works:
            names.append("ddq")
        if self.contacts:
            names.append("gaps")
        if self.returns_torques:
            names.append("tau")
        return names

    def step(self, angles: Array, q: Array, dq: Array, h: Any, *given: Array) -> tuple[Array, ...]:
        """State (q, dq) of a rollout after a step with all its stages; then the torques at its start, if requested.

        ``given`` are the inputs of the step after its length h.
        """
        if self.method == "semi_implicit":
            return self._semi_implicit(angles, q, dq, h, *given)
        state: tuple[Array, ...] = q, dq
        sums: tuple[Array, ...] = zeros(self.model.nq), zeros(self.model.nv)
        torques: list[Array] = []
        for row in stages(RK4):
            results = self._stage(angles, *state, q, dq, *sums, np.array(row), h, *given)
            state, sums = results[:2], results[2:4]  # (q, dq) of each
            angles = state[0]
            torques += results[4:]  # none, or the torques at this stage
        return (*state, *torques[:1])  # the first stage is at the start of the step

    def _semi_implicit(self, angles: Array, q: Array, dq: Array, *work_and_inputs: Any) -> tuple[Array, ...]:
        """dq1 by :func:`~twistwrench.mechanics.algorithms.contact.velocity_step`, then q1 = q ⊕ h dq1.

        With friction, dq1 is evaluated at the midpoint qm = q ⊕ ½ h dq, and q1 = qm ⊕ ½ h dq1. Works use mean velocities.
        """
        work_count = int(self.works)
        work = work_and_inputs[:work_count]  # one array, or none
        h, *given = work_and_inputs[work_count:]
        law_model, plant, inputs = self._models(given)
        references = [inputs[name] for name in self.law.names]
        if hasattr(self.law, "torques_of_step"):
            tau, gains = self.law.torques_of_step(law_model, angles, q, dq, h, *references)
        else:  # laws of the caller are used unchanged
            tau, gains = self.law.torques(law_model, angles, q, dq, *references), None
        contact_torques, gaps = self._contact_torques(plant, angles, dq, inputs)
        middle = angles
        start, duration = q, h  # of the last move, to q1
        if self.friction:
            middle = start = integration.halfway(self.model, q, h * dq, angles)
            duration = 0.5 * h
        if self.works and not self.friction:
            ddq = self._accelerations(plant, angles, dq, _add_contacts(tau, contact_torques), inputs)
            dq1 = dq + h * ddq
            mean_velocities = dq
            friction_torques = zeros(plant.nv)
        else:
            dq1, tau, friction_torques = velocity_step(
                plant, middle, dq, h, tau, gains=gains, limits=inputs.get("torque limits"),
                friction=self.friction, push=contact_torques, wrenches=self._robot_wrenches(inputs),
            )  # fmt: skip
            ddq = (dq1 - dq) / h
            mean_velocities = 0.5 * (dq + dq1)
        q1 = integration.add_at_angles(self.model, start, duration * dq1, middle)
        reported_torques = [tau] * self.returns_torques
        if not self.works:
            return q1, dq1, *reported_torques
        powers = self._powers(plant, middle, mean_velocities, tau, friction_torques, inputs, contact_torques)
        state = self._with_peak(q1, dq1, work[0] + h * powers)
        return *state, ddq, *gaps, *reported_torques

    def _stage(self, angles: Array, *states_and_inputs: Any) -> tuple[Array, ...]:
        """One stage of a Runge–Kutta method, by its row of :func:`stages`.

        ``states_and_inputs`` are the state, the state at the start of the step, the sums, the row, h and the other inputs.
        """
        n = len(self.state)  # arrays of a state: q, dq and in simulations W
        q, dq = states_and_inputs[:2]
        start = states_and_inputs[n : 2 * n]
        last_sums = states_and_inputs[2 * n : 3 * n]
        row, h, *given = states_and_inputs[3 * n :]
        keep_sum, weight, rate_factor, sum_factor, is_last = row
        rates, tau, gaps = self._rates(angles, q, dq, given)
        sums = [keep_sum * last_sum + weight * rate for last_sum, rate in zip(last_sums, rates, strict=True)]
        next_state = [
            x0 + h * (rate_factor * rate + sum_factor * rate_sum)
            for x0, rate, rate_sum in zip(start, rates, sums, strict=True)
        ]
        next_q = integration.normalise_quaternions(self.model, next_state[0], is_last)
        state = self._with_peak(next_q, *next_state[1:])
        accelerations = [rates[1]] * self.works  # ddq is the rate of dq
        return *state, *sums, *accelerations, *gaps, *[tau] * self.returns_torques

    def _with_peak(self, q: Array, dq: Array, *work: Array) -> list[Any]:
        """State; in simulations followed by its peak.

        The peak is the sum of squared velocities. Tiny multiples of the other squares make it NaN if any entry is NaN.
        """
        if not work:
            return [q, dq]
        peak = dq @ dq + _WEIGHT_OF_POSITIONS_AND_WORKS * (q @ q + work[0] @ work[0])
        return [q, dq, work[0], peak]

    def _rates(
        self, angles: Array, q: Array, dq: Array, given: Sequence[Array]
    ) -> tuple[list[Array], Array, tuple[Array, ...]]:
        """Rates of the state with smoothed dry friction, torques of the law, and gaps of contacts: (gaps,) or ()."""
        law_model, plant, inputs = self._models(given)
        tau = self.law.torques(law_model, angles, q, dq, *(inputs[name] for name in self.law.names))
        if self.limited:
            tau = clip_torques(tau, inputs["torque limits"])
        tau_past_friction = tau
        contact_torques, gaps = self._contact_torques(plant, angles, dq, inputs)
        if self.friction:
            sliding = sliding_share(motor_velocities(plant, dq), inputs["creep"])
            tau_past_friction = torque_past_eased_friction(plant, dq, tau, sliding)
        ddq = self._accelerations(plant, angles, dq, _add_contacts(tau_past_friction, contact_torques), inputs)
        rates = [integration.coordinate_rates(self.model, angles) @ dq, ddq]
        if self.works:
            friction_torques = tau_past_friction - tau
            rates.append(self._powers(plant, angles, dq, tau, friction_torques, inputs, contact_torques))
        return rates, tau, gaps

    def _accelerations(self, plant: Model, angles: Array, dq: Array, tau: Array, inputs: dict[str, Array]) -> Array:
        """Accelerations (nv,) under joint torques (nv,) and the wrenches of the step."""
        return forward_dynamics(plant, angles, dq, tau, wrenches=self._robot_wrenches(inputs))

    def _models(self, given: Sequence[Array]) -> tuple[Model, Model, dict[str, Array]]:
        """Model in the control law, model of the plant, and the inputs of the step by name."""
        names = [name for name, _ in self.inputs[1:]]  # without dt
        inputs = dict(zip(names, given, strict=True))
        law_model = regrouped(self.model)
        plant = self.model if moves_joints(self.model, self.parameters) else law_model
        if self.parameters:
            plant = with_symbolic_parameters(plant, self.parameters, list(inputs["parameters"]))
        return law_model, plant, inputs

    def _robot_wrenches(self, inputs: dict[str, Array]) -> dict[str, Array] | None:
        """Wrenches that the robot applies, by frame; None without frames."""
        return {frame: -inputs[f"wrench at {frame}"] for frame in self.frames} or None

    def _contact_torques(
        self, plant: Model, angles: Array, dq: Array, inputs: dict[str, Array]
    ) -> tuple[Array | None, tuple[Array, ...]]:
        """Sum of the contact torques (nv,), and a tuple of the gaps of all contacts; None and () without contacts."""
        if not self.contacts:
            return None, ()
        contact_torques, gaps = zeros(plant.nv), zeros(len(self.contacts))
        for k, contact in enumerate(self.contacts):
            numbers = [inputs[f"{name} of contact {k}"] for name in contact.numbers]
            tau, depths = contact.symbolic_torques(plant, angles, dq, *numbers)
            contact_torques = contact_torques + tau
            gaps[k] = -largest(depths)
        return contact_torques, (gaps,)

    def _powers(
        self,
        plant: Model,
        angles: Array,
        dq: Array,
        tau: Array,
        friction_torques: Array,
        inputs: dict[str, Array],
        contact_torques: Array | None,
    ) -> Array:
        """Powers (4,) of torques, friction, wrenches and contacts: the order of :data:`.forces.WORKS`."""
        powers = zeros(len(WORKS))
        powers[0] = tau @ dq
        powers[1] = friction_torques @ dq
        for frame in self.frames:
            wrench_torques = integration.wrench_torques(plant, angles, inputs[f"wrench at {frame}"], frame)
            powers[2] = powers[2] + wrench_torques @ dq
        if contact_torques is not None:
            powers[3] = contact_torques @ dq
        return np.asarray(powers)


def _add_contacts(tau: Array, contact_torques: Array | None) -> Array:
    """Joint torques plus contact torques, if there are contacts."""
    return tau if contact_torques is None else tau + contact_torques


def stages(tableau: Tableau) -> tuple[tuple[float, ...], ...]:
    """A row of five numbers for each stage of a method of :data:`TABLEAUS`.

    - 1 if the sum of weighted rates is kept, 0 if it starts anew
    - weight of the rate of this stage in the sum
    - factor of this rate in the step from the start to the next stage
    - factor of the sum in that step
    - 1 if the step ends there
    """
    a, b, _, _, _ = tableau.numbers
    last = len(b) - 1
    rows = [(float(i > 0), float(b[i]), float(a[i + 1][i]), 0.0, 0.0) for i in range(last)]
    last_row = (float(last > 0), float(b[last]), 0.0, 1.0, 1.0)
    return (*rows, last_row)


MAX_OPERATIONS_PER_CALL = 5e8
"""Number of operations between two checks for a keyboard interrupt: a few hundredths of a second."""
MAX_CONTACT_POINTS = 64
"""Largest number of contact points and joint stops in compiled steps; each has its own operations in the program."""
MAX_ENTRIES_PER_CALL = 2_000_000
"""Largest number of entries of states and accelerations that one call returns."""


def can_compile_steps(system: System) -> bool:
    """True if steps can be compiled and forces, apart from callbacks, depend only on the state."""
    has_gains = system.dry_friction is not None and system.dry_friction.has_gains
    contact_points = sum(contact.size for contact in system.contacts)
    return not has_gains and contact_points <= MAX_CONTACT_POINTS and compiles()


def constants(system: System, plan: StepPlan) -> dict[str, Array]:
    """Constant inputs of a step, by the names of the plan."""
    no_state = np.zeros(0)  # constant wrenches do not depend on it
    values = {}
    for frame, law in system.wrenches.items():
        if not law.varies:
            values[f"wrench at {frame}"] = law(0.0, no_state, no_state)
    if plan.eases and system.friction is not None:
        values["creep"] = system.friction.creep
    for k, contact in enumerate(plan.contacts):
        for name, value in contact.numbers.items():
            values[f"{name} of contact {k}"] = value
    return values


class CompiledSteps:
    """Steps of one method, under the held torques of a system and its constant wrenches."""

    takes_many = True
    """States and times may have a batch axis."""

    def __init__(self, system: System, plan: StepPlan, order: int, h: float, kernel: Any, cost: float) -> None:
        self.system, self.plan, self.kernel = system, plan, kernel
        self.order = order
        """Order of the method."""
        self.h = h
        """Length of a step [s]."""
        self.stages = plan.stages
        """Evaluations of forward dynamics in a step."""
        max_steps_by_cost = MAX_OPERATIONS_PER_CALL / (cost * self.stages)  # cost: operations of a stage
        max_steps_by_entries = MAX_ENTRIES_PER_CALL / (system.size + system.nv)
        self.most = max(1, int(min(max_steps_by_cost, max_steps_by_entries)))
        """Largest number of steps in one call."""
        self.names = list(dict(plan.inputs[1:]))
        """Names of the inputs of a step except its length."""
        self.constants = constants(system, plan)
        self.cuts = slice(0, system.nq), system.moving, slice(system.nq + system.nv, system.size)
        """Slices of a state: coordinates, velocities and works."""
        self.shares = [0.0]
        """Times of the kernel calls of a step, as fractions of the step."""
        self.table = np.zeros((1, _NUMBERS_PER_STAGE))
        """Rows of :func:`stages`, one for each kernel call of a step."""
        self.laws: list[tuple[str, ControlLaw]] = []
        """Names of inputs of the plan, each with the callback that returns it."""

    @classmethod
    def build(cls, system: System, method: str, order: int, h: float) -> CompiledSteps | None:
        """Compiled steps of a system; None if compilation is impossible."""
        if method not in COMPILED_METHODS or not can_compile_steps(system):
            return None
        return cls._with_kernel(system, StepPlan.from_system(system, method), order, h, scalar=True)

    @classmethod
    def _with_kernel(
        cls, system: System, plan: StepPlan, order: int, h: float, *, scalar: bool
    ) -> CompiledSteps | None:
        """Compiled steps for one state at a time, or for a batch; None if compilation is impossible."""
        robot = system.robot

        def build() -> Any:
            robot.engine.require_invertible()
            doc = f"Steps of {robot.name}, compiled: {plan.method}."
            return compile_form(cls.recurrence(plan), "simulated step", doc, scalar=scalar)

        kernel = robot.engine.cache((*plan.key, cls.__name__, scalar), build)
        owner = owner_of(kernel)
        return None if owner is None else cls(system, plan, order, h, kernel, owner.cost)

    def side_by_side(self) -> CompiledSteps:
        """These steps compiled for a batch, or themselves if that is impossible.

        Results of a state do not depend on its neighbours in the batch.
        """
        batched = self._with_kernel(self.system, self.plan, self.order, self.h, scalar=False)
        return self if batched is None else batched

    def under(self, held: Array) -> Self:
        """Copy of these steps, under other torques (nv,) of the controller."""
        copied = copy(self)
        copied.system = self.system.under(held)
        return copied

    @staticmethod
    def recurrence(plan: StepPlan) -> Scan:
        """Compiled loop over whole steps."""
        return plan.recurrence()

    def advance(self, y: Array, steps: int, h: float | None = None) -> tuple[Array, Array, Array]:
        """States before and after each step, (..., steps + 1, size), from y (..., size).

        Also returns accelerations (..., steps, nv) and contact gaps (..., steps, contacts) at the start of each step.
        """
        return self.advance_with(y, steps, self.h if h is None else h, self.inputs())

    def inputs(self) -> list[Array]:
        """Inputs of a step except its length, if there are no callbacks."""
        values = {"tau": self.system.held, **self.constants}
        return [values[name] for name in self.names]

    def parts(self, states: Array) -> list[Array]:
        """Parts of states (..., size): coordinates, velocities and works."""
        return [states[..., cut] for cut in self.cuts]

    def advance_with(self, y: Array, steps: int, h: float, inputs: Sequence[Array]) -> tuple[Array, Array, Array]:
        """Take steps with inputs (..., n) that are constant over all of them; results as of :meth:`advance`."""
        s = self.system
        Y = np.empty((*y.shape[:-1], steps + 1, s.size))
        ddq = np.empty((*y.shape[:-1], steps, s.nv))
        Y[..., 0, :] = y
        after = Y[..., 1:, :]
        step_inputs = [x[..., None, :] for x in inputs]
        if steps > 1:
            step_inputs = [np.broadcast_to(x, (*x.shape[:-2], steps, x.shape[-1])) for x in step_inputs]
        gaps = np.empty((*ddq.shape[:-1], len(s.contacts)))
        peaks = np.empty(ddq.shape[:-1])
        out = [*self.parts(after), peaks, ddq]
        if s.contacts:
            out.append(gaps)
        initial_peak = 0.0  # arbitrary
        self.kernel(*self.parts(y), initial_peak, np.full(steps, h), *step_inputs, out=tuple(out))
        s.evaluations += self.stages * steps
        return Y, ddq, gaps

    def after(self, t: Any, y: Array, h: float) -> Array:
        """States a time h after states (..., size) at times t."""
        return self.take_stages(t, y, h, self.stages)[0]

    def step_and_accelerations(self, t: Any, y: Array, h: float) -> tuple[Array, Array]:
        """States a time h later, and accelerations (..., nv) at the given states."""
        if self.system.dry_friction is not None:  # accelerations are evaluated with a step of the usual length self.h
            return self.after(t, y, h), self.accelerations(t, y)
        return self.take_stages(t, y, h, self.stages)

    def accelerations(self, t: Any, y: Array) -> Array:
        """Accelerations (..., nv) at the start of steps from states (..., size) at times t."""
        return self.take_stages(t, y, self.h, 1)[1]

    def take_stages(self, _t: Any, y: Array, h: float, count: int) -> tuple[Array, Array]:
        """States after a step, of which at least the first ``count`` stages are taken, and accelerations at its start."""
        Y, ddq, _ = self.advance(y, 1, h)  # all stages
        self.system.evaluations += count - self.stages  # advance counted all: only requested stages count
        return Y[..., 1, :], ddq[..., 0, :]
