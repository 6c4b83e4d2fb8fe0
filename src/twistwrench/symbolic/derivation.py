"""Derivation of Lagrange's equations of a robot, checked against Newton-Euler. Modern Robotics section 8.1."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

from ..core.answers.answer import Answer
from ..core.answers.blocks import Block
from ..core.errors import KernelError, ShapeError, ValueRangeError
from ..core.numbers import printed, residual
from ..core.text import listed
from ..core.typing import Names
from ..core.verdict import Verdict, Word
from ..mechanics.model.model import Model
from ..robot import Robot, load
from ..robot.base import require_robot
from .coordinates import Coordinate, coordinates_of, variable_names
from .derivation_check import TOLERANCE, DerivationCheck, check_derivation
from .derivation_size import (
    MAX_AUTOMATIC_PRODUCTS,
    MAX_EXPANDED_COORDINATES,
    MAX_POSITION_TERMS,
    MAX_ROTATION_TERMS,
    check_expanded,
    check_named,
)
from .equations import Equations, Label, Line, Step, assemble_equations
from .expanded_form import (
    RingArithmetic,
    SymbolicMotion,
    Terms,
    chain_angles,
    drive_energies,
    energies,
    motion_of,
    ring_of,
    spring_energies,
)
from .factored_form import EquationWriter
from .intermediate_names import named_derivation
from .names import names_of, require_sympy, sympy
from .parameters import ModelEntries, model_entries
from .source_code import free_symbols
from .trig_polynomial import Ring

_MAX_LISTED = 6
"""Largest number of joints that a remark names."""
Form: TypeAlias = Literal["auto", "expanded", "named"]
"""``expanded``: every term is written out. ``named``: intermediate results get names. ``auto``: expanded if that is short."""


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
    """Names of the steps to print; None for the steps that fit into a screen."""
    source: str | Path = ""
    """File of the robot."""

    @property
    def verdict(self) -> Verdict:
        """DONE, or LOOK AGAIN if the equations disagree with the compiled kernels."""
        if self.check is None or self.check.worst <= TOLERANCE:
            return Verdict(Word.DONE)
        deviation = residual(self.check.worst)
        allowed = printed(TOLERANCE)
        reason = f"the equations disagree with Newton–Euler by {deviation} (allowed {allowed})"
        return Verdict(Word.LOOK_AGAIN, (reason,))

    @property
    def robot_name(self) -> str:
        """Name of the robot."""
        return self.name

    @property
    def brief(self) -> str:
        """Number of joints."""
        noun = "joints" if len(self.q) > 1 else "joint"
        return f"{len(self.q)} {noun}"

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
        """Raise KernelError if the equations disagree with the compiled kernels: no program may be made of them."""
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
    if isinstance(robot, str | Path):
        robot = load(robot)
    robot = _moving_robot(robot)
    model = robot.model
    entries = model_entries(model, symbols)
    coordinates = coordinates_of(model)
    ring = ring_of(entries, coordinates)
    motion = None  # of the expanded form
    if form == "expanded" or (form == "auto" and model.nv <= MAX_EXPANDED_COORDINATES):
        motion = motion_of(model, entries, coordinates, ring, MAX_POSITION_TERMS, MAX_ROTATION_TERMS)
        product_count = float("inf")  # of terms; infinite if positions have too many terms
        if motion is not None:
            product_count = motion.products([body.inertia for body in entries.bodies])
        if form == "expanded":
            check_expanded(robot.name, product_count, model.nv)
        elif product_count > MAX_AUTOMATIC_PRODUCTS:
            motion = None
    if motion is None:
        check_named(robot)
        fields = named_derivation(model, entries, coordinates)
    else:
        fields = _expanded_derivation(model, entries, coordinates, ring, motion)
    expressions = [fields["lagrangian"], *fields["tau"]]
    expressions += dict(fields.get("definitions", ())).values()
    for step in fields["steps"]:
        expressions += dict(step.lines).values()
    used_names = set(names_of(free_symbols(expressions)))
    names, rates, accelerations = variable_names(coordinates)
    derivation = Derivation(
        name=robot.name,
        q=_symbols(names),
        dq=_symbols(rates),
        ddq=_symbols(accelerations),
        parameters=tuple(parameter for parameter in entries.parameters if parameter.name in used_names),
        meanings=tuple((coordinate.name, coordinate.meaning) for coordinate in coordinates),
        remarks=_friction_remark(robot),
        source=model.source,
        # τ = M q̈ + c + g for every robot; rounding errors of cancelled numbers may look like further terms
        **(fields | {"split": True}),
    )
    selected = None
    if steps is not None:
        selected = tuple(names_of(derivation.chosen(_named_steps(steps))))
    return replace(derivation, check=check_derivation(derivation, robot), selected=selected)


def _expanded_derivation(
    model: Model, entries: ModelEntries, coordinates: tuple[Coordinate, ...], ring: Ring, motion: SymbolicMotion
) -> dict[str, Any]:
    """Fields of the derivation with every term written out."""
    arithmetic = RingArithmetic(ring, coordinates)
    zero = ring.number(0.0)
    kinetic, potential = energies(entries, motion, arithmetic)
    springs = spring_energies(model, entries, arithmetic)
    drives = drive_energies(entries, arithmetic)
    K = sum((*kinetic, *drives), zero)
    P = sum((*potential, *springs), zero)
    masses = [parameter.name for parameter in entries.parameters if "masses" in parameter.kinds]
    writer = EquationWriter(ring, chain_angles(model, ring, coordinates), masses=masses)
    fields = assemble_equations(Terms(ring, coordinates, K, P), writer)
    tags = [body.tag for body in entries.bodies]
    energy_parts = kinetic, potential, springs, drives
    energy_steps = _energy_steps(writer, coordinates, tags, motion, energy_parts, fields["lagrangian"])
    return fields | {"steps": (*energy_steps, *fields["steps"]), "form": "expanded"}


def _moving_robot(robot: Robot) -> Robot:
    """The robot; raises ShapeError for another object, and ValueRangeError for a robot without a joint that moves."""
    if not isinstance(robot, Robot):
        raise ShapeError(f"derive takes a robot, got {robot!r}: tw.load(path) or one of tw.robots.")
    require_robot(robot, "derive")
    if not robot.model.nv:
        raise ValueRangeError(f"nothing to derive: {robot.name!r} has no joint that moves.")
    return robot


def _named_steps(steps: Names) -> Iterable[str] | None:
    """Names of steps; None for ``"all"``."""
    means_all = steps == "all" or list(steps) == ["all"]
    return None if means_all else steps


def _friction_remark(robot: Robot) -> tuple[str, ...]:
    """Remark that friction is left out, with the joints that have friction; empty for a robot without friction."""
    friction = robot.model.friction
    if not friction.any:
        return ()
    has_friction = friction.viscous.astype(bool) | friction.static.astype(bool) | friction.load.astype(bool)
    names = []  # of joints
    for body in robot.model.leaders:
        _, velocity_slice = body.places
        if has_friction[velocity_slice].any():
            names.append(body.joint.name)
    return (f"Friction is left out of these equations; the robot has some at {listed(names, _MAX_LISTED)}.",)


def _symbols(names: Iterable[str]) -> tuple[Any, ...]:
    """Symbols of SymPy."""
    return tuple(map(sympy.Symbol, names))


def _energy_steps(
    writer: EquationWriter, coordinates: Any, tags: list[str], motion: SymbolicMotion, energy_parts: Any, L: Any
) -> tuple[Step, ...]:
    """Steps of :data:`_ENERGY_STEPS`, which come before Lagrange's equations.

    ``tags`` are the suffixes of the bodies' symbols. ``energy_parts`` are the kinetic and potential energies of the bodies, and
    the energies of springs and drives.
    """
    _, rates, _ = variable_names(coordinates)
    K, P, springs, drives = energy_parts

    def column(vector: Any) -> Any:
        """Expression of a vector."""
        return sympy.ImmutableMatrix([writer.write_by_motion(entry, rates, writer.write_by_angle) for entry in vector])

    def energy_by_mass(total: Any) -> Any:
        """Expression of an energy, with its terms ordered by mass."""
        return writer.write_by_motion(total, rates, writer.write_by_mass)

    lines: defaultdict[str, list[Line]] = defaultdict(list)
    for i, tag in enumerate(tags):
        lines["positions"].append((Label(f"p_{tag}"), column(motion.positions[i])))
        lines["velocities"].append((Label(f"v_{tag}"), column(motion.velocities[i])))
        if any(motion.turning[i]):
            lines["angular_velocities"].append((Label(f"omega_{tag}"), column(motion.turning[i])))
        if K[i]:
            lines["kinetic_energies"].append((Label(f"K_{tag}"), energy_by_mass(K[i])))
            lines["potential_energies"].append((Label(f"P_{tag}"), writer.write_by_angle(P[i])))
    for number, spring_energy in enumerate(springs, 1):
        lines["spring_energies"].append((Label(f"E_{number}"), writer.write_by_angle(spring_energy)))
    for number, drive_energy in enumerate(drives, 1):
        lines["drive_energies"].append((Label(f"T_{number}"), energy_by_mass(drive_energy)))
    lines["lagrangian"].append((Label("L"), L))
    steps = []
    for name, remark in _ENERGY_STEPS.items():
        if lines[name]:
            steps.append(Step(name, remark, tuple(lines[name])))
    return tuple(steps)


_ENERGY_STEPS = {
    "positions": "centres of mass in the base frame",
    "velocities": "of the centres of mass",
    "angular_velocities": "of the links, in their own axes",
    "kinetic_energies": "½ m v·v + ½ ω·I ω of each link",
    "drive_energies": "½ J q̇² of each drive with an armature",
    "potential_energies": "−m (gravity · p) of each link",
    "spring_energies": "½ k stretch² of each spring",
    "lagrangian": "the sum of K less the sum of P",
}
"""Names and remarks of the steps before those of Lagrange's equations."""
