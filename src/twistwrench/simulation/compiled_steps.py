"""Compiled steps of rollouts and simulations: torques, forward dynamics and integration, traced together.

Angles are inputs in addition to the coordinates, with the same values. As a separate array, their magnitude can be
checked once. A whole step can therefore be compiled without branches.
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
"""Methods in which each stage depends only on the previous one."""
COMPILED_METHODS = ("semi_implicit", *TABLEAUS)
"""Methods with compiled steps, by their names in simulations."""

Ports = list[tuple[str, tuple[int, ...]]]

_WEIGHT_OF_REST = 1e-30
"""Weight of coordinates and works in the peak of a state."""


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
    friction: bool = False
    returns_torques: bool = False
    works: bool = False
    """True in simulations."""
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
        return "simulated step" if self.works else "rollout", *self.law.key, *options, contacts

    @property
    def state(self) -> Ports:
        """Names and shapes of the parts of the state passed between steps."""
        ports: Ports = [("q", (self.model.nq,)), ("dq", (self.model.nv,))]
        if self.works:
            ports.append(("work", (len(WORKS),)))
        return ports

    @property
    def _state_names(self) -> list[str]:
        """Names of the outputs that are the next state, and of its peak in simulations."""
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
        """Names and shapes of the inputs of each step, in the kernel's order: those of contacts last."""
        nq, nv = self.model.nq, self.model.nv
        ports: Ports = [("dt", ())]
        ports += [(name, (nq if name == "q_des" else nv,)) for name in self.law.names]
        if self.limited:
            ports.append(("torque limits", (nv,)))
        ports += [(f"wrench at {frame}", (6,)) for frame in self.frames]
        if self.eases:
            ports.append(("creep", (nv,)))
        if self.parameters:
            ports.append(("parameters", (len(self.parameters),)))
        for k, contact in enumerate(self.contacts):
            for name, x in contact.numbers.items():
                ports.append((f"{name} of contact {k}", x.shape))
        return ports

    def recurrence(self) -> Scan:
        """Loop over whole steps. In simulations a peak, arbitrary at first, follows the state: see :meth:`_with_peak`."""
        if self.method in TABLEAUS:
            program, sources = self._trace_stage()
            table, hidden = stages(TABLEAUS[self.method]), len(self.state)
            return Scan(program, sources, visible=len(self.state) + self.works, hidden=hidden, table=table)
        ports = [("angles", self.state[0][1]), *self.state, *self.inputs]
        program = trace(self._semi_implicit, ports, [*self._state_names, *self._reports])
        sources = (*self._state_sources, *[Source("given")] * len(self.inputs))
        return Scan(program, sources, visible=len(self.state) + self.works)

    def one_stage(self) -> Scan:
        """Loop over Runge–Kutta stages: sums are states; start of the step and row of the tableau are inputs."""
        program, stage_sources = self._trace_stage()
        sources = [source if source.kind == "state" else Source("given") for source in stage_sources]
        return Scan(program, tuple(sources), visible=2 * len(self.state) + self.works)

    def _trace_stage(self) -> tuple[Program, tuple[Source, ...]]:
        """Program of a stage, and the sources of its inputs."""
        state, n = self.state, len(self.state)
        start: Ports = [(f"{name} at start", shape) for name, shape in state]
        sums: Ports = [(f"{name} sum", shape) for name, shape in state]
        ports: Ports = [("angles", state[0][1]), *state, *start, *sums, ("stage", (5,)), *self.inputs]
        sources = [*self._state_sources]
        sources += [Source("start", k) for k in range(n)]
        sources += [Source("state", n + self.works + k) for k in range(n)]
        sources += [Source("stage"), *[Source("given")] * len(self.inputs)]
        names = [*self._state_names, *dict(sums), *self._reports]
        return trace(self._stage, ports, names), tuple(sources)

    @property
    def _state_sources(self) -> list[Source]:
        """Sources of the state of a program: angles and coordinates are one array."""
        return [Source("state", 0), *(Source("state", k) for k in range(len(self.state)))]

    @property
    def _reports(self) -> list[str]:
        """Names of the outputs at the start of a step."""
        names = []
        if self.works:
            names.append("ddq")
        if self.contacts:
            names.append("gaps")
        if self.returns_torques:
            names.append("tau")
        return names

    def step(self, angles: Array, q: Array, dq: Array, h: Any, *given: Array) -> tuple[Array, ...]:
        """State of a rollout after a step with all its stages, and the applied torques if requested."""
        if self.method == "semi_implicit":
            return self._semi_implicit(angles, q, dq, h, *given)
        results: tuple[Array, ...] = q, dq, zeros(self.model.nq), zeros(self.model.nv)
        torques: list[Array] = []
        for row in stages(RK4):
            state, sums = results[:2], results[2:4]
            results = self._stage(angles, *state, q, dq, *sums, np.array(row), h, *given)
            angles = results[0]
            torques += results[4:]
        return (*results[:2], *torques[:1])

    def _semi_implicit(self, angles: Array, q: Array, dq: Array, *rest: Any) -> tuple[Array, ...]:
        """dq1 by :func:`~twistwrench.mechanics.algorithms.contact.velocity_step`, then q1 = q ⊕ h dq1.

        With friction, dq1 is that at the midpoint qm = q ⊕ ½ h dq, and q1 = qm ⊕ ½ h dq1; works use mean velocities.
        """
        work, (h, *given) = rest[: self.works], rest[self.works :]
        known, plant, inputs = self._models(given)
        references = [inputs[name] for name in self.law.names]
        if hasattr(self.law, "torques_of_step"):
            tau, gains = self.law.torques_of_step(known, angles, q, dq, h, *references)
        else:  # laws of the caller are used unchanged
            tau, gains = self.law.torques(known, angles, q, dq, *references), None
        push, gaps = self._contact_torques(plant, angles, dq, inputs)
        middle, start, share = angles, q, h
        if self.friction:
            middle = start = integration.halfway(self.model, q, h * dq, angles)
            share = 0.5 * h
        if self.works and not self.friction:
            ddq = self._accelerations(plant, angles, dq, _add_push(tau, push), inputs)
            dq1, mean, lost = dq + h * ddq, dq, zeros(plant.nv)
        else:
            dq1, tau, lost = velocity_step(
                plant, middle, dq, h, tau, gains=gains, limits=inputs.get("torque limits"),
                friction=self.friction, push=push, wrenches=self._robot_wrenches(inputs),
            )  # fmt: skip
            ddq, mean = (dq1 - dq) / h, 0.5 * (dq + dq1)
        q1, reports = integration.add_at_angles(self.model, start, share * dq1, middle), [tau] * self.returns_torques
        if not work:
            return q1, dq1, *reports
        powers = self._powers(plant, middle, mean, tau, lost, inputs, push)
        return *self._with_peak(q1, dq1, work[0] + h * powers), ddq, *gaps, *reports

    def _stage(self, angles: Array, *rest: Any) -> tuple[Array, ...]:
        """One stage of a Runge–Kutta method, by its row of :func:`stages`."""
        n = len(self.state)
        (q, dq, *_), start, before, (row, h, *given) = rest[:n], rest[n : 2 * n], rest[2 * n : 3 * n], rest[3 * n :]
        keep, weight, last, all_of_them, ends = row
        rates, tau, gaps = self._rates(angles, q, dq, given)
        sums = [keep * total + weight * rate for total, rate in zip(before, rates, strict=True)]
        after = [
            x0 + h * (last * rate + all_of_them * total) for x0, rate, total in zip(start, rates, sums, strict=True)
        ]
        after = self._with_peak(integration.normalise_quaternions(self.model, after[0], ends), *after[1:])
        return *after, *sums, *[rates[1]] * self.works, *gaps, *[tau] * self.returns_torques

    def _with_peak(self, q: Array, dq: Array, *work: Array) -> list[Any]:
        """State and, in simulations, its peak: squared velocities plus tiny multiples of the rest, NaN if any entry is."""
        if not work:
            return [q, dq]
        peak = dq @ dq + _WEIGHT_OF_REST * (q @ q + work[0] @ work[0])
        return [q, dq, work[0], peak]

    def _rates(
        self, angles: Array, q: Array, dq: Array, given: Sequence[Array]
    ) -> tuple[list[Array], Array, tuple[Array, ...]]:
        """Rates of the state with smoothed dry friction, torques, and gaps of contacts, if any."""
        known, plant, inputs = self._models(given)
        tau = self.law.torques(known, angles, q, dq, *(inputs[name] for name in self.law.names))
        if self.limited:
            tau = clip_torques(tau, inputs["torque limits"])
        force = tau
        push, gaps = self._contact_torques(plant, angles, dq, inputs)
        if self.friction:
            force = torque_past_eased_friction(
                plant, dq, tau, sliding_share(motor_velocities(plant, dq), inputs["creep"])
            )
        ddq = self._accelerations(plant, angles, dq, _add_push(force, push), inputs)
        rates = [integration.coordinate_rates(self.model, angles) @ dq, ddq]
        if self.works:
            rates.append(self._powers(plant, angles, dq, tau, force - tau, inputs, push))
        return rates, tau, gaps

    def _accelerations(self, plant: Model, angles: Array, dq: Array, force: Array, inputs: dict[str, Array]) -> Array:
        return forward_dynamics(plant, angles, dq, force, wrenches=self._robot_wrenches(inputs))

    def _models(self, given: Sequence[Array]) -> tuple[Model, Model, dict[str, Array]]:
        """Model in the control law, model of the plant, and the inputs of the step by name."""
        inputs = dict(zip(dict(self.inputs[1:]), given, strict=True))
        known = regrouped(self.model)
        plant = self.model if moves_joints(self.model, self.parameters) else known
        if self.parameters:
            plant = with_symbolic_parameters(plant, self.parameters, list(inputs["parameters"]))
        return known, plant, inputs

    def _robot_wrenches(self, inputs: dict[str, Array]) -> dict[str, Array] | None:
        """Wrenches applied by the robot."""
        return {frame: -inputs[f"wrench at {frame}"] for frame in self.frames} or None

    def _contact_torques(
        self, plant: Model, angles: Array, dq: Array, inputs: dict[str, Array]
    ) -> tuple[Array | None, tuple[Array, ...]]:
        """Contact torques (nv,) and the gap of each contact; empty without contacts."""
        if not self.contacts:
            return None, ()
        push, gaps = zeros(plant.nv), zeros(len(self.contacts))
        for k, contact in enumerate(self.contacts):
            numbers = [inputs[f"{name} of contact {k}"] for name in contact.numbers]
            tau, depths = contact.symbolic_torques(plant, angles, dq, *numbers)
            push, gaps[k] = push + tau, -largest(depths)
        return push, (gaps,)

    def _powers(
        self,
        plant: Model,
        at: Array,
        dq: Array,
        tau: Array,
        lost: Array,
        inputs: dict[str, Array],
        push: Array | None,
    ) -> Array:
        """Powers of torques, friction, wrenches and contacts, in the order of :data:`.forces.WORKS`, (4,)."""
        powers = zeros(len(WORKS))
        powers[0], powers[1] = tau @ dq, lost @ dq
        for frame in self.frames:
            powers[2] = powers[2] + integration.wrench_torques(plant, at, inputs[f"wrench at {frame}"], frame) @ dq
        if push is not None:
            powers[3] = push @ dq
        return np.asarray(powers)


def _add_push(force: Array, push: Array | None) -> Array:
    """Joint torques plus those of contacts, if any."""
    return force if push is None else force + push


def stages(tableau: Tableau) -> tuple[tuple[float, ...], ...]:
    """A row for each stage of a method in which each stage depends only on the previous one.

    Entries: 1 if the sum of weighted rates is kept; the weight; the factors of this rate and of the sum from the start
    of the step to the next stage; 1 if the step ends there.
    """
    a, b, _, _, _ = tableau.numbers
    last = len(b) - 1
    rows = [(float(i > 0), float(b[i]), float(a[i + 1][i]), 0.0, 0.0) for i in range(last)]
    return (*rows, (float(last > 0), float(b[last]), 0.0, 1.0, 1.0))


MAX_OPERATIONS_PER_CALL = 5e8
"""Operations between two checks for a keyboard interrupt: a few hundredths of a second."""
MAX_CONTACT_POINTS = 64
"""Largest number of contact points and joint stops in compiled steps; each is unrolled."""
MAX_ENTRIES_PER_CALL = 2_000_000
"""Largest number of entries of the states of one call."""


def can_compile_steps(system: System) -> bool:
    """True if forces, apart from callbacks, depend on the state only and steps can be compiled."""
    has_gains = system.dry_friction is not None and system.dry_friction.has_gains
    contact_points = sum(contact.size for contact in system.contacts)
    return not has_gains and contact_points <= MAX_CONTACT_POINTS and compiles()


def constants(system: System, plan: StepPlan) -> dict[str, Array]:
    """Constant inputs of a step, by the names of the plan."""
    no_state = np.zeros(0)
    values = {}
    for frame, law in system.wrenches.items():
        if not law.varies:
            values[f"wrench at {frame}"] = law(0.0, no_state, no_state)
    if plan.eases and system.friction is not None:
        values["creep"] = system.friction.creep
    for k, contact in enumerate(plan.contacts):
        for name, x in contact.numbers.items():
            values[f"{name} of contact {k}"] = x
    return values


class CompiledSteps:
    """Steps of one method, under the held torques of a system and its constant wrenches."""

    takes_many = True

    def __init__(self, system: System, plan: StepPlan, order: int, h: float, kernel: Any, cost: float) -> None:
        self.system, self.plan, self.order, self.h, self.kernel = system, plan, order, h, kernel
        self.stages = plan.stages
        """Evaluations of forward dynamics in a step."""
        calls_by_cost = MAX_OPERATIONS_PER_CALL / (cost * self.stages)
        self.most = max(1, int(min(calls_by_cost, MAX_ENTRIES_PER_CALL / (system.size + system.nv))))
        """Largest number of steps in one call."""
        self.names = list(dict(plan.inputs[1:]))
        """Names of the inputs of a step except its length."""
        self.constants = constants(system, plan)
        self.cuts = slice(0, system.nq), system.moving, slice(system.nq + system.nv, system.size)
        """Slices of the parts of a state."""
        self.shares, self.table = [0.0], np.zeros((1, 5))
        """Times of the calls of a step, as fractions of it, and coefficients from each stage to the next, (stages, 5)."""
        self.laws: list[tuple[str, ControlLaw]] = []
        """Callbacks with the names of their results in the plan."""

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
        """Compiled steps for one state at a time, or for a batch."""
        robot = system.robot

        def build() -> Any:
            robot.engine.require_invertible()
            doc = f"Steps of {robot.name}, compiled: {plan.method}."
            return compile_form(cls.recurrence(plan), "simulated step", doc, scalar=scalar)

        kernel = robot.engine.cache((*plan.key, cls.__name__, scalar), build)
        owner = owner_of(kernel)
        return None if owner is None else cls(system, plan, order, h, kernel, owner.cost)

    def side_by_side(self) -> CompiledSteps:
        """These steps compiled for a batch; results of a state do not depend on its neighbours."""
        return self._with_kernel(self.system, self.plan, self.order, self.h, scalar=False) or self

    def under(self, held: Array) -> Self:
        """Same steps of a copy of the system, under these torques of the controller."""
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
        """Take steps with inputs (..., n) that are constant over all of them."""
        s = self.system
        Y, ddq = np.empty((*y.shape[:-1], steps + 1, s.size)), np.empty((*y.shape[:-1], steps, s.nv))
        Y[..., 0, :] = y
        after = Y[..., 1:, :]
        rows = [x[..., None, :] for x in inputs]
        if steps > 1:
            rows = [np.broadcast_to(x, (*x.shape[:-2], steps, x.shape[-1])) for x in rows]
        gaps = np.empty((*ddq.shape[:-1], len(s.contacts)))
        out = [*self.parts(after), np.empty(ddq.shape[:-1]), ddq]
        if s.contacts:
            out.append(gaps)
        self.kernel(*self.parts(y), 0.0, np.full(steps, h), *rows, out=tuple(out))
        s.evaluations += self.stages * steps
        return Y, ddq, gaps

    def after(self, t: Any, y: Array, h: float) -> Array:
        """States a time h after states (..., size) at times t."""
        return self.take_stages(t, y, h, self.stages)[0]

    def step_and_accelerations(self, t: Any, y: Array, h: float) -> tuple[Array, Array]:
        """States a time h later, and accelerations (..., nv) at the given states."""
        if self.system.dry_friction is not None:  # accelerations are those of a step of the usual length
            return self.after(t, y, h), self.accelerations(t, y)
        return self.take_stages(t, y, h, self.stages)

    def accelerations(self, t: Any, y: Array) -> Array:
        """Accelerations (..., nv) at the start of steps from states (..., size) at times t."""
        return self.take_stages(t, y, self.h, 1)[1]

    def take_stages(self, _t: Any, y: Array, h: float, count: int) -> tuple[Array, Array]:
        """States after at least the first ``count`` stages of a step, and accelerations at its start."""
        Y, ddq, _ = self.advance(y, 1, h)
        self.system.evaluations += count - self.stages  # only the requested stages count
        return Y[..., 1, :], ddq[..., 0, :]
