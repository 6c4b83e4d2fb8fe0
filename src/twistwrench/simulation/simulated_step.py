"""One step of a simulation as a program: that of a rollout, with the works done in it and the accelerations it begins with.

The state is the y = (q, dq, W) of :mod:`.forces`, and the formulas are those of :mod:`.schemes`: works are integrated by the
method that moves the robot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..algorithms import integration
from ..algorithms.contact_forces import largest
from ..algorithms.coordinate_rates import coordinate_rates
from ..algorithms.forward_dynamics import forward_dynamics
from ..algorithms.friction import eased, torque_past_eased_friction
from ..algorithms.jacobians import wrench_torques
from ..algorithms.recursion import zeros
from ..algorithms.velocity_step import velocity_step
from ..model.model import Model
from ..program.program import Program
from ..program.recurrence import Recurrence, Source
from ..program.trace import trace
from ..typing import Array
from .forces import WORKS
from .robot_contact import RobotContact
from .step_program import Plan, Ports, stages
from .tableau import EULER, RK4

TABLEAUS = {"euler": EULER, "rk4": RK4}
"""The methods whose stages need the one before alone."""
SIMULATED = ("semi_implicit", *TABLEAUS)
"""The methods that have steps here, by their names in simulations."""

FED = (*(Source("state", k) for k in (0, 0, 1, 2)),)
"""Where the state of a program comes from: angles and coordinates are the same numbers."""
_TRACE = 1e-30


def ended(q: Array, dq: Array, work: Array) -> tuple[Array, Array, Array, Any]:
    """A state, and its peak: the square of all velocities, with a trace of all else, so that it is no number if any is none."""
    return q, dq, work, dq @ dq + _TRACE * (q @ q + work @ work)


@dataclass(frozen=True)
class SimulatedStep(Plan):
    """What a step of a simulation is made of; its torques and wrenches are constant."""

    contacts: tuple[RobotContact, ...] = ()
    """What the robot runs into."""

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

    def recurrence(self) -> Recurrence:
        """The program, and where its inputs come from: the state is q, dq, W and a peak, of a step its accelerations are said.

        The peak is that of :func:`ended`. Nothing takes it; it goes in as any number.
        """
        if self.method == "semi_implicit":
            names = ["q", "dq", "work", "peak", "ddq", *self._gaps]
            program = trace(self._semi_implicit_step, [*self._state(), *self.given], names)
            return Recurrence(program, (*FED, *[Source("given")] * len(self.given)), visible=4)
        program, fed = self._staged()
        return Recurrence(program, fed, visible=4, hidden=3, table=stages(TABLEAUS[self.method]))

    def one_stage(self) -> Recurrence:
        """The same for each stage of a Runge-Kutta method: sums are states, the beginning of the step and the row are given."""
        program, fed = self._staged()
        sources = [source if source.kind == "state" else Source("given") for source in fed]
        return Recurrence(program, tuple(sources), visible=7)

    @property
    def _gaps(self) -> list[str]:
        """What is said of contacts as a step begins: how far each is from touching."""
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
        """As :class:`~twistwrench.simulation.schemes.SemiImplicit`; with friction, works are by the mean velocities."""
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
        """Of coordinates, velocities and works, dry friction eased off; ``given`` is what a step is given but its length."""
        return self._rates(angles, dq, given)[0]

    def _rates(
        self, angles: Array, dq: Array, given: Sequence[Array]
    ) -> tuple[tuple[Array, Array, Array], tuple[Array, ...]]:
        """The same, and the gaps of contacts, if there are any."""
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
        """What all contacts do to the joints, (nv,), and how far each is from touching; nothing without contacts."""
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
        """Of torques, friction, wrenches and contacts, in the order of :data:`.forces.WORKS`, (4,)."""
        pushes: Sequence[Array] = [wrench_torques(plant, at, rest[f"wrench at {f}"], f) for f in self.frames]
        found = zeros(len(WORKS))
        found[0], found[1] = tau @ dq, lost @ dq
        for one in pushes:
            found[2] = found[2] + one @ dq
        if push is not None:
            found[3] = push @ dq
        return np.asarray(found)
