"""From a question to machine code: options are checked, a program is traced, a kernel compiled, kept, and called.

A robot has one engine, ``robot.engine``. All that is built on robots asks it, and reaches for nothing else inside a robot.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core import arguments, lazy
from ..errors import KernelError, ShapeError, SingularMassMatrixError, ValueRangeError
from ..kernels import threads
from ..kernels.interpreter import compiles
from ..typing import Array
from . import kept_robots
from .out_argument import refuse_lazy, refuse_overlap, refuse_text, unfit
from .state_arguments import brought, is_symbolic, misfit, numbers
from .wrench_arguments import by_frame

if TYPE_CHECKING:
    from ..kernels.call_form import CallForm
    from ..model.model import Model
    from ..program.forms import Form
    from ..program.program import Program
    from .wrench_arguments import Wrenches

Options = Mapping[str, Any]
CalledAgain = Callable[[str, Any, "CallForm", int], bool]
"""Takes the name and the kernel of a quantity, what was asked for, and how often; says whether it knows enough."""

ENOUGH = -1

LARGEST_COMPILED = 1_000_000
"""Programs beyond this many instructions run on NumPy. Compiling takes some 0.02 to 0.1 ms an instruction (bench/NOTES.md), so
two minutes at most; the regressor of a chain of 100 links has 800,000."""


class Engine:
    """The programs and kernels of one model. It pickles as the model: machine code is made again where it arrives."""

    def __init__(
        self,
        model: Model | Callable[[], Model],
        called_again: Callable[[], CalledAgain | None] | None = None,
        origin: str = "",
    ) -> None:
        self._model = model
        self._origin = origin
        """The key of what was kept of the robot's file; empty where nothing is."""
        self._called_again = called_again
        """Gives whom to tell of calls with one state."""
        self._kernels: dict[Any, Any] = {}
        self.single_poses: dict[Any, Any] = {}
        """How single poses are looked for, by the options."""
        self._called: dict[Any, Any] = {}
        self._calls: dict[Any, int] = {}
        """How often each kind of call was made with one state; :data:`ENOUGH` where nobody wants to know any more."""

    def __getstate__(self) -> Model:
        return self.model

    def __setstate__(self, model: Model) -> None:
        self.__init__(model)  # type: ignore[misc]

    @cached_property
    def model(self) -> Model:
        """The model; of a robot that was kept, read from its file when first asked for."""
        return self._model() if callable(self._model) else self._model

    # ── programs and kernels ──

    def program(self, names: Sequence[str], options: Options) -> Program:
        """One straight-line program of the quantities named."""
        from .quantity_options import wanted
        from .quantity_programs import program_of_several

        return program_of_several(self.model, wanted(self.model, names, options))

    def kernel(self, names: Sequence[str], options: Options) -> Any:
        """One compiled function of the quantities named; raises UnknownNameError, KernelError, SingularMassMatrixError."""
        key = kept_robots.kernel_key(self._origin, names, options) if compiles() else ""
        if not key:
            return self._made(names, options)
        if key not in self._kernels:
            found = kept_robots.kernel(key, lambda: self._form(names, options))
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
            program, title = self._form(names, options), ", ".join(asked)
            inputs, outputs = (", ".join(port.name for port in ports) for ports in (program.inputs, program.outputs))
            doc = f"{title} of {self.model.name}, compiled. Inputs: {inputs}. Outputs: {outputs}."
            found = compiled(program, title, doc)
        self._kernels[key] = found
        return found

    def _form(self, names: Sequence[str], options: Options) -> Form:
        """The program of the quantities named, with the loop that serves it best."""
        from . import column_loops, long_robots
        from .quantity_options import wanted
        from .quantity_programs import program_of_several

        asked = wanted(self.model, names, options)
        looped: Form | None = long_robots.products_of(self.model, asked) or column_loops.columns_of(self.model, asked)
        return looped or program_of_several(self.model, asked)

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

    # ── calls ──

    def call(self, name: str, *arrays: Any, out: Any = None, **options: Any) -> Any:
        """A quantity of arrays of any batch shape, by its kernel; of symbols, by its algorithm; of Dask arrays, later."""
        for array in arrays:
            if type(array) is not np.ndarray:
                arrays = arguments.of_plain(arrays) or brought(self.model, name, arrays, options)
                if any(map(lazy.is_lazy, arrays)):
                    return self._later(name, arrays, out, options)
                break
        key = (name, *options.values()) if options else name
        try:
            kernel = self._called.get(key)
        except TypeError:  # an option nothing can be kept under; kernel() says what is wrong with it
            kernel = None
        if kernel is None:
            if is_symbolic(arrays):
                return self.reference(name, arrays, options)
            kernel = self.kernel((name,), options)
            self._called[key] = kernel
        if (arrays[0].ndim < 2 or len(arrays[0]) == 1) and "wrenches" not in options:
            self._note(name, arrays, options)
        if isinstance(out, tuple):
            refuse_overlap(name, out)
        try:
            if out is not None:
                refuse_text(out)
            return threads.call(kernel, arrays, out)
        except (TypeError, ValueError) as problem:
            if is_symbolic(arrays):
                return self.reference(name, arrays, options)
            if lazy.is_asking_for_type():
                return _of_type(kernel, arrays)
            explained = misfit(self.model, name, arrays, options) or problem
            if explained is problem and out is not None:
                explained = unfit(name, out, self.program((name,), options), arrays)
            raise explained from None

    def call_with_wrenches(
        self,
        name: str,
        arrays: tuple[Any, ...],
        by_robot: Wrenches | None,
        on_robot: Wrenches | None,
        out: Any = None,
        **options: Any,
    ) -> Any:
        """The same with the wrenches by and on the robot, which are further inputs of the kernel."""
        if by_robot is None and on_robot is None:
            return self.call(name, *arrays, out=out, **options)
        total = by_frame(self.model, arrays, by_robot, on_robot)
        if not total:
            return self.call(name, *arrays, out=out, **options)
        whole, options = (*arrays, *total.values()), {**options, "wrenches": tuple(total)}
        found = self.call(name, *whole, out=out, **options)
        if all(type(array) is np.ndarray for array in whole) and not (by_robot and on_robot):
            self._note(name, whole, options, "wrench_by_robot" if by_robot else "wrench_on_robot")
        return found

    def _note(self, name: str, arrays: Sequence[Array], options: Options, wrenches: str = "") -> None:
        """Count a call with one state, and tell it to who may put something faster in front of the next of its kind.

        ``wrenches``: the argument they were given as.
        """
        from ..kernels.call_form import CallForm

        first = arrays[0]
        kind = batch, char = first.shape[:-1], first.dtype.char
        key = name, *options.values()
        calls = self._calls.get((key, wrenches, kind), 0)
        if calls == ENOUGH or self._called_again is None or char not in "df" or batch not in ((), (1,)):
            return
        if (tell := self._called_again()) is None or any((a.shape[:-1], a.dtype.char) != kind for a in arrays):
            return
        rest = tuple((option, value) for option, value in options.items() if option != "wrenches")
        asked = CallForm(rest, wrenches, options.get("wrenches", ()), wrenches == "wrench_on_robot", batch, char)
        kernel = self._called[key if options else name]
        self._calls[key, wrenches, kind] = ENOUGH if tell(name, kernel, asked, calls + 1) else calls + 1

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

    def _later(self, name: str, arrays: Sequence[Any], out: Any, options: Options) -> Any:
        """The quantity of Dask arrays: Dask arrays of the results, computed when asked for."""
        signature = self.kernel((name,), options).signature
        if (problem := misfit(self.model, name, arrays, options)) is not None:
            raise problem
        refuse_lazy(name, out)
        return lazy.later(partial(_now, self, name, options), str(signature), arrays)


def _now(engine: Engine, name: str, options: Options, *arrays: Array) -> Any:
    """A quantity of NumPy arrays; a function that travels to other processes."""
    return engine.call(name, *arrays, **options)


def _of_type(kernel: Any, arrays: Sequence[Array]) -> Any:
    """Results of the type and rank that arrays of these types and ranks give, of no samples."""
    batch = (0,) * (max(a.ndim for a in arrays) - 1)
    dtype: Any = np.float32 if all(np.can_cast(a.dtype, np.float32) for a in arrays) else np.float64
    cores = [core.count(",") + bool(core) for core in re.findall(r"\(([^)]*)\)", kernel.signature.partition("->")[2])]
    found = tuple(np.empty(batch + (0,) * rank, dtype) for rank in cores)
    return found if len(found) > 1 else found[0]


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
