"""Programs evaluated on arrays of NumPy, JAX and PyTorch, and on symbols of CasADi.

Fused products round twice here, so results agree with compiled ones up to rounding errors, not to the bit.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...core.typing import Array
from ..ir.loops import AFTER, ATTEMPTS, BEFORE, TIMES, TOLERANCES, ColumnSolve, Form, Products, Scan, Search, Source
from ..ir.program import FUSED, Program

Functions = Mapping[str, Callable[..., Any]]
"""Functions that compute each operation, by name."""


def functions_of(namespace: Any, where: Callable[[Any, Any, Any], Any]) -> Functions:
    """Operations as functions of a package, from its sqrt, sin, cos, exp and sign; ``where`` selects by a condition."""
    return {
        "add": operator.add, "sub": operator.sub, "mul": operator.mul, "div": _quotient, "neg": operator.neg,
        **{name: getattr(namespace, name) for name in ("sqrt", "sin", "cos", "exp", "sign")},
        "min": lambda a, b: where(a < b, a, b), "max": lambda a, b: where(a > b, a, b),
        **{op: _fused(*signs) for op, signs in FUSED.items()},
    }  # fmt: skip


def _quotient(a: Any, b: Any) -> Any:
    """Quotient; for two constants, without Python's exception for a zero divisor."""
    return float(np.divide(a, b)) if isinstance(a, float) and isinstance(b, float) else a / b


def _fused(product: int, addend: int) -> Callable[..., Any]:
    def run(a: Any, b: Any, c: Any) -> Any:
        ab = a * b if product > 0 else -(a * b)
        return ab + c if addend > 0 else ab - c

    return run


def evaluated(
    program: Program, elements: Sequence[Any], functions: Functions, spent: Mapping[int, Sequence[int]] | None = None
) -> list[Any]:
    """Elements of all results in C order from those of all inputs; ``spent`` lists values to release after each instruction."""
    values: dict[int, Any] = {}
    spent = spent or {}
    for number, (op, args, value) in enumerate(program.instructions):
        if op == "const":
            values[number] = value
        elif op == "input":
            values[number] = elements[int(value)]
        else:
            values[number] = functions[op](*(values[a] for a in args))
        for done in spent.get(number, ()):
            del values[done]
    return [values[result] for result in program.results]


def batch_shape(arrays: Sequence[Any], program: Program) -> tuple[int, ...]:
    """Broadcast shape of the batch axes. Raises ValueError if they do not broadcast."""
    return np.broadcast_shapes(*(a.shape[: a.ndim - len(p.shape)] for a, p in zip(arrays, program.inputs, strict=True)))


def last_uses(program: Program) -> dict[int, list[int]]:
    """Values whose last use is in each instruction, to be released after it."""
    last = {a: k for k, i in enumerate(program.instructions) for a in i.args}
    kept = set(program.results)
    found: dict[int, list[int]] = {}
    for number, k in last.items():
        if number not in kept:
            found.setdefault(k, []).append(number)
    return found


# ── A program on whole arrays, one NumPy call per instruction: fallback without a compiler, and reference for tests

# Called like a ufunc: broadcasting, ``out=``, float32 in and out. Fused products round twice here, so results agree with
# compiled ones up to rounding errors, not to the bit.

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
        single = all(
            np.can_cast(a.dtype, np.float32) for a in arrays
        )  # the loop that NumPy would take of a ufunc's two
        dtype: Any = np.float32 if single else np.float64
        batch = batch_shape(arrays, self.program)
        samples = int(np.prod(batch))
        rows = [
            np.broadcast_to(a, (*batch, *p.shape)).reshape(samples, p.size).astype(dtype, copy=False)
            for a, p in zip(arrays, self.program.inputs, strict=True)
        ]
        results = [np.empty((samples, p.size), dtype) for p in self.program.outputs]
        for start in range(0, samples, CHUNK):
            part = slice(start, start + CHUNK)
            self._evaluate([r[part].T for r in rows], [r[part].T for r in results])
        shaped = [r.reshape((*batch, *p.shape)) for r, p in zip(results, self.program.outputs, strict=True)]
        if out is None:
            shaped = [s if s.ndim else s[()] for s in shaped]
        else:
            places = out if isinstance(out, tuple) else (out,)
            if len(places) != self.nout:
                raise ValueError(f"{self.__name__}: out= has {len(places)} arrays, {self.nout} wanted.")
            for k, place in enumerate(places):
                if place is not None:
                    np.copyto(place, shaped[k], casting="same_kind")  # casts like a ufunc: never to integers
                    shaped[k] = place
        return shaped[0] if self.nout == 1 else tuple(shaped)

    def _evaluate(self, inputs: list[Array], outputs: list[Array]) -> None:
        columns = [c for columns in inputs for c in columns]
        found = evaluated(self.program, columns, _FUNCTIONS, self._spent)
        slots = [row for rows in outputs for row in rows]
        for slot, result in zip(slots, found, strict=True):
            slot[...] = result


# ── Columns on whole arrays: fallback without a compiler, and reference for tests


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
        made = self.kernel(*args)
        found, shared = list(made[: self.nout]), made[self.nout :]
        for group, kernel in zip(self.columns.groups, self.groups, strict=True):
            for matrix, column in group.places:
                found[matrix][..., column] = kernel(*shared, found[matrix][..., column])
        if out is None:
            return tuple(found)
        for k, place in enumerate(out):
            if place is not None:
                np.copyto(place, found[k], casting="same_kind")
                found[k] = place
        return tuple(found)


# ── Products on whole arrays: fallback without a compiler, and reference for tests


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
        found: list[Array] = []
        for matrix in self.products.matrices:
            before, after = (factors[a] @ factors[b] for a, b in (matrix.before, matrix.after))
            M: Array = np.where(relations == BEFORE, before, np.where(relations == AFTER, after, before.dtype.type(0)))
            for r, c, x in matrix.added:
                M[..., r, c] += x
            found.append(M)
        if out is not None:
            places = out if isinstance(out, tuple) else (out,)
            for k, place in enumerate(places):
                if place is not None:
                    np.copyto(place, found[k], casting="same_kind")
                    found[k] = place
        return found[0] if self.nout == 1 else tuple(found)


# ── A search on whole arrays, one NumPy kernel call per step: fallback without a compiler, and reference for tests


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
        size, rank = s.x.size, len(s.target.shape)
        batch = np.broadcast_shapes(target.shape[: target.ndim - rank], start.shape[:-1])
        wanted = np.broadcast_to(target, (*batch, *s.target.shape)).reshape(-1, s.target.size)
        x = np.minimum(np.maximum(np.broadcast_to(start, (*batch, size)).reshape(-1, size), s.least), s.most)
        given = np.concatenate([wanted, np.broadcast_to(self._allowed(settings), (len(x), self._count()))], axis=1)
        passed = self._attempt(given, x, int(settings[TIMES]))
        starts, rows = np.ones(len(x)), np.flatnonzero(_goes_on(passed[:, size]))
        gap = wanted[rows][:, list(s.near), None] - reached
        far = (settings[TOLERANCES + self._count() :, None] * (gap * gap)).sum(axis=1)
        for _ in range(int(settings[ATTEMPTS])):
            if not len(rows):
                break
            nearest = np.argmin(far, axis=1)
            far[np.arange(len(rows)), nearest] = np.inf
            found, before = self._attempt(given[rows], places[nearest], int(settings[TIMES])), passed[rows]
            new, old = found[:, size + 1], before[:, size + 1]
            better = ~_goes_on(found[:, size]) | (new < old) | (np.isnan(old) & ~np.isnan(new))
            passed[rows] = np.where(better[:, None], found, before)
            starts[rows] += 1
            left = _goes_on(found[:, size])
            rows, far = rows[left], far[left]
        results = passed[:, :size], np.concatenate([starts[:, None], passed[:, size:-2]], axis=1)
        shaped = [a.reshape((*batch, -1)) for a in results]
        if out is not None:
            for place, a in zip(out, shaped, strict=True):
                place[...] = a
            return tuple(out)
        return tuple(shaped)

    def _count(self) -> int:
        return self.search.program.inputs[-1].size - self.search.target.size

    def _allowed(self, settings: Array) -> Array:
        return settings[TOLERANCES : TOLERANCES + self._count()]

    def _attempt(self, given: Array, x: Array, times: int) -> Array:
        """Memory after the last step of an attempt, which ends when the target is found or progress stops."""
        passed = np.concatenate([x, np.broadcast_to(self.search.begins, (len(x), len(self.search.begins)))], axis=1)
        rows = np.arange(len(x))
        for _ in range(times):
            x, passed[rows] = self.kernel(x, x, passed[rows], given[rows])
            goes = passed[rows, -1] > 0.0
            rows, x = rows[goes], x[goes]
            if not len(rows):
                break
        return passed


def _goes_on(there: Array) -> Array:
    """Mask of searches to continue: neither found nor invalid."""
    return np.asarray(~((there < 0) | (there > 0)))


# ── A scan on whole arrays, one NumPy kernel call per step: fallback without a compiler, and reference for tests


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
        single = all(np.can_cast(np.asarray(a).dtype, np.float32) for a in args)
        dtype: Any = np.float32 if single else np.float64
        given = [np.asarray(a, dtype) for a in args[r.visible :]]
        axes = [a.ndim - 1 - len(port.shape) for a, port in zip(given, r.inputs[r.visible :], strict=True)]
        batch = np.broadcast_shapes(
            *(o.shape[: o.ndim - 1 - len(p.shape)] for o, p in zip(out, r.outputs, strict=True))
        )
        state = [np.broadcast_to(np.asarray(a, dtype), (*batch, *np.shape(a)[-1:])) for a in args[: r.visible]]
        state += [np.zeros((*batch, *port.shape), dtype) for port in r.states[r.visible :]]
        kept = out[0].shape[len(batch)]
        every = given[0].shape[axes[0]] // max(kept, 1)
        for row in range(kept):
            for between in range(every):
                number = row * every + between
                now = dict(zip(r.given, (np.take(a, number, k) for a, k in zip(given, axes, strict=True)), strict=True))
                begin = list(state)
                for stage, coefficients in enumerate(r.table):
                    found = self.kernel(
                        *(
                            self._input(k, s, now, state, begin, np.array(coefficients, dtype))
                            for k, s in enumerate(r.sources)
                        )
                    )
                    state = list(found[: len(r.states)])
                    if stage == 0 and between == 0:
                        for k, result in zip(r.reported, out[r.visible :], strict=True):
                            result[..., row, :] = found[k]
            for result, x in zip(out, state[: r.visible], strict=False):
                result[..., row, :] = x
        return out

    @staticmethod
    def _input(
        k: int, source: Source, now: dict[int, Array], state: list[Array], begin: list[Array], row: Array
    ) -> Any:
        if source.kind == "given":
            return now[k]
        if source.kind == "stage":
            return row
        return begin[source.state] if source.kind == "start" else state[source.state]


# ── Any form on whole arrays, without a compiler or for programs too long for it


def on_numpy(form: Form, name: str, doc: str) -> Any:
    """Equivalent of the compiled ufunc of a form."""
    if isinstance(form, Program):
        return NumpyKernel(form, name, doc)
    if isinstance(form, Products):
        return NumpyProducts(form, name, doc)
    if isinstance(form, ColumnSolve):
        return NumpyColumns(form, name, doc)
    return NumpySteps(form, name, doc) if isinstance(form, Scan) else NumpySearch(form, name, doc)
