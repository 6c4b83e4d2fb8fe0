"""The robot's quantities on a GPU, a thread for each sample: ``robot.cuda``."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, Unpack

from ..errors import UnknownNameError, ValueRangeError
from ..kernels.cuda_kernel import CudaKernel
from ..targets.c import PRECISIONS
from .quantity_methods import QuantityMethods
from .quantity_options import KernelOptions, checked_options
from .wrench_arguments import check_mapping

if TYPE_CHECKING:
    from .robot import Robot

Device = Any
"""An array in a GPU's memory: PyTorch's, CuPy's, whatever has ``__cuda_array_interface__`` or DLPack."""


class CudaRobot(QuantityMethods[Device, Device]):
    """A robot's quantities for arrays in a GPU's memory, with the names and arguments of :class:`~twistwrench.Robot`.

    Arrays are (..., n), all float32 or all float64; nothing is copied. An input without batch axes serves all samples.
    What comes out is of the first input's library, or in ``out=``; a kernel is compiled at its first call. Calls do not
    wait for the GPU.

    Parameters
    ----------
    robot : Robot
    stream : optional, a stream of PyTorch's or CuPy's, or a handle; None: the first input's
    kernels : dict, optional, those compiled so far, shared between streams

    Raises
    ------
    ShapeError, ValueRangeError
        As the robot's methods.
    KernelError
        There is no GPU.
    MissingExtraError
        There is no NVRTC.

    Examples
    --------
    >>> import twistwrench as tw
    >>> tw.robots.panda().cuda.kernel("inverse_dynamics")
    <CudaKernel inverse_dynamics: (7),(7),(7)->(7)>
    """

    def __init__(self, robot: Robot, stream: Any = None, kernels: dict[Any, CudaKernel] | None = None) -> None:
        self._robot, self._stream = robot, stream
        self._kernels: dict[Any, CudaKernel] = {} if kernels is None else kernels
        self._call, self._with_wrenches = self._launch, self._launch_with_wrenches

    def __repr__(self) -> str:
        return f"<CudaRobot {self._robot.name!r}>"

    def on(self, stream: Any) -> CudaRobot:
        """The same robot, with kernels launched on another stream of the GPU.

        Parameters
        ----------
        stream : a stream of PyTorch's or CuPy's, or a handle; None: the first input's

        Returns
        -------
        robot : CudaRobot

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.panda().cuda.on(None).kernel("mass_matrix")
        <CudaKernel mass_matrix: (7)->(7,7)>
        """
        return CudaRobot(self._robot, stream, self._kernels)

    def kernel(self, name: str, **options: Unpack[KernelOptions]) -> CudaKernel:
        """GPU kernel of any quantity, with the options of :meth:`twistwrench.Robot.kernel`; wrenches are by the robot.

        Parameters
        ----------
        name : str, a quantity
        **options : as for :meth:`twistwrench.Robot.kernel`

        Returns
        -------
        kernel : CudaKernel

        Raises
        ------
        KernelError
            There is no program for it, as :meth:`twistwrench.Robot.export_c` says, or it is too long.
        UnknownNameError
            There is no such quantity, frame or joint.
        SingularMassMatrixError
            It needs M⁻¹, and M has none.

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.panda().cuda.kernel("mass_matrix")
        <CudaKernel mass_matrix: (7)->(7,7)>
        """
        return self._kernel(name, options)

    def source(self, name: str, precision: str = "double", **options: Unpack[KernelOptions]) -> str:
        """CUDA C++ source of a quantity's kernel; needs no GPU.

        Parameters
        ----------
        name : str, a quantity
        precision : "double" or "float"
        **options : as for :meth:`twistwrench.Robot.kernel`

        Returns
        -------
        text : str; docs/cuda.md says how to compile it

        Raises
        ------
        UnknownNameError
            ``precision`` is neither, or there is no such quantity.
        KernelError
            There is no program for it, or it is too long.

        Examples
        --------
        >>> import twistwrench as tw
        >>> text = tw.robots.panda().cuda.source("inverse_dynamics", precision="float")
        >>> "void __launch_bounds__(THREADS) panda_inverse_dynamics" in text
        True
        """
        from ..export.document import comment

        if precision not in PRECISIONS:
            raise UnknownNameError.of("precision", precision, PRECISIONS)
        function = self.kernel(name, **options).function(precision)
        about = [
            f"{name} of the robot {self._robot.name} as a CUDA kernel, numbers of type {precision}. By twistwrench "
            f"{version('twistwrench')}.",
            "A thread computes a sample, a block THREADS of them; blocks: (samples + THREADS - 1) / THREADS.",
            "An input has a pointer and how many elements lie from one sample to the next, 0 if one serves all.",
            "Compile with -std=c++17 -fmad=false: products that are fused are fused here. As C++ (-ffp-contract=off) the",
            "function of the same name runs all blocks on the processor.",
        ]
        return f"{comment(about)}\n{function.source}"

    def _kernel(self, name: str, options: Mapping[str, Any]) -> CudaKernel:
        asked = (name, *options.items())
        try:
            return self._kernels[asked]
        except (KeyError, TypeError):  # not yet asked for like this, or by a list
            pass
        key = (name, *checked_options(self._robot.model, name, options).items())
        if key not in self._kernels:
            from ..export.request import prefix_of, requests

            (request,) = requests(self._robot, [(name, options)], "double", prefix_of(self._robot, None))
            self._kernels[key] = CudaKernel(request.function.name, request.function.program, name)
        with contextlib.suppress(TypeError):
            self._kernels[asked] = self._kernels[key]
        return self._kernels[key]

    def _launch(self, name: str, *arrays: Device, out: Any = None, **options: Any) -> Any:
        return self._kernel(name, options)(*arrays, out=out, stream=self._stream)

    def _launch_with_wrenches(
        self,
        name: str,
        arrays: tuple[Device, ...],
        by_robot: Mapping[str, Device] | None,
        on_robot: Mapping[str, Device] | None,
        out: Any = None,
        **options: Any,
    ) -> Any:
        """Launch a kernel that takes wrenches as further inputs; the sign of those on the robot is part of its program."""
        check_mapping(by_robot)
        check_mapping(on_robot)
        by, on = dict(by_robot or {}), dict(on_robot or {})
        if both := by.keys() & on.keys():
            raise ValueRangeError(
                f"{name}: wrenches by and on the robot are given at {min(both)!r}. Give one, their difference."
            )
        total = {**by, **on}
        frames = tuple(sorted(total))
        if frames:
            options["wrenches"] = frames
        if on:
            options["on_robot"] = tuple(sorted(on))
        return self._launch(name, *arrays, *(total[frame] for frame in frames), out=out, **options)
