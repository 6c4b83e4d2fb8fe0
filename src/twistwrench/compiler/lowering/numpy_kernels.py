"""Forms on whole arrays, one NumPy call per instruction: fallback without a compiler, and reference for tests.

Each class is called like the compiled ufunc of its form: broadcasting, ``out=``, float32 in and out. Fused products round twice
here, so results agree with compiled ones up to rounding errors, not to the bit.
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
"""Number of samples evaluated at a time: intermediates stay in the cache, and memory is bounded."""

_FUNCTIONS = functions_of(np, np.where)


class NumpyKernel:
    """Equivalent of the compiled ufunc of a program."""

    def __init__(self, program: Program, name: str, doc: str) -> None:
        self.program, self.__name__, self.__doc__ = program, name, doc
        self.signature, self.nin, self.nout = program.signature, len(program.inputs), len(program.outputs)
        self._spent = last_uses(program)

    def __repr__(self) -> str:
        return f"<NumpyKernel {self.__name__!r} {self.signature}>"

    def __call__(self, *args: ArrayLike, out: Any = None) -> Any:
        """Evaluate on arrays whose last axes match the signature."""
        arrays = [np.asarray(a) for a in args[: self.nin]]
        if len(args) != self.nin:
            raise TypeError(f"{self.__name__} takes {self.nin} arrays, got {len(args)}.")
        for a, port in zip(arrays, self.program.inputs, strict=True):
            if not np.can_cast(a.dtype, float):
                raise TypeError(f"{self.__name__}: {port.name} is {a.dtype}, real numbers wanted.")
        for number, (a, port) in enumerate(zip(arrays, self.program.inputs, strict=True)):
            if a.ndim < len(port.shape) or a.shape[a.ndim - len(port.shape) :] != port.shape:
                raise ValueError(
                    f"{self.__name__}: operand {number} has shape {a.shape}, core shape {port.shape} wanted."
                )
        dtype, batch = _loop_type(arrays), batch_shape(arrays, self.program)
        samples = int(np.prod(batch))
        columns: list[Array] = []
        for a, port in zip(arrays, self.program.inputs, strict=True):
            rows = np.broadcast_to(a, (*batch, *port.shape)).reshape(samples, port.size)
            columns += list(rows.astype(dtype, copy=False).T)
        results: list[Any] = []
        result_columns: list[Array] = []
        for port in self.program.outputs:
            rows = np.empty((samples, port.size), dtype)
            result_columns += list(rows.T)
            results.append(rows.reshape((*batch, *port.shape)))
        for start in range(0, samples, CHUNK):
            part = slice(start, start + CHUNK)
            chunk = [column[part] for column in columns]
            computed = evaluated(self.program, chunk, _FUNCTIONS, self._spent)
            for column, values in zip(result_columns, computed, strict=True):
                column[part] = values
        if out is None:
            results = [result[()] for result in results]  # an array without axes becomes a number
        else:
            _copy_results(results, out, self.__name__)
        return _single_or_tuple(results)


def _loop_type(arrays: Sequence[Array]) -> Any:
    """Type of the loop that NumPy would select among the two of a compiled ufunc."""
    for a in arrays:
        if not np.can_cast(a.dtype, np.float32):
            return np.float64
    return np.float32


def _copy_results(results: list[Any], out: Any, name: str) -> None:
    """Copy results to the arrays of ``out``, which take their places in the list; casts like a ufunc, never to integers."""
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
        results, shared = list(returned[: self.nout]), returned[self.nout :]
        for group, kernel in zip(self.columns.groups, self.groups, strict=True):
            for matrix, column in group.places:
                results[matrix][..., column] = kernel(*shared, results[matrix][..., column])
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
        factors, relations = self.kernel(*args), np.array(self.products.relations)
        results: list[Array] = []
        for matrix in self.products.matrices:
            left, right = matrix.before
            before = factors[left] @ factors[right]
            left, right = matrix.after
            after = factors[left] @ factors[right]
            M: Array = np.where(relations == BEFORE, before, np.where(relations == AFTER, after, before.dtype.type(0)))
            for r, c, x in matrix.added:
                M[..., r, c] += x
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
        """Run all attempts."""
        s = self.search
        size, target_axes = s.x.size, len(s.target.shape)
        status, error = size, size + 1  # columns of the memory after x
        batch = np.broadcast_shapes(target.shape[: target.ndim - target_axes], start.shape[:-1])
        targets = np.broadcast_to(target, (*batch, *s.target.shape)).reshape(-1, s.target.size)
        x = np.minimum(np.maximum(np.broadcast_to(start, (*batch, size)).reshape(-1, size), s.least), s.most)
        tolerances = np.broadcast_to(self._tolerances(settings), (len(x), self._count()))
        given = np.concatenate([targets, tolerances], axis=1)
        max_steps = int(settings[TIMES])
        best = self._attempt(given, x, max_steps)
        starts, rows = np.ones(len(x)), np.flatnonzero(_is_unfinished(best[:, status]))
        gap = targets[rows][:, list(s.near), None] - reached
        distances = (settings[TOLERANCES + self._count() :, None] * (gap * gap)).sum(axis=1)
        for _ in range(int(settings[ATTEMPTS])):
            if not len(rows):
                break
            nearest = np.argmin(distances, axis=1)
            distances[np.arange(len(rows)), nearest] = np.inf  # each start is used once
            attempt, before = self._attempt(given[rows], places[nearest], max_steps), best[rows]
            unfinished = _is_unfinished(attempt[:, status])
            new_error, old_error = attempt[:, error], before[:, error]
            is_better = ~unfinished | (new_error < old_error) | (np.isnan(old_error) & ~np.isnan(new_error))
            best[rows] = np.where(is_better[:, None], attempt, before)
            starts[rows] += 1
            rows, distances = rows[unfinished], distances[unfinished]
        configurations = best[:, :size].reshape((*batch, -1))
        reports = np.concatenate([starts[:, None], best[:, status:-2]], axis=1).reshape((*batch, -1))
        if out is None:
            return configurations, reports
        out[0][...], out[1][...] = configurations, reports
        return tuple(out)

    def _count(self) -> int:
        """Number of tolerances."""
        return self.search.program.inputs[-1].size - self.search.target.size

    def _tolerances(self, settings: Array) -> Array:
        return settings[TOLERANCES : TOLERANCES + self._count()]

    def _attempt(self, given: Array, x: Array, times: int) -> Array:
        """Memory after the last step of an attempt, which ends when the target is found or progress stops."""
        memory = np.concatenate([x, np.broadcast_to(self.search.begins, (len(x), len(self.search.begins)))], axis=1)
        rows = np.arange(len(x))
        for _ in range(times):
            x, memory[rows] = self.kernel(x, x, memory[rows], given[rows])
            continues = memory[rows, -1] > 0.0
            rows, x = rows[continues], x[continues]
            if not len(rows):
                break
        return memory


def _is_unfinished(status: Array) -> Array:
    """Mask of searches to continue: neither found nor invalid."""
    return np.asarray(~((status < 0) | (status > 0)))


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
        arrays = [np.asarray(a) for a in args]
        dtype = _loop_type(arrays)
        batches = []
        for result, port in zip(out, r.outputs, strict=True):
            batches.append(result.shape[: result.ndim - 1 - len(port.shape)])
        batch = np.broadcast_shapes(*batches)
        initial, given_arrays = arrays[: r.visible], arrays[r.visible :]
        state = [np.broadcast_to(a.astype(dtype, copy=False), (*batch, *a.shape[-1:])) for a in initial]
        state += [np.zeros((*batch, *port.shape), dtype) for port in r.states[r.visible :]]
        given = []
        for a, port in zip(given_arrays, r.inputs[r.visible :], strict=True):
            given.append(_GivenInput(a.astype(dtype, copy=False), port))
        kept_rows = out[0].shape[len(batch)]
        steps_per_row = given[0].steps // max(kept_rows, 1)
        for row in range(kept_rows):
            for between in range(steps_per_row):
                number = row * steps_per_row + between
                inputs = {k: array.at(number) for k, array in zip(r.given, given, strict=True)}
                begin = list(state)
                for stage, coefficients in enumerate(r.table):
                    table_row = np.array(coefficients, dtype)
                    operands = [self._input(k, s, inputs, state, begin, table_row) for k, s in enumerate(r.sources)]
                    results = self.kernel(*operands)
                    state = list(results[: len(r.states)])
                    if stage == 0 and between == 0:
                        for k, reported in zip(r.reported, out[r.visible :], strict=True):
                            reported[..., row, :] = results[k]
            for kept, x in zip(out, state[: r.visible], strict=False):
                kept[..., row, :] = x
        return out

    @staticmethod
    def _input(
        k: int, source: Source, inputs: dict[int, Array], state: list[Array], begin: list[Array], table_row: Array
    ) -> Any:
        if source.kind == "given":
            return inputs[k]
        if source.kind == "stage":
            return table_row
        if source.kind == "start":
            return begin[source.state]
        return state[source.state]


class _GivenInput:
    """Array with an input of every step."""

    def __init__(self, array: Array, port: TensorSpec) -> None:
        self.array = array
        self.axis = array.ndim - 1 - len(port.shape)
        """Axis of the steps."""
        self.steps = array.shape[self.axis]

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
