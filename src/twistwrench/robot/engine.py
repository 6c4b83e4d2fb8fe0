"""From a question to machine code: options are checked, a program is traced, a kernel compiled, kept, and called.

A robot has one engine, ``robot.engine``. All that is built on robots asks it, and reaches for nothing else inside a robot.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core import arguments, lazy
from ..kernels import threads
from ..typing import Array
from .model_kernels import ModelKernels, Options
from .out_argument import refuse_lazy, refuse_overlap, refuse_text, unfit
from .state_arguments import brought, is_symbolic, misfit
from .wrench_arguments import by_frame

if TYPE_CHECKING:
    from ..kernels.call_form import CallForm
    from ..model.model import Model
    from .kept_robots import KeptModel
    from .wrench_arguments import Wrenches

CalledAgain = Callable[[str, Any, "CallForm", int], bool]
"""Takes the name and the kernel of a quantity, what was asked for, and how often; says whether it knows enough."""

ENOUGH = -1


class Engine(ModelKernels):
    """The programs and kernels of one model, and calls of them. It pickles as the model: machine code is made again there."""

    def __init__(self, model: Model | KeptModel, called_again: Callable[[], CalledAgain | None] | None = None) -> None:
        super().__init__(model)
        self._called_again = called_again
        """Gives whom to tell of calls with one state."""
        self.single_poses: dict[Any, Any] = {}
        """How single poses are looked for, by the options."""
        self._called: dict[Any, Any] = {}
        self._calls: dict[Any, int] = {}
        """How often each kind of call was made with one state; :data:`ENOUGH` where nobody wants to know any more."""

    def __getstate__(self) -> Model:
        return self.model

    def __setstate__(self, model: Model) -> None:
        self.__init__(model)  # type: ignore[misc]

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
        first = arrays[0]
        kind = batch, char = first.shape[:-1], first.dtype.char
        key = name, *options.values()
        calls = self._calls.get((key, wrenches, kind), 0)
        if calls == ENOUGH or self._called_again is None or char not in "df" or batch not in ((), (1,)):
            return
        if (tell := self._called_again()) is None or any((a.shape[:-1], a.dtype.char) != kind for a in arrays):
            return
        if not calls:  # nothing pays before a second call
            self._calls[key, wrenches, kind] = 1
            return
        from ..kernels.call_form import CallForm

        rest = tuple((option, value) for option, value in options.items() if option != "wrenches")
        asked = CallForm(rest, wrenches, options.get("wrenches", ()), wrenches == "wrench_on_robot", batch, char)
        kernel = self._called[key if options else name]
        self._calls[key, wrenches, kind] = ENOUGH if tell(name, kernel, asked, calls + 1) else calls + 1

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
