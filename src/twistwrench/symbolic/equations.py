"""Lagrange's equations of anything: their terms by name, the steps that led to them, and the ways to print them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import wraps
from inspect import Parameter as Argument
from inspect import signature
from typing import Any

from ..errors import ShapeError, UnknownNameError, ValueRangeError
from .latex import Latex
from .notation import Notation, Text
from .symbols import Parameter


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
    """Step of a derivation: its name, a sentence about it, its lines."""

    name: str
    """As in :meth:`Equations.step`."""
    remark: str
    """A sentence."""
    lines: tuple[Line, ...]
    """What is printed, line by line."""


@dataclass(frozen=True, eq=False)
class Equations:
    """Symbolic equations of motion τ = M(q) q̈ + h(q, q̇) in SymPy.

    Made by :func:`twistwrench.symbolic.lagrange` and ``derive``. Of a robot, and of a Lagrangian that is ½ q̇'M q̇ less
    a potential, h = c + g: ``split`` says so. Of one with terms linear in the rates (a magnetic force) or with time in
    it, h has more in it; ``tau`` has it all.
    """

    name: str
    """Of the robot or system."""
    q: tuple[Any, ...]
    """Symbols of the coordinates."""
    dq: tuple[Any, ...]
    """Symbols of their rates."""
    ddq: tuple[Any, ...]
    """Symbols of their accelerations."""
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
    """The derivation, step by step."""
    definitions: tuple[tuple[Any, Any], ...] = ()
    """Symbol and expression of each intermediate result, in those before it; where there are any, everything else is
    written in them."""
    parameters: tuple[Parameter, ...] = ()
    """The named numbers, with their values."""
    meanings: tuple[tuple[str, str], ...] = ()
    """Symbol and meaning of the coordinates."""
    remarks: tuple[str, ...] = ()
    """What a reader should know, in sentences."""
    split: bool = True
    """Whether c and g are all of τ but M q̈."""
    cache: dict[str, Any] = field(default_factory=dict, repr=False)
    """What was computed from these equations before."""

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
        """Step by its name, hyphens as good as underscores.

        Parameters
        ----------
        name : str

        Returns
        -------
        step : Step

        Raises
        ------
        UnknownNameError
            There is no such step; they are listed.

        Examples
        --------
        >>> import twistwrench as tw
        >>> equations = tw.symbolic.derive(tw.robots.pendulum())
        >>> equations.step("gravity-forces").name
        'gravity_forces'
        """
        for step in self.steps:
            if step.name == str(name).replace("-", "_"):
                return step
        raise UnknownNameError.of("step", name, [s.name for s in self.steps])

    def chosen(self, steps: Iterable[str] | None) -> tuple[Step, ...]:
        """Steps by their names, all of them for None.

        Parameters
        ----------
        steps : iterable of str, optional, names of the steps that are written; None: all

        Returns
        -------
        steps : tuple of Step

        Raises
        ------
        UnknownNameError
            There is no such step.

        Examples
        --------
        >>> import twistwrench as tw
        >>> equations = tw.symbolic.derive(tw.robots.pendulum())
        >>> [step.name for step in equations.chosen(["gravity_forces"])]
        ['gravity_forces']
        """
        names = [steps] if isinstance(steps, str) or not isinstance(steps, Iterable | None) else steps
        return self.steps if names is None else tuple(map(self.step, names))

    def text(self, steps: Iterable[str] | None = None) -> str:
        """Plain text with Greek letters.

        Parameters
        ----------
        steps : iterable of str, optional, names of the steps that are written; None: all

        Returns
        -------
        text : str

        Raises
        ------
        UnknownNameError
            There is no such step.

        Examples
        --------
        >>> import twistwrench as tw
        >>> equations = tw.symbolic.derive(tw.robots.pendulum())
        >>> print(equations.text(["gravity_forces"]))
        gravity_forces: g, what is left at rest
          g₁ = m₁ L₁ g sin(θ₁)
        """
        notation = Text()
        parts = []
        for step in self.chosen(steps):
            lines = [f"  {label.write(notation)} = {notation.write(expr)}" for label, expr in step.lines]
            parts.append("\n".join([f"{step.name}: {step.remark}".rstrip(": "), *lines]))
        return "\n\n".join(parts)

    def latex(self, steps: Iterable[str] | None = None, *, document: bool = True) -> str:
        r"""LaTeX for amsmath.

        Parameters
        ----------
        steps : iterable of str, optional, names of the steps that are written; None: all
        document : bool, a document that compiles; False: what goes between

        Returns
        -------
        text : str

        Raises
        ------
        UnknownNameError
            There is no such step.

        Examples
        --------
        >>> import twistwrench as tw
        >>> equations = tw.symbolic.derive(tw.robots.pendulum())
        >>> equations.latex().startswith(r"\documentclass")
        True
        """
        from .documents import latex_document

        return latex_document(self, self.chosen(steps), Latex(), whole=document)

    def markdown(self, steps: Iterable[str] | None = None) -> str:
        """Markdown with formulas between dollars, as GitHub and notebooks show them.

        Parameters
        ----------
        steps : iterable of str, optional, names of the steps that are written; None: all

        Returns
        -------
        text : str

        Raises
        ------
        UnknownNameError
            There is no such step.

        Examples
        --------
        >>> import twistwrench as tw
        >>> equations = tw.symbolic.derive(tw.robots.pendulum())
        >>> "$" in equations.markdown(["gravity_forces"])
        True
        """
        from .documents import markdown_document

        return markdown_document(self, self.chosen(steps), Latex())

    def html(self, steps: Iterable[str] | None = None) -> str:
        """HTML page that needs nothing else: formulas are MathML, which browsers show without scripts.

        Parameters
        ----------
        steps : iterable of str, optional, names of the steps that are written; None: all

        Returns
        -------
        text : str

        Raises
        ------
        UnknownNameError
            There is no such step.

        Examples
        --------
        >>> import twistwrench as tw
        >>> equations = tw.symbolic.derive(tw.robots.pendulum())
        >>> "<math" in equations.html(["gravity_forces"])
        True
        """
        from .derivation_page import html_page

        return html_page(self, self.chosen(steps))

    def numpy_source(self) -> str:
        """Python module that needs NumPy only: functions of arrays with any leading batch shape.

        Returns
        -------
        source : str

        Raises
        ------
        ValueRangeError
            No source can hold the equations, as :meth:`function`.

        Examples
        --------
        >>> import twistwrench as tw
        >>> equations = tw.symbolic.derive(tw.robots.pendulum())
        >>> "def inverse_dynamics(" in equations.numpy_source()
        True
        """
        from .numpy_source import numpy_source

        return numpy_source(self)

    def c_source(self, prefix: str | None = None) -> str:
        """C99 source that needs math.h only: one file, no allocation.

        Parameters
        ----------
        prefix : str, optional, what names begin with, as in ``prefix_inverse_dynamics``; None: the equations' name

        Returns
        -------
        source : str

        Raises
        ------
        ValueRangeError
            A prefix begins no name in C, or as :meth:`function`.

        Examples
        --------
        >>> import twistwrench as tw
        >>> equations = tw.symbolic.derive(tw.robots.pendulum())
        >>> "void pendulum_inverse_dynamics(" in equations.c_source()
        True
        """
        from .c_source import c_source

        return c_source(self, prefix)

    def function(self, name: str) -> Callable[..., Any]:
        """Function of :meth:`numpy_source`, ready to call: inverse_dynamics(q, dq, ddq), bias_forces(q, dq) and so on.

        Parameters
        ----------
        name : str, of the function

        Returns
        -------
        function : callable
            Its last argument, ``parameters``, maps the name of every constant to its number; without it, the robot's
            own. The time of a Lagrangian that depends on it is one of them. It raises UnknownNameError for constants
            that are not there, and ValueRangeError where some are missing.

        Raises
        ------
        UnknownNameError
            There is no such function.
        ValueRangeError
            No source can hold the equations (Max, Piecewise, what SymPy leaves as a derivative).

        Examples
        --------
        >>> import twistwrench as tw
        >>> equations = tw.symbolic.derive(tw.robots.pendulum())
        >>> equations.function("inverse_dynamics")([0.0], [0.0], [1.0]).tolist()
        [1.0]
        """
        from .printed_code import FUNCTIONS, constants

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
