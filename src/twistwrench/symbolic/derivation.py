"""Lagrange's equations of a robot, derived. Modern Robotics section 8.1."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from ..errors import MissingExtraError, ShapeError, ValueRangeError
from ..listing import listed
from . import derivation_size as size
from .check import DerivationCheck, checked
from .equation_assembly import assembled
from .equations import Equations, Label, Line, Step
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
from .generalized_coordinates import coordinates_of
from .symbol_choice import model_entries

if TYPE_CHECKING:
    from ..robot import Robot

FORMS = ("auto", "expanded", "named")
"""``expanded``: every term written out. ``named``: intermediate results get names. ``auto``: expanded where it is short."""


@dataclass(frozen=True, eq=False, repr=False)
class Derivation(Equations):
    """Symbolic equations of motion of a robot, with how they compare to the compiled kernels in ``check``.

    Torques belong to the coordinates ``q``: the robot's own, except for planar joints, (x, y, theta) with their rates,
    and floating ones, (x, y, z, alpha, beta, gamma) with the ZYX Euler angles of MR appendix B.1.1.
    """

    form: str = "expanded"
    """"expanded" or "named"."""
    check: DerivationCheck | None = None
    """Residuals against the compiled kernels."""


def require_sympy(purpose: str = "Deriving equations") -> None:
    """MissingExtraError unless SymPy is there."""
    try:
        import sympy  # noqa: F401  only whether it is there
    except ImportError:
        raise MissingExtraError.of("sympy", "symbolic", purpose) from None


def derive(robot: Robot, *, symbols: str | Iterable[str] = "all", form: str = "auto") -> Derivation:
    """Symbolic dynamics: Lagrange's equations of a robot with named symbols, checked against the kernels.

    Parameters
    ----------
    robot : Robot
    symbols : "all", "none", kinds and names in any mix, which of the robot's numbers become symbols
        Kinds: lengths, coms, masses, inertias, gravity, springs, gears; names: ``"L_1"``, ``"m_2"``. The others stay
        numbers.
    form : "expanded", "named" or "auto"
        ``"named"``: intermediate results get names, each printed.

    Returns
    -------
    equations : Derivation, in SI units, angles in radians

    Raises
    ------
    UnknownNameError
        The robot has not such symbols.
    ValueRangeError
        The robot is too large; said before starting.
    MissingExtraError
        There is no SymPy.
    KernelError
        The result disagrees with Newton–Euler.

    Notes
    -----
    MR section 8.1. Friction is left out, which ``remarks`` then says. Numbers are the shortest decimals within 4e-16 of
    the model's.

    Examples
    --------
    >>> import twistwrench as tw
    >>> arm = derive(tw.robots.planar_2r())
    >>> print(arm.text("gravity_forces"))
    gravity_forces: g, what is left at rest
      g₁ = (m₁ + m₂) L₁ g cos(θ₁) + m₂ L₂ g cos(θ₁ + θ₂)
      g₂ = m₂ L₂ g cos(θ₁ + θ₂)
    """
    from ..robot import Robot

    require_sympy()
    if not isinstance(robot, Robot):
        raise ShapeError(f"derive takes a robot, got {robot!r}: tw.load(path) or one of tw.robots.")
    if form not in FORMS:
        raise ValueRangeError(f"form={form!r} is not allowed. Choose from: {', '.join(map(repr, FORMS))}.")
    model = robot.model
    if not model.nv:
        raise ValueRangeError(f"nothing to derive: {robot.name!r} has no joint that moves.")
    entries, coordinates = model_entries(model, symbols), coordinates_of(model)
    ring = ring_of(entries, coordinates)
    motion = None
    if form == "expanded" or (form == "auto" and model.nv <= size.MOST_EXPANDED):
        motion = motion_of(model, entries, coordinates, ring, size.LARGEST_POSITION, size.LARGEST_ROTATION)
        work = size.expanded_products(entries, motion)
        if form == "expanded":
            size.check_expanded(robot.name, work, model.nv)
        elif work > size.COMFORTABLE:
            motion = None
    if motion is None:
        from .intermediate_names import named_derivation

        size.check_named(robot)
        found = named_derivation(model, entries, coordinates)
    else:
        arithmetic = RingArithmetic(ring, coordinates)
        kinetic, potential = energies(entries, motion, arithmetic)
        zero, springs = ring.number(0.0), spring_energies(model, entries, arithmetic)
        drives = drive_energies(entries, arithmetic)
        terms = Terms(ring, coordinates, sum((*kinetic, *drives), zero), sum((*potential, *springs), zero))
        masses = [p.name for p in entries.parameters if "masses" in p.kinds]
        writer = EquationWriter(ring, chain_angles(model, ring, coordinates), masses=masses)
        fields = assembled(terms, writer)
        tags = [b.tag for b in entries.bodies]
        before = _energy_steps(
            writer, coordinates, tags, motion, (kinetic, potential, springs, drives), fields["lagrangian"]
        )
        found = {**fields, "steps": (*before, *fields["steps"]), "form": "expanded"}
    seen = _free_symbols(found)
    derivation = Derivation(
        name=robot.name,
        q=_symbols(c.name for c in coordinates),
        dq=_symbols(c.rate for c in coordinates),
        ddq=_symbols(c.acceleration for c in coordinates),
        parameters=tuple(p for p in entries.parameters if p.name in seen),
        meanings=tuple((c.name, c.meaning) for c in coordinates),
        remarks=_friction_remark(robot),
        **found | {"split": True},  # whatever rounding left of numbers that cancel
    )
    return replace(derivation, check=checked(derivation, robot))


def _friction_remark(robot: Robot) -> tuple[str, ...]:
    friction = robot.model.friction
    if not friction.any:
        return ()
    rubbing = friction.viscous.astype(bool) | friction.static.astype(bool) | friction.load.astype(bool)
    names = [body.joint.name for body in robot.model.leaders for k in range(body.joint.nv) if rubbing[body.v_index + k]]
    return (f"Friction is left out of these equations; the robot has some at {listed(names, 6)}.",)


def _symbols(names: Iterable[str]) -> tuple[Any, ...]:
    import sympy

    return tuple(map(sympy.Symbol, names))


def _free_symbols(found: dict[str, Any]) -> set[str]:
    exprs = [found["lagrangian"], *found["tau"], *(e for _, e in found.get("definitions", ()))]
    exprs += [e for step in found["steps"] for _, e in step.lines]
    return {s.name for e in exprs for s in e.free_symbols}


def _energy_steps(
    writer: EquationWriter, coordinates: Any, tags: list[str], motion: SymbolicMotion, energy: Any, L: Any
) -> tuple[Step, ...]:
    import sympy

    motions, (K, P, springs, drives) = [c.rate for c in coordinates], energy

    def column(vector: Any) -> Any:
        return sympy.ImmutableMatrix([writer.by_motion(x, motions, writer.by_angle) for x in vector])

    def each(letter: str, vectors: Any, keep: Any = lambda _: True) -> tuple[Line, ...]:
        return tuple((Label(f"{letter}_{tag}"), column(x)) for tag, x in zip(tags, vectors, strict=True) if keep(x))

    places = [i for i, k in enumerate(K) if k]
    kinetic = ((Label(f"K_{tags[i]}"), writer.by_motion(K[i], motions, writer.by_mass)) for i in places)
    potential = ((Label(f"P_{tags[i]}"), writer.by_angle(P[i])) for i in places)
    stored = tuple((Label(f"E_{n}"), writer.by_angle(x)) for n, x in enumerate(springs, 1))
    turned = tuple((Label(f"T_{n}"), writer.by_motion(x, motions, writer.by_mass)) for n, x in enumerate(drives, 1))
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
