"""Symbols and notation: rounded constants, symbol names, order of factors, plain text, and a robot's parameters."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from ..core.errors import MissingExtraError, UnknownNameError, ValueRangeError
from ..core.numbers import printed
from ..core.third_party import lazy_module
from ..mechanics.model.couplings import refuse_couplings
from ..mechanics.model.model import BASE, Body, Model

sympy: Any = lazy_module("sympy")


def require_sympy(purpose: str = "Deriving equations") -> None:
    """Raise MissingExtraError unless SymPy is installed."""
    try:
        import sympy  # noqa: F401  availability check only
    except ImportError:
        raise MissingExtraError.from_extra("sympy", "symbolic", purpose) from None


_ROUND_OFF = 4e-16
"""Two units in the last place."""


def shortest(value: float, scale: float = 0.0) -> float:
    """Shortest decimal within 4e-16 of the value; for differences, relative to ``scale``, the size of the operands.

    >>> shortest(0.010000000000000002), shortest(0.1 + 0.2), shortest(1 / 3)
    (0.01, 0.3, 0.3333333333333333)
    """
    value = float(value)
    allowed = _ROUND_OFF * max(abs(value), scale)
    for digits in range(1, 17):
        near = float(f"{value:.{digits}g}")
        if abs(near - value) <= allowed:
            return near
    return value


# ── Parts of a symbol's name: letter, dots, index

GREEK = {
    "alpha": "α", "beta": "β", "gamma": "γ", "delta": "δ", "epsilon": "ε", "zeta": "ζ", "eta": "η", "theta": "θ", "iota": "ι",
    "kappa": "κ", "lambda": "λ", "mu": "μ", "nu": "ν", "xi": "ξ", "pi": "π", "rho": "ρ", "sigma": "σ", "tau": "τ",
    "upsilon": "υ", "phi": "φ", "chi": "χ", "psi": "ψ", "omega": "ω", "Gamma": "Γ", "Delta": "Δ", "Theta": "Θ",
    "Lambda": "Λ", "Xi": "Ξ", "Pi": "Π", "Sigma": "Σ", "Phi": "Φ", "Psi": "Ψ", "Omega": "Ω",
}  # fmt: skip

MARKS = {"ddot": "\u0308", "dot": "\u0307"}


def name_parts(name: str) -> tuple[str, str, str]:
    """Stem, mark and index of a symbol's name: thetadot_1 → theta, dot, 1."""
    stem, _, index = name.partition("_")
    for mark in MARKS:
        if stem.endswith(mark) and len(stem) > len(mark):
            return stem[: -len(mark)], mark, index
    return stem, "", index


def link_number(index: str) -> tuple[int, bool]:
    """Number of a link or joint; rotors (r1) sort after links of the same number."""
    number = re.match(r"(r?)(\d+)", index)
    return (int(number[2]), bool(number[1])) if number else (0, False)


# ── Order of factors and terms

RANKS = {"G": -0.7, "m": 0, "I": 1, "L": 2, "r": 2, "a": 2, "h": 2, "g": 3, "t": 4.5}


def _factors(expr: Any) -> list[Any]:
    return list(expr.args) if expr.is_Mul else [expr]


def is_sum(factors: list[Any]) -> bool:
    """True for a single factor that is a sum."""
    return len(factors) == 1 and bool(factors[0].is_Add)


def signed_factors(term: Any) -> tuple[bool, list[Any]]:
    """Sign of a term and its factors without sign; sums among them are normalised to a positive first term."""
    coefficient, rest = term.as_coeff_Mul()
    negative = bool(coefficient.is_negative)
    factors = [] if abs(coefficient) == 1 else [abs(coefficient)]
    for factor in _factors(rest):
        whole = factor.is_Pow and factor.exp.is_Integer and factor.exp.is_positive
        base, power = (factor.base, int(factor.exp)) if whole else (factor, 1)
        if base.is_Add and signed_factors(ordered_terms(base)[0])[0]:
            negative ^= bool(power % 2)
            factor = (-base) ** power
        if factor != 1:
            factors.append(factor)
    return negative, factors or [abs(coefficient)]


@lru_cache(maxsize=1 << 14)
def ordered_terms(expr: Any) -> list[Any]:
    """Terms of a sum in textbook order."""
    return sorted(expr.as_ordered_terms() if expr.is_Add else [expr], key=_term_key)


def _exponent(term: Any, symbol: Any) -> int:
    """Whole power of a symbol in a term; 1 if it is another."""
    for factor in _factors(term):
        if factor.is_Pow and factor.base == symbol and factor.exp.is_Integer:
            return int(factor.exp)
    return 1


def _term_key(term: Any) -> tuple[Any, ...]:
    marks, letters = [0, 0], []
    for symbol in term.free_symbols:
        stem, mark, index = name_parts(symbol.name)
        if mark:
            marks[mark == "dot"] += 1
        rank = 9 if mark else RANKS.get(stem, 4)
        letters.append((link_number(index), rank, symbol.name, -_exponent(term, symbol)))
    return (-min(marks[0], 1), -min(marks[1], 1), tuple(sorted(letters)), str(term) if not letters else "")


# ── Notations: plain text, and the base of LaTeX and MathML

# Order of factors: numbers, masses, inertias, lengths, gravity, sines and cosines, sums, rates, accelerations. Order of
# terms: with accelerations, with rates, without; then by link number.

_SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")  # Unicode has a subscript x, but not y and z
_SUPERSCRIPTS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


class Notation:
    """Order of writing; subclasses define the appearance."""

    def write(self, expr: Any) -> str:
        """Text of an expression, a column or a matrix."""
        if isinstance(expr, sympy.MatrixBase):
            return self.matrix([[self.write(x) for x in row] for row in expr.tolist()])
        if expr.is_Add:
            return self.join(self.terms(expr))
        if expr.is_Mul:
            return self._product(expr)
        if expr.is_Symbol:
            return self.symbol(expr.name)
        if expr.is_Number:
            return self._number(expr)
        if expr.is_Pow:
            return self._power(expr)
        if expr.func.__name__ in ("sin", "cos"):
            return self.function(expr.func.__name__, self.write(expr.args[0]))
        return self.other(expr)

    def terms(self, expr: Any) -> list[tuple[str, str]]:
        """Terms of a sum, each with its sign."""
        terms = []
        for term in ordered_terms(expr):
            negative, factors = signed_factors(term)
            terms.append(("-", self._negative_operand(factors)) if negative else ("+", self._quotient(factors)))
        return terms

    def _product(self, expr: Any) -> str:
        negative, factors = signed_factors(expr)
        return self.minus(self._negative_operand(factors)) if negative else self._quotient(factors)

    def _negative_operand(self, factors: list[Any]) -> str:
        """Operand of a minus sign; a sum is put in brackets."""
        inner = self._quotient(factors)
        return self.bracket(inner) if is_sum(factors) else inner

    def _quotient(self, factors: list[Any]) -> str:
        above: list[Any] = []
        below: list[Any] = []
        for factor in factors:
            if factor.is_Pow and factor.exp.is_Number and factor.exp.is_negative:
                below.append(factor.base**-factor.exp)
            else:
                above.append(factor)
        top = self._factors(above)
        if not below:
            return top
        return self.fraction(self.above(top) if is_sum(above) else top or "1", self._factors(below))

    def _factors(self, factors: list[Any]) -> str:
        ordered = sorted(factors, key=self._factor_key)
        alone = len(ordered) == 1
        return self.times([self.write(f) if alone or not f.is_Add else self.bracket(self.write(f)) for f in ordered])

    def _factor_key(self, factor: Any) -> tuple[Any, ...]:
        base = factor.base if factor.is_Pow else factor
        if base.is_Number:
            return (-1, 0, "")
        if base.is_Symbol:
            stem, mark, index = name_parts(base.name)
            return ({"": RANKS.get(stem, 4), "dot": 8, "ddot": 9}[mark], link_number(index), base.name)
        if base.is_Add:
            parts = [name_parts(s.name) for s in base.free_symbols]
            if any(mark for _, mark, _ in parts):
                return (7, 0, str(base))
            heavy = any(stem in ("m", "I") for stem, _, _ in parts) and not base.has(sympy.sin, sympy.cos)
            return (-0.5 if heavy else 5, 0, str(base))
        return (6, 0, str(base))

    def _power(self, expr: Any) -> str:
        if expr.exp.is_Number and expr.exp.is_negative:
            return self.fraction("1", self.write(expr.base**-expr.exp))
        if not expr.exp.is_Integer:
            return self.other(expr)
        if expr.base.func.__name__ in ("sin", "cos"):
            return self.function(expr.base.func.__name__, self.write(expr.base.args[0]), str(expr.exp))
        base = self.write(expr.base)
        return self.superscript(base if expr.base.is_Symbol else self.bracket(base), str(expr.exp))

    def _number(self, x: Any) -> str:
        if x.is_negative:
            return self.minus(self._number(-x))
        if x.is_Rational and not x.is_Integer:
            return self.fraction(self.figure(str(x.p)), self.figure(str(x.q)))
        return self.figure(str(x) if x.is_Integer else f"{printed(float(x))}")

    # Appearance in plain text, for the terminal.

    def symbol(self, name: str) -> str:
        """Symbol with Greek letters, dots for rates, and indices."""
        stem, mark, index = name_parts(name)
        low = re.sub(r"^r(?=\d)", "ᵣ", index).replace("_", ",").translate(_SUBSCRIPTS)
        return unicodedata.normalize("NFC", GREEK.get(stem, stem) + (MARKS[mark] if mark else "")) + low

    def figure(self, digits: str) -> str:
        """Number without a sign."""
        return digits

    def function(self, name: str, argument: str, power: str = "") -> str:
        """Sine or cosine, or a power of it."""
        return f"{name}{power.translate(_SUPERSCRIPTS)}({argument})"

    def superscript(self, base: str, power: str) -> str:
        """Power."""
        return base + power.translate(_SUPERSCRIPTS)

    def bracket(self, inner: str) -> str:
        """Parentheses."""
        return f"({inner})"

    def above(self, inner: str) -> str:
        """Numerator that is a sum."""
        return self.bracket(inner)

    def fraction(self, top: str, bottom: str) -> str:
        """Quotient."""
        halves = {("1", "2"): "½", ("1", "4"): "¼", ("3", "4"): "¾"}
        return halves.get((top, bottom)) or f"{top}/{f'({bottom})' if ' ' in bottom else bottom}"

    def times(self, factors: list[str]) -> str:
        """Product."""
        return " ".join(factors)

    def minus(self, inner: str) -> str:
        """Negative of a term."""
        return f"−{inner}"

    def join(self, terms: list[tuple[str, str]]) -> str:
        """Sum of signed terms."""
        (first_sign, first), *others = terms
        head = self.minus(first) if first_sign == "-" else first
        return head + "".join(self.between(sign) + term for sign, term in others)

    def between(self, sign: str) -> str:
        """Plus or minus, with spacing."""
        return f" {self.operator(sign)} "

    def operator(self, sign: str) -> str:
        """Plus or minus between terms."""
        return "−" if sign == "-" else "+"

    def matrix(self, rows: list[list[str]]) -> str:
        """Matrix in parentheses; columns are written as rows."""
        if all(len(row) == 1 for row in rows):
            return "(" + ", ".join(row[0] for row in rows) + ")"
        return "[" + "; ".join(", ".join(row) for row in rows) + "]"

    def slope(self, top: str, variable: str, *, rate: bool = False) -> str:
        """∂top/∂variable, or its rate."""
        return f"{'d/dt ' if rate else ''}∂{top}/∂{variable}"

    def partial(self, variable: str, inner: str) -> str:
        """∂/∂variable of an expression."""
        return f"∂/∂{variable} {inner}"

    def other(self, expr: Any) -> str:
        """Expression without its own rule."""
        return str(expr)


class Text(Notation):
    """Plain text with Greek letters and indices."""


# ── Parameters of a robot: lengths, centres of mass, masses, inertias, gravity

_AXES = "xyz"
_LENGTH_TOLERANCE = 1e-12  # tolerance: a centre of mass is a quotient, with rounding error
_DUST = 1e-14


@dataclass(frozen=True)
class Parameter:
    """Named number of the robot; lengths are positive, with signs in the equations."""

    name: str
    """Symbol."""
    value: float
    """Value in SI units."""
    kinds: frozenset[str]
    """Kinds: lengths, coms, masses, inertias, gravity, springs, gears."""
    meaning: str
    """Meaning as text."""


@dataclass(frozen=True)
class Entry:
    """Number of the model: ``sign * parameter`` in the equations, or the plain value without a parameter."""

    value: float
    parameter: Parameter | None = None

    @property
    def sign(self) -> int:
        """Sign of the value relative to the parameter."""
        return -1 if self.parameter is not None and self.value * self.parameter.value < 0 else 1


Entries = tuple[Entry, ...]


@dataclass(frozen=True)
class BodyEntries:
    """Numbers of one body: joint position, point of the joint axis, pitch, mass, centre of mass, and inertia about it."""

    tag: str
    """Suffix of its symbols: its number, or r1 for the rotor of joint 1."""
    place: Entries
    point: Entries
    pitch: Entry
    mass: Entry
    com: Entries
    inertia: tuple[Entries, ...]
    ratio: Entry
    """Ratio of its joint's rate to the rate of the coordinate; a symbol for a gear."""


@dataclass(frozen=True)
class ModelEntries:
    """Numbers of the robot, and the parameters among them."""

    bodies: tuple[BodyEntries, ...]
    gravity: Entries
    springs: Entries
    """Stiffnesses."""
    armature: Entries
    """Drive inertias, one per velocity."""
    parameters: tuple[Parameter, ...]


class Namer:
    """Names the model's numbers body by body: L_1 for the position of the next joint, r_1 for a centre of mass."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.parameters: list[Parameter] = []
        self.tags = _tags(model)

    def entries(self) -> ModelEntries:
        """Numbers of the model, with names where they have one."""
        bodies = self.model.bodies
        lengths = {i: self._lengths(i) for i in range(BASE, len(bodies))}
        found = tuple(self._body(i, body, lengths) for i, body in enumerate(bodies))
        g = self.model.gravity
        many = np.count_nonzero(g) > 1
        letters = [f"g_{axis}" if many else "g" for axis in _AXES]
        gravity = tuple(self._named_entry(n, x, "gravity", "gravity [m/s²]") for n, x in zip(letters, g, strict=True))
        springs = []
        for n, spring in enumerate(self.model.springs, 1):
            joined = " and ".join(joint for joint, _ in spring.terms)
            parameter = self._new(
                f"k_{n}", spring.stiffness, ["springs"], f"stiffness between {joined} [N m/rad or N/m]"
            )
            springs.append(Entry(spring.stiffness, parameter))
        return ModelEntries(found, gravity, tuple(springs), self._armature(), tuple(self.parameters))

    def _armature(self) -> Entries:
        refuse_couplings(self.model, "derivation of equations of motion")
        found = [Entry(0.0)] * self.model.nv
        for n, body in enumerate(self.model.leaders, 1):
            values = self.model.armature[body.places[1]]
            if body.joint.nv > 1 and values.any():
                raise ValueRangeError(
                    f"joint {body.joint.name!r} is {body.joint.kind} and has an armature, which equations of motion are not "
                    f"derived with. Leave it out: robot.with_armature({{{body.joint.name!r}: 0}})."
                )
            if values.any():
                meaning = f"inertia of the drive of joint {body.joint.name} [kg m² or kg]"
                value = float(values[0])
                found[body.v_index] = Entry(value, self._new(f"J_{n}", value, ["gears"], meaning))
        return tuple(found)

    def _new(self, name: str, value: float, kinds: Iterable[str], meaning: str, *, signed: bool = False) -> Parameter:
        self.parameters.append(Parameter(name, float(value if signed else abs(value)), frozenset(kinds), meaning))
        return self.parameters[-1]

    def _named_entry(self, name: str, value: float, kind: str, meaning: str) -> Entry:
        """Entry with its own name, unless the value is zero."""
        return Entry(float(value), self._new(name, value, [kind], meaning)) if value else Entry(0.0)

    def _lengths(self, i: int) -> dict[tuple[int, float], Parameter]:
        """Symbols of lengths of body i, by coordinate axis and size of the displacement, for its joints and its tip."""
        children = [(f"joint {b.joint.name}", b.placement[:3, 3]) for b in self.model.bodies if b.parent == i]
        tip = self.model.all_frames.get(self.model.tip or "")
        if i != BASE and tip is not None and tip.body == i:
            children.append((f"frame {self.model.tip}", tip.pose[:3, 3]))
        com = np.zeros(3) if i == BASE else self.model.bodies[i].inertia.com
        sizes: dict[tuple[int, float], tuple[str, list[str]]] = {}
        for what, place in children:
            for k, x in enumerate(place):
                if x and not any(_same(k, x, key) for key in sizes):
                    sizes[k, shortest(abs(x))] = (what, ["lengths"])
        for (k, size), (_, kinds) in sizes.items():
            if _same(k, com[k], (k, size)):
                kinds.append("coms")
        axes = [k for k, _ in sizes]
        found, where = {}, "in the base" if i == BASE else self._massive_link(self.model.bodies[i])[1]
        for n, ((k, size), (what, kinds)) in enumerate(sizes.items()):
            letter = _AXES[k] if len(sizes) > 1 else ""
            again = f"_{axes[:n].count(k) + 1}" if axes[:n].count(k) else ""
            meaning = f"{_AXES[k]} of {what} {where}" + (", and of its centre of mass" if "coms" in kinds else "")
            tag = "0" if i == BASE else self.tags[i]
            found[k, size] = self._new(f"L_{tag}{letter}{again}", size, kinds, f"{meaning} [m]")
        return found

    def _massive_link(self, body: Body) -> tuple[str, str]:
        """Link with the mass of a body, and words for the body's frame; of a DH table, the user never named that frame."""
        G, frames = self.model.link_inertias, self.model.frames
        index = self.model.bodies.index(body)
        fixed = [name for name, f in frames.items() if f.body == index and name in G and G[name].parameters.any()]
        if body.link in fixed or len(fixed) != 1:
            return body.link, f"in {body.link}"
        return fixed[0], f"from joint {body.joint.name}"

    def _body(self, i: int, body: Body, lengths: dict[int, dict[tuple[int, float], Parameter]]) -> BodyEntries:
        n, (link, where), G = self.tags[i], self._massive_link(body), body.inertia
        mass = self._named_entry(f"m_{n}", shortest(G.mass), "masses", f"mass of {link} [kg]")
        place = tuple(_with_length(k, x, lengths[body.parent]) for k, x in enumerate(body.placement[:3, 3]))
        extent = float(np.abs(G.com).max())
        com_places = [0.0 if abs(x) <= _DUST * extent else shortest(x, extent) for x in G.com]
        com = [_with_length(k, x, lengths[i]) for k, x in enumerate(com_places)]
        unnamed = [k for k, entry in enumerate(com) if entry.value and entry.parameter is None]
        for k in unnamed:
            name, meaning = (
                f"r_{n}{_AXES[k] if len(unnamed) > 1 else ''}",
                f"{_AXES[k]} of the centre of mass of {link}{'' if link == body.link else f' {where}'} [m]",
            )
            com[k] = self._named_entry(name, com[k].value, "coms", meaning)
        point, pitch = self._axis(n, body)
        return BodyEntries(n, place, point, pitch, mass, tuple(com), self._inertia(n, body), self._ratio(n, body))

    def _ratio(self, n: str, body: Body) -> Entry:
        if body.joint.moves_body or abs(body.ratio) == 1.0:
            return Entry(body.ratio)
        meaning = f"gear ratio of {_driven_joint(self.model, body)}"
        return Entry(body.ratio, self._new(f"G_{n.removeprefix('r')}", body.ratio, ["gears"], meaning))

    def _axis(self, n: str, body: Body) -> tuple[Entries, Entry]:
        """Point of the axis in the child's frame, and the pitch; zeros for joints that do not rotate about one axis."""
        none = (Entry(0.0),) * 3
        if body.joint.nv > 1 or not body.joint.axes[0, :3].any():
            return none, Entry(0.0)
        w, v = body.joint.axes[0, :3], body.joint.axes[0, 3:]
        at, h = np.cross(w, v) / (w @ w), float(w @ v / (w @ w))
        at = np.where(np.abs(at) <= _DUST * np.abs(at).max(), 0.0, [shortest(x) for x in at])
        name = body.joint.name
        many, meaning = np.count_nonzero(at) > 1, f"of the axis of {name} in {body.link} [m]"
        each = zip(_AXES, at, strict=True)
        point = tuple(self._named_entry(f"a_{n}{k if many else ''}", x, "lengths", f"{k} {meaning}") for k, x in each)
        if abs(h) <= _DUST * float(np.abs(v).max(initial=0.0)):
            return point, Entry(0.0)
        return point, Entry(h, self._new(f"h_{n}", h, ["lengths"], f"pitch of {name} [m/rad]"))

    def _inertia(self, n: str, body: Body) -> tuple[Entries, ...]:
        I, scale = body.inertia.moment_about_com, float(np.abs(body.inertia.moment_about_origin).max())
        found: list[list[Entry]] = [[Entry(0.0)] * 3 for _ in range(3)]
        for a in range(3):
            for b in range(a, 3):
                value = shortest(I[a, b], scale)  # the parallel-axis term leaves a rounding error
                if abs(value) > _DUST * scale:
                    axes = _AXES[a] + _AXES[b]
                    meaning = (
                        f"rotational inertia {axes} of {self._massive_link(body)[0]} about its centre of mass [kg m²]"
                    )
                    # Products of inertia keep their sign, as in the matrix.
                    parameter = self._new(f"I_{n}{axes}", value, ["inertias"], meaning, signed=True)
                    found[a][b] = found[b][a] = Entry(value, parameter)
        return tuple(map(tuple, found))


def _driven_joint(model: Model, rotor: Body) -> str:
    """Joint driven by a rotor."""
    name = rotor.joint.name
    actuator = model.actuators.get(name)
    return name.removesuffix(".rotor") if actuator is None else actuator.joint


def _tags(model: Model) -> list[str]:
    """Suffixes of the symbols of bodies: their number; for a rotor, r and the number of the driven joint."""
    numbers = {body.joint.name: n for n, body in enumerate(model.leaders, 1)}
    tags: list[str] = []
    for i, body in enumerate(model.bodies, 1):
        n = numbers.get(_driven_joint(model, body)) if not body.joint.moves_body else None
        tag = f"r{n}"
        tags.append(str(i) if n is None or tag in tags else tag)
    return tags


def _same(k: int, x: Any, key: tuple[int, float]) -> bool:
    return key[0] == k and abs(abs(float(x)) - key[1]) <= _LENGTH_TOLERANCE * key[1]


def _with_length(k: int, x: Any, lengths: dict[tuple[int, float], Parameter]) -> Entry:
    return Entry(shortest(x), next((p for key, p in lengths.items() if x and _same(k, x, key)), None))


# ── The choice of ``symbols=``

KINDS = ("lengths", "coms", "masses", "inertias", "gravity", "springs", "gears")
"""Kinds accepted by ``symbols=``, besides ``"all"`` and ``"none"``."""


def model_entries(model: Model, symbols: str | Iterable[str] = "all") -> ModelEntries:
    """Name the model's numbers selected by ``symbols``: kinds, names, ``"all"`` or ``"none"``; raises UnknownNameError."""
    entries = Namer(model).entries()
    selected = _selected_names(symbols, entries.parameters)

    def select(entry: Any) -> Any:
        """Entry, or tuples of entries, with plain numbers for symbols that are not selected."""
        if isinstance(entry, tuple):
            return tuple(map(select, entry))
        return entry if entry.parameter is None or entry.parameter.name in selected else Entry(entry.value)

    bodies = []
    for body in entries.bodies:
        fields = {name: select(entry) for name, entry in vars(body).items() if name != "tag"}
        bodies.append(BodyEntries(body.tag, **fields))
    parameters = tuple(p for p in entries.parameters if p.name in selected)
    return ModelEntries(
        tuple(bodies), select(entries.gravity), select(entries.springs), select(entries.armature), parameters
    )


def _selected_names(symbols: str | Iterable[str], parameters: tuple[Parameter, ...]) -> set[str]:
    words = [symbols] if isinstance(symbols, str) else symbols
    try:
        words = [str(word).strip() for word in words]
    except TypeError:
        raise ValueRangeError(
            f"symbols={symbols!r}: give 'all', 'none', or a list of kinds ({', '.join(KINDS)}) and names such as 'L_1'."
        ) from None
    names = {p.name for p in parameters}
    chosen: set[str] = set()
    for word in words:
        if word == "all":
            chosen |= names
        elif word in KINDS:
            chosen |= {p.name for p in parameters if word in p.kinds}
        elif word in names:
            chosen.add(word)
        elif word != "none":
            choices = ["all", "none", *KINDS, *sorted(names)]
            raise UnknownNameError.from_choices("symbol or kind of symbols", word, choices)
    return chosen
