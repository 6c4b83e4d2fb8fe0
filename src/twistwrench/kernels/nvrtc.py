"""NVIDIA's run-time compiler: CUDA source to what a GPU loads. Found when first needed; nothing of it is imported before.

It comes as a wheel (the extra ``cuda``, and with PyTorch or CuPy), or with the CUDA toolkit. What it made is kept in the cache.
"""

from __future__ import annotations

import ctypes
import importlib.util
import os
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from ..core import cache as disk
from ..errors import KernelError, MissingExtraError

_SYSTEM = ("nvrtc64_130_0.dll", "nvrtc64_120_0.dll") if sys.platform == "win32" else (
    "libnvrtc.so", "libnvrtc.so.13", "libnvrtc.so.12"
)  # fmt: skip


def compiled(source: str, name: str, options: tuple[str, ...], capability: tuple[int, int]) -> bytes:
    """Code of ``source`` for GPUs of a compute capability, from the cache if it is there.

    Raises MissingExtraError where there is no compiler, KernelError with what it said where it refuses.
    """
    making = compiler()
    key = disk.digest(f"NVRTC {making.version} {capability} {options}", source).hex()
    code = disk.load(key)
    if code is None:
        code = making.compile(source, name, options, capability)
        disk.store(key, code)
    return code


class Compiler:
    """The compiler in one shared library."""

    def __init__(self, library: Any) -> None:
        self._library = library
        library.nvrtcGetErrorString.restype = ctypes.c_char_p
        major, minor = ctypes.c_int(), ctypes.c_int()
        self._call("nvrtcVersion", ctypes.byref(major), ctypes.byref(minor))
        self.version = (major.value, minor.value)

    def __repr__(self) -> str:
        return f"<NVRTC {self.version[0]}.{self.version[1]}>"

    @property
    def capabilities(self) -> tuple[int, ...]:
        """The GPUs it knows, as 10 major + minor, in order."""
        count = ctypes.c_int()
        self._call("nvrtcGetNumSupportedArchs", ctypes.byref(count))
        known = (ctypes.c_int * count.value)()
        self._call("nvrtcGetSupportedArchs", known)
        return tuple(sorted(known))

    def compile(self, source: str, name: str, options: tuple[str, ...], capability: tuple[int, int]) -> bytes:
        """Machine code for GPUs it knows; for newer ones the assembly (PTX) that their driver compiles."""
        wanted, known = 10 * capability[0] + capability[1], self.capabilities
        older = [one for one in known if one <= wanted]
        if not older:
            raise KernelError(
                f"NVRTC {self.version[0]}.{self.version[1]} makes no code for a GPU of compute capability "
                f"{capability[0]}.{capability[1]}; it begins with {known[0] / 10}. Install an older one, such as "
                "pip install nvidia-cuda-nvrtc-cu12."
            )
        kind, size = ("CUBIN", f"sm_{wanted}") if wanted in known else ("PTX", f"compute_{older[-1]}")
        program = ctypes.c_void_p()
        self._call("nvrtcCreateProgram", ctypes.byref(program), source.encode(), f"{name}.cu".encode(), 0, None, None)
        try:
            texts = [option.encode() for option in (f"--gpu-architecture={size}", *options)]
            given = (ctypes.c_char_p * len(texts))(*texts)
            code = self._library.nvrtcCompileProgram(program, len(texts), given)
            if code:
                raise KernelError(
                    f"NVRTC refused the kernel {name}: {self._meaning(code)}. It says:\n{self._text(program, 'ProgramLog')}"
                )
            return self._bytes(program, kind)
        finally:
            self._library.nvrtcDestroyProgram(ctypes.byref(program))

    def _text(self, program: ctypes.c_void_p, what: str) -> str:
        return self._bytes(program, what).rstrip(b"\0\n").decode(errors="replace")

    def _bytes(self, program: ctypes.c_void_p, what: str) -> bytes:
        size = ctypes.c_size_t()
        self._call(f"nvrtcGet{what}Size", program, ctypes.byref(size))
        content = ctypes.create_string_buffer(size.value)
        self._call(f"nvrtcGet{what}", program, content)
        return content.raw

    def _meaning(self, code: int) -> str:
        return (self._library.nvrtcGetErrorString(code) or b"").decode() or f"error {code}"

    def _call(self, function: str, *arguments: Any) -> None:
        code = getattr(self._library, function)(*arguments)
        if code:
            raise KernelError(f"NVRTC: {function} failed: {self._meaning(code)}.")


@cache
def compiler() -> Compiler:
    """The compiler of this environment. MissingExtraError where there is none."""
    for place in _places():
        try:
            return Compiler(ctypes.CDLL(place))
        except (OSError, AttributeError):  # not there, or not what its name says
            continue
    raise MissingExtraError(
        "robot.cuda needs 'nvrtc', NVIDIA's run-time compiler, which is not installed: "
        f"{MissingExtraError.advice('cuda')}. That of a CUDA toolkit is found through CUDA_HOME or CUDA_PATH."
    )


def _places() -> Iterator[str]:
    """Where it may be: packages of this environment, the toolkit that is named, what the system finds."""
    pattern = "nvrtc64*.dll" if sys.platform == "win32" else "libnvrtc.so*"
    package = importlib.util.find_spec("nvidia")
    for folder in (package.submodule_search_locations or ()) if package else ():
        for home in sorted(Path(folder).iterdir(), reverse=True) if Path(folder).is_dir() else ():
            yield from _files(home, pattern)
    for variable in ("CUDA_HOME", "CUDA_PATH"):
        if toolkit := os.environ.get(variable):
            yield from _files(Path(toolkit), pattern)
    yield from _SYSTEM
    yield from _files(Path("/usr/local/cuda"), pattern)


def _files(home: Path, pattern: str) -> Iterator[str]:
    for folder in ("lib", "lib64", "bin", "bin/x86_64"):
        files = sorted((home / folder).glob(pattern), key=lambda file: (".alt." in file.name, file.name))
        yield from map(str, files)
