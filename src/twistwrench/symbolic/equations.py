"""Lagrange's equations of a system: named terms, steps of the derivation, output formats, and assembly."""

from __future__ import annotations

import operator
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import wraps
from inspect import Parameter as Argument
from inspect import signature
from typing import Any

import numpy as np

from ..core.errors import ShapeError, UnknownNameError, ValueRangeError
from ..core.glossary import complete
from .c_source import c_source
from .coordinates import variable_names
from .documents import Latex, latex_document, markdown_document
from .expanded_form import Terms
from .factored_form import EquationWriter
from .names import Notation, Text, names_of, sympy
from .numpy_source import numpy_source
from .parameters import Parameter
from .source_code import FUNCTIONS, constants
from .trig_polynomial import TrigPolynomial
from .web_page import html_page


@dataclass(frozen=True)
class Label:
    """Left-hand side of an equation: a symbol, or a derivative of L, K or P with respect to a symbol."""

    name: str
    """Symbol, or letter of the quantity that is differentiated."""
    variable: str = ""
    """Symbol of differentiation; empty for a plain symbol."""
    rate: bool = False
    """True for the rate of the derivative, d/dt."""
    time: str = ""
    """Symbol of time for the explicit time derivative ∂/∂t of the derivative; empty otherwise."""

    def write(self, notation: Notation) -> str:
        """Text in the given notation."""
        quantity = notation.symbol(self.name)
        if not self.variable:
            return quantity
        derivative = notation.slope(quantity, notation.symbol(self.variable), rate=self.rate)
        if self.time:
            return notation.partial(notation.symbol(self.time), derivative)
        return derivative


Line = tuple[Label, Any]
"""Label and the SymPy expression or column that it equals."""


@dataclass(frozen=True)
class Step:
    """Step of a derivation: name, remark and lines."""

    name: str
    """Name for :meth:`Equations.step`."""
    remark: str
    """Sentence that explains the step."""
    lines: tuple[Line, ...]
    """Lines of the step."""


@dataclass(frozen=True, eq=False)
class Equations:
    """Symbolic equations of motion τ = M(q) q̈ + h(q, q̇) in SymPy.

    Made by :func:`twistwrench.symbolic.lagrange` and ``derive``. For a robot, and for a Lagrangian ½ q̇'M q̇ minus a
    potential, h = c + g. ``split`` is False for a Lagrangian that has terms linear in the rates (a magnetic force) or
    depends on time: h then has further terms, which ``tau`` includes.

    Examples
    --------
    >>> import twistwrench as tw
    >>> equations = tw.symbolic.derive(tw.robots.pendulum())
    >>> print(equations.text(["gravity_forces"]))
    gravity_forces: g, torques at rest
      g₁ = m₁ L₁ g sin(θ₁)
    >>> equations.step("gravity-forces") is equations.chosen(["gravity_forces"])[0]
    True
    >>> "documentclass" in equations.latex(), "$" in equations.markdown(), "<math" in equations.html()
    (True, True, True)
    >>> "def inverse_dynamics(" in equations.numpy_source(), "void pendulum_inverse_dynamics(" in equations.c_source()
    (True, True)
    >>> equations.function("inverse_dynamics")([0.0], [0.0], [1.0]).tolist()
    [1.0]
    """

    name: str
    """Name of the robot or system."""
    q: tuple[Any, ...]
    """Symbols of the coordinates."""
    dq: tuple[Any, ...]
    """Symbols of the rates of the coordinates."""
    ddq: tuple[Any, ...]
    """Symbols of the accelerations of the coordinates."""
    lagrangian: Any
    """L = K - P."""
    mass_matrix: Any
    """M, an ImmutableMatrix (n, n)."""
    christoffel: Any
    """Christoffel symbols Γ_ijk of the first kind, an ImmutableDenseNDimArray (n, n, n): c_i = Σ_jk Γ_ijk q̇_j q̇_k."""
    coriolis_matrix: Any
    """C_ij = Σ_k Γ_ijk q̇_k, (n, n), with C q̇ = c and dM/dt - 2C skew-symmetric."""
    coriolis_forces: Any
    """c, the terms quadratic in the velocities; (n, 1)."""
    gravity_forces: Any
    """g = ∂P/∂q, the torques at rest; (n, 1)."""
    tau: Any
    """Right-hand sides, (n, 1)."""
    steps: tuple[Step, ...]
    """Steps of the derivation."""
    definitions: tuple[tuple[Any, Any], ...] = ()
    """Symbol and expression of each intermediate result, in terms of earlier results. If there are any, all other
    expressions contain them."""
    parameters: tuple[Parameter, ...] = ()
    """Named numbers, with their values."""
    meanings: tuple[tuple[str, str], ...] = ()
    """Symbol and meaning of the coordinates."""
    remarks: tuple[str, ...] = ()
    """Remarks, in sentences."""
    split: bool = True
    """True if τ = M q̈ + c + g."""
    cache: dict[str, Any] = field(default_factory=dict, repr=False)
    """Cached results of these equations."""

    def __repr__(self) -> str:
        sizes = f"{len(self.q)} coordinates, {len(self.definitions)} definitions"
        return f"<{type(self).__name__} of {self.name!r}: {sizes}>"

    @property
    def centripetal(self) -> dict[tuple[int, int], Any]:
        """Non-zero coefficients of q̇_j² in c_i: Γ_ijj at (i, j), counted from 0."""
        n = len(self.q)
        coefficients = {}
        for i, j in np.ndindex(n, n):
            if self.christoffel[i, j, j] != 0:
                coefficients[i, j] = self.christoffel[i, j, j]
        return coefficients

    @property
    def coriolis(self) -> dict[tuple[int, int, int], Any]:
        """Non-zero coefficients of q̇_j q̇_k, j < k, in c_i: 2 Γ_ijk at (i, j, k), counted from 0."""
        n = len(self.q)
        coefficients = {}
        for i, j, k in np.ndindex(n, n, n):
            if j < k and self.christoffel[i, j, k] != 0:
                coefficients[i, j, k] = 2 * self.christoffel[i, j, k]
        return coefficients

    @property
    def values(self) -> dict[Any, float]:
        """Map from symbols of the named parameters to numbers, for ``subs``."""
        return {sympy.Symbol(parameter.name): parameter.value for parameter in self.parameters}

    # ── output ──

    def step(self, name: str) -> Step:
        """Step with a name; hyphens and underscores are equivalent.

        Parameters
        ----------
        name : str

        Returns
        -------
        step : Step
        """
        step_name = str(name).replace("-", "_")
        for step in self.steps:
            if step.name == step_name:
                return step
        raise UnknownNameError.from_choices("step", name, names_of(self.steps))

    def chosen(self, steps: Iterable[str] | None) -> tuple[Step, ...]:
        """Steps with the given names, or all steps for None.

        Returns
        -------
        steps : tuple of Step
        """
        if steps is None:
            return self.steps
        if isinstance(steps, str) or not isinstance(steps, Iterable):
            return (self.step(steps),)
        return tuple(map(self.step, steps))

    def text(self, steps: Iterable[str] | None = None) -> str:
        """Plain text with Greek letters.

        Returns
        -------
        text : str
        """
        notation = Text()
        parts = []
        for step in self.chosen(steps):
            lines = [f"{step.name}: {step.remark}".rstrip(": ")]
            for label, expr in step.lines:
                lines.append(f"  {label.write(notation)} = {notation.write(expr)}")
            parts.append("\n".join(lines))
        return "\n\n".join(parts)

    def latex(self, steps: Iterable[str] | None = None, *, document: bool = True) -> str:
        r"""LaTeX for amsmath.

        Parameters
        ----------
        document : bool, a complete document; False: only its body

        Returns
        -------
        text : str
        """
        return latex_document(self, self.chosen(steps), Latex(), whole=document)

    def markdown(self, steps: Iterable[str] | None = None) -> str:
        """Markdown with formulas between dollars, as displayed by GitHub and notebooks.

        Returns
        -------
        text : str
        """
        return markdown_document(self, self.chosen(steps), Latex())

    def html(self, steps: Iterable[str] | None = None) -> str:
        """Self-contained HTML page with formulas in MathML, which browsers display without scripts.

        Returns
        -------
        text : str
        """
        return html_page(self, self.chosen(steps))

    def numpy_source(self) -> str:
        """Python module that needs only NumPy: functions of arrays with any leading batch shape.

        Returns
        -------
        source : str

        Raises
        ------
        ValueRangeError
            The equations cannot be written as source, see :meth:`function`.
        """
        return numpy_source(self)

    def c_source(self, prefix: str | None = None) -> str:
        """C99 source that needs only math.h: one file, without allocation.

        Parameters
        ----------
        prefix : str, optional, of the names, as in ``prefix_inverse_dynamics``; None: the name of the equations

        Returns
        -------
        source : str

        Raises
        ------
        ValueRangeError
            The prefix cannot begin a C identifier, or :meth:`function` raises it.
        """
        return c_source(self, prefix)

    def function(self, name: str) -> Callable[..., Any]:
        """Function of :meth:`numpy_source`, ready to call: inverse_dynamics(q, dq, ddq), bias_forces(q, dq) and so on.

        Parameters
        ----------
        name : str, of the function

        Returns
        -------
        function : callable
            Its last argument, ``parameters``, maps names of constants to numbers; the default is the robot's own
            values. The time of a time-dependent Lagrangian is one of the constants. The function raises
            UnknownNameError for unknown constants, and ValueRangeError for missing ones.

        Raises
        ------
        ValueRangeError
            The equations cannot be written as source (Max, Piecewise, derivatives that SymPy leaves unevaluated).
        """
        if not isinstance(name, str) or name not in FUNCTIONS:
            raise UnknownNameError.from_choices("function", name, FUNCTIONS)
        if "module" not in self.cache:
            module: dict[str, Any] = {}
            exec(compile(self.numpy_source(), f"<equations of {self.name}>", "exec"), module)
            self.cache["module"] = module
        return _with_checked_parameters(self.cache["module"][name], names_of(constants(self)))


def _with_checked_parameters(function: Callable[..., Any], names: list[str]) -> Callable[..., Any]:
    """Function that first checks that every constant has a number. ``names`` are the names of all constants."""
    function_signature = signature(function)
    has_defaults = function_signature.parameters["parameters"].default is not Argument.empty

    @wraps(function)
    def check_and_call(*args: Any, **kwargs: Any) -> Any:
        """Result of the function; raises ShapeError, UnknownNameError or ValueRangeError for invalid constants."""
        arguments = function_signature.bind_partial(*args, **kwargs).arguments
        if "parameters" not in arguments and has_defaults:
            return function(*args, **kwargs)
        numbers = arguments.get("parameters", {})
        if not isinstance(numbers, Mapping):
            raise ShapeError(
                f"parameters={numbers!r}: give a dict of {', '.join(names) or 'nothing'} and their numbers."
            )
        number_by_name = {}
        for constant, number in numbers.items():
            name = str(constant)  # of a symbol
            if name not in names:
                raise UnknownNameError.from_choices("constant", name, names)
            number_by_name[name] = number
        missing_names = [name for name in names if name not in number_by_name]
        if missing_names:
            raise ValueRangeError(
                f"parameters= of {function.__name__} has no number for {', '.join(missing_names)}. All are wanted: "
                f"{', '.join(names)}."
            )
        return function(**{**arguments, "parameters": number_by_name})

    return check_and_call


# ── Assembly from sums of products, with the steps in the order of the book

STEPS = {
    "momenta": "the derivatives of L with respect to the rates",
    "explicit_time": "explicit time derivatives of the momenta",
    "momentum_rates": "time derivatives of the momenta",
    "slopes": "the derivatives of L with respect to the coordinates",
    "mass_matrix": "M, symmetric: coefficients of the accelerations",
    "christoffel": "Γ_ijk = ½ (∂M_ij/∂q_k + ∂M_ik/∂q_j − ∂M_jk/∂q_i), those that are not zero, j ≤ k",
    "centripetal": "coefficients of the squared rates, by torque and joint: Γ_ijj",
    "coriolis": "coefficients of the products of two rates, by torque and joints: 2 Γ_ijk",
    "coriolis_matrix": "C_ij = Σ Γ_ijk q̇_k: dM/dt − 2C is skew",
    "gravity_forces": "g, torques at rest",
    "equations": "d/dt ∂L/∂q̇ − ∂L/∂q, the equations of motion",
}
"""Names and remarks of the steps after the Lagrangian, in order."""


def entry_name(letter: str, *indices: int) -> str:
    """Name of an entry, with indices from 1: M, 0, 1 → M_12. If an index has two digits, all are separated."""
    numbers = [index + 1 for index in indices]
    separator = "_" if max(numbers) > 9 else ""
    index_text = separator.join(map(str, numbers))
    return f"{letter}_{index_text}"


def weighted_sum(coefficients: Iterable[Any], factors: Iterable[Any]) -> Any:
    """Sum of the products of coefficients and factors, SymPy expressions."""
    return sympy.Add(*map(operator.mul, coefficients, factors))


def assemble_equations(terms: Terms, writer: EquationWriter) -> dict[str, Any]:
    """Fields of :class:`~twistwrench.symbolic.equations.Equations` from K and P."""
    n = len(terms.coordinates)
    names, rates, accelerations = variable_names(terms.coordinates)
    motions = [*rates, *accelerations]
    dq = list(map(terms.ring.symbol, rates))
    ddq = list(map(terms.ring.symbol, accelerations))
    L = terms.kinetic - terms.potential

    def write_force(total: TrigPolynomial) -> Any:
        """Expression of a force, sorted by rates and accelerations, then by angles."""
        return writer.write_by_motion(total, motions, writer.write_by_angle)

    def write_energy(total: TrigPolynomial) -> Any:
        """Expression of an energy or momentum, sorted by rates and accelerations, then by masses."""
        return writer.write_by_motion(total, motions, writer.write_by_mass)

    def rate_of(total: TrigPolynomial) -> TrigPolynomial:
        """Derivative with respect to time, by the chain rule."""
        result = terms.zero
        for coordinate, v, a in zip(terms.coordinates, dq, ddq, strict=True):
            result = result + total.diff(coordinate.name) * v + total.diff(coordinate.rate) * a
        return result

    def product_sum(coefficients: Iterable[TrigPolynomial], factors: Iterable[TrigPolynomial]) -> TrigPolynomial:
        """Sum of the products of coefficients and factors."""
        return sum(map(operator.mul, coefficients, factors), terms.zero)

    M = terms.mass_matrix
    gamma = terms.christoffel
    g = terms.gravity_forces
    C: Any = np.empty((n, n), object)
    for i, j in np.ndindex(n, n):
        C[i, j] = product_sum(gamma[i, j], dq)
    c = [product_sum(C[i], dq) for i in range(n)]
    momenta = list(map(L.diff, rates))  # ∂L/∂q̇
    slopes = list(map(L.diff, names))  # ∂L/∂q
    momentum_rates = list(map(rate_of, momenta))
    matrix = sympy.ImmutableMatrix
    written_M = matrix(n, n, lambda i, j: writer.write_by_mass(M[min(i, j), max(i, j)]))  # of the upper triangle
    written_gamma = sympy.ImmutableDenseNDimArray(list(map(writer.write_by_angle, gamma.flat)), gamma.shape)
    written_C = matrix(n, n, lambda i, j: write_force(C[i, j]))
    written_c = matrix(list(map(write_force, c)))
    written_g = matrix(list(map(writer.write_by_angle, g)))
    written_ddq = [writer.symbols[name] for name in accelerations]
    # Terms of L that are linear in the rates, beside ½ q̇'M q̇ and a potential, produce further forces.
    tau = []
    split = True
    for i in range(n):
        M_ddq = product_sum(M[i], ddq)
        difference = momentum_rates[i] - slopes[i] - M_ddq - c[i] - g[i]
        further_forces = difference.without_dust(0.0)  # without terms that are zero
        if further_forces.terms:
            split = False
        inertia_terms = weighted_sum(written_M.row(i), written_ddq)
        tau.append(inertia_terms + written_c[i] + written_g[i] + write_force(further_forces))
    fields = equation_fields(
        names, rates, written_M, written_gamma, written_C, written_c, written_g, matrix(tau),
        list(map(write_energy, momenta)), list(map(write_energy, momentum_rates)), list(map(write_force, slopes)),
    )  # fmt: skip
    return {**fields, "lagrangian": write_energy(L), "split": split}


def equation_fields(
    q: Sequence[str],
    dq: Sequence[str],
    M: Any,
    gamma: Any,
    C: Any,
    c: Any,
    g: Any,
    tau: Any,
    momenta: Sequence[Any],
    rates: Sequence[Any],
    slopes: Sequence[Any],
    *,
    explicit_time: Sequence[Line] = (),
    only: Iterable[str] = STEPS,
) -> dict[str, Any]:
    """Fields of :class:`Equations`. Its steps are those of :data:`STEPS` that are in ``only`` and have lines.

    ``q`` and ``dq`` are names of symbols, ``momenta`` are ∂L/∂q̇, ``rates`` are d/dt ∂L/∂q̇, and ``slopes`` are ∂L/∂q.
    """
    lines: defaultdict[str, list[Line]] = defaultdict(list)
    lines["explicit_time"] = list(explicit_time)
    n = len(q)
    for i in range(n):
        lines["momenta"].append((Label("L", dq[i]), momenta[i]))
        lines["momentum_rates"].append((Label("L", dq[i], rate=True), rates[i]))
        lines["slopes"].append((Label("L", q[i]), slopes[i]))
        lines["gravity_forces"].append((Label(entry_name("g", i)), g[i]))
        lines["equations"].append((Label(entry_name("tau", i)), tau[i]))
    for i, j in np.ndindex(n, n):
        if i <= j:
            lines["mass_matrix"].append((Label(entry_name("M", i, j)), M[i, j]))
        if C[i, j] != 0:
            lines["coriolis_matrix"].append((Label(entry_name("C", i, j)), C[i, j]))
    for i, j, k in np.ndindex(n, n, n):
        if j > k or gamma[i, j, k] == 0:
            continue
        lines["christoffel"].append((Label(entry_name("Gamma", i, j, k)), gamma[i, j, k]))
        if j == k:
            lines["centripetal"].append((Label(entry_name("b", i, j)), gamma[i, j, k]))
        else:
            lines["coriolis"].append((Label(entry_name("b", i, j, k)), 2 * gamma[i, j, k]))
    steps = []
    for name, remark in STEPS.items():
        if name in only and lines[name]:
            steps.append(Step(name, remark, tuple(lines[name])))
    return {
        "mass_matrix": M,
        "christoffel": gamma,
        "coriolis_matrix": C,
        "coriolis_forces": c,
        "gravity_forces": g,
        "tau": tau,
        "steps": tuple(steps),
    }


complete(globals())
