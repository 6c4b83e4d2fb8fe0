"""The CUDA driver through ctypes: contexts, modules, launches, memory. Loaded when first needed."""

from __future__ import annotations

import contextlib
import ctypes
import sys
import threading
from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any

from ..errors import KernelError

_NAMES = ("nvcuda.dll",) if sys.platform == "win32" else ("libcuda.so.1", "libcuda.so")

_ADVICE = (
    "robot.cuda needs an NVIDIA GPU and its driver. The methods of the robot itself run on the processor, and "
    "robot.cuda.source(…) gives the CUDA text on any machine."
)

_INVALID_VALUE, _NO_DEVICE, _INVALID_CONTEXT = 1, 100, 201
_DEVICE_ORDINAL = 9
"""CU_POINTER_ATTRIBUTE_DEVICE_ORDINAL."""

_MAJOR, _MINOR = 75, 76
"""CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MAJOR and _MINOR."""

_MOST_BLOCKS = 2**31 - 1


class Driver:
    """The driver in one shared library. Addresses and streams are integers, a device is its number."""

    def __init__(self, library: Any) -> None:
        self._library = library
        self._primary: dict[int, ctypes.c_void_p] = {}
        self._lock = threading.Lock()
        code = library.cuInit(0)
        if code:
            what = "finds no GPU" if code == _NO_DEVICE else f"does not start ({self._meaning(code)})"
            raise KernelError(f"the NVIDIA driver {what}. {_ADVICE}")

    def device_of(self, address: int) -> int | None:
        """The device whose memory it is; None of memory that is not a device's."""
        found = ctypes.c_int()
        asked = ctypes.byref(found), _DEVICE_ORDINAL, ctypes.c_void_p(address)
        code = self._library.cuPointerGetAttribute(*asked)
        if code == _INVALID_CONTEXT:  # a thread that has none yet
            with self.context(0):
                code = self._library.cuPointerGetAttribute(*asked)
        if code == _INVALID_VALUE:
            return None
        self._check("cuPointerGetAttribute", code)
        return found.value if found.value >= 0 else None

    def current_device(self) -> int:
        """The device of the thread's context, else the first."""
        context, device = ctypes.c_void_p(), ctypes.c_int()
        self._call("cuCtxGetCurrent", ctypes.byref(context))
        if not context.value:
            return 0
        self._call("cuCtxGetDevice", ctypes.byref(device))
        return device.value

    @contextlib.contextmanager
    def context(self, device: int) -> Iterator[int]:
        """Within it a context of the device is current: the one that is, else the device's primary one."""
        current = ctypes.c_void_p()
        self._call("cuCtxGetCurrent", ctypes.byref(current))
        if current.value and self.current_device() == device:
            yield current.value
            return
        primary = self._primary_context(device)
        self._call("cuCtxPushCurrent_v2", primary)
        try:
            yield primary.value or 0
        finally:
            self._call("cuCtxPopCurrent_v2", ctypes.byref(current))

    def _primary_context(self, device: int) -> ctypes.c_void_p:
        with self._lock:
            if device not in self._primary:
                handle, context = ctypes.c_int(), ctypes.c_void_p()
                self._call("cuDeviceGet", ctypes.byref(handle), device)
                self._call("cuDevicePrimaryCtxRetain", ctypes.byref(context), handle)
                self._primary[device] = context
            return self._primary[device]

    def capability(self, device: int) -> tuple[int, int]:
        """The compute capability of a device, such as (9, 0)."""
        handle, found = ctypes.c_int(), ctypes.c_int()
        self._call("cuDeviceGet", ctypes.byref(handle), device)
        numbers = []
        for attribute in (_MAJOR, _MINOR):
            self._call("cuDeviceGetAttribute", ctypes.byref(found), attribute, handle)
            numbers.append(found.value)
        return numbers[0], numbers[1]

    def function(self, code: bytes, name: str) -> ctypes.c_void_p:
        """A kernel of a module, loaded into the current context, for good."""
        module, function = ctypes.c_void_p(), ctypes.c_void_p()
        self._call("cuModuleLoadData", ctypes.byref(module), code)
        self._call("cuModuleGetFunction", ctypes.byref(function), module, name.encode())
        return function

    def launch(
        self, function: ctypes.c_void_p, blocks: int, threads: int, stream: int, arguments: Sequence[int]
    ) -> None:
        """Start a kernel whose arguments are integers of 64 bits and addresses; it runs when the stream gets there."""
        if blocks > _MOST_BLOCKS:
            raise KernelError(f"{blocks} blocks of {threads} samples are more than a GPU takes. Give them in parts.")
        values = (ctypes.c_int64 * len(arguments))(*(ctypes.c_int64(a).value for a in arguments))
        places = (ctypes.c_void_p * len(arguments))(*(ctypes.addressof(values) + 8 * k for k in range(len(arguments))))
        sizes = [ctypes.c_uint(n) for n in (blocks, 1, 1, threads, 1, 1, 0)]
        self._call("cuLaunchKernel", function, *sizes, ctypes.c_void_p(stream), places, None)

    def wait(self, stream: int, other: int) -> None:
        """What is given to ``stream`` from now on runs after what ``other`` has been given so far."""
        if stream == other:
            return
        event = ctypes.c_void_p()
        self._call("cuEventCreate", ctypes.byref(event), ctypes.c_uint(2))  # without times
        try:
            self._call("cuEventRecord", event, ctypes.c_void_p(other))
            self._call("cuStreamWaitEvent", ctypes.c_void_p(stream), event, ctypes.c_uint(0))
        finally:
            self._call("cuEventDestroy_v2", event)

    def allocate(self, size: int) -> int:
        """Memory of the current context's device."""
        address = ctypes.c_uint64()
        self._call("cuMemAlloc_v2", ctypes.byref(address), ctypes.c_size_t(max(size, 1)))
        return address.value

    def free(self, address: int) -> None:
        """Give memory back, when what uses it has run."""
        self._call("cuMemFree_v2", ctypes.c_uint64(address))

    def copy_in(self, address: int, host: int, size: int) -> None:
        """Copy host memory to a device's."""
        self._call("cuMemcpyHtoD_v2", ctypes.c_uint64(address), ctypes.c_void_p(host), ctypes.c_size_t(size))

    def copy_out(self, host: int, address: int, size: int, stream: int) -> None:
        """Copy a device's memory to the host's, after what the stream has been given."""
        self._call("cuStreamSynchronize", ctypes.c_void_p(stream))
        self._call("cuMemcpyDtoH_v2", ctypes.c_void_p(host), ctypes.c_uint64(address), ctypes.c_size_t(size))

    def _call(self, function: str, *arguments: Any) -> None:
        self._check(function, getattr(self._library, function)(*arguments))

    def _check(self, function: str, code: int) -> None:
        if code:
            raise KernelError(f"CUDA: {function} failed: {self._meaning(code)}.")

    def _meaning(self, code: int) -> str:
        texts = []
        for function in (self._library.cuGetErrorName, self._library.cuGetErrorString):
            text = ctypes.c_char_p()
            if function(code, ctypes.byref(text)) == 0 and text.value:
                texts.append(text.value.decode(errors="replace"))
        return ", ".join(texts) or f"error {code}"


@cache
def driver() -> Driver:
    """The driver of this machine. KernelError where there is none, or no GPU."""
    for name in _NAMES:
        try:
            library = ctypes.CDLL(name)
        except OSError:
            continue
        return Driver(library)
    raise KernelError(f"no NVIDIA driver is found on this machine ({', '.join(_NAMES)}). {_ADVICE}")
