"""Target of the compiled code: properties of LLVM and the processor, cached on disk, and the chosen processor.

Loading LLVM takes longer than everything else before a cached result, which needs only these four properties. If LLVM is
loaded already, they come from LLVM.
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

from ...core import object_cache
from ...core.errors import ValueRangeError

LOOP = "loop"
"""Name of the function with the type of a ufunc's inner loop."""


class CompilerFacts(NamedTuple):
    """LLVM and the host processor, in LLVM's terms."""

    version: str
    triple: str
    """Target triple of the code."""
    cpu: str
    features: str
    """Features of the processor: ``+`` before each available one, ``-`` before each missing one."""

    @property
    def present(self) -> frozenset[str]:
        """Features that are available."""
        return frozenset(name[1:] for name in self.features.split(",") if name.startswith("+"))


def compiler() -> CompilerFacts:
    """Properties from LLVM if it is loaded, else those cached for this processor."""
    if "llvmlite.binding" in sys.modules:
        return _llvm_facts()
    return _cached_facts()


def _llvm_facts() -> CompilerFacts:
    import llvmlite.binding as llvm

    features = llvm.get_host_cpu_features().flatten()
    triple = llvm.get_process_triple()
    if sys.platform == "win32" and not triple.endswith("-elf"):
        triple += "-elf"  # Windows calling convention in object files that our loader reads
    return CompilerFacts(str(llvm.llvm_version_info), triple, llvm.get_host_cpu_name(), features)


@cache
def _cached_facts() -> CompilerFacts:
    about = _processor()
    if about is None:
        return _llvm_facts()
    key = object_cache.digest("compiler", *_llvmlite(), about).hex()
    cached_facts = _facts_in(object_cache.load(key) or b"")
    if cached_facts is not None:
        return cached_facts
    facts = _llvm_facts()
    object_cache.store(key, "\n".join(facts).encode())
    return facts


def _facts_in(entry: bytes) -> CompilerFacts | None:
    """Properties in an entry of the cache; None for an entry of another form."""
    try:
        words = entry.decode().split("\n")
    except UnicodeDecodeError:
        return None
    if len(words) != len(CompilerFacts._fields):
        return None
    return CompilerFacts(*words)


def _llvmlite() -> list[str]:
    """Version of llvmlite, and sizes and times of its libraries."""
    import llvmlite

    folder = Path(str(llvmlite.__file__)).parent / "binding"
    words = [llvmlite.__version__]
    for path in sorted(folder.glob("*llvmlite*")):
        about = path.stat()
        words.append(f"{about.st_size} {about.st_mtime_ns}")
    return words


_CPUINFO = Path("/proc/cpuinfo")
_OF_A_CORE = ("processor", "cpu MHz", "core id", "apicid", "initial apicid", "physical id", "bogomips", "BogoMIPS")
"""Fields of the processor report that differ between cores or over time."""


def _processor() -> str | None:
    """Description that distinguishes this processor from others; None if the system has no short one.

    The system describes the machine. NumPy queries the processor itself, which may have fewer features under an emulator.
    """
    from numpy._core import _multiarray_umath  # type: ignore[attr-defined]

    features: dict[str, bool] = getattr(_multiarray_umath, "__cpu_features__", {})
    try:
        with _CPUINFO.open("rb", buffering=0) as file:
            text = (file.read(8192) or b"").decode("utf-8", "replace")
    except OSError:
        return None
    first, end, _ = text.partition("\n\n")  # the first core
    lines = [line for line in first.splitlines() if line.partition(":")[0].strip() not in _OF_A_CORE]
    names_features = any(line.startswith(("flags", "Features")) for line in lines)
    if not (end and features and names_features):
        return None
    present = [name for name, is_present in features.items() if is_present]
    return "\n".join([platform.machine(), *lines, *present])


# ── Target processor: name, features, vector width, and fused products

# It is the host, or a lesser processor named by ``TWISTWRENCH_CPU``, for the same code on all machines of a cluster.

VARIABLE = "TWISTWRENCH_CPU"


@dataclass(frozen=True)
class Precision:
    """Floating-point type: its name in LLVM, its size, and its letter in NumPy."""

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
        """Nearest representable number; infinity above the largest, as NumPy rounds."""
        try:
            return float(struct.unpack(self.char, struct.pack(self.char, value))[0])
        except OverflowError:
            return math.copysign(math.inf, value)

    def pattern(self, value: float) -> int:
        """Bits of the nearest number as a signed integer; for positive numbers, they have the same order as the numbers."""
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
    """True if the machine has fused products. Otherwise code rounds twice, since emulation takes hundreds of cycles."""

    def narrowed(self, bits: int) -> Machine:
        """The same machine with vectors of ``bits`` bits."""
        return replace(self, vector_bits=bits)

    def lanes(self, precision: Precision) -> int:
        """Number of samples per vector."""
        return self.vector_bits // precision.bits


X86_LEVELS = {
    "x86-64": ("sse2",),
    "x86-64-v2": ("cx16", "popcnt", "sahf", "sse3", "sse4.1", "sse4.2", "ssse3"),
    "x86-64-v3": ("avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "xsave"),
    "x86-64-v4": ("avx512bw", "avx512cd", "avx512dq", "avx512f", "avx512vl"),
}
"""Levels of the x86-64 psABI in LLVM's terms, with the features that each adds to the previous one."""


@cache
def host() -> Machine:
    """Processor on which this process runs."""
    about = compiler()
    return _machine(about.triple, about.cpu, about.features, about.present)


def choices() -> dict[str, Machine]:
    """Processors that ``TWISTWRENCH_CPU`` may name here, because this one runs their code; the host first."""
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
    """Target processor: the host, or the one that ``TWISTWRENCH_CPU`` names.

    Raises ValueRangeError for an unknown name, or for a processor whose code this one cannot run.
    """
    name = os.environ.get(VARIABLE, "").strip().lower() or "host"
    if name == "host":
        return host()
    allowed = choices()
    if name not in allowed:
        why = ""
        if name in X86_LEVELS and _is_x86(host().triple):
            why = f" {name} wants {', '.join(_lacking(name))}."
        raise ValueRangeError(
            f"{VARIABLE}: {os.environ[VARIABLE]!r} names no processor whose code this one ({host().cpu}) runs.{why}"
            f" Allowed here: {', '.join(allowed)}."
        )
    return allowed[name]


def _machine(triple: str, cpu: str, features: str, present: frozenset[str]) -> Machine:
    """Machine with the widest vectors of those features; all 64-bit processors in LLVM have SSE2, NEON or an equivalent."""
    if {"avx512f", "avx512dq"} <= present:
        wide = ",".join(filter(None, [features, "-prefer-256-bit"]))
        return Machine(triple, cpu, wide, 512)
    fused = not _is_x86(triple) or bool({"fma", "fma4"} & present)
    vector_bits = 256 if "avx" in present else 128
    return Machine(triple, cpu, features, vector_bits, fused)


def _is_x86(triple: str) -> bool:
    return triple.startswith(("x86_64", "amd64", "i386", "i486", "i586", "i686"))


def _lacking(level: str) -> list[str]:
    """Features of an x86-64 level, and of those below it, that the host lacks."""
    present, lacking = compiler().present, []
    for name, features in X86_LEVELS.items():
        lacking += [feature for feature in features if feature not in present]
        if name == level:
            break
    return lacking
