"""The target of code: LLVM's facts about itself and the processor, cached on disk, and the processor chosen.

Loading LLVM takes longer than everything else before a cached result, and only these four facts are needed of it then. If it
is loaded, the facts come from it.
"""

from __future__ import annotations

import math
import os
import platform
import struct
import sys
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

from ..core import object_cache
from ..errors import ValueRangeError

LOOP = "loop"
"""Name of the function with the shape of a ufunc's inner loop."""


class CompilerFacts(NamedTuple):
    """LLVM and the processor it runs on, in LLVM's terms."""

    version: str
    triple: str
    """Target triple of the code."""
    cpu: str
    features: str
    """Features of the processor: each name behind ``+`` if present, else behind ``-``."""

    @property
    def present(self) -> frozenset[str]:
        """The features that are there."""
        return frozenset(name[1:] for name in self.features.split(",") if name.startswith("+"))


def compiler() -> CompilerFacts:
    """LLVM's facts if it is loaded, else those cached for this processor."""
    return _llvm_facts() if "llvmlite.binding" in sys.modules else _cached_facts()


def _llvm_facts() -> CompilerFacts:
    import llvmlite.binding as llvm

    features = llvm.get_host_cpu_features().flatten()
    triple = llvm.get_process_triple()
    if sys.platform == "win32" and not triple.endswith("-elf"):
        triple += "-elf"  # the calling convention of Windows in object files that our loader reads
    return CompilerFacts(str(llvm.llvm_version_info), triple, llvm.get_host_cpu_name(), features)


@cache
def _cached_facts() -> CompilerFacts:
    about = _processor()
    if about is None:
        return _llvm_facts()
    key = object_cache.digest("compiler", *_llvmlite(), about).hex()
    words = (object_cache.load(key) or b"").decode().split("\n")
    if len(words) == len(CompilerFacts._fields):
        return CompilerFacts(*words)
    found = _llvm_facts()
    object_cache.store(key, "\n".join(found).encode())
    return found


def _llvmlite() -> list[str]:
    """Version of llvmlite, and size and time of its libraries."""
    import llvmlite

    folder = Path(str(llvmlite.__file__)).parent / "binding"
    stats = [path.stat() for path in sorted(folder.glob("*llvmlite*"))]
    return [llvmlite.__version__, *(f"{s.st_size} {s.st_mtime_ns}" for s in stats)]


_CPUINFO = Path("/proc/cpuinfo")
_OF_A_CORE = ("processor", "cpu MHz", "core id", "apicid", "initial apicid", "physical id", "bogomips", "BogoMIPS")
"""Fields of the system's report that differ between cores or moments."""


def _processor() -> str | None:
    """Description that distinguishes this processor from others; None if the system has no short one.

    The system describes the machine; NumPy queries the processor itself, which may have fewer features under an emulator.
    """
    from numpy._core import _multiarray_umath  # type: ignore[attr-defined]

    seen: dict[str, bool] = getattr(_multiarray_umath, "__cpu_features__", {})
    try:
        with _CPUINFO.open("rb", buffering=0) as file:
            text = (file.read(8192) or b"").decode("utf-8", "replace")
    except OSError:
        return None
    first, end, _ = text.partition("\n\n")  # the first core
    lines = [line for line in first.splitlines() if line.partition(":")[0].strip() not in _OF_A_CORE]
    if not (end and seen and any(line.startswith(("flags", "Features")) for line in lines)):
        return None
    return "\n".join([platform.machine(), *lines, *(name for name, there in seen.items() if there)])


# ── The target processor: its name, its features, the width of its vectors, and fused products

# That is the processor at hand, or a lesser one named by ``TWISTWRENCH_CPU``, for one code on all machines of a cluster.

VARIABLE = "TWISTWRENCH_CPU"


@dataclass(frozen=True)
class Precision:
    """A floating-point type: LLVM's name for it, its size, and the letters NumPy uses."""

    llvm: str
    bytes: int
    char: str
    mantissa: int
    """Stored bits of the significand."""

    @property
    def bits(self) -> int:
        """Size in bits."""
        return 8 * self.bytes

    def rounded(self, value: float) -> float:
        """The nearest number; infinity for what is beyond the largest, as NumPy rounds it."""
        try:
            return float(struct.unpack(self.char, struct.pack(self.char, value))[0])
        except OverflowError:
            return math.copysign(math.inf, value)

    def pattern(self, value: float) -> int:
        """The bits of the nearest number as a signed integer; those of positive numbers order like the numbers."""
        return int.from_bytes(struct.pack(f"<{self.char}", self.rounded(value)), "little", signed=True)


DOUBLE = Precision("double", 8, "d", 52)
SINGLE = Precision("float", 4, "f", 23)


@dataclass(frozen=True)
class Machine:
    """Description of a processor for the compiler."""

    triple: str
    cpu: str
    features: str
    vector_bits: int
    fused: bool = True
    """True if the machine has fused products. Without them, code rounds twice: emulation takes hundreds of cycles."""

    def narrowed(self, bits: int) -> Machine:
        """The same with vectors of so many bits."""
        return replace(self, vector_bits=bits)

    def lanes(self, precision: Precision) -> int:
        """Number of samples computed side by side."""
        return self.vector_bits // precision.bits


X86_LEVELS = {
    "x86-64": ("sse2",),
    "x86-64-v2": ("cx16", "popcnt", "sahf", "sse3", "sse4.1", "sse4.2", "ssse3"),
    "x86-64-v3": ("avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "xsave"),
    "x86-64-v4": ("avx512bw", "avx512cd", "avx512dq", "avx512f", "avx512vl"),
}
"""The levels of the x86-64 psABI, by LLVM's names: what each adds to the one before."""


@cache
def host() -> Machine:
    """The processor this process runs on."""
    about = compiler()
    return _machine(about.triple, about.cpu, about.features, about.present)


def choices() -> dict[str, Machine]:
    """Processors that ``TWISTWRENCH_CPU`` may name here, since this one runs their code; the host first."""
    triple = host().triple
    found = {"host": host()}
    if _is_x86(triple):
        present: frozenset[str] = frozenset()
        for name, added in X86_LEVELS.items():
            present |= {*added}
            if not _lacking(name):
                found[name] = _machine(triple, name, "", present)
    elif triple.startswith(("aarch64", "arm64")):
        found["armv8-a"] = _machine(triple, "generic", "", frozenset())
    return found


def chosen() -> Machine:
    """The processor that code is made for: the host, or the one that ``TWISTWRENCH_CPU`` names.

    Raises ValueRangeError for an unknown name, or for a processor whose code this one cannot run.
    """
    name = os.environ.get(VARIABLE, "").strip().lower() or "host"
    if name == "host":
        return host()
    allowed = choices()
    if name not in allowed:
        lacking = _lacking(name) if name in X86_LEVELS and _is_x86(host().triple) else []
        why = f" {name} wants {', '.join(lacking)}." if lacking else ""
        raise ValueRangeError(
            f"{VARIABLE}: {os.environ[VARIABLE]!r} names no processor whose code this one ({host().cpu}) runs.{why}"
            f" Allowed here: {', '.join(allowed)}."
        )
    return allowed[name]


def _machine(triple: str, cpu: str, features: str, present: frozenset[str]) -> Machine:
    """The widest vectors of those features; every 64-bit processor that LLVM serves has SSE2, NEON or their equal."""
    if {"avx512f", "avx512dq"} <= present:
        wide = ",".join(filter(None, [features, "-prefer-256-bit"]))
        return Machine(triple, cpu, wide, 512)
    fused = not _is_x86(triple) or bool({"fma", "fma4"} & present)
    return Machine(triple, cpu, features, 256 if "avx" in present else 128, fused)


def _is_x86(triple: str) -> bool:
    return triple.startswith(("x86_64", "amd64", "i386", "i486", "i586", "i686"))


def _lacking(level: str) -> list[str]:
    """Features of an x86-64 level, and of those below it, that the host lacks."""
    present, names = compiler().present, list(X86_LEVELS)
    wanted = [f for name in names[: names.index(level) + 1] for f in X86_LEVELS[name]]
    return [f for f in wanted if f not in present]
