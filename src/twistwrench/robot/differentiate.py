"""Compiled derivatives of any NumPy function, by forward or reverse mode on its traced program."""

from __future__ import annotations

import inspect
import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ..errors import KernelError, ShapeError, TwistWrenchError
from ..ir.expr import Expr
from ..ir.tracer import Trace, trace
from .engine import compiled
from .programs import Chart, Derivative
from .quantities import Shape
from .robot import Robot

_ADVICE = (
    "It runs once, on symbols, for all values there will be: +, -, *, /, @, **, np.sin, np.cos, np.tan, np.arctan, np.arctan2, "
    "np.sqrt, np.exp, np.log, np.tanh, np.hypot, np.abs and robots' methods of the names that robot.kernel takes are "
    "understood; branches and comparisons of values, np.linalg.inv and solve, math.sin are not. For np.maximum, minimum, clip "
    "and where take tw.pointwise. np.array([…]) holds symbols, np.zeros(n) only floats; np.arctan2 and np.hypot want a symbol "
    "as their first."
)


def differentiate(
    function: Callable[..., Any],
    arguments: Mapping[str, Shape | int | Robot],
    by: str | Sequence[str] | None = None,
    *,
    form: str = "jacobian",
    mode: str = "auto",
    values: bool = False,
) -> np.ufunc:
    """Automatic differentiation: a compiled kernel of the derivatives of a function written with NumPy and robots' methods.

    Parameters
    ----------
    function : callable, of one sample, in NumPy's functions and robots' methods
    arguments : {name: shape, int or Robot}
        In the function's order, the shape of each, or the robot whose configuration it is.
    by : str or sequence of str, optional, which of them to differentiate by; None: all
    form : "jacobian", "along", "weighted", "hessian" or "hessian_along", as listed in the notes
    mode : "auto", "forward" or "reverse"; ``"auto"`` takes fewer operations
    values : bool, the function's own results come first

    Returns
    -------
    kernel : ufunc, of the arguments, then of weights w and direction v where the form has them

    Raises
    ------
    KernelError
        The function cannot be traced, or its derivatives are too large.

    Notes
    -----
    With x all of ``by``, f the results, and w, v further inputs of the kernel, ``form`` is

    - ``"jacobian"``, ∂f/∂x: for each result and each of ``by``, the axes of the one before those of the other;
    - ``"along"``, (∂f/∂x) v, the derivative along a direction v: as the results (known as JVP);
    - ``"weighted"``, ∂(w·f)/∂x, for weights of all entries of the results: as ``by`` (known as VJP);
    - ``"hessian"``, ∂²f/∂x²: for each result, two more axes for the entries of all ``by``, one after another;
    - ``"hessian_along"``, ∂²(w·f)/∂x² v: as ``by``. A function of a single number takes no weights.

    Derivatives by a configuration are along robot.add, nv of them: those of f(q ⊕ v) by v at v = 0, first and second,
    so Hessians are symmetric; f must not depend on how long quaternions are. The sign of a number has the derivative 0,
    and so has all that only jumps.

    Source: Griewank and Walther, Evaluating Derivatives (2008).

    Examples
    --------
    >>> import numpy as np, twistwrench as tw
    >>> slopes = tw.differentiate(lambda x, y: np.sin(x) @ y, {"x": 3, "y": 3}, by="x")
    >>> slopes.signature, slopes([0, 0, np.pi], [1, 2, 3]).round(12).tolist()
    ('(3),(3)->(3)', [1.0, 2.0, -3.0])
    >>> robot = tw.robots.floating_box()
    >>> height = tw.differentiate(lambda q: robot.center_of_mass(q)[2], {"q": robot})
    >>> height([0, 1, 0, 0, 0, 0, 5]).shape
    (6,)
    """
    name = getattr(function, "__name__", type(function).__name__)
    what = f"differentiate {name}"
    if not callable(function):
        raise KernelError(f"{what}: {function!r} is no function. For a quantity of a robot: robot.kernel(name, by=…).")
    models, shapes = _arguments(what, function, arguments)
    derivative = Derivative.from_inputs(what, tuple(shapes), tuple(shapes) if by is None else by, form, mode, values)

    def run(*arrays: Any) -> list[Any]:
        try:
            return _results(what, function(*(a if np.size(a) else np.zeros(a.shape) for a in arrays)))
        except TwistWrenchError:
            raise
        except Exception as problem:
            raise KernelError(f"{what}: it cannot be traced: {str(problem).rstrip('.')}. {_ADVICE}") from problem

    owner = Trace()
    first = [x.shape for x in run(*(_one(owner.inputs(0, shape)) for shape in shapes.values()))]
    owner.forget()
    names = [f"result{k + 1}" for k in range(len(first))] if len(first) > 1 else ["result"]
    directions = {label: (models[label].nv,) if label in models else shape for label, shape in shapes.items()}
    more = derivative.inputs(directions, dict(zip(names, first, strict=True)))

    if twice := [label for label in more if label in shapes]:
        raise ShapeError(f"{what}: an argument is named {twice[0]!r}, as a further input of the kernel is. Rename it.")

    def on_symbols(*arrays: Any) -> tuple[Any, ...]:
        given = dict(zip((*shapes, *more), arrays, strict=True))
        charts = {x: Chart.from_input(given[x], models[x].model if x in models else None) for x in derivative.by}
        results = run(*(given[label] for label in shapes))
        return derivative.of_results(what, results, charts, {label: given[label] for label in more})

    program = trace(on_symbols, [*shapes.items(), *more.items()], derivative.outputs(names))
    inputs, outputs = (", ".join(port.name for port in ports) for ports in (program.inputs, program.outputs))
    doc = f"{form} of {name} by {', '.join(derivative.by)}, compiled. Inputs: {inputs}. Outputs: {outputs}."
    return compiled(program, name, doc)


def _arguments(what: str, function: Callable[..., Any], arguments: Any) -> tuple[dict[str, Robot], dict[str, Shape]]:
    """The robots among the arguments, and the shapes of all."""
    if not isinstance(arguments, Mapping) or not arguments:
        raise ShapeError(
            f"{what}: arguments are a dict {{name: shape or robot}} in the function's order, as in {{'x': (3,)}}, "
            f"got {arguments!r}."
        )
    shapes: dict[str, Shape] = {}
    for name, given in arguments.items():
        shape = given.nq if isinstance(given, Robot) else given
        try:
            sizes = tuple(operator.index(n) for n in (shape if isinstance(shape, tuple | list) else (shape,)))
        except TypeError:
            sizes = (-1,)
        if any(n < 0 for n in sizes):
            raise ShapeError(f"{what}: {name} has shape {given!r}; give whole numbers, as in (3, 4), or a robot.")
        shapes[str(name)] = sizes
    try:
        inspect.signature(function).bind(*shapes)
    except TypeError as problem:
        raise ShapeError(f"{what}: the function does not take the arguments {', '.join(shapes)}: {problem}.") from None
    except ValueError:  # a builtin that does not tell
        pass
    return {str(name): given for name, given in arguments.items() if isinstance(given, Robot)}, shapes


def _results(what: str, returned: Any) -> list[Any]:
    """Results of the function as arrays of symbols and real numbers."""
    found = []
    for result in returned if isinstance(returned, tuple) else (returned,):
        try:
            array = np.asarray(result, object)
            for e in array.reshape(-1):
                if not isinstance(e, Expr):
                    float(e)
        except (TypeError, ValueError):
            raise ShapeError(
                f"{what}: it returned {str(result)[:60]!r}. Return an array of numbers, or a tuple of such arrays."
            ) from None
        found.append(array)
    if not found:
        raise ShapeError(f"{what}: it returned nothing. Return an array of numbers, or a tuple of such arrays.")
    return found


def _one(array: Any) -> Any:
    """Scalar in place of an array without axes."""
    return array if array.ndim else array[()]
