"""Derivation of Lagrange's equations of a robot: size estimate, equations, check against Newton-Euler."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from ..core.answers.answer import Answer
from ..core.answers.blocks import Block
from ..core.errors import KernelError, ShapeError, ValueRangeError
from ..core.numbers import printed, residual
from ..core.text import argument, listed
from ..core.typing import Array, Names
from ..core.verdict import Verdict, Word
from ..robot import Robot, load
from ..robot.task_space_methods import require_robot
from .equations import Equations, Label, Line, Step, assemble_equations
from .expanded_form import (
    RingArithmetic,
    SymbolicMotion,
    Terms,
    chain_angles,
    coordinates_of,
    drive_energies,
    energies,
    motion_of,
    ring_of,
    spring_energies,
    to_robot,
)
from .factored_form import EquationWriter
from .intermediate_names import named_derivation
from .names import model_entries, require_sympy, sympy

# ── Size of a derivation, estimated beforehand

LARGEST_POSITION = 1500
"""Maximum number of terms in a centre-of-mass coordinate for an expanded derivation."""
LARGEST_ROTATION = 100
"""Maximum number of terms in an entry of a rotation."""
MAX_AUTOMATIC_PRODUCTS = 30_000
"""Maximum number of products of two terms in the kinetic energy for which equations are expanded by default."""
LARGEST_EXPANDED = 1_000_000
"""Maximum number of products times coordinates for an expanded derivation; more would fill hundreds of pages."""
MOST_EXPANDED = 4
"""Maximum number of coordinates for which equations are expanded by default; longer ones are unreadable."""
LARGEST_NAMED = 8_000
"""Maximum number of lines of named intermediate results."""


def check_expanded(name: str, products: float, coordinates: int) -> None:
    """Raise ValueRangeError beyond :data:`LARGEST_EXPANDED`."""
    if products * coordinates > LARGEST_EXPANDED:
        count = (
            f"more than {LARGEST_POSITION:,} terms in a coordinate of a position, or {LARGEST_ROTATION} in a rotation"
        )
        if products < float("inf"):
            count = (
                f"{int(products):,} products of terms in its kinetic energy, to be differentiated by {coordinates} "
                f"coordinates; allowed are {LARGEST_EXPANDED // coordinates:,}"
            )
        raise ValueRangeError(
            f"{name!r} is too large to write out: {count}. Leave {argument('form', 'expanded')} out and "
            "intermediate results get names; or "
            f"lock joints (robot.lock), or keep numbers instead of symbols, {argument('symbols', 'none')}."
        )


def named_lines(robot: Robot) -> int:
    """Approximate number of lines with named intermediate results: columns of Jacobians and their derivatives."""
    model = robot.model
    depth: list[int] = []
    lines = 0
    for body in model.bodies:
        before = depth[body.parent] if body.parent >= 0 else 0
        n = before + body.joint.nv
        depth.append(n)
        lines += 9 * n + 9 * n * (n - 1) // 2
    n = model.nv
    return lines + n * n * (n + 1) // 4


def check_named(robot: Robot) -> None:
    """Raise ValueRangeError beyond :data:`LARGEST_NAMED` lines."""
    lines = named_lines(robot)
    if lines > LARGEST_NAMED:
        raise ValueRangeError(
            f"{robot.name!r} is too large to derive: its {robot.nv} coordinates would take about {lines:,} lines of named "
            f"intermediate results; allowed are {LARGEST_NAMED:,}. Lock joints (robot.lock), derive a leg or an arm by itself, "
            "or use the compiled kernels (robot.inverse_dynamics), which have no such limit."
        )


# ── Evaluation of expressions on arrays of samples


class Evaluator:
    """Evaluator of expressions, given values of their symbols; definitions are evaluated first, in order."""

    def __init__(self, values: Mapping[Any, Any]) -> None:
        self._known: dict[Any, Any] = dict(values)

    @classmethod
    def from_state(cls, equations: Equations, q: Array, dq: Array, ddq: Array) -> Evaluator:
        """Evaluator at states (..., n), with parameters at their own values."""
        values: dict[Any, Any] = dict(equations.values)
        for symbols, array in ((equations.q, q), (equations.dq, dq), (equations.ddq, ddq)):
            values |= {symbol: array[..., k] for k, symbol in enumerate(symbols)}
        evaluator = cls(values)
        for symbol, expr in equations.definitions:
            evaluator._known[symbol] = evaluator(expr)
        return evaluator

    def __call__(self, expr: Any) -> Any:
        """Value of one expression."""
        known = self._known.get(expr)
        if known is None:
            known = self._known[expr] = self._value(expr)
        return known

    def array(self, exprs: Any, batch: tuple[int, ...]) -> Array:
        """Values of a matrix or array of expressions, (*batch, *its shape)."""
        shape = tuple(int(n) for n in exprs.shape)
        rows = [np.broadcast_to(self(exprs[place]), batch) for place in np.ndindex(shape)]
        return np.stack(rows, axis=-1).reshape(*batch, *shape)

    def _value(self, expr: Any) -> Any:
        if expr.is_Number:
            return float(expr)
        if expr.is_Add:
            return sum(map(self, expr.args))
        if expr.is_Mul:
            total = 1.0
            for factor in expr.args:
                total = total * self(factor)
            return total
        if expr.is_Pow and expr.exp.is_Integer:
            return self(expr.base) ** int(expr.exp)
        if expr.is_Pow:
            return np.power(self(expr.base), self(expr.exp))
        return getattr(np, expr.func.__name__)(*map(self, expr.args))


# ── Comparison with Newton–Euler dynamics at random states

TOLERANCE = 1e-12
"""Tolerance relative to the largest torque, mass or force; both sides round sums of a few hundred terms of order one."""

_STATES, _CHECK_SEED = 16, 8100


@dataclass(frozen=True)
class DerivationCheck:
    """Check of a derivation: deviation from the compiled kernels, relative to the largest entry of each quantity."""

    inverse_dynamics: float
    """Relative deviation of τ."""
    mass_matrix: float
    """Relative deviation of M."""
    coriolis_forces: float
    """Relative deviation of c."""
    gravity_forces: float
    """Relative deviation of g."""
    states: int
    """Number of random states."""

    @property
    def worst(self) -> float:
        """Largest of the deviations."""
        return max(self.inverse_dynamics, self.mass_matrix, self.coriolis_forces, self.gravity_forces)

    def __str__(self) -> str:
        return (
            f"checked against Newton–Euler at {self.states} random states: τ to {residual(self.inverse_dynamics)}, "
            f"M to {residual(self.mass_matrix)}, c to {residual(self.coriolis_forces)}, g to "
            f"{residual(self.gravity_forces)} of the largest entry"
        )


def check_derivation(equations: Equations, robot: Robot) -> DerivationCheck:
    """Deviation from the kernels at random states."""
    n, rng = robot.nv, np.random.default_rng(_CHECK_SEED)
    u, (du, ddu) = rng.uniform(-1.5, 1.5, (_STATES, n)), rng.standard_normal((2, _STATES, n))
    evaluator = Evaluator.from_state(equations, u, du, ddu)
    quantities = ("inverse_dynamics", "mass_matrix", "coriolis_forces", "gravity_forces")
    expected: dict[str, list[Array]] = {name: [] for name in quantities}
    zero = np.zeros(n)

    def torques_at_rest(q: Array) -> Array:  # without gravity, springs still produce torque
        return robot.bias_forces(q, zero) if robot.model.springs else robot.gravity_forces(q)

    for x, dx, ddx in zip(u, du, ddu, strict=True):
        q, dq, ddq, N = to_robot(robot.model, x, dx, ddx)
        bias = ddq - N @ ddx  # dN/dt du: part of c due to the choice of coordinates
        M = robot.mass_matrix(q)
        expected["inverse_dynamics"].append(N.T @ robot.inverse_dynamics(q, dq, ddq))
        expected["mass_matrix"].append(N.T @ M @ N)
        expected["coriolis_forces"].append(N.T @ (robot.coriolis_forces(q, dq) + M @ bias))
        expected["gravity_forces"].append(N.T @ torques_at_rest(q))
    torque = np.abs(expected["inverse_dynamics"]).max()
    deviations = {}
    for name, rows in expected.items():
        exprs = equations.tau if name == "inverse_dynamics" else getattr(equations, name)
        values = evaluator.array(exprs, (_STATES,)).reshape(np.shape(rows))
        scale = np.abs(rows).max() if name == "mass_matrix" else torque
        deviations[name] = float(np.abs(values - rows).max() / scale) if scale else float(np.abs(values).max())
    return DerivationCheck(**deviations, states=_STATES)


# ── The derivation. Modern Robotics section 8.1

Form: TypeAlias = Literal["auto", "expanded", "named"]
"""``expanded``: every term is written out. ``named``: intermediate results get names. ``auto``: expanded if short."""


@dataclass(frozen=True, eq=False, repr=False)
class Derivation(Answer, Equations):
    """Symbolic equations of motion of a robot, with their comparison with the compiled kernels in ``check``.

    Printing it shows the report of ``twistwrench derive``. The verdict is DONE, or LOOK AGAIN if the comparison fails.

    Torques belong to the coordinates ``q``: the robot's own, except for planar joints, (x, y, theta) with their rates,
    and floating joints, (x, y, z, alpha, beta, gamma) with the ZYX Euler angles of MR appendix B.1.1.

    Examples
    --------
    >>> import twistwrench as tw
    >>> arm = tw.derive("planar_2r")
    >>> arm, list(arm.sources()), len(list(arm.blocks()))
    (<Derivation of planar_2r: DONE, 2 joints>, ['ROBOT'], 21)
    >>> arm.facts()["steps"], arm.tables["Steps"].rows()[0]["entries"]
    ('16', 2)
    >>> "def inverse_dynamics(" in arm.numpy_source(), "void arm_inverse_dynamics(" in arm.c_source("arm")
    (True, True)
    """

    call = "derive"

    form: str = "expanded"
    """"expanded" or "named"."""
    check: DerivationCheck | None = None
    """Comparison with the compiled kernels."""
    selected: tuple[str, ...] | None = None
    """Names of the steps to print; None: those that fit into a screen."""
    source: str | Path = ""
    """File of the robot."""

    @property
    def verdict(self) -> Verdict:
        """DONE, or LOOK AGAIN if the equations disagree with the compiled kernels."""
        if self.check is None or self.check.worst <= TOLERANCE:
            return Verdict(Word.DONE)
        gap, allowed = residual(self.check.worst), printed(TOLERANCE)
        return Verdict(Word.LOOK_AGAIN, (f"the equations disagree with Newton–Euler by {gap} (allowed {allowed})",))

    @property
    def robot_name(self) -> str:
        """Name of the robot."""
        return self.name

    @property
    def brief(self) -> str:
        """Number of joints."""
        return f"{len(self.q)} joint{'s' * (len(self.q) > 1)}"

    def blocks(self) -> Iterator[Block]:
        """Verdict, symbols with their values, steps of the derivation, check and remarks.

        Returns
        -------
        blocks : iterator of Block
        """
        from .derivation_view import derivation_view

        return derivation_view(self)

    def numpy_source(self) -> str:
        """Python module of the equations, as :meth:`Equations.numpy_source`.

        Returns
        -------
        source : str

        Raises
        ------
        KernelError
            The equations disagree with the compiled kernels.
        """
        self._refuse_disagreement()
        return super().numpy_source()

    def c_source(self, prefix: str | None = None) -> str:
        """C99 source of the equations, as :meth:`Equations.c_source`.

        Parameters
        ----------
        prefix : str, optional, of the names of functions; default: the robot's name

        Returns
        -------
        source : str

        Raises
        ------
        KernelError
            The equations disagree with the compiled kernels.
        """
        self._refuse_disagreement()
        return super().c_source(prefix)

    def _refuse_disagreement(self) -> None:
        """Raise if the equations are wrong: no program may be made of them."""
        if not self.verdict.ok:
            raise KernelError(f"{self.verdict.reasons[0]}. Please report this robot with its file.")

    def facts(self) -> Mapping[str, str]:
        """Numbers of joints, symbols and steps, and the largest deviation from the kernels.

        Returns
        -------
        facts : {name: text}
        """
        facts = {"joints": str(len(self.q)), "symbols": str(len(self.parameters)), "steps": str(len(self.steps))}
        if self.check is not None:
            facts["largest deviation from Newton–Euler"] = residual(self.check.worst)
        return facts

    def sources(self) -> Mapping[str, str | Path]:
        """File of the robot.

        Returns
        -------
        files : {argument: path}
        """
        return {"ROBOT": self.source} if self.source else {}


def derive(
    robot: Robot | str | Path,
    *,
    symbols: Names = "all",
    form: Form = "auto",
    steps: Names | None = None,
) -> Derivation:
    """Symbolic dynamics: Lagrange's equations of a robot with named symbols, checked against the kernels (MR section 8.1).

    Friction is left out, as noted in ``remarks``. Numbers are the shortest decimals within 4e-16 of the model's
    numbers.

    Parameters
    ----------
    robot : Robot, path or name
    symbols : "all", "none", kinds and names in any mix
        Quantities kept as symbols: all, none, lengths, coms, masses, inertias, gravity, springs, gears, or names such as
        L_1; the others are numbers.
    form : "expanded", "named" or "auto"
        Write terms in full, or name intermediate results.
    steps : names, "all", or None
        Steps to print and write, by name, or all; default: those that fit into a screen.

    Returns
    -------
    equations : Derivation, in SI units, angles in radians; its verdict is LOOK AGAIN if it disagrees with Newton–Euler

    Raises
    ------
    ValueRangeError
        The robot is too large; raised before the derivation.
    MissingExtraError
        SymPy is not installed.

    Examples
    --------
    >>> import twistwrench as tw
    >>> arm = derive(tw.robots.planar_2r())
    >>> print(arm.text("gravity_forces"))
    gravity_forces: g, torques at rest
      g₁ = (m₁ + m₂) L₁ g cos(θ₁) + m₂ L₂ g cos(θ₁ + θ₂)
      g₂ = m₂ L₂ g cos(θ₁ + θ₂)
    """
    require_sympy()
    if form not in get_args(Form):
        raise ValueRangeError(f"form={form!r} is not allowed. Choose from: {', '.join(map(repr, get_args(Form)))}.")
    robot = _moving_robot(load(robot) if isinstance(robot, str | Path) else robot)
    model = robot.model
    entries, coordinates = model_entries(model, symbols), coordinates_of(model)
    ring = ring_of(entries, coordinates)
    motion = None
    if form == "expanded" or (form == "auto" and model.nv <= MOST_EXPANDED):
        motion = motion_of(model, entries, coordinates, ring, LARGEST_POSITION, LARGEST_ROTATION)
        work = float("inf") if motion is None else motion.products([body.inertia for body in entries.bodies])
        if form == "expanded":
            check_expanded(robot.name, work, model.nv)
        elif work > MAX_AUTOMATIC_PRODUCTS:
            motion = None
    if motion is None:
        check_named(robot)
        fields = named_derivation(model, entries, coordinates)
    else:
        arithmetic = RingArithmetic(ring, coordinates)
        kinetic, potential = energies(entries, motion, arithmetic)
        zero, springs = ring.number(0.0), spring_energies(model, entries, arithmetic)
        drives = drive_energies(entries, arithmetic)
        terms = Terms(ring, coordinates, sum((*kinetic, *drives), zero), sum((*potential, *springs), zero))
        masses = [p.name for p in entries.parameters if "masses" in p.kinds]
        writer = EquationWriter(ring, chain_angles(model, ring, coordinates), masses=masses)
        fields = assemble_equations(terms, writer)
        tags = [b.tag for b in entries.bodies]
        energy = kinetic, potential, springs, drives
        energy_steps = _energy_steps(writer, coordinates, tags, motion, energy, fields["lagrangian"])
        fields |= {"steps": (*energy_steps, *fields["steps"]), "form": "expanded"}
    exprs = [fields["lagrangian"], *fields["tau"], *(e for _, e in fields.get("definitions", ()))]
    exprs += [e for step in fields["steps"] for _, e in step.lines]
    used = {symbol.name for e in exprs for symbol in e.free_symbols}
    derivation = Derivation(
        name=robot.name,
        q=_symbols(c.name for c in coordinates),
        dq=_symbols(c.rate for c in coordinates),
        ddq=_symbols(c.acceleration for c in coordinates),
        parameters=tuple(p for p in entries.parameters if p.name in used),
        meanings=tuple((c.name, c.meaning) for c in coordinates),
        remarks=_friction_remark(robot),
        source=model.source,
        **fields | {"split": True},  # rounding errors of cancelled numbers
    )
    selected = None if steps is None else tuple(step.name for step in derivation.chosen(_named_steps(steps)))
    return replace(derivation, check=check_derivation(derivation, robot), selected=selected)


def _moving_robot(robot: Robot) -> Robot:
    """The robot; raises ShapeError for another object, and ValueRangeError without a joint that moves."""
    if not isinstance(robot, Robot):
        raise ShapeError(f"derive takes a robot, got {robot!r}: tw.load(path) or one of tw.robots.")
    require_robot(robot, "derive")
    if not robot.model.nv:
        raise ValueRangeError(f"nothing to derive: {robot.name!r} has no joint that moves.")
    return robot


def _named_steps(steps: Names) -> Iterable[str] | None:
    """Names of steps; None for ``"all"``."""
    return None if steps == "all" or list(steps) == ["all"] else steps


def _friction_remark(robot: Robot) -> tuple[str, ...]:
    friction = robot.model.friction
    if not friction.any:
        return ()
    rubbing = friction.viscous.astype(bool) | friction.static.astype(bool) | friction.load.astype(bool)
    names = [body.joint.name for body in robot.model.leaders for k in range(body.joint.nv) if rubbing[body.v_index + k]]
    return (f"Friction is left out of these equations; the robot has some at {listed(names, 6)}.",)


def _symbols(names: Iterable[str]) -> tuple[Any, ...]:
    return tuple(map(sympy.Symbol, names))


def _energy_steps(
    writer: EquationWriter, coordinates: Any, tags: list[str], motion: SymbolicMotion, energy: Any, L: Any
) -> tuple[Step, ...]:
    motions, (K, P, springs, drives) = [c.rate for c in coordinates], energy

    def column(vector: Any) -> Any:
        return sympy.ImmutableMatrix([writer.write_by_motion(x, motions, writer.write_by_angle) for x in vector])

    def each(letter: str, vectors: Any, keep: Any = lambda _: True) -> tuple[Line, ...]:
        return tuple((Label(f"{letter}_{tag}"), column(x)) for tag, x in zip(tags, vectors, strict=True) if keep(x))

    moving = [i for i, k in enumerate(K) if k]
    kinetic = ((Label(f"K_{tags[i]}"), writer.write_by_motion(K[i], motions, writer.write_by_mass)) for i in moving)
    potential = ((Label(f"P_{tags[i]}"), writer.write_by_angle(P[i])) for i in moving)
    stored = tuple((Label(f"E_{n}"), writer.write_by_angle(x)) for n, x in enumerate(springs, 1))
    turned = tuple(
        (Label(f"T_{n}"), writer.write_by_motion(x, motions, writer.write_by_mass)) for n, x in enumerate(drives, 1)
    )
    steps = (
        Step("positions", "centres of mass in the base frame", each("p", motion.positions)),
        Step("velocities", "of the centres of mass", each("v", motion.velocities)),
        Step("angular_velocities", "of the links, in their own axes", each("omega", motion.turning, any)),
        Step("kinetic_energies", "½ m v·v + ½ ω·I ω of each link", tuple(kinetic)),
        Step("drive_energies", "½ J q̇² of each drive with an armature", turned),
        Step("potential_energies", "−m (gravity · p) of each link", tuple(potential)),
        Step("spring_energies", "½ k stretch² of each spring", stored),
        Step("lagrangian", "the sum of K less the sum of P", ((Label("L"), L),)),
    )
    return tuple(step for step in steps if step.lines)
