"""What a traced function's derivatives are: by which inputs, in which form, and along which directions each input moves.

The bridge between `program.differentiate`, which knows expressions, and configurations, which know robot.add.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..algorithms.coordinate_rates import brackets, moving_parts
from ..errors import KernelError, UnknownNameError
from ..model.model import Model
from ..program import autodiff
from ..program.expr import Expr
from ..program.trace import Trace
from ..typing import Array

Shape = tuple[int, ...]

FORMS = ("jacobian", "along", "weighted", "hessian", "hessian_along")
"""∂f/∂x; (∂f/∂x) v; ∂(w·f)/∂x; ∂²f/∂x²; ∂²(w·f)/∂x² v."""
MODES = ("auto", "forward", "reverse")
LARGEST_RESULT = 500_000
LARGEST_WORK = 2_000_000
"""Numbers that may come out of one kernel, and operations it may take: beyond, tracing takes minutes."""


@dataclass(frozen=True)
class Derivative:
    """A derivative that was asked for, checked."""

    by: tuple[str, ...]
    form: str = "jacobian"
    mode: str = "auto"
    values: bool = False
    """Whether the function's own results come first."""

    @classmethod
    def of(cls, what: str, inputs: Sequence[str], by: Any, form: Any, mode: Any, values: Any) -> Derivative:
        """By names of ``inputs``; raises UnknownNameError and KernelError. ``what`` is the function's name."""
        names = (by,) if isinstance(by, str) else tuple(by) if isinstance(by, Sequence) else ()
        if not names:
            raise KernelError(f"{what}: by={by!r} names no input. Name one or several of {', '.join(inputs)}.")
        for name in names:
            if name not in inputs:
                raise UnknownNameError.of(f"input of {what}", name, inputs)
        if len(set(names)) < len(names):
            raise KernelError(f"{what}: an input is named twice in by={names}. Name each once.")
        for label, given, allowed in (("form", form, FORMS), ("mode", mode, MODES)):
            if given not in allowed:
                raise UnknownNameError.of(f"{label} of a derivative", given, allowed)
        if mode != "auto" and form not in ("jacobian", "hessian"):
            raise KernelError(f"{what}: form={form!r} has one way to compute it; leave mode={mode!r} out.")
        return cls(names, form, mode, bool(values))

    @property
    def weighs(self) -> bool:
        """Whether results are summed up by weights."""
        return self.form in ("weighted", "hessian_along")

    def inputs(self, charts: Mapping[str, Shape], outputs: Mapping[str, Shape]) -> dict[str, Shape]:
        """What goes in besides: the weights of the results and the direction; ``charts``: shapes of directions by input."""
        more: dict[str, Shape] = {}
        if self.weighs and list(outputs.values()) != [()]:  # one number is its own sum
            more.update({f"weight on {name}": shape for name, shape in outputs.items()})
        if self.form in ("along", "hessian_along"):
            more.update({f"along {name}": charts[name] for name in self.by})
        return more

    def outputs(self, names: Sequence[str]) -> list[str]:
        """Names of what comes out."""
        if self.form == "jacobian":
            found = [f"{out}_by_{name}" for out in names for name in self.by]
        elif self.form == "along":
            found = [f"{out}_along" for out in names]
        elif self.form == "hessian":
            found = [f"{out}_hessian" for out in names]
        else:
            found = [f"{self.form}_by_{name}" for name in self.by]
        return [*(names if self.values else ()), *found]

    def of_results(
        self, what: str, results: Sequence[Any], charts: Mapping[str, Chart], more: Mapping[str, Any]
    ) -> tuple[Array, ...]:
        """The derivatives of arrays of symbols or numbers, as :meth:`outputs` names them; ``more``: by :meth:`inputs`."""
        joined = Chart.joined([charts[name] for name in self.by])
        sizes = [math.prod(charts[name].shape) for name in self.by]
        symbols = (e for part in (joined.known, *(np.ravel(r) for r in results)) for e in part if isinstance(e, Expr))
        owner = next((e.trace for e in symbols), None) or Trace()
        results = [np.asarray(result, object) for result in results]
        flat = [owner.lift(e) for result in results for e in result.reshape(-1)]
        given = [x for name, x in more.items() if name.startswith("weight on ")]
        weights = [e for x in given for e in np.reshape(x, -1)] if given else [1.0]
        direction = [e for name, x in more.items() if name.startswith("along ") for e in np.reshape(x, -1)]
        self._check_size(what, flat, joined)
        if self.form == "along":
            rates = iter(autodiff.along(flat, joined.known, direction))
            found = [_filled(result.shape, [next(rates) for _ in range(result.size)]) for result in results]
        elif self.form in ("jacobian", "hessian"):
            J = autodiff.jacobian(flat, joined.known, sum(sizes), self.mode)
            whole = J if self.form == "jacobian" else _hessian(J, joined)
            found, first = [], 0
            for result in results:
                rows = whole[first : first + result.size]
                first += result.size
                if self.form == "hessian":
                    found.append(rows.reshape((*result.shape, *rows.shape[1:])))
                    continue
                parts = np.split(rows, np.cumsum(sizes)[:-1], axis=1)
                found += [
                    part.reshape((*result.shape, *charts[n].shape)) for n, part in zip(self.by, parts, strict=True)
                ]
        else:
            total = autodiff.gradient(flat, weights, joined.known, sum(sizes))
            if self.form == "hessian_along":
                total = _hessian_along(total, joined, direction)
            parts = np.split(total, np.cumsum(sizes)[:-1])
            found = [part.reshape(charts[n].shape) for n, part in zip(self.by, parts, strict=True)]
        return (*(results if self.values else ()), *found)

    def _check_size(self, what: str, flat: Sequence[Expr], chart: Chart) -> None:
        n, rows = math.prod(chart.shape), len(flat)
        size = {"jacobian": rows * n, "hessian": rows * n * n}.get(self.form, 0)
        advice = "Differentiate fewer results, by fewer inputs, or along a direction: form='along' or 'weighted'."
        if size > LARGEST_RESULT:
            raise KernelError(
                f"{what}: its {self.form} has {size} numbers, more than the {LARGEST_RESULT} one kernel may give. {advice}"
            )
        if size:
            counted = autodiff.work(flat, chart.known)
            effort = min(counted) if self.mode == "auto" else getattr(counted, self.mode)
            effort *= n if self.form == "hessian" else 1
            if effort > LARGEST_WORK:
                raise KernelError(
                    f"{what}: its {self.form} takes some {effort} operations, more than the {LARGEST_WORK} one kernel may "
                    f"take. {advice}"
                )


@dataclass(frozen=True)
class Chart:
    """How an input moves along its directions, of that shape: what is known of the derivatives of expressions."""

    shape: Shape
    known: autodiff.Known
    brackets: Array | None = None
    """c with [a, b] = Σ c_abd d, where directions do not commute."""

    @classmethod
    def of(cls, x: Any, model: Model | None = None) -> Chart:
        """Each entry of x is a direction; of a robot's q, that of ``model``, each velocity, along robot.add."""
        if model is None:
            return cls(np.shape(x), {e: {k: e.trace.one} for k, e in enumerate(np.reshape(x, -1))})
        known: dict[Expr, dict[int, Expr]] = {}
        for part, slope in moving_parts(model, x):
            for e, row in zip(part.reshape(-1), slope.reshape(part.size, model.nv), strict=True):
                slopes = {k: e.trace.lift(d) for k, d in enumerate(row)}
                known[e] = {k: d for k, d in slopes.items() if d is not e.trace.zero}
                if e.op == "sub":  # the trace turns its operands round to negate it
                    known[-e] = {k: -d for k, d in known[e].items()}
        c = brackets(model)
        return cls((model.nv,), known, c if c.any() else None)

    @classmethod
    def joined(cls, charts: Sequence[Chart]) -> Chart:
        """Several inputs as one, their directions one after another."""
        n, first = sum(math.prod(chart.shape) for chart in charts), 0
        known: dict[Expr, dict[int, Expr]] = {}
        c = np.zeros((n, n, n)) if any(chart.brackets is not None for chart in charts) else None
        for chart in charts:
            last = first + math.prod(chart.shape)
            known.update({e: {first + k: d for k, d in row.items()} for e, row in chart.known.items()})
            if c is not None and chart.brackets is not None:
                c[first:last, first:last, first:last] = chart.brackets
            first = last
        return cls((n,), known, c)


# Twice along robot.add is, with L_a the derivative along a, L_b L_a f: the derivative along b of the gradient's entry a. It is
# not symmetric where directions do not commute: L_a L_b f - L_b L_a f = L_[a,b] f. Half of each is the second derivative of
# f(q ⊕ v) by v at v = 0, the exponential being even there: L_b L_a f + ½ L_[a,b] f.


def _hessian(J: Array, chart: Chart) -> Array:
    """Second derivatives from first ones (rows, n), symmetric; (rows, n, n)."""
    rows, n = J.shape
    H = np.full((rows, n, n), 0.0, object)
    for b in range(n):
        unit = [float(k == b) for k in range(n)]
        slopes = _filled((rows, b + 1), _along(J[:, : b + 1], chart, unit))
        for a in range(b + 1):
            turned = 0.0 if chart.brackets is None else 0.5 * (J @ chart.brackets[a, b].astype(object))
            H[:, a, b] = H[:, b, a] = slopes[:, a] + turned
    return H


def _hessian_along(gradient: Array, chart: Chart, direction: Sequence[Any]) -> Array:
    """The symmetric second derivative times the direction, from the gradient (n,); (n,)."""
    product = _filled(gradient.shape, _along(gradient, chart, direction))
    if chart.brackets is not None:
        for a, b, d in np.argwhere(chart.brackets):
            product[a] = product[a] + 0.5 * chart.brackets[a, b, d] * (direction[b] * gradient[d])
    return product


def _along(entries: Array, chart: Chart, direction: Sequence[Any]) -> list[Any]:
    """The derivatives of entries, some of which may be plain numbers, along a direction."""
    flat = entries.reshape(-1)
    places = [k for k, e in enumerate(flat) if isinstance(e, Expr)]
    found: list[Any] = [0.0] * flat.size
    for k, rate in zip(places, autodiff.along([flat[k] for k in places], chart.known, direction), strict=True):
        found[k] = rate
    return found


def _filled(shape: Shape, entries: Sequence[Any]) -> Array:
    """An object array; NumPy must not look into what is in it."""
    array = np.empty(math.prod(shape), object)
    array[:] = entries
    return array.reshape(shape)
