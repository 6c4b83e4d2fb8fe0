"""Compiled steps of rollouts and simulations: torques, forward dynamics and integration, traced together.

Angles go in apart from the coordinates they are: the same numbers, as an array that is nothing but angles, whose size can be
looked at once. That is what lets a whole step be one piece of machine code without a branch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..algorithms import kinematics as integration
from ..algorithms.contact import largest, velocity_step
from ..algorithms.forward_dynamics import forward_dynamics
from ..algorithms.friction import eased, torque_past_eased_friction
from ..algorithms.kinematics import coordinate_rates, wrench_torques
from ..algorithms.operational_space import clipped
from ..algorithms.recursion import zeros
from ..errors import UnknownNameError
from ..ir.loops import Scan, Source
from ..ir.program import Program
from ..ir.tracer import trace
from ..model.model import Model
from ..model.parameters import moves_joints, regrouped, with_symbolic_parameters
from ..robot.engine import compiled
from ..runtime.gufunc import owner_of
from ..runtime.interpreter import compiles
from ..typing import Array
from .contact import RobotContact
from .forces import WORKS, System
from .schemes import EULER, RK4, Tableau
from .torque_laws import GivenTorque, TorqueLaw

ROLLOUT_METHODS = ("semi_implicit", "rk4")
"""The methods of rollouts, by the names they have in simulations."""

Ports = list[tuple[str, tuple[int, ...]]]


def method_named(name: Any) -> str:
    """The name; UnknownNameError lists those there are."""
    if not isinstance(name, str) or name not in ROLLOUT_METHODS:
        raise UnknownNameError.from_choices("method", name, ROLLOUT_METHODS)
    return name


@dataclass(frozen=True)
class Plan:
    """Step of a simulation or rollout, without its numbers."""

    model: Model
    law: TorqueLaw
    method: str
    limited: bool = False
    """True if torques are clipped."""
    frames: tuple[str, ...] = ()
    """Frames at which wrenches act on the robot."""
    parameters: tuple[str, ...] = ()
    friction: bool = False
    says_torques: bool = False

    @property
    def key(self) -> tuple[Any, ...]:
        """Plans of one robot with one key are one program."""
        said = self.method, self.limited, self.frames, self.parameters, self.friction, self.says_torques
        return ("rollout", *self.law.key, *said)

    @property
    def state_sizes(self) -> tuple[int, ...]:
        """Sizes of the parts of the state: q, dq, and the rest that is passed from step to step."""
        return self.model.nq, self.model.nv

    @property
    def eases(self) -> bool:
        """True if dry friction is smoothed at low speeds, and not an impulse that stops a joint."""
        return self.friction and self.method != "semi_implicit"

    @property
    def given(self) -> Ports:
        """Names and shapes of what is given for each step, in the kernel's order."""
        nq, nv = self.model.nq, self.model.nv
        ports: Ports = [("dt", ())]
        ports += [(name, (nq,) if name == "q_des" else (nv,)) for name in self.law.names]
        ports += [("torque limits", (nv,))] * self.limited
        ports += [(f"wrench at {frame}", (6,)) for frame in self.frames]
        ports += [("creep", (nv,))] * self.eases
        return [*ports, *[("parameters", (len(self.parameters),))] * bool(self.parameters)]

    def recurrence(self) -> Scan:
        """The program, and where its inputs come from."""
        nq, nv, given = self.model.nq, self.model.nv, self.given
        state: Ports = [("angles", (nq,)), ("q", (nq,)), ("dq", (nv,))]
        fed = [Source("state", 0), Source("state", 0), Source("state", 1)]
        sources = [Source("given")] * len(given)
        said = ["tau"] * self.says_torques
        if self.method == "semi_implicit":
            program = trace(self._semi_implicit, [*state, *given], ["q", "dq", *said])
            return Scan(program, (*fed, *sources), visible=2)
        more: Ports = [
            ("q at start", (nq,)),
            ("dq at start", (nv,)),
            ("q sum", (nq,)),
            ("dq sum", (nv,)),
            ("stage", (5,)),
        ]
        fed += [Source("start", 0), Source("start", 1), Source("state", 2), Source("state", 3), Source("stage")]
        names = ["q", "dq", "q sum", "dq sum", *said]
        program = trace(self._runge_kutta, [*state, *more, *given], names)
        return Scan(program, (*fed, *sources), visible=2, hidden=2, table=stages(RK4))

    # ── on symbols ──

    def step(self, angles: Array, q: Array, dq: Array, h: Any, *given: Array) -> tuple[Array, ...]:
        """State after a step, by all of its stages, and the applied torques if they are requested."""
        if self.method == "semi_implicit":
            return self._semi_implicit(angles, q, dq, h, *given)
        found: tuple[Array, ...] = q, dq, zeros(self.model.nq), zeros(self.model.nv)
        said: list[Array] = []
        for row in stages(RK4):
            found = self._runge_kutta(angles, *found[:2], q, dq, *found[2:4], np.array(row), h, *given)
            angles, said = found[0], [*said, *found[4:]]
        return (*found[:2], *said[:1])

    def _semi_implicit(self, angles: Array, q: Array, dq: Array, h: Any, *given: Array) -> tuple[Array, ...]:
        """dq1 by :func:`~twistwrench.algorithms.contact.velocity_step`, then q1 = q ⊕ h dq1.

        With friction, dq1 is that of the middle, qm = q ⊕ ½ h dq, and then q1 = qm ⊕ ½ h dq1.
        """
        known, plant, rest = self._models(given)
        wanted = [rest[name] for name in self.law.names]
        if hasattr(self.law, "torques_of_step"):
            tau, gains = self.law.torques_of_step(known, angles, q, dq, h, *wanted)
        else:  # a law of the caller's stays as it is
            tau, gains = self.law.torques(known, angles, q, dq, *wanted), None
        middle = integration.halfway(self.model, q, h * dq, angles) if self.friction else angles
        dq1, tau, _ = velocity_step(
            plant, middle, dq, h, tau, gains=gains, limits=rest["torque limits"] if self.limited else None,
            friction=self.friction, wrenches=self._pushed(rest),
        )  # fmt: skip
        if self.friction:
            q1 = integration.moved(self.model, middle, 0.5 * h * dq1, middle)
        else:
            q1 = integration.moved(self.model, q, h * dq1, angles)
        found = q1, dq1
        return (*found, tau) if self.says_torques else found

    def _runge_kutta(
        self, angles: Array, q: Array, dq: Array, q0: Array, dq0: Array, q_sum: Array, dq_sum: Array, row: Array, h: Any,
        *given: Array,
    ) -> tuple[Array, ...]:  # fmt: skip
        """One stage, by its row of :func:`stages`."""
        keep, weight, last, all_of_them, ends = row
        tau, ddq = self._dynamics(angles, q, dq, given)
        rates = coordinate_rates(self.model, angles) @ dq
        q_sum, dq_sum = keep * q_sum + weight * rates, keep * dq_sum + weight * ddq
        q1 = q0 + h * (last * rates + all_of_them * q_sum)
        dq1 = dq0 + h * (last * ddq + all_of_them * dq_sum)
        found = integration.normalised(self.model, q1, ends), dq1, q_sum, dq_sum
        return (*found, tau) if self.says_torques else found

    def _dynamics(self, angles: Array, q: Array, dq: Array, given: Sequence[Array]) -> tuple[Array, Array]:
        """Torques and accelerations."""
        known, plant, rest = self._models(given)
        tau = force = self._torques(known, angles, q, dq, rest)
        if self.friction:
            force = torque_past_eased_friction(plant, dq, tau, eased(dq, rest["creep"]))
        return tau, forward_dynamics(plant, angles, dq, force, wrenches=self._pushed(rest))

    def _torques(self, known: Model, angles: Array, q: Array, dq: Array, rest: dict[str, Array]) -> Array:
        """Torques of the law, clipped to the limits."""
        tau = self.law.torques(known, angles, q, dq, *(rest[name] for name in self.law.names))
        return clipped(tau, rest["torque limits"]) if self.limited else tau

    def _models(self, given: Sequence[Array]) -> tuple[Model, Model, dict[str, Array]]:
        """Model in the control law, model of the plant, and the inputs of the step by name."""
        rest = dict(zip([name for name, _ in self.given[1:]], given, strict=True))
        known = regrouped(self.model)
        plant = known if not moves_joints(self.model, self.parameters) else self.model
        if self.parameters:
            plant = with_symbolic_parameters(plant, self.parameters, list(rest["parameters"]))
        return known, plant, rest

    def _pushed(self, rest: dict[str, Array]) -> dict[str, Array] | None:
        """The wrenches that the robot applies."""
        return {frame: -rest[f"wrench at {frame}"] for frame in self.frames} or None


def stages(tableau: Tableau) -> tuple[tuple[float, ...], ...]:
    """A row for each stage of a method whose stages need the one before alone.

    Whether the sum of weighted rates is kept, the weight, what of this rate and what of the sum leads from the beginning of the
    step to the next stage, and whether the step ends there.
    """
    a, b, _, _, _ = tableau.numbers
    last = len(b) - 1
    rows = [(float(i > 0), b[i], a[i + 1][i], 0.0, 0.0) for i in range(last)]
    return (*(tuple(map(float, row)) for row in rows), (float(last > 0), float(b[last]), 0.0, 1.0, 1.0))


# ── Simulation step: a rollout step with its works and initial accelerations

# The state is the y = (q, dq, W) of :mod:`.forces`, and the formulas are those of :mod:`.schemes`: works are integrated by the
# method that moves the robot.

TABLEAUS = {"euler": EULER, "rk4": RK4}
"""The methods whose stages need the one before alone."""
SIMULATED = ("semi_implicit", *TABLEAUS)
"""The methods that have steps here, by their names in simulations."""

FED = (*(Source("state", k) for k in (0, 0, 1, 2)),)
"""Sources of the state of a program: angles and coordinates are one array."""
_TRACE = 1e-30


def ended(q: Array, dq: Array, work: Array) -> tuple[Array, Array, Array, Any]:
    """State and its peak: squared velocities with a trace of all else, which is NaN if any entry is."""
    return q, dq, work, dq @ dq + _TRACE * (q @ q + work @ work)


@dataclass(frozen=True)
class SimulatedStep(Plan):
    """Step of a simulation under constant torques and wrenches, without its numbers."""

    contacts: tuple[RobotContact, ...] = ()
    """Contacts of the robot."""

    @property
    def key(self) -> tuple[Any, ...]:
        """Plans of one robot with one key are one program."""
        touches = tuple(contact.key for contact in self.contacts)
        return "simulated step", self.method, self.frames, self.friction, touches

    @property
    def given(self) -> Ports:
        """Names and shapes of what is given for each step, in the kernel's order: those of contacts last."""
        numbers = [
            (f"{name} of contact {k}", x) for k, one in enumerate(self.contacts) for name, x in one.numbers.items()
        ]
        return [*super().given, *((name, x.shape) for name, x in numbers)]

    @property
    def stages(self) -> int:
        """Evaluations of forward dynamics in a step."""
        return len(TABLEAUS[self.method].b) if self.method in TABLEAUS else 1

    def recurrence(self) -> Scan:
        """Loop and sources of its inputs: the state is q, dq, W and a peak; each step returns its accelerations.

        The peak is that of :func:`ended`. Nothing takes it; it goes in as any number.
        """
        if self.method == "semi_implicit":
            names = ["q", "dq", "work", "peak", "ddq", *self._gaps]
            program = trace(self._semi_implicit_step, [*self._state(), *self.given], names)
            return Scan(program, (*FED, *[Source("given")] * len(self.given)), visible=4)
        program, fed = self._staged()
        return Scan(program, fed, visible=4, hidden=3, table=stages(TABLEAUS[self.method]))

    def one_stage(self) -> Scan:
        """Loop over Runge-Kutta stages: sums are states; start of the step and row of the tableau are inputs."""
        program, fed = self._staged()
        sources = [source if source.kind == "state" else Source("given") for source in fed]
        return Scan(program, tuple(sources), visible=7)

    @property
    def _gaps(self) -> list[str]:
        """Names of the gaps of contacts as a step begins."""
        return ["gaps"] * bool(self.contacts)

    def _state(self) -> Ports:
        nq, nv = self.model.nq, self.model.nv
        return [("angles", (nq,)), ("q", (nq,)), ("dq", (nv,)), ("work", (len(WORKS),))]

    def _staged(self) -> tuple[Program, tuple[Source, ...]]:
        """The program of a stage, and where its inputs come from."""
        state = self._state()
        more: Ports = [(f"{name} {when}", shape) for when in ("at start", "sum") for name, shape in state[1:]]
        fed = [
            *FED,
            *(Source("start", k) for k in range(3)),
            *(Source("state", k) for k in range(4, 7)),
            Source("stage"),
        ]
        names = ["q", "dq", "work", "peak", "q sum", "dq sum", "work sum", "ddq", *self._gaps]
        program = trace(self._stage, [*state, *more, ("stage", (5,)), *self.given], names)
        return program, (*fed, *[Source("given")] * len(self.given))

    # ── on symbols ──

    def _semi_implicit_step(
        self, angles: Array, q: Array, dq: Array, work: Array, h: Any, *given: Array
    ) -> tuple[Array, ...]:
        """Semi-implicit step; with friction, works use mean velocities."""
        _, plant, rest = self._models(given)
        tau, (push, gaps) = rest["tau"], self._touched(plant, angles, dq, rest)
        if not self.friction:
            force = tau if push is None else tau + push
            ddq = forward_dynamics(plant, angles, dq, force, wrenches=self._pushed(rest))
            dq1, powers = dq + h * ddq, self._powers(plant, angles, dq, tau, zeros(plant.nv), rest, push)
            return *ended(integration.moved(self.model, q, h * dq1, angles), dq1, work + h * powers), ddq, *gaps
        middle = integration.halfway(self.model, q, h * dq, angles)
        dq1, tau, lost = velocity_step(
            plant, middle, dq, h, tau, friction=True, push=push, wrenches=self._pushed(rest)
        )  # fmt: skip
        powers = self._powers(plant, middle, 0.5 * (dq + dq1), tau, lost, rest, push)
        q1 = integration.moved(self.model, middle, 0.5 * h * dq1, middle)
        return *ended(q1, dq1, work + h * powers), (dq1 - dq) / h, *gaps

    def _stage(
        self, angles: Array, _q: Array, dq: Array, _work: Array, q0: Array, dq0: Array, work0: Array, q_sum: Array,
        dq_sum: Array, work_sum: Array, row: Array, h: Any, *given: Array,
    ) -> tuple[Array, ...]:  # fmt: skip
        """One stage of a Runge-Kutta method, by its row of :func:`.step_program.stages`."""
        keep, weight, last, all_of_them, ends = row
        rates, gaps = self._rates(angles, dq, given)
        pairs = list(zip((q_sum, dq_sum, work_sum), rates, strict=True))
        sums = [keep * total + weight * rate for total, rate in pairs]
        ends_at = [
            x0 + h * (last * rate + all_of_them * total)
            for x0, rate, total in zip((q0, dq0, work0), rates, sums, strict=True)
        ]
        return *ended(integration.normalised(self.model, ends_at[0], ends), *ends_at[1:]), *sums, rates[1], *gaps

    def rates(self, angles: Array, dq: Array, given: Sequence[Array]) -> tuple[Array, Array, Array]:
        """Rates of coordinates, velocities and works with smoothed dry friction."""
        return self._rates(angles, dq, given)[0]

    def _rates(
        self, angles: Array, dq: Array, given: Sequence[Array]
    ) -> tuple[tuple[Array, Array, Array], tuple[Array, ...]]:
        """Rates, and the gaps of contacts, if there are any."""
        _, plant, rest = self._models(given)
        tau, (push, gaps) = rest["tau"], self._touched(plant, angles, dq, rest)
        force = tau
        if self.friction:
            force = torque_past_eased_friction(plant, dq, tau, eased(dq, rest["creep"]))
        total = force if push is None else force + push
        ddq = forward_dynamics(plant, angles, dq, total, wrenches=self._pushed(rest))
        powers = self._powers(plant, angles, dq, tau, force - tau, rest, push)
        return (coordinate_rates(self.model, angles) @ dq, ddq, powers), gaps

    def _touched(
        self, plant: Model, angles: Array, dq: Array, rest: dict[str, Array]
    ) -> tuple[Array | None, tuple[Array, ...]]:
        """Contact torques (nv,) and the gap of each contact; empty without contacts."""
        if not self.contacts:
            return None, ()
        push, gaps = zeros(plant.nv), zeros(len(self.contacts))
        for k, one in enumerate(self.contacts):
            tau, depths = one.traced(plant, angles, dq, *(rest[f"{name} of contact {k}"] for name in one.numbers))
            push, gaps[k] = push + tau, -largest(depths)
        return push, (gaps,)

    def _powers(
        self,
        plant: Model,
        at: Array,
        dq: Array,
        tau: Array,
        lost: Array,
        rest: dict[str, Array],
        push: Array | None = None,
    ) -> Array:
        """Powers of torques, friction, wrenches and contacts, in the order of :data:`.forces.WORKS`, (4,)."""
        pushes: Sequence[Array] = [wrench_torques(plant, at, rest[f"wrench at {f}"], f) for f in self.frames]
        found = zeros(len(WORKS))
        found[0], found[1] = tau @ dq, lost @ dq
        for one in pushes:
            found[2] = found[2] + one @ dq
        if push is not None:
            found[3] = push @ dq
        return np.asarray(found)


# ── Blocks of compiled steps without callbacks

_IN_ONE_CALL = 5e8
"""Operations between two looks at whether the user wants to stop: some hundredths of a second."""
_TOUCHING = 64
"""Points and joints that run into something, up to which steps are compiled: each is written out."""
_NUMBERS = 2_000_000
"""Numbers that the states of one call may be."""


def acts_by_itself(system: System) -> bool:
    """True if the forces on a robot depend on its state only, apart from functions, and steps can be compiled."""
    gained = system.dry_friction is not None and system.dry_friction.gained
    touching = sum(contact.size for contact in system.contacts)
    return not gained and touching <= _TOUCHING and compiles()


def rubs(system: System) -> bool:
    """True if there is friction."""
    return system.friction is not None or (system.dry_friction is not None and system.dry_friction.friction)


def constants(system: System, plan: SimulatedStep) -> dict[str, Array]:
    """Constant inputs of a step, by the names of the plan."""
    nothing = np.zeros(0)
    given = {
        f"wrench at {frame}": law(0.0, nothing, nothing) for frame, law in system.wrenches.items() if not law.varies
    }
    if plan.eases and system.friction is not None:
        given["creep"] = system.friction.creep
    for k, contact in enumerate(plan.contacts):
        given |= {f"{name} of contact {k}": x for name, x in contact.numbers.items()}
    return given


class CompiledSteps:
    """The steps of one method, under the torques held by a system and its constant wrenches."""

    takes_many = True

    def __init__(self, system: System, plan: SimulatedStep, order: int, h: float, kernel: Any, effort: float) -> None:
        self.system, self.plan, self.order, self.h, self.kernel = system, plan, order, h, kernel
        self.stages = plan.stages
        """Evaluations of forward dynamics in a step."""
        self.most = max(1, int(min(_IN_ONE_CALL / (effort * self.stages), _NUMBERS / (system.size + system.nv))))
        """Steps to take in one call."""
        self.names = [name for name, _ in plan.given[1:]]
        """Names of the inputs of a step but its length."""
        self.constants = constants(system, plan)
        self.cuts = slice(0, system.nq), system.moving, slice(system.nq + system.nv, system.size)
        """The parts of a state."""

    @classmethod
    def build(cls, system: System, method: str, order: int, h: float) -> CompiledSteps | None:
        """The steps of a system in machine code; None where there is a contact, or they cannot be compiled."""
        if method not in SIMULATED or not acts_by_itself(system):
            return None
        model = system.robot.model
        acting: dict[str, Any] = {
            "frames": tuple(system.wrenches),
            "friction": rubs(system),
            "contacts": system.contacts,
        }
        plan = SimulatedStep(model, GivenTorque(), method, **acting)
        return cls._with_kernel(system, plan, order, h, scalar=True)

    @classmethod
    def _with_kernel(
        cls, system: System, plan: SimulatedStep, order: int, h: float, *, scalar: bool
    ) -> CompiledSteps | None:
        """Return compiled steps for one state at a time, or for a batch."""
        robot = system.robot

        def made() -> Any:
            robot.engine.require_invertible()
            doc = f"Steps of {robot.name}, compiled: {plan.method}."
            return compiled(cls.recurrence(plan), "simulated step", doc, scalar=scalar)

        kernel = robot.engine.cached((*plan.key, cls.__name__, scalar), made)
        owner = owner_of(kernel)
        return None if owner is None else cls(system, plan, order, h, kernel, owner.cost)

    def side_by_side(self) -> CompiledSteps:
        """Return these steps compiled for a batch: the numbers of a state do not depend on its neighbours."""
        return self._with_kernel(self.system, self.plan, self.order, self.h, scalar=False) or self

    @staticmethod
    def recurrence(plan: SimulatedStep) -> Scan:
        """Return the compiled loop: whole steps."""
        return plan.recurrence()

    def take(self, y: Array, steps: int, h: float | None = None) -> tuple[Array, Array, Array]:
        """States before and after each step, (..., steps + 1, size), with accelerations and gaps as each step begins.

        That is the accelerations (..., steps, nv), and how far each contact is from touching, (..., steps, contacts).
        ``y`` (..., size) is the first of these states.
        """
        return self.advance_with(y, steps, self.h if h is None else h, self.inputs())

    def inputs(self) -> list[Array]:
        """Inputs of a step but its length, if none is a function."""
        given = {"tau": self.system.held, **self.constants}
        return [given[name] for name in self.names]

    def advance_with(self, y: Array, steps: int, h: float, given: Sequence[Array]) -> tuple[Array, Array, Array]:
        """Take steps with inputs ``given`` (..., n) that hold for all of them."""
        s = self.system
        Y, ddq = np.empty((*y.shape[:-1], steps + 1, s.size)), np.empty((*y.shape[:-1], steps, s.nv))
        Y[..., 0, :] = y
        after = Y[..., 1:, :]
        rows = [x[..., None, :] for x in given]
        if steps > 1:
            rows = [np.broadcast_to(x, (*x.shape[:-2], steps, x.shape[-1])) for x in rows]
        before, ends = ([x[..., cut] for cut in self.cuts] for x in (y, after))
        gaps = np.empty((*ddq.shape[:-1], len(s.contacts)))
        said = (ddq, gaps) if s.contacts else (ddq,)
        self.kernel(*before, 0.0, np.full(steps, h), *rows, out=(*ends, np.empty(ddq.shape[:-1]), *said))
        s.evaluations += self.stages * steps
        return Y, ddq, gaps

    def after(self, t: Any, y: Array, h: float) -> Array:
        """Return the states a time h after states (..., size) at times t."""
        return self.stepped(t, y, h, self.stages)[0]

    def begun(self, t: Any, y: Array, h: float) -> tuple[Array, Array]:
        """Return the states a time h later and the accelerations (..., nv) at the given states."""
        if self.system.dry_friction is not None:  # whose accelerations are those of a step of the usual length
            return self.after(t, y, h), self.accelerations(t, y)
        return self.stepped(t, y, h, self.stages)

    def accelerations(self, t: Any, y: Array) -> Array:
        """Accelerations (..., nv) at the beginning of steps from states (..., size) at times t."""
        return self.stepped(t, y, self.h, 1)[1]

    def stepped(self, _t: Any, y: Array, h: float, count: int) -> tuple[Array, Array]:
        """States after the first ``count`` stages of a step at least, and the accelerations at its beginning."""
        Y, ddq, _ = self.take(y, 1, h)
        self.system.evaluations += count - self.stages  # stages beyond those requested are not counted
        return Y[..., 1, :], ddq[..., 0, :]
