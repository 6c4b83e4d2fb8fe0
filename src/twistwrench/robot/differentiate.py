"""Derivatives of traced functions and of NumPy functions, by forward or reverse mode; along robot.add for configurations."""

from __future__ import annotations

import inspect
import math
import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate, chain, islice
from typing import Any

import numpy as np

from ..compiler.ir import autodiff
from ..compiler.ir.expr import Expr
from ..compiler.ir.tracer import Trace, trace
from ..core.errors import KernelError, ShapeError, TwistWrenchError, UnknownNameError
from ..core.typing import Array
from ..mechanics.algorithms.kinematics import brackets, moving_parts
from ..mechanics.model.model import Model
from .engine import compile_form, ports_text
from .quantities import Shape
from .robot import Robot

FORMS = (
    "jacobian",  # ∂f/∂x
    "along",  # (∂f/∂x) v
    "weighted",  # ∂(w·f)/∂x
    "hessian",  # ∂²f/∂x²
    "hessian_along",  # ∂²(w·f)/∂x² v
)
MODES = ("auto", "forward", "reverse")
LARGEST_RESULT = 500_000
"""Largest number of results of one kernel; beyond it, tracing takes minutes."""
LARGEST_WORK = 2_000_000
"""Largest number of operations of one kernel; beyond it, tracing takes minutes."""
_MAX_QUOTED = 60
"""Number of characters of a wrong result that a message quotes."""


@dataclass(frozen=True)
class Derivative:
    """Validated request for a derivative."""

    by: tuple[str, ...]
    """Names of the inputs to differentiate by."""
    form: str = "jacobian"
    """One of ``FORMS``."""
    mode: str = "auto"
    """One of ``MODES``."""
    values: bool = False
    """True if the function's own results come first."""

    @classmethod
    def from_inputs(cls, what: str, inputs: Sequence[str], by: Any, form: Any, mode: Any, values: Any) -> Derivative:
        """From a user's choices; raises UnknownNameError and KernelError.

        ``what`` is the function's name in messages, and ``inputs`` are the names that ``by`` may have.
        """
        names: tuple[Any, ...] = ()
        if isinstance(by, str):
            names = (by,)
        elif isinstance(by, Sequence):
            names = tuple(by)
        if not names:
            raise KernelError(f"{what}: by={by!r} names no input. Name one or several of {', '.join(inputs)}.")
        for name in names:
            if name not in inputs:
                raise UnknownNameError.from_choices(f"input of {what}", name, inputs)
        if len(set(names)) < len(names):
            raise KernelError(f"{what}: an input is named twice in by={names}. Name each once.")
        for label, choice, allowed in (("form", form, FORMS), ("mode", mode, MODES)):
            if choice not in allowed:
                raise UnknownNameError.from_choices(f"{label} of a derivative", choice, allowed)
        if mode != "auto" and form not in ("jacobian", "hessian"):
            raise KernelError(f"{what}: form={form!r} has one way to compute it; leave mode={mode!r} out.")
        return cls(names, form, mode, bool(values))

    @property
    def weighs(self) -> bool:
        """True if results are summed with weights."""
        return self.form in ("weighted", "hessian_along")

    def inputs(self, charts: Mapping[str, Shape], outputs: Mapping[str, Shape]) -> dict[str, Shape]:
        """Shapes of additional inputs by name: weights of the results, and the direction.

        ``charts``: shapes of directions by input. ``outputs``: shapes of the function's results by name.
        """
        shapes: dict[str, Shape] = {}
        is_single_number = list(outputs.values()) == [()]
        if self.weighs and not is_single_number:  # a single number needs no weight
            for name, shape in outputs.items():
                shapes[f"weight on {name}"] = shape
        if self.form in ("along", "hessian_along"):
            for name in self.by:
                shapes[f"along {name}"] = charts[name]
        return shapes

    def outputs(self, names: Sequence[str]) -> list[str]:
        """Names of the outputs, from the names of the function's results."""
        if self.form == "jacobian":
            labels = [f"{result_name}_by_{name}" for result_name in names for name in self.by]
        elif self.form in ("along", "hessian"):
            labels = [f"{result_name}_{self.form}" for result_name in names]
        else:
            labels = [f"{self.form}_by_{name}" for name in self.by]
        if self.values:
            return [*names, *labels]
        return labels

    def derive(
        self, what: str, results: Sequence[Any], charts: Mapping[str, Chart], more: Mapping[str, Any]
    ) -> tuple[Array, ...]:
        """Derivatives of ``results``, arrays of symbols or numbers, in the order of :meth:`outputs`.

        ``charts``: directions by input. ``more``: values of the inputs that :meth:`inputs` adds, by name.
        """
        own_charts = [charts[name] for name in self.by]
        input_shapes = [chart.shape for chart in own_charts]
        chart = Chart.concatenate(own_charts)
        direction_count = math.prod(chart.shape)
        results = [np.asarray(result, object) for result in results]
        symbols_or_numbers = _entries(results)
        symbol_trace = _trace_of([*chart.known, *symbols_or_numbers])
        result_entries = list(map(symbol_trace.lift, symbols_or_numbers))
        direction = _entries_of("along ", more)
        self._check_size(what, result_entries, chart)
        if self.form == "along":
            rates = autodiff.along(result_entries, chart.known, direction)
            derivatives = _split(rates, [result.shape for result in results])
        elif self.form == "jacobian":
            J = autodiff.jacobian(result_entries, chart.known, direction_count, self.mode)
            derivatives = _jacobian_parts(J, results, input_shapes)
        elif self.form == "hessian":
            J = autodiff.jacobian(result_entries, chart.known, direction_count, self.mode)
            parts = np.split(_hessian(J, chart), _boundaries(results))
            derivatives = []
            for result, part in zip(results, parts, strict=True):
                derivatives.append(part.reshape((*result.shape, direction_count, direction_count)))
        else:
            weights = _entries_of("weight on ", more)
            if result_entries and not weights:  # a single number needs no weight
                weights = [1.0]
            gradient = autodiff.gradient(result_entries, weights, chart.known, direction_count)
            if self.form == "hessian_along":
                gradient = _hessian_along(gradient, chart, direction)
            derivatives = _split(gradient, input_shapes)
        if self.values:
            return (*results, *derivatives)
        return tuple(derivatives)

    def _check_size(self, what: str, result_entries: Sequence[Expr], chart: Chart) -> None:
        """Raise KernelError for a Jacobian or Hessian that is too large to trace; the other forms are small."""
        if self.form not in ("jacobian", "hessian"):
            return
        n = math.prod(chart.shape)
        number_count = len(result_entries) * n
        if self.form == "hessian":
            number_count *= n
        advice = "Differentiate fewer results, by fewer inputs, or along a direction: form='along' or 'weighted'."
        if number_count > LARGEST_RESULT:
            raise KernelError(
                f"{what}: its {self.form} has {number_count} numbers, more than the {LARGEST_RESULT} one kernel may "
                f"give. {advice}"
            )
        if not number_count:
            return
        counts = autodiff.work(result_entries, chart.known)
        operations = min(counts) if self.mode == "auto" else getattr(counts, self.mode)
        if self.form == "hessian":
            operations *= n
        if operations > LARGEST_WORK:
            raise KernelError(
                f"{what}: its {self.form} takes some {operations} operations, more than the {LARGEST_WORK} one kernel may "
                f"take. {advice}"
            )


@dataclass(frozen=True)
class Chart:
    """Directions of one input, or of several, with known derivatives of expressions along them."""

    shape: Shape
    """Shape of a derivative along all directions: the input's, or (nv,) for a configuration."""
    known: autodiff.Known
    """Derivatives by expression, then by the number of the direction; a number that is missing has derivative 0."""
    brackets: Array | None = None
    """Structure constants c with [a, b] = Σ c_abd d; None if the directions commute."""

    @classmethod
    def from_input(cls, x: Any, model: Model | None = None) -> Chart:
        """Directions of the input x: its entries, or the velocities along robot.add if x is the q of a robot's ``model``."""
        if model is None:
            entries = np.reshape(x, -1)
            return cls(np.shape(x), {entry: {k: entry.trace.one} for k, entry in enumerate(entries)})
        known: dict[Expr, dict[int, Expr]] = {}
        for part, slopes in moving_parts(model, x):
            slopes_of_entries = slopes.reshape(part.size, model.nv)
            for entry, slopes_of_entry in zip(part.reshape(-1), slopes_of_entries, strict=True):
                known[entry] = {}
                for k, number_or_symbol in enumerate(slopes_of_entry):
                    slope = entry.trace.lift(number_or_symbol)
                    if slope is not entry.trace.zero:
                        known[entry][k] = slope
                if entry.op == "sub":  # the trace stores -(a - b) as b - a, an expression of its own
                    known[-entry] = {k: -slope for k, slope in known[entry].items()}
        constants = brackets(model)
        if not constants.any():
            return cls((model.nv,), known)
        return cls((model.nv,), known, constants)

    @classmethod
    def concatenate(cls, charts: Sequence[Chart]) -> Chart:
        """Several inputs combined, with their directions concatenated."""
        direction_count = sum(math.prod(chart.shape) for chart in charts)
        known: dict[Expr, dict[int, Expr]] = {}
        constants = np.zeros((direction_count, direction_count, direction_count))
        offset = 0  # number of directions of the charts before
        for chart in charts:
            count = math.prod(chart.shape)
            for entry, slopes in chart.known.items():
                known[entry] = {offset + k: slope for k, slope in slopes.items()}
            if chart.brackets is not None:
                own = slice(offset, offset + count)
                constants[own, own, own] = chart.brackets
            offset += count
        if all(chart.brackets is None for chart in charts):
            return cls((direction_count,), known)
        return cls((direction_count,), known, constants)


def _jacobian_parts(J: Array, results: Sequence[Array], input_shapes: Sequence[Shape]) -> list[Array]:
    """Derivatives of each result by each input, the inputs of the first result first."""
    column_counts = [math.prod(shape) for shape in input_shapes]
    column_boundaries = list(accumulate(column_counts))[:-1]
    parts_by_result = np.split(J, _boundaries(results))
    derivatives = []
    for result, rows in zip(results, parts_by_result, strict=True):
        parts_by_input = np.split(rows, column_boundaries, axis=1)
        for shape, part in zip(input_shapes, parts_by_input, strict=True):
            derivatives.append(part.reshape((*result.shape, *shape)))
    return derivatives


def _entries_of(kind: str, more: Mapping[str, Any]) -> list[Any]:
    """Entries of the additional inputs whose names begin with ``kind``, one after the other."""
    inputs = [x for name, x in more.items() if name.startswith(kind)]
    return _entries(inputs)


def _entries(arrays: Iterable[Any]) -> list[Any]:
    """Entries of several arrays, one after the other."""
    return list(chain.from_iterable(np.reshape(array, -1) for array in arrays))


def _trace_of(entries: Iterable[Any]) -> Trace:
    """Trace of the first symbol; a new one if all entries are numbers."""
    for entry in entries:
        if isinstance(entry, Expr):
            return entry.trace
    return Trace()


def _boundaries(arrays: Sequence[Array]) -> list[int]:
    """Numbers of the rows at which the second and later arrays begin, if all arrays' entries are rows of one table."""
    return list(accumulate(array.size for array in arrays))[:-1]


def _split(entries: Sequence[Any] | Array, shapes: Sequence[Shape]) -> list[Array]:
    """Object arrays of the given shapes, filled one after the other."""
    remaining = iter(entries)
    return [_object_array(shape, list(islice(remaining, math.prod(shape)))) for shape in shapes]


# With L_a the derivative along a, differentiating twice along robot.add gives L_b L_a f: the derivative along b of the
# gradient's entry a. It is not symmetric if directions do not commute: L_a L_b f - L_b L_a f = L_[a,b] f. With half the
# bracket added it is the second derivative of f(q ⊕ v) by v at v = 0: L_b L_a f + ½ L_[a,b] f.


def _hessian(J: Array, chart: Chart) -> Array:
    """Symmetric second derivatives (m, n, n) of m results, from first derivatives (m, n)."""
    m, n = J.shape
    H = np.full((m, n, n), 0.0, object)
    for b, direction in enumerate(np.eye(n).tolist()):
        # the upper triangle is enough, as the result is symmetric
        rates = _along(J[:, : b + 1], chart, direction)
        slopes = _object_array((m, b + 1), rates)
        for a in range(b + 1):
            half_bracket: Any = 0.0
            if chart.brackets is not None:
                half_bracket = 0.5 * (J @ chart.brackets[a, b].astype(object))
            H[:, a, b] = slopes[:, a] + half_bracket
            H[:, b, a] = H[:, a, b]
    return H


def _hessian_along(gradient: Array, chart: Chart, direction: Sequence[Any]) -> Array:
    """Symmetric second derivative times the direction (n,), from the gradient (n,)."""
    product = _object_array(gradient.shape, _along(gradient, chart, direction))
    if chart.brackets is not None:
        for a, b, d in np.argwhere(chart.brackets):
            product[a] = product[a] + 0.5 * chart.brackets[a, b, d] * (direction[b] * gradient[d])
    return product


def _along(entries: Array, chart: Chart, direction: Sequence[Any]) -> list[Any]:
    """Derivatives of entries along a direction; entries may be plain numbers."""
    symbols = {k: entry for k, entry in enumerate(entries.reshape(-1)) if isinstance(entry, Expr)}
    rates = autodiff.along(list(symbols.values()), chart.known, direction)
    derivatives: list[Any] = [0.0] * entries.size
    for k, rate in zip(symbols, rates, strict=True):
        derivatives[k] = rate
    return derivatives


def _object_array(shape: Shape, entries: Sequence[Any]) -> Array:
    """Object array filled entry by entry, so that NumPy does not inspect the entries."""
    array = np.empty(math.prod(shape), object)
    array[:] = entries
    return array.reshape(shape)


# ── Compiled derivatives of any NumPy function

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
    """Automatic differentiation: a compiled kernel with derivatives of a function written with NumPy and robot methods.

    Parameters
    ----------
    function : callable, of one sample, written with NumPy functions and robot methods
    arguments : {name: shape, int or Robot}
        Shape of each argument in order, or the robot if the argument is its configuration.
    by : str or sequence of str, optional, arguments to differentiate by; None: all
    form : "jacobian", "along", "weighted", "hessian" or "hessian_along", see the notes
    mode : "auto", "forward" or "reverse"; ``"auto"`` selects the mode with fewer operations
    values : bool, return the function's own results first

    Returns
    -------
    kernel : ufunc of the arguments, followed by weights w and direction v if the form requires them

    Raises
    ------
    KernelError
        The function cannot be traced, or its derivatives are too large.

    Notes
    -----
    With x all arguments in ``by``, f the results, and w, v further inputs of the kernel, ``form`` is

    - ``"jacobian"``, ∂f/∂x: one array for each pair of result and argument, the result's axes first;
    - ``"along"``, (∂f/∂x) v, derivative along a direction v (JVP): shaped like the results;
    - ``"weighted"``, ∂(w·f)/∂x, with one weight for each entry of the results (VJP): shaped like ``by``;
    - ``"hessian"``, ∂²f/∂x²: one array for each result, with two more axes over the concatenated entries of ``by``;
    - ``"hessian_along"``, ∂²(w·f)/∂x² v: shaped like ``by``. Functions that return one number take no weights.

    Derivatives by a configuration are along robot.add: those of f(q ⊕ v) by v (nv,) at v = 0, first and second, so that
    Hessians are symmetric. The function must not depend on the norm of quaternions. The derivative of the sign function
    and of other step functions is 0.

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
        raise KernelError(
            f"{what}: {function!r} is not a function. For a quantity of a robot: robot.kernel(name, by=…)."
        )
    models, shapes = _arguments(what, function, arguments)
    if by is None:
        by = tuple(shapes)
    derivative = Derivative.from_inputs(what, tuple(shapes), by, form, mode, values)

    def run_on_symbols(*arrays: Any) -> list[Any]:
        """Results of the function, as arrays; raises KernelError if it cannot be traced."""
        try:
            return _results(what, function(*map(_floats_if_empty, arrays)))
        except TwistWrenchError:
            raise
        except Exception as problem:
            raise KernelError(f"{what}: it cannot be traced: {str(problem).rstrip('.')}. {_ADVICE}") from problem

    symbol_trace = Trace()
    # A first run, for the shapes of the results.
    symbols = [_scalar_if_no_axes(symbol_trace.inputs(0, shape)) for shape in shapes.values()]
    result_shapes = [result.shape for result in run_on_symbols(*symbols)]
    symbol_trace.forget()
    result_names = ["result"]
    if len(result_shapes) != 1:
        result_names = [f"result{k}" for k in range(1, len(result_shapes) + 1)]
    direction_shapes = {**shapes, **{label: (model.nv,) for label, model in models.items()}}
    shapes_of_results = dict(zip(result_names, result_shapes, strict=True))
    further_inputs = derivative.inputs(direction_shapes, shapes_of_results)
    for label in further_inputs:
        if label in shapes:
            raise ShapeError(f"{what}: an argument is named {label!r}, as a further input of the kernel is. Rename it.")

    def derivatives(*arrays: Any) -> tuple[Any, ...]:
        """Derivatives from the arguments of the function, followed by the further inputs."""
        own_arrays = arrays[: len(shapes)]
        further_arrays = arrays[len(shapes) :]
        inputs = dict(zip(shapes, own_arrays, strict=True))
        charts = {}
        for label in derivative.by:
            charts[label] = Chart.from_input(inputs[label], models.get(label))
        weights_and_directions = dict(zip(further_inputs, further_arrays, strict=True))
        return derivative.derive(what, run_on_symbols(*own_arrays), charts, weights_and_directions)

    program = trace(derivatives, [*shapes.items(), *further_inputs.items()], derivative.outputs(result_names))
    doc = f"{form} of {name} by {', '.join(derivative.by)}, compiled. {ports_text(program)}"
    return compile_form(program, name, doc)


def _floats_if_empty(array: Any) -> Any:
    """Array of symbols, or floats in place of one without elements."""
    if np.size(array):
        return array
    return np.zeros(array.shape)


def _arguments(what: str, function: Callable[..., Any], arguments: Any) -> tuple[dict[str, Model], dict[str, Shape]]:
    """Models of robots among the arguments, and the shapes of all arguments."""
    if not isinstance(arguments, Mapping) or not arguments:
        raise ShapeError(
            f"{what}: arguments are a dict {{name: shape or robot}} in the function's order, as in {{'x': (3,)}}, "
            f"got {arguments!r}."
        )
    shapes: dict[str, Shape] = {}
    models: dict[str, Model] = {}
    for name, argument in arguments.items():
        shape = argument
        if isinstance(argument, Robot):
            shape = argument.nq
            models[str(name)] = argument.model
        sizes = _whole_numbers(shape)
        if sizes is None:
            raise ShapeError(f"{what}: {name} has shape {argument!r}; give whole numbers, as in (3, 4), or a robot.")
        shapes[str(name)] = sizes
    try:
        inspect.signature(function).bind(*shapes)
    except TypeError as problem:
        raise ShapeError(f"{what}: the function does not take the arguments {', '.join(shapes)}: {problem}.") from None
    except ValueError:  # builtins may have no signature
        pass
    return models, shapes


def _whole_numbers(shape: Any) -> Shape | None:
    """Shape as whole numbers, of one axis if it is a number; None if it is not a shape."""
    if not isinstance(shape, tuple | list):
        shape = (shape,)
    try:
        sizes = tuple(map(operator.index, shape))
    except TypeError:
        return None
    if min(sizes, default=0) < 0:
        return None
    return sizes


def _results(what: str, returned: Any) -> list[Any]:
    """Results of the function as arrays of symbols and real numbers."""
    arrays = []
    if not isinstance(returned, tuple):
        returned = (returned,)
    for result in returned:
        try:
            array = np.asarray(result, object)
            for entry in array.reshape(-1):
                if not isinstance(entry, Expr):
                    float(entry)  # only for its error
        except (TypeError, ValueError):
            raise ShapeError(
                f"{what}: it returned {str(result)[:_MAX_QUOTED]!r}. Return an array of numbers, or a tuple of such arrays."
            ) from None
        arrays.append(array)
    if not arrays:
        raise ShapeError(f"{what}: it returned nothing. Return an array of numbers, or a tuple of such arrays.")
    return arrays


def _scalar_if_no_axes(array: Any) -> Any:
    """Scalar in place of a zero-dimensional array."""
    if array.ndim:
        return array
    return array[()]
