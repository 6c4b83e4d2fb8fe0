"""Lagrange's equations of anything: their terms by name, the steps that led to them, and the ways to print them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import wraps
from inspect import Parameter as Argument
from inspect import signature
from typing import Any

from ..errors import ShapeError, UnknownNameError, ValueRangeError
from .notation import Latex, Notation, Text
from .parameters import Parameter

__all__ = ["Equations", "Label", "Line", "Step"]


@dataclass(frozen=True)
class Label:
    """What stands left of an equals sign: a symbol, or a derivative of L (or K, P) with respect to one."""

    name: str
    variable: str = ""
    rate: bool = False
    time: str = ""
    """The symbol of time, for what of a rate is due to it alone."""

    def write(self, notation: Notation) -> str:
        """In one of the notations."""
        top = notation.symbol(self.name)
        if not self.variable:
            return top
        slope = notation.slope(top, notation.symbol(self.variable), rate=self.rate)
        return notation.partial(notation.symbol(self.time), slope) if self.time else slope


Line = tuple[Label, Any]
"""A label and the SymPy expression or column that it equals."""


@dataclass(frozen=True)
class Step:
    """One step of a derivation: its name, a sentence about it, its lines."""

    name: str
    remark: str
    lines: tuple[Line, ...]


@dataclass(frozen=True, eq=False)
class Equations:
    """τ = M(q) q̈ + h(q, q̇) in SymPy, made by :func:`twistwrench.symbolic.lagrange` and ``derive``.

    Of a robot, and of a Lagrangian that is ½ q̇'M q̇ less a potential, h = c + g: ``split`` says so. Of one with terms linear in
    the rates (a magnetic force) or with time in it, h has more in it; ``tau`` has it all.

    Where ``definitions`` is not empty, everything after it is written in the symbols defined there, each in those before
    it. ``q``, ``dq`` and ``ddq`` are the symbols of coordinates, rates and accelerations.
    """

    name: str
    q: tuple[Any, ...]
    dq: tuple[Any, ...]
    ddq: tuple[Any, ...]
    lagrangian: Any
    """L = K - P."""
    mass_matrix: Any
    """M, an ImmutableMatrix (n, n)."""
    christoffel: Any
    """Γ_ijk of the first kind, an ImmutableDenseNDimArray (n, n, n): c_i = Σ_jk Γ_ijk q̇_j q̇_k."""
    coriolis_matrix: Any
    """C_ij = Σ_k Γ_ijk q̇_k: C q̇ = c and dM/dt - 2C is skew; (n, n)."""
    coriolis_forces: Any
    """c, the velocity products; (n, 1)."""
    gravity_forces: Any
    """g = ∂P/∂q, all that is left at rest; (n, 1)."""
    tau: Any
    """The right-hand sides, (n, 1)."""
    steps: tuple[Step, ...]
    definitions: tuple[tuple[Any, Any], ...] = ()
    parameters: tuple[Parameter, ...] = ()
    """The named numbers, with their values."""
    meanings: tuple[tuple[str, str], ...] = ()
    """Symbol and meaning of the coordinates."""
    remarks: tuple[str, ...] = ()
    split: bool = True
    """Whether c and g are all of τ but M q̈."""
    cache: dict[str, Any] = field(default_factory=dict, repr=False)

    def __repr__(self) -> str:
        return (
            f"<{type(self).__name__} of {self.name!r}: {len(self.q)} coordinates, {len(self.definitions)} definitions>"
        )

    @property
    def centripetal(self) -> dict[tuple[int, int], Any]:
        """The coefficient of q̇_j² in c_i, those that are not zero: Γ_ijj at (i, j), counted from 0."""
        n = range(len(self.q))
        return {(i, j): self.christoffel[i, j, j] for i in n for j in n if self.christoffel[i, j, j] != 0}

    @property
    def coriolis(self) -> dict[tuple[int, int, int], Any]:
        """The coefficient of q̇_j q̇_k, j < k, in c_i, those that are not zero: 2 Γ_ijk at (i, j, k), counted from 0."""
        n = range(len(self.q))
        return {
            (i, j, k): 2 * self.christoffel[i, j, k]
            for i in n
            for j in n
            for k in range(j + 1, len(self.q))
            if self.christoffel[i, j, k] != 0
        }

    @property
    def values(self) -> dict[Any, float]:
        """Symbol → number of the named parameters, for ``subs``."""
        import sympy

        return {sympy.Symbol(p.name): p.value for p in self.parameters}

    # ── ways out ──

    def step(self, name: str) -> Step:
        """A step by its name, hyphens as good as underscores; UnknownNameError lists them."""
        for step in self.steps:
            if step.name == str(name).replace("-", "_"):
                return step
        raise UnknownNameError.of("step", name, [s.name for s in self.steps])

    def chosen(self, steps: Iterable[str] | None) -> tuple[Step, ...]:
        """The steps named, all of them for None."""
        names = [steps] if isinstance(steps, str) or not isinstance(steps, Iterable | None) else steps
        return self.steps if names is None else tuple(map(self.step, names))

    def text(self, steps: Iterable[str] | None = None) -> str:
        """Plain text with Greek letters."""
        notation = Text()
        parts = []
        for step in self.chosen(steps):
            lines = [f"  {label.write(notation)} = {notation.write(expr)}" for label, expr in step.lines]
            parts.append("\n".join([f"{step.name}: {step.remark}".rstrip(": "), *lines]))
        return "\n\n".join(parts)

    def latex(self, steps: Iterable[str] | None = None, *, document: bool = True) -> str:
        """LaTeX for amsmath: a document that compiles, or with ``document=False`` what goes between."""
        from .documents import latex_document

        return latex_document(self, self.chosen(steps), Latex(), whole=document)

    def markdown(self, steps: Iterable[str] | None = None) -> str:
        """Markdown with formulas between dollars, as GitHub and notebooks show them."""
        from .documents import markdown_document

        return markdown_document(self, self.chosen(steps), Latex())

    def html(self, steps: Iterable[str] | None = None) -> str:
        """A page that needs nothing else: formulas are MathML, which browsers show without scripts."""
        from .page import html_page

        return html_page(self, self.chosen(steps))

    def numpy_source(self) -> str:
        """A Python module that needs NumPy only: functions of arrays with any leading batch shape."""
        from .source import numpy_source

        return numpy_source(self)

    def c_source(self, prefix: str | None = None) -> str:
        """C99 that needs math.h only: one file, no allocation, functions named ``prefix_inverse_dynamics`` and so on.

        Raises ValueRangeError for a prefix that begins no name in C, and as :meth:`function` does.
        """
        from .c_source import c_source

        return c_source(self, prefix)

    def function(self, name: str) -> Callable[..., Any]:
        """A function of :meth:`numpy_source`, ready to call: inverse_dynamics(q, dq, ddq), bias_forces(q, dq) and so on.

        Its last argument, ``parameters``, maps the name of every constant to its number; without it, the robot's own. The
        time of a Lagrangian that depends on it is one of them.

        Raises UnknownNameError for other functions, and ValueRangeError for equations that no source can hold
        (Max, Piecewise, what SymPy leaves as a derivative); the function, UnknownNameError for constants that are not
        there, and ValueRangeError where some are missing.
        """
        from .source import FUNCTIONS, constants

        if not isinstance(name, str) or name not in FUNCTIONS:
            raise UnknownNameError.of("function", name, FUNCTIONS)
        if "module" not in self.cache:
            scope: dict[str, Any] = {}
            exec(compile(self.numpy_source(), f"<equations of {self.name}>", "exec"), scope)
            self.cache["module"] = scope
        return _complete(self.cache["module"][name], [s.name for s in constants(self)])


def _complete(function: Callable[..., Any], names: list[str]) -> Callable[..., Any]:
    """The function, which first looks whether each constant has a number."""
    wanted = signature(function)

    @wraps(function)
    def checked(*args: Any, **kwargs: Any) -> Any:
        given = wanted.bind_partial(*args, **kwargs).arguments
        by_itself = wanted.parameters["parameters"].default is not Argument.empty
        if "parameters" not in given and by_itself:
            return function(*args, **kwargs)
        numbers = given.get("parameters", {})
        if not isinstance(numbers, Mapping):
            raise ShapeError(
                f"parameters={numbers!r}: give a dict of {', '.join(names) or 'nothing'} and their numbers."
            )
        values = {str(key): value for key, value in numbers.items()}
        for key in values:
            if key not in names:
                raise UnknownNameError.of("constant", key, names)
        if missing := [key for key in names if key not in values]:
            raise ValueRangeError(
                f"parameters= of {function.__name__} has no number for {', '.join(missing)}. All are wanted: "
                f"{', '.join(names)}."
            )
        return function(**{**given, "parameters": values})

    return checked
