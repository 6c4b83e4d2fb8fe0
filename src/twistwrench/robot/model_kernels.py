"""The programs and kernels of one model: found as they were kept, or traced and compiled, on NumPy where they cannot be."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import KernelError, ShapeError, SingularMassMatrixError, ValueRangeError
from ..kernels.interpreter import compiles
from . import kept_robots
from .state_arguments import brought, is_symbolic, numbers

if TYPE_CHECKING:
    from ..model.model import Model
    from ..program.forms import Form
    from ..program.program import Program
    from .kept_robots import KeptModel

Options = Mapping[str, Any]

LARGEST_COMPILED = 1_000_000
"""Programs beyond this many instructions run on NumPy. Compiling takes some 0.02 to 0.1 ms an instruction (bench/NOTES.md), so
two minutes at most; the regressor of a chain of 100 links has 800,000."""


class ModelKernels:
    """The programs and kernels of one model, each made once."""

    def __init__(self, model: Model | KeptModel) -> None:
        self._given = model
        self._kernels: dict[Any, Any] = {}

    @cached_property
    def model(self) -> Model:
        """The model; of a robot that was kept, read from its file when first asked for."""
        return _model_of(self._given)

    def program(self, names: Sequence[str], options: Options) -> Program:
        """One straight-line program of the quantities named."""
        from .quantity_options import wanted
        from .quantity_programs import program_of_several

        return program_of_several(self.model, wanted(self.model, names, options))

    def kernel(self, names: Sequence[str], options: Options) -> Any:
        """One compiled function of the quantities named; raises UnknownNameError, KernelError, SingularMassMatrixError."""
        key, kept = "", self._given
        if isinstance(kept, kept_robots.KeptModel) and compiles():
            key = kept_robots.kernel_key(kept.key, names, options)
        if not key:
            return self._made(names, options)
        if key not in self._kernels:
            # What makes the program is held by the kernel, and must not hold what holds the kernel.
            found = kept_robots.kernel(key, lambda: form_of(_model_of(kept), names, options))
            if found is None:
                found = self._made(names, options)
                kept_robots.keep_kernel(key, found)
            self._kernels[key] = found
        return self._kernels[key]

    def _made(self, names: Sequence[str], options: Options) -> Any:
        """The same, traced and compiled here."""
        from . import large_derivatives
        from .quantities import QUANTITIES
        from .quantity_options import wanted

        asked = wanted(self.model, names, options)
        key = tuple((name, *full.items()) for name, full in asked.items())
        if key in self._kernels:
            return self._kernels[key]
        if any(QUANTITIES[name].needs_inverse for name in asked):
            self.require_invertible()
        if large_derivatives.applies(self.model, asked):
            found: Any = large_derivatives.LargeDerivatives(self, options)
        else:
            program, title = form_of(self.model, names, options), ", ".join(asked)
            inputs, outputs = (", ".join(port.name for port in ports) for ports in (program.inputs, program.outputs))
            doc = f"{title} of {self.model.name}, compiled. Inputs: {inputs}. Outputs: {outputs}."
            found = compiled(program, title, doc)
        self._kernels[key] = found
        return found

    def kept(self, key: Any, make: Callable[[], Any]) -> Any:
        """What ``make`` gives, made once for each ``key``: kernels of programs that are no quantity, such as rollouts."""
        if key not in self._kernels:
            self._kernels[key] = make()
        return self._kernels[key]

    def require_invertible(self) -> None:
        """Raise SingularMassMatrixError if M has no inverse at a generic configuration, naming the joints involved."""
        from ..model.configuration import random_configuration

        if self.model.nv == 0:
            return
        M = self.reference("mass_matrix", (random_configuration(self.model, np.random.default_rng(0), ()),), {})
        names = [b.joint.name for b in self.model.leaders for _ in range(b.joint.nv)]
        d = np.sqrt(np.abs(np.diagonal(M)))
        scale = np.where(d > 0, d, 1.0)
        values, vectors = np.linalg.eigh(M / np.outer(scale, scale))
        null = np.abs(values) <= 1e-13 * self.model.nv
        if not null.any():
            return
        lost = np.abs(vectors[:, null]).max(axis=1)
        guilty = list(dict.fromkeys(n for n, x in zip(names, lost, strict=True) if x > 0.1))
        raise SingularMassMatrixError(
            f"the mass matrix of robot {self.model.name!r} has no inverse: joints {', '.join(guilty)} move nothing with "
            "inertia of its own. Lock them (robot.lock), give their links mass, or use inverse dynamics, which needs no "
            "inverse."
        )

    def reference(self, name: str, arrays: Sequence[Any], options: Options) -> Any:
        """A quantity by its algorithm on floats or symbols, at one state."""
        from .quantities import QUANTITIES
        from .quantity_options import checked_options
        from .quantity_programs import evaluated, inputs_of

        full = checked_options(self.model, name, options)
        if "derivative" in full:
            raise KernelError(f"reference {name}: algorithms know no by=; kernel({name!r}, by=…) does.")
        traced = is_symbolic(arrays)
        quantity = QUANTITIES[name]
        given = [np.asarray(a) for a in brought(self.model, name, arrays, options)]
        if not traced:
            given = numbers(f"reference {name}", {}, **{f"input {k}": a for k, a in enumerate(given, start=1)})
        shapes = inputs_of(self.model, name, full)
        if len(given) != len(shapes):
            listed = ", ".join("wrench" if label.startswith("wrench at ") else label for label, _ in shapes)
            raise ShapeError(f"reference {name}: {len(given)} arrays given, {listed} wanted.")
        for (label, shape), array in zip(shapes, given, strict=True):
            if array.shape != shape:
                raise ShapeError(f"reference {name}: {label} has shape {array.shape}, one state has {shape}.")
        try:
            with np.errstate(divide="raise"):
                found = evaluated(quantity, self.model, [a.astype(object) for a in given], full)
            if traced:
                return found
        except (ZeroDivisionError, FloatingPointError):
            raise ValueRangeError(
                f"reference {name}: a matrix to be inverted is singular at this state. The method of that name goes on."
            ) from None
        return tuple(np.asarray(x, float) for x in found) if isinstance(found, tuple) else np.asarray(found, float)


def _model_of(given: Model | KeptModel) -> Model:
    return given.model if isinstance(given, kept_robots.KeptModel) else given


def form_of(model: Model, names: Sequence[str], options: Options) -> Form:
    """The program of the quantities named, with the loop that serves it best."""
    from . import column_loops, long_robots
    from .quantity_options import wanted
    from .quantity_programs import program_of_several

    asked = wanted(model, names, options)
    looped: Form | None = long_robots.products_of(model, asked) or column_loops.columns_of(model, asked)
    return looped or program_of_several(model, asked)


def compiled(given: Form, name: str, doc: str, *, lone: bool = False) -> Any:
    """A program, or steps of one, as a NumPy ufunc; on NumPy where it cannot be compiled, or is too long.

    What is ``lone`` is for one sample at a time.
    """
    from ..program.forms import program_of

    program = program_of(given)
    # NumPy's ufuncs cannot have an axis of no elements, as those of a robot with every joint locked; compiled loops copy
    # samples of three axes at most, and second derivatives of matrices have four.
    empty = any(port.size == 0 or len(port.shape) > 3 for port in [*program.inputs, *program.outputs])
    if empty or not compiles() or len(program.instructions) > LARGEST_COMPILED:
        from ..targets.numpy_forms import on_numpy

        return on_numpy(given, name, doc)
    from ..kernels.ufunc import make_ufunc

    return make_ufunc(given, name, doc, lone=lone)
