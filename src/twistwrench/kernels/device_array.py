"""Arrays in a GPU's memory: those of others, seen through their protocols, and our own where there is no library to make one.

``__cuda_array_interface__`` is read first (CuPy, PyTorch, Numba, JAX), then DLPack. Nothing is copied, and no library is
imported: an output of PyTorch's or CuPy's kind is made by the module that the input's type comes from.
"""

from __future__ import annotations

import contextlib
import math
import sys
import weakref
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from ..errors import KernelError, ShapeError, ValueRangeError
from . import dlpack
from .cuda_driver import Driver, driver

LEGACY = 1
"""CU_STREAM_LEGACY, the default stream by its name."""


class View(NamedTuple):
    """Where an array lies and how; strides in elements."""

    address: int
    """Of the first element."""
    shape: tuple[int, ...]
    """Lengths of the axes."""
    strides: tuple[int, ...]
    """Elements from one entry to the next along each axis."""
    dtype: np.dtype[Any]
    """Of the elements."""
    stream: int | None
    """The stream on which its contents are made; None: they are there."""
    readonly: bool = False
    """Whether nothing may be written there."""
    keep: Any = None
    """What holds the memory."""

    @property
    def empty(self) -> bool:
        """Whether it has no elements."""
        return 0 in self.shape

    @property
    def reach(self) -> tuple[int, int]:
        """Bytes from its address to its first byte and to the one behind its last."""
        if self.empty:
            return 0, 0
        ends = [(n - 1) * s for n, s in zip(self.shape, self.strides, strict=True)]
        size = self.dtype.itemsize
        return size * sum(min(0, end) for end in ends), size * (sum(max(0, end) for end in ends) + 1)


def view(array: Any, label: str) -> View:
    """An array in a GPU's memory as it lies there; ``label`` names it in errors.

    Raises ValueRangeError for what is none: on the processor, masked, or of a library that does not hand it out.
    """
    if isinstance(array, DeviceArray):
        return array.view
    try:
        about = getattr(array, "__cuda_array_interface__", None)
        if about is not None:
            return _from_interface(about, array, label)
        place = getattr(array, "__dlpack_device__", None)
        if place is not None and not isinstance(array, np.ndarray):
            return _from_dlpack(array, place(), label)
    except (KernelError, ShapeError, ValueRangeError):
        raise
    except Exception as problem:  # PyTorch's for tensors with gradients, and whatever else others say
        raise ValueRangeError(f"{label} does not hand out its memory: {problem}") from problem
    raise ValueRangeError(_on_the_processor(array, label))


def _on_the_processor(array: Any, label: str) -> str:
    kind = type(array)
    name = kind.__name__ if kind.__module__ == "builtins" else f"{kind.__module__}.{kind.__name__}"
    return (
        f"{label} is a {name}, which is not in a GPU's memory. Move it there: cupy.asarray(x), "
        "torch.as_tensor(x, device='cuda'), or twistwrench.cuda.to_device(x). Without .cuda the robot's methods take "
        "NumPy arrays."
    )


def _from_interface(about: Any, array: Any, label: str) -> View:
    """By the CUDA array interface, version 3 and its ancestors."""
    shape = tuple(int(n) for n in about["shape"])
    dtype = np.dtype(about["typestr"])
    address, readonly = about["data"]
    if about.get("mask") is not None:
        raise ValueRangeError(f"{label} is a masked array. Fill it, or leave its masked samples out.")
    strides = about.get("strides")
    if strides is None:
        inner = _contiguous(shape)
    else:
        if any(s % dtype.itemsize for s in strides):
            raise ValueRangeError(
                f"{label}: its elements are {strides} bytes apart, no multiples of their size. Copy it."
            )
        inner = tuple(int(s) // dtype.itemsize for s in strides)
    stream = about.get("stream")
    if _library(array) == "torch":  # which speaks version 2, and leaves the stream to be known
        stream = int(sys.modules["torch"].cuda.current_stream(array.device).cuda_stream)
    return View(int(address or 0), shape, inner, dtype, None if stream is None else int(stream), bool(readonly), array)


_LIBRARIES: dict[type, str] = {}


def _library(array: Any) -> str:
    """``"torch"`` or ``"cupy"`` for arrays of theirs and of classes derived from these."""
    kind = type(array)
    if kind not in _LIBRARIES:
        tops = [base.__module__.partition(".")[0] for base in kind.__mro__]
        _LIBRARIES[kind] = next((top for top in tops if top in ("torch", "cupy") and top in sys.modules), "")
    return _LIBRARIES[kind]


@lru_cache(maxsize=256)
def _contiguous(shape: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(math.prod(shape[k + 1 :]) for k in range(len(shape)))


def empty_like(array: Any, shape: tuple[int, ...], dtype: np.dtype[Any], device: int, stream: int) -> Any:
    """A new array of the kind of ``array``: PyTorch's, CuPy's, or ours."""
    library = _library(array)
    if library == "torch":
        return sys.modules["torch"].empty(shape, dtype=array.dtype, device=array.device)
    if library == "cupy":
        cupy = sys.modules["cupy"]
        with cupy.cuda.Device(device):
            return cupy.empty(shape, dtype)
    return DeviceArray(shape, dtype, device, stream)


class DeviceArray:
    """Array in a GPU's memory, without arithmetic: what comes out where no CuPy or PyTorch array went in.

    Any library that reads ``__cuda_array_interface__`` or DLPack takes it as it is (``cupy.asarray``,
    ``torch.from_dlpack``); :meth:`to_numpy` copies it. Its memory is given back when nobody holds it any more.

    Parameters
    ----------
    shape : tuple of int
    dtype : float32 or float64
    device : int, number of the GPU
    stream : int, handle of the stream that fills it
    """

    def __init__(self, shape: tuple[int, ...], dtype: DTypeLike, device: int = 0, stream: int = LEGACY) -> None:
        self.shape, self.dtype, self.device = tuple(shape), np.dtype(dtype), device
        self.stream = stream or LEGACY
        size = math.prod(self.shape) * self.dtype.itemsize
        gpu = driver()
        with gpu.context(device):
            self.address = gpu.allocate(size)
        weakref.finalize(self, _release, gpu, device, self.address).atexit = False

    def __repr__(self) -> str:
        return f"<DeviceArray of shape {self.shape}, {self.dtype}, on GPU {self.device}>"

    @property
    def view(self) -> View:
        """Where it lies."""
        return View(self.address, self.shape, _contiguous(self.shape), self.dtype, self.stream, keep=self)

    @property
    def __cuda_array_interface__(self) -> dict[str, Any]:
        return {
            "shape": self.shape,
            "typestr": self.dtype.str,
            "data": (self.address, False),
            "strides": None,
            "version": 3,
            "stream": self.stream,
        }

    def __dlpack_device__(self) -> tuple[int, int]:
        return dlpack.CUDA, self.device

    def __dlpack__(self, *, stream: int | None = None, **asked: Any) -> Any:
        if asked.get("copy"):
            raise BufferError("a DeviceArray hands out its own memory, no copy of it.")
        if stream != -1:
            with driver().context(self.device):
                driver().wait(stream or LEGACY, self.stream)
        return dlpack.capsule(self.address, self.device, self.shape, _contiguous(self.shape), self.dtype, self)

    def to_numpy(self) -> NDArray[Any]:
        """Copy to the processor, when what makes the array has run.

        Returns
        -------
        values : array of the same shape and type
        """
        found = np.empty(self.shape, self.dtype)
        with driver().context(self.device):
            driver().copy_out(found.ctypes.data, self.address, found.nbytes, self.stream)
        return found


def to_device(values: ArrayLike, device: int = 0) -> DeviceArray:
    """Copy numbers into a GPU's memory, float32 as they are, all others as float64.

    Parameters
    ----------
    values : array_like of real numbers
    device : int, number of the GPU

    Returns
    -------
    array : DeviceArray

    Raises
    ------
    ValueRangeError
        ``values`` is no array of real numbers.
    KernelError
        There is no GPU.
    """
    try:
        array = np.asarray(values)
        kept = np.ascontiguousarray(array if array.dtype == np.float32 else array.astype(float, casting="same_kind"))
    except (TypeError, ValueError):
        raise ValueRangeError(f"to_device takes an array of real numbers, got {str(values)[:60]!r}.") from None
    made = DeviceArray(array.shape, kept.dtype, device)
    with driver().context(device):
        driver().copy_in(made.address, kept.ctypes.data, kept.nbytes)
    return made


def _release(gpu: Driver, device: int, address: int) -> None:
    with contextlib.suppress(KernelError), gpu.context(device):  # a context that is gone took its memory along
        gpu.free(address)


def _from_dlpack(array: Any, place: tuple[Any, Any], label: str) -> View:
    kind = int(place[0])
    if kind == dlpack.CPU:
        raise ValueRangeError(_on_the_processor(array, label))
    if kind not in (dlpack.CUDA, dlpack.CUDA_MANAGED):
        raise ValueRangeError(
            f"{label} lies on a device of DLPack's kind {kind}; robot.cuda reads NVIDIA's GPUs, kind {dlpack.CUDA}."
        )
    lent = dlpack.Borrowed(array.__dlpack__(stream=LEGACY))
    if lent.dtype is None:
        raise ValueRangeError(f"{label} holds no floating-point numbers. robot.cuda takes float32 and float64.")
    strides = _contiguous(lent.shape) if lent.strides is None else lent.strides
    return View(lent.address, lent.shape, strides, lent.dtype, LEGACY, keep=lent)
