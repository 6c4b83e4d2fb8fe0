"""Forms evaluated by NumPy on whole arrays, one call per instruction: fallback without a compiler, and reference for tests.

Each class is called like the compiled ufunc of its form: it broadcasts, accepts ``out=``, and returns float32 for float32.
Fused products round twice here. So results agree with compiled ones up to rounding errors, not to the bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...core.typing import Array
from ..ir.loops import AFTER, ATTEMPTS, BEFORE, TIMES, TOLERANCES, ColumnSolve, Form, Products, Scan, Search, Source
from ..ir.program import Program, TensorSpec
from .reference_interpreter import batch_shape, evaluated, functions_of, last_uses

CHUNK = 4096
"""Number of samples that are evaluated at once, few enough that intermediate values stay in the processor's cache."""

_FUNCTIONS = functions_of(np, np.where)


class NumpyKernel:
    """Equivalent of the compiled ufunc of a program."""

    def __init__(self, program: Program, name: str, doc: str) -> None:
        self.program, self.__name__, self.__doc__ = program, name, doc
        self.signature, self.nin, self.nout = program.signature, len(program.inputs), len(program.outputs)
        self._last_uses = last_uses(program)

    def __repr__(self) -> str:
        return f"<NumpyKernel {self.__name__!r} {self.signature}>"

    def __call__(self, *args: ArrayLike, out: Any = None) -> Any:
        """Evaluate on arrays whose last axes match the signature."""
        if len(args) != self.nin:
            raise TypeError(f"{self.__name__} takes {self.nin} arrays, got {len(args)}.")
        arrays = [np.asarray(argument) for argument in args]
        for array, port in zip(arrays, self.program.inputs, strict=True):
            if not np.can_cast(array.dtype, float):
                raise TypeError(f"{self.__name__}: {port.name} is {array.dtype}, real numbers wanted.")
        for number, (array, port) in enumerate(zip(arrays, self.program.inputs, strict=True)):
            batch_axis_count = array.ndim - len(port.shape)
            if batch_axis_count < 0 or array.shape[batch_axis_count:] != port.shape:
                raise ValueError(
                    f"{self.__name__}: operand {number} has shape {array.shape}, core shape {port.shape} wanted."
                )
        dtype = _loop_type(arrays)
        batch = batch_shape(arrays, self.program)
        samples = int(np.prod(batch))
        input_columns: list[Array] = []  # one (samples,) array for each element of an input
        for array, port in zip(arrays, self.program.inputs, strict=True):
            sample_rows = np.broadcast_to(array, (*batch, *port.shape)).reshape(samples, port.size)
            input_columns += list(sample_rows.astype(dtype, copy=False).T)
        results: list[Any] = []
        result_columns: list[Array] = []  # views of the results
        for port in self.program.outputs:
            sample_rows = np.empty((samples, port.size), dtype)
            result_columns += list(sample_rows.T)
            results.append(sample_rows.reshape((*batch, *port.shape)))
        for start in range(0, samples, CHUNK):
            chunk = slice(start, start + CHUNK)
            elements = [column[chunk] for column in input_columns]
            result_elements = evaluated(self.program, elements, _FUNCTIONS, self._last_uses)
            for column, values in zip(result_columns, result_elements, strict=True):
                column[chunk] = values
        if out is None:
            results = [result[()] for result in results]  # an array without axes becomes a number
        else:
            _copy_results(results, out, self.__name__)
        return _single_or_tuple(results)


def _loop_type(arrays: Sequence[Array]) -> Any:
    """Type of the loop that NumPy would select for a compiled ufunc: float32 if it holds all inputs, otherwise float64."""
    for array in arrays:
        if not np.can_cast(array.dtype, np.float32):
            return np.float64
    return np.float32


def _copy_results(results: list[Any], out: Any, name: str) -> None:
    """Copy results to the arrays of ``out``, and put these arrays into the list of results.

    Types are cast as by a ufunc, so not to integers.
    """
    targets = out if isinstance(out, tuple) else (out,)
    if len(targets) != len(results):
        raise ValueError(f"{name}: out= has {len(targets)} arrays, {len(results)} wanted.")
    for k, target in enumerate(targets):
        if target is not None:
            np.copyto(target, results[k], casting="same_kind")
            results[k] = target


def _single_or_tuple(results: Sequence[Any]) -> Any:
    """The only result, or all in a tuple, as a ufunc returns them."""
    if len(results) == 1:
        return results[0]
    return tuple(results)


class NumpyColumns:
    """Equivalent of the compiled ufunc of a column solve."""

    def __init__(self, columns: ColumnSolve, name: str, doc: str) -> None:
        self.columns, self.__name__, self.__doc__ = columns, name, doc
        self.signature, self.nin, self.nout = columns.signature, len(columns.inputs), len(columns.outputs)
        self.kernel = NumpyKernel(columns.program, name, doc)
        self.groups = [NumpyKernel(group.program, name, doc) for group in columns.groups]

    def __repr__(self) -> str:
        return f"<NumpyColumns {self.__name__!r} {self.signature}>"

    def __call__(self, *args: ArrayLike, out: Any = None) -> Any:
        """Evaluate on arrays whose last axes match the signature."""
        returned = self.kernel(*args)
        results = list(returned[: self.nout])
        shared_values = returned[self.nout :]
        for group, kernel in zip(self.columns.groups, self.groups, strict=True):
            for matrix, column in group.places:
                solution = kernel(*shared_values, results[matrix][..., column])
                results[matrix][..., column] = solution
        if out is not None:
            _copy_results(results, out, self.__name__)
        return tuple(results)


class NumpyProducts:
    """Equivalent of the compiled ufunc of products."""

    def __init__(self, products: Products, name: str, doc: str) -> None:
        self.products, self.__name__, self.__doc__ = products, name, doc
        self.signature, self.nin, self.nout = products.signature, len(products.inputs), len(products.outputs)
        self.kernel = NumpyKernel(products.program, name, doc)

    def __repr__(self) -> str:
        return f"<NumpyProducts {self.__name__!r} {self.signature}>"

    def __call__(self, *args: ArrayLike, out: Any = None) -> Any:
        """Evaluate on arrays whose last axes match the signature."""
        factors = self.kernel(*args)
        relations = np.array(self.products.relations)
        results: list[Array] = []
        for matrix in self.products.matrices:
            left, right = matrix.before
            before = factors[left] @ factors[right]
            left, right = matrix.after
            after = factors[left] @ factors[right]
            zero = before.dtype.type(0)
            after_or_zero = np.where(relations == AFTER, after, zero)
            M: Array = np.where(relations == BEFORE, before, after_or_zero)
            for row, column, constant in matrix.added:
                M[..., row, column] += constant
            results.append(M)
        if out is not None:
            _copy_results(results, out, self.__name__)
        return _single_or_tuple(results)


class NumpySearch:
    """Equivalent of the compiled ufunc of a search; settings and tables are common to all samples."""

    def __init__(self, search: Search, name: str, doc: str) -> None:
        self.search, self.__name__, self.__doc__ = search, name, doc
        self.signature = search.signature
        self.kernel = NumpyKernel(search.program, name, doc)

    def __repr__(self) -> str:
        return f"<NumpySearch {self.__name__!r} {self.signature}>"

    def __call__(
        self, target: Array, start: Array, settings: Array, places: Array, reached: Array, out: Any = None
    ) -> tuple[Array, ...]:
        """Run all attempts of all samples.

        ``places`` are further start configurations, used after ``start``, and ``reached`` the target entries at these.
        """
        s = self.search
        size, target_axes = s.x.size, len(s.target.shape)
        status, error = size, size + 1  # columns of the memory after x
        batch = np.broadcast_shapes(target.shape[: target.ndim - target_axes], start.shape[:-1])
        targets = np.broadcast_to(target, (*batch, *s.target.shape)).reshape(-1, s.target.size)
        x = np.broadcast_to(start, (*batch, size)).reshape(-1, size)
        x = np.minimum(np.maximum(x, s.least), s.most)
        tolerances = np.broadcast_to(self._tolerances(settings), (len(x), self._tolerance_count()))
        targets_and_tolerances = np.concatenate([targets, tolerances], axis=1)
        max_steps = int(settings[TIMES])
        best = self._attempt(targets_and_tolerances, x, max_steps)  # memories of the best attempts
        attempt_counts = np.ones(len(x))
        rows = np.flatnonzero(_is_unfinished(best[:, status]))  # samples that need another attempt
        weights = settings[TOLERANCES + self._tolerance_count() :]
        difference = targets[rows][:, list(s.near), None] - reached
        distances = (weights[:, None] * (difference * difference)).sum(axis=1)
        for _ in range(int(settings[ATTEMPTS])):
            if not len(rows):
                break
            nearest = np.argmin(distances, axis=1)
            distances[np.arange(len(rows)), nearest] = np.inf  # each start is used once
            attempt = self._attempt(targets_and_tolerances[rows], places[nearest], max_steps)
            old_best = best[rows]
            is_unfinished = _is_unfinished(attempt[:, status])
            new_error, old_error = attempt[:, error], old_best[:, error]
            has_first_number = np.isnan(old_error) & ~np.isnan(new_error)
            is_better = ~is_unfinished | (new_error < old_error) | has_first_number
            best[rows] = np.where(is_better[:, None], attempt, old_best)
            attempt_counts[rows] += 1
            rows, distances = rows[is_unfinished], distances[is_unfinished]
        configurations = best[:, :size].reshape((*batch, -1))
        # The last two columns of the memory, steps without progress and the flag to continue, are not reported.
        reports = np.concatenate([attempt_counts[:, None], best[:, status:-2]], axis=1).reshape((*batch, -1))
        if out is None:
            return configurations, reports
        out[0][...] = configurations
        out[1][...] = reports
        return tuple(out)

    def _tolerance_count(self) -> int:
        """Number of tolerances, which follow the target entries in the last input of the program."""
        return self.search.program.inputs[-1].size - self.search.target.size

    def _tolerances(self, settings: Array) -> Array:
        """Tolerances in the settings."""
        return settings[TOLERANCES : TOLERANCES + self._tolerance_count()]

    def _attempt(self, targets_and_tolerances: Array, x: Array, max_steps: int) -> Array:
        """Memory after the last step of an attempt from x, one row for each sample.

        An attempt ends when the target is found, progress stops, or ``max_steps`` are made.
        """
        initial_values = np.broadcast_to(self.search.begins, (len(x), len(self.search.begins)))
        memory = np.concatenate([x, initial_values], axis=1)
        rows = np.arange(len(x))  # samples whose attempt goes on
        for _ in range(max_steps):
            x, memory[rows] = self.kernel(x, x, memory[rows], targets_and_tolerances[rows])
            continues = memory[rows, -1] > 0.0
            rows, x = rows[continues], x[continues]
            if not len(rows):
                break
        return memory


def _is_unfinished(status: Array) -> Array:
    """Mask of samples without an answer: neither found (status above 0) nor invalid (below 0). NaN counts as no answer."""
    has_answer = (status < 0) | (status > 0)
    return np.asarray(~has_answer)


class NumpySteps:
    """Equivalent of the compiled ufunc of a scan: arrays of a batch, and ``out=`` for the results."""

    def __init__(self, recurrence: Scan, name: str, doc: str) -> None:
        self.recurrence, self.__name__, self.__doc__ = recurrence, name, doc
        self.signature = recurrence.signature
        self.kernel = NumpyKernel(recurrence.program, name, doc)

    def __repr__(self) -> str:
        return f"<NumpySteps {self.__name__!r} {self.signature}>"

    def __call__(self, *args: Array, out: tuple[Array, ...]) -> tuple[Array, ...]:
        """Evaluate all steps; ``args`` are the initial states, then the inputs given for each step."""
        r = self.recurrence
        arrays = [np.asarray(argument) for argument in args]
        dtype = _loop_type(arrays)
        batches = []
        for result, port in zip(out, r.outputs, strict=True):
            batches.append(result.shape[: result.ndim - 1 - len(port.shape)])
        batch = np.broadcast_shapes(*batches)
        initial_states, given_arrays = arrays[: r.visible], arrays[r.visible :]
        state = [np.broadcast_to(a.astype(dtype, copy=False), (*batch, *a.shape[-1:])) for a in initial_states]
        state += [np.zeros((*batch, *port.shape), dtype) for port in r.states[r.visible :]]
        given = []
        for array, port in zip(given_arrays, r.inputs[r.visible :], strict=True):
            given.append(_GivenInput(array.astype(dtype, copy=False), port))
        row_count = out[0].shape[len(batch)]
        steps_per_row = given[0].steps // max(row_count, 1)
        for row in range(row_count):
            for step_in_row in range(steps_per_row):
                step = row * steps_per_row + step_in_row
                inputs = {k: array.at(step) for k, array in zip(r.given, given, strict=True)}
                start = list(state)
                for stage, coefficients in enumerate(r.table):
                    table_row = np.array(coefficients, dtype)
                    operands = []
                    for k, source in enumerate(r.sources):
                        operands.append(self._input(k, source, inputs, state, start, table_row))
                    results = self.kernel(*operands)
                    state = list(results[: len(r.states)])
                    if stage == 0 and step_in_row == 0:
                        for k, reported in zip(r.reported, out[r.visible :], strict=True):
                            reported[..., row, :] = results[k]
            # The first results are the visible states; those after them were stored as reports.
            for result, visible_state in zip(out, state[: r.visible], strict=False):
                result[..., row, :] = visible_state
        return out

    @staticmethod
    def _input(
        k: int, source: Source, inputs: dict[int, Array], state: list[Array], start: list[Array], table_row: Array
    ) -> Any:
        """Input k of the program from its source; ``start`` is the state at the beginning of the step."""
        if source.kind == "given":
            return inputs[k]
        if source.kind == "stage":
            return table_row
        if source.kind == "start":
            return start[source.state]
        return state[source.state]


class _GivenInput:
    """Array that contains an input for every step."""

    def __init__(self, array: Array, port: TensorSpec) -> None:
        self.array = array
        self.axis = array.ndim - 1 - len(port.shape)
        """Axis of the steps."""
        self.steps = array.shape[self.axis]
        """Number of steps."""

    def at(self, step: int) -> Array:
        """Input of one step."""
        return np.take(self.array, step, self.axis)


def on_numpy(form: Form, name: str, doc: str) -> Any:
    """Equivalent of the compiled ufunc of a form."""
    if isinstance(form, Program):
        return NumpyKernel(form, name, doc)
    if isinstance(form, Products):
        return NumpyProducts(form, name, doc)
    if isinstance(form, ColumnSolve):
        return NumpyColumns(form, name, doc)
    if isinstance(form, Scan):
        return NumpySteps(form, name, doc)
    return NumpySearch(form, name, doc)
