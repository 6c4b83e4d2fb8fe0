"""Engine: traces, compiles, caches and calls the kernels of one model."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, partial
from itertools import compress
from typing import TYPE_CHECKING, Any

import numpy as np

from ..compiler.runtime import batch_threads
from ..compiler.runtime.interpreter import compiles
from ..core import arguments, third_party
from ..core.errors import KernelError, ShapeError, SingularMassMatrixError, ValueRangeError
from ..core.typing import Array
from .arguments import Wrenches, input_name, is_symbolic, misfit, numbers, sum_by_frame, to_numbers
from .kernels.disk_cache import CachedModel, kernel_key
from .kernels.out_checks import refuse_overlap, refuse_text, unfit

if TYPE_CHECKING:
    from ..compiler.ir.loops import Form
    from ..compiler.ir.program import Program
    from ..compiler.runtime.dispatch import CallSignature
    from ..mechanics.model.model import Model

Options = Mapping[str, Any]

LARGEST_COMPILED = 1_000_000
"""Largest number of instructions that is compiled; longer programs run on NumPy. Compilation costs about 0.02 to 0.1 ms
per instruction (bench/NOTES.md), at most two minutes; the regressor of a chain of 100 links has 800,000
instructions."""


def _model_of(source: Model | CachedModel) -> Model:
    """Model itself, or the model of a cached robot, read from its file at first use."""
    if isinstance(source, CachedModel):
        return source.model
    return source


def execution_form(model: Model, names: Sequence[str], options: Options) -> Form:
    """Program of the named quantities in the form that runs fastest: straight line or loops."""
    from .kernels.large_robots import columns_of, products_of
    from .kernels.options import options_by_quantity
    from .programs import program_of_several

    options_of_names = options_by_quantity(model, names, options)
    form: Form | None = products_of(model, options_of_names)
    if form is None:
        form = columns_of(model, options_of_names)
    if form is None:
        form = program_of_several(model, options_of_names)
    return form


def ports_text(program: Form) -> str:
    """Sentences that list a program's inputs and outputs, for the docstring of its kernel."""
    inputs = ", ".join(port.name for port in program.inputs)
    outputs = ", ".join(port.name for port in program.outputs)
    return f"Inputs: {inputs}. Outputs: {outputs}."


def compile_form(form: Form, name: str, doc: str, *, scalar: bool = False) -> Any:
    """Compiled program as a NumPy ufunc; a NumPy function if the program is too long or cannot be compiled.

    If ``scalar`` is true, the kernel evaluates one sample at a time.
    """
    from ..compiler.ir.loops import program_of

    program = program_of(form)
    # NumPy ufuncs do not support axes without elements, which occur if every joint is locked. Compiled loops copy
    # samples of at most three axes, but second derivatives of matrices have four.
    ports = [*program.inputs, *program.outputs]
    has_unsupported_shape = any(port.size == 0 or len(port.shape) > 3 for port in ports)
    is_too_long = len(program.instructions) > LARGEST_COMPILED
    if has_unsupported_shape or is_too_long or not compiles():
        from ..compiler.lowering.numpy_kernels import on_numpy

        return on_numpy(form, name, doc)
    from ..compiler.runtime.gufunc import make_ufunc

    return make_ufunc(form, name, doc, scalar=scalar)


# A robot has one engine, ``robot.engine``: the only part of a robot that other modules use directly.

_MIN_NULL_COMPONENT = 0.1
"""Component of a joint in a null direction of the mass matrix above which the joint is named."""
_MAX_NULL_EIGENVALUE = 1e-13
"""Eigenvalue of the scaled mass matrix, for each velocity, up to which it is a rounding error of zero."""

DirectCallOffer = Callable[[str, Any, "CallSignature", int], bool]
"""Callback for repeated calls: (name, kernel, call signature, number of calls) → True to stop counting."""

COUNTING_STOPPED = -1
"""Value in place of a number of calls that is no longer counted."""


class Engine:
    """Programs and kernels of one model, each created once, and calls of them.

    An engine is pickled as its model; machine code is compiled again after unpickling.
    """

    def __init__(
        self, model: Model | CachedModel, offer_reference: Callable[[], DirectCallOffer | None] | None = None
    ) -> None:
        self._model_source = model
        self._kernels: dict[Any, Any] = {}
        self._offer_reference = offer_reference
        """Weak reference to the callback that is offered repeated calls with one state."""
        self.single_poses: dict[Any, Any] = {}
        """Inverse-kinematics searches for single poses, by options."""
        self._called_kernels: dict[Any, Any] = {}
        """Kernels by the name of the quantity, or by (name, values of the options)."""
        self._call_counts: dict[Any, int] = {}
        """Number of calls with one state, by call signature; :data:`COUNTING_STOPPED` if no longer counted."""

    def __getstate__(self) -> Model:
        return self.model

    def __setstate__(self, model: Model) -> None:
        type(self).__init__(self, model)

    @cached_property
    def model(self) -> Model:
        """Model of the robot; of a cached robot, read from its file at first use."""
        return _model_of(self._model_source)

    def program(self, names: Sequence[str], options: Options) -> Program:
        """Straight-line program of the named quantities."""
        from .kernels.options import options_by_quantity
        from .programs import program_of_several

        return program_of_several(self.model, options_by_quantity(self.model, names, options))

    def kernel(self, names: Sequence[str], options: Options) -> Any:
        """Compiled function of the named quantities; raises UnknownNameError, KernelError, SingularMassMatrixError."""
        cache_key = ""  # of the disk; empty without one
        model_source = self._model_source
        if isinstance(model_source, CachedModel) and compiles():
            cache_key = kernel_key(model_source.key, names, options)
        if not cache_key:
            return self._build(names, options)
        if cache_key not in self._kernels:
            from ..compiler.runtime.gufunc import load_ufunc, store_ufunc

            # The kernel keeps this function. It must not refer to the engine, which would be a reference cycle.
            kernel = load_ufunc(cache_key, lambda: execution_form(_model_of(model_source), names, options))
            if kernel is None:
                kernel = self._build(names, options)
                store_ufunc(cache_key, kernel)
            self._kernels[cache_key] = kernel
        return self._kernels[cache_key]

    def _build(self, names: Sequence[str], options: Options) -> Any:
        """Trace and compile a kernel, without cache."""
        from .kernels.large_robots import LapackDerivatives, needs_lapack
        from .kernels.options import options_by_quantity
        from .quantities import QUANTITIES

        options_of_names = options_by_quantity(self.model, names, options)
        key = tuple((name, *quantity_options.items()) for name, quantity_options in options_of_names.items())
        if key in self._kernels:
            return self._kernels[key]
        if any(QUANTITIES[name].needs_inverse for name in options_of_names):
            self.require_invertible()
        if needs_lapack(self.model, options_of_names):
            kernel: Any = LapackDerivatives(self, options)
        else:
            form = execution_form(self.model, names, options)
            title = ", ".join(options_of_names)
            kernel = compile_form(form, title, f"{title} of {self.model.name}, compiled. {ports_text(form)}")
        self._kernels[key] = kernel
        return kernel

    def cache(self, key: Any, make: Callable[[], Any]) -> Any:
        """Return the result of ``make``, called once for each ``key``, such as the kernel of a rollout."""
        if key not in self._kernels:
            self._kernels[key] = make()
        return self._kernels[key]

    def require_invertible(self) -> None:
        """Raise SingularMassMatrixError, naming the joints, if M has no inverse at a generic configuration."""
        from ..mechanics.model.configurations import random_configuration

        if self.model.nv == 0:
            return
        q = random_configuration(self.model, np.random.default_rng(0), ())
        M = self.reference("mass_matrix", (q,), {})
        joint_of_velocity: list[str] = []
        for body in self.model.leaders:
            joint_of_velocity += [body.joint.name] * body.joint.nv
        # With ones on its diagonal, M is compared without regard to the joints' units.
        diagonal = np.abs(np.diagonal(M))
        root_diagonal = np.sqrt(diagonal)
        scale = np.where(root_diagonal > 0, root_diagonal, 1.0)
        eigenvalues, eigenvectors = np.linalg.eigh(M / np.outer(scale, scale))
        is_null = np.abs(eigenvalues) <= _MAX_NULL_EIGENVALUE * self.model.nv
        if not is_null.any():
            return
        largest_components = np.abs(eigenvectors[:, is_null]).max(axis=1)  # of each velocity
        massless_joints = compress(joint_of_velocity, largest_components > _MIN_NULL_COMPONENT)
        massless = dict.fromkeys(massless_joints)  # each once
        raise SingularMassMatrixError(
            f"the mass matrix of robot {self.model.name!r} has no inverse: joints {', '.join(massless)} move nothing with "
            "inertia of its own. Lock them (robot.lock), give their links mass, or use inverse dynamics, which needs no "
            "inverse."
        )

    def reference(self, name: str, arrays: Sequence[Any], options: Options) -> Any:
        """Quantity evaluated by its algorithm on floats or symbols, at one state."""
        from .kernels.options import checked_options
        from .programs import evaluate_quantity, inputs_of
        from .quantities import QUANTITIES

        all_options = checked_options(self.model, name, options)
        if "derivative" in all_options:
            raise KernelError(f"reference {name}: algorithms have no by=; kernel({name!r}, by=…) has.")
        is_traced = is_symbolic(arrays)
        quantity = QUANTITIES[name]
        inputs = list(map(np.asarray, to_numbers(self.model, name, arrays, options)))
        if not is_traced:
            input_by_label = {f"input {k}": array for k, array in enumerate(inputs, start=1)}
            inputs = numbers(f"reference {name}", {}, **input_by_label)
        ports = inputs_of(self.model, name, all_options)
        if len(inputs) != len(ports):
            input_names = ", ".join(input_name(label) for label, _ in ports)
            raise ShapeError(f"reference {name}: {len(inputs)} arrays given, {input_names} wanted.")
        for (label, shape), array in zip(ports, inputs, strict=True):
            if array.shape != shape:
                raise ShapeError(f"reference {name}: {label} has shape {array.shape}, one state has {shape}.")
        try:
            object_inputs = [array.astype(object) for array in inputs]
            with np.errstate(divide="raise"):
                result = evaluate_quantity(quantity, self.model, object_inputs, all_options)
            if is_traced:
                return result
        except (ZeroDivisionError, FloatingPointError):
            raise ValueRangeError(
                f"reference {name}: a matrix to be inverted is singular at this state. The method of that name goes on."
            ) from None
        if isinstance(result, tuple):
            return tuple(np.asarray(x, float) for x in result)
        return np.asarray(result, float)

    def call(self, name: str, *arrays: Any, out: Any = None, **options: Any) -> Any:
        """Quantity for arrays of any batch shape, by its kernel; for symbols by the algorithm, for Dask arrays later."""
        for array in arrays:
            if type(array) is not np.ndarray:
                arrays = arguments.of_plain(arrays) or to_numbers(self.model, name, arrays, options)
                if any(map(third_party.is_lazy, arrays)):
                    return self._evaluate_later(name, arrays, out, options)
                break
        key = (name, *options.values()) if options else name
        try:
            kernel = self._called_kernels.get(key)
        except TypeError:  # unhashable option: self.kernel() below raises the specific error
            kernel = None
        if kernel is None:
            if is_symbolic(arrays):
                return self.reference(name, arrays, options)
            kernel = self.kernel((name,), options)
            self._called_kernels[key] = kernel
        if (arrays[0].ndim < 2 or len(arrays[0]) == 1) and "wrenches" not in options:  # one state
            self._count_call(name, arrays, options)
        if isinstance(out, tuple):
            refuse_overlap(name, out)
        try:
            if out is not None:
                refuse_text(out)
            return batch_threads.call(kernel, arrays, out)
        except (TypeError, ValueError) as call_error:
            if is_symbolic(arrays):
                return self.reference(name, arrays, options)
            if third_party.is_asking_for_type():
                return _empty_results(kernel, arrays)
            error = misfit(self.model, name, arrays, options) or call_error
            if error is call_error and out is not None:  # the inputs fit
                error = unfit(name, out, self.program((name,), options), arrays)
            raise error from None

    def call_with_wrenches(
        self,
        name: str,
        arrays: tuple[Any, ...],
        by_robot: Wrenches | None,
        on_robot: Wrenches | None,
        out: Any = None,
        **options: Any,
    ) -> Any:
        """Quantity with wrenches by and on the robot as further inputs of the kernel."""
        if by_robot is None and on_robot is None:
            return self.call(name, *arrays, out=out, **options)
        total = sum_by_frame(self.model, arrays, by_robot, on_robot)
        if not total:
            return self.call(name, *arrays, out=out, **options)
        return self.call(name, *arrays, *total.values(), out=out, **options, wrenches=tuple(total))

    def _count_call(self, name: str, arrays: Sequence[Array], options: Options) -> None:
        """Count a call with one state; from the second call on, offer such calls to a builtin that replaces the method."""
        first_array = arrays[0]
        batch_shape = first_array.shape[:-1]
        type_char = first_array.dtype.char
        array_kind = (batch_shape, type_char)
        key = (name, *options.values()), array_kind
        earlier_calls = self._call_counts.get(key, 0)
        if earlier_calls == COUNTING_STOPPED or self._offer_reference is None:
            return
        if type_char not in "df" or batch_shape not in ((), (1,)):
            return
        offer = self._offer_reference()
        if offer is None or any((a.shape[:-1], a.dtype.char) != array_kind for a in arrays):
            return
        if earlier_calls == 0:  # a single call is not worth the setup
            self._call_counts[key] = 1
            return
        from ..compiler.runtime.dispatch import CallSignature

        kernel_key_of_call = (name, *options.values()) if options else name
        kernel = self._called_kernels[kernel_key_of_call]
        signature = CallSignature(tuple(options.items()), batch_shape, type_char)
        call_count = earlier_calls + 1
        is_settled = offer(name, kernel, signature, call_count)
        self._call_counts[key] = COUNTING_STOPPED if is_settled else call_count

    def _evaluate_later(self, name: str, arrays: Sequence[Any], out: Any, options: Options) -> Any:
        """Evaluate a quantity on Dask arrays; results are Dask arrays, computed later."""
        signature = self.kernel((name,), options).signature
        shape_error = misfit(self.model, name, arrays, options)
        if shape_error is not None:
            raise shape_error
        if out is not None:
            raise ShapeError(
                f"{name}: out= is for results that are computed now, and those of Dask arrays are computed later. Leave it out."
            )
        return third_party.later(partial(_call_engine, self, name, options), str(signature), arrays)


def _call_engine(engine: Engine, name: str, options: Options, *arrays: Array) -> Any:
    """Quantity of NumPy arrays; a function of the module, which can be sent to other processes."""
    return engine.call(name, *arrays, **options)


def _empty_results(kernel: Any, arrays: Sequence[Array]) -> Any:
    """Empty results with the type and rank that follow from the types and ranks of the inputs."""
    max_rank = max(array.ndim for array in arrays)
    batch_shape = (0,) * (max_rank - 1)
    dtype: Any = np.float64
    if all(np.can_cast(a.dtype, np.float32) for a in arrays):
        dtype = np.float32
    results: list[Array] = []
    _, _, output_signature = kernel.signature.partition("->")
    for axes in re.findall(r"\(([^)]*)\)", output_signature):  # "6,6" for a matrix, "" for a number
        rank = len(axes.split(",")) if axes else 0
        results.append(np.empty(batch_shape + (0,) * rank, dtype))
    if len(results) == 1:
        return results[0]
    return tuple(results)


class ConstrainedEngine(Engine):
    """Engine of a robot with constraints: kernels of its open tree, with the constraints filled in as an option.

    A quantity that constraints change raises KernelError, unless a quantity with constraints is requested beside it.
    """

    def __init__(self, tree: Engine, constraints: tuple[Any, ...]) -> None:
        super().__init__(tree._model_source)
        self._tree = tree
        self._constraints = constraints

    def __getstate__(self) -> Any:
        return self._tree, self._constraints

    def __setstate__(self, state: Any) -> None:
        type(self).__init__(self, *state)

    def program(self, names: Sequence[str], options: Options) -> Program:
        """Straight-line program of the named quantities."""
        return self._tree.program(names, self._with_constraints(names, options))

    def kernel(self, names: Sequence[str], options: Options) -> Any:
        """Compiled function of the named quantities."""
        return self._tree.kernel(names, self._with_constraints(names, options))

    def reference(self, name: str, arrays: Sequence[Any], options: Options) -> Any:
        """Quantity evaluated by its algorithm at one state."""
        return self._tree.reference(name, arrays, self._with_constraints((name,), options))

    def _with_constraints(self, names: Sequence[str], options: Options) -> Options:
        """Options with the constraints; raises KernelError for quantities that they change."""
        from .kernels.options import options_of
        from .quantities import QUANTITIES

        for name in names:
            if "constraints" in options_of(name):
                return {"constraints": self._constraints, **options}
        changed_quantities = [name for name in names if QUANTITIES[name].constrained != "as is"]
        if changed_quantities:
            raise KernelError(
                f"{', '.join(changed_quantities)}: not available for a robot with constraints. For the robot with its "
                "loops open: robot.open()."
            )
        return options
