"""One step of a rollout as a program: torques, forward dynamics and the move along the manifold, traced together.

Angles go in apart from the coordinates they are: the same numbers, as an array that is nothing but angles, whose size can be
looked at once. That is what lets a whole step be one piece of machine code without a branch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ..algorithms import integration
from ..algorithms.control_laws import clipped
from ..algorithms.coordinate_rates import coordinate_rates
from ..algorithms.forward_dynamics import forward_dynamics
from ..algorithms.friction import eased, torque_past_eased_friction
from ..algorithms.velocity_step import velocity_step
from ..errors import UnknownNameError
from ..model.base_parameters import regrouped
from ..model.model import Model
from ..model.variable_parameters import moves_joints, varied
from ..program.recurrence import Recurrence, Source
from ..program.trace import trace
from ..typing import Array
from .tableau import RK4, Tableau
from .torque_laws import TorqueLaw

ROLLOUT_METHODS = ("semi_implicit", "rk4")
"""The methods of rollouts, by the names they have in simulations."""

Ports = list[tuple[str, tuple[int, ...]]]


def method_named(name: Any) -> str:
    """The name; UnknownNameError lists those there are."""
    if not isinstance(name, str) or name not in ROLLOUT_METHODS:
        raise UnknownNameError.of("method", name, ROLLOUT_METHODS)
    return name


@dataclass(frozen=True)
class Plan:
    """What a step is made of; everything but numbers."""

    model: Model
    law: TorqueLaw
    method: str
    limited: bool = False
    """Whether torques are clipped."""
    frames: tuple[str, ...] = ()
    """Where wrenches act on the robot."""
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
        """How many numbers each part of the state is: q, dq, and what else is passed on from step to step."""
        return self.model.nq, self.model.nv

    @property
    def eases(self) -> bool:
        """Whether dry friction is eased off at low speeds, and not an impulse that at most stops a joint."""
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

    def recurrence(self) -> Recurrence:
        """The program, and where its inputs come from."""
        nq, nv, given = self.model.nq, self.model.nv, self.given
        state: Ports = [("angles", (nq,)), ("q", (nq,)), ("dq", (nv,))]
        fed = [Source("state", 0), Source("state", 0), Source("state", 1)]
        sources = [Source("given")] * len(given)
        said = ["tau"] * self.says_torques
        if self.method == "semi_implicit":
            program = trace(self._semi_implicit, [*state, *given], ["q", "dq", *said])
            return Recurrence(program, (*fed, *sources), visible=2)
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
        return Recurrence(program, (*fed, *sources), visible=2, hidden=2, table=stages(RK4))

    # ── on symbols ──

    def _semi_implicit(self, angles: Array, q: Array, dq: Array, h: Any, *given: Array) -> tuple[Array, ...]:
        """dq1 by :func:`~twistwrench.algorithms.velocity_step.velocity_step`, then q1 = q ⊕ h dq1.

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
        """Of the law, within the limits."""
        tau = self.law.torques(known, angles, q, dq, *(rest[name] for name in self.law.names))
        return clipped(tau, rest["torque limits"]) if self.limited else tau

    def _models(self, given: Sequence[Array]) -> tuple[Model, Model, dict[str, Array]]:
        """The robot as the law knows it and as it is, and what is given for the step, by name."""
        rest = dict(zip([name for name, _ in self.given[1:]], given, strict=True))
        known = regrouped(self.model)
        plant = known if not moves_joints(self.model, self.parameters) else self.model
        if self.parameters:
            plant = varied(plant, self.parameters, list(rest["parameters"]))
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
