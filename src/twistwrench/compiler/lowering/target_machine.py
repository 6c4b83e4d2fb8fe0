"""Target of the compiled code: properties of LLVM and the processor, cached on disk, and the chosen processor.

The key of a cached kernel contains four properties of LLVM and of the processor. Loading LLVM for them would take longer than
everything else that a cached kernel needs. They are therefore cached on disk; if LLVM is loaded already, they come from LLVM.
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
    """Properties of LLVM and of the processor that runs it, in LLVM's terms."""

    version: str
    """Version of LLVM."""
    triple: str
    """Target triple of the code: architecture, vendor, system and format of object files."""
    cpu: str
    """Name of the processor."""
    features: str
    """Features of the processor: ``+`` before each available one, ``-`` before each missing one."""

    @property
    def present(self) -> frozenset[str]:
        """Features that are available."""
        return frozenset(name[1:] for name in self.features.split(",") if name.startswith("+"))


def compiler() -> CompilerFacts:
    """Properties of LLVM and the processor: from LLVM if it is loaded, otherwise from the cache."""
    if "llvmlite.binding" in sys.modules:
        return _llvm_facts()
    return _cached_facts()


def _llvm_facts() -> CompilerFacts:
    """Properties from LLVM; loads LLVM."""
    import llvmlite.binding as llvm

    features = llvm.get_host_cpu_features().flatten()
    triple = llvm.get_process_triple()
    if sys.platform == "win32" and not triple.endswith("-elf"):
        triple += "-elf"  # Windows calling convention in object files that our loader reads
    return CompilerFacts(str(llvm.llvm_version_info), triple, llvm.get_host_cpu_name(), features)


@cache
def _cached_facts() -> CompilerFacts:
    """Properties in the cache for this processor and this build of LLVM; from LLVM if the cache has none."""
    processor = _processor_description()
    if processor is None:
        return _llvm_facts()
    key = object_cache.digest("compiler", *_llvmlite_description(), processor).hex()
    entry = object_cache.load(key) or b""  # no entry counts as one of another form
    cached_facts = _facts_from_entry(entry)
    if cached_facts is not None:
        return cached_facts
    facts = _llvm_facts()
    object_cache.store(key, "\n".join(facts).encode())
    return facts


def _facts_from_entry(entry: bytes) -> CompilerFacts | None:
    """Properties in an entry of the cache, one a line; None for an entry of another form."""
    try:
        lines = entry.decode().split("\n")
    except UnicodeDecodeError:
        return None
    if len(lines) != len(CompilerFacts._fields):
        return None
    return CompilerFacts(*lines)


def _llvmlite_description() -> list[str]:
    """Version of llvmlite, and sizes and times of its libraries, which differ between builds."""
    import llvmlite

    folder = Path(str(llvmlite.__file__)).parent / "binding"
    description = [llvmlite.__version__]
    for path in sorted(folder.glob("*llvmlite*")):
        status = path.stat()
        description.append(f"{status.st_size} {status.st_mtime_ns}")
    return description


_CPUINFO = Path("/proc/cpuinfo")
"""Report on the processor in Linux."""
_FIELDS_OF_ONE_CORE = (
    "processor",
    "cpu MHz",
    "core id",
    "apicid",
    "initial apicid",
    "physical id",
    "bogomips",
    "BogoMIPS",
)
"""Fields of the report that differ between cores or over time."""
_REPORT_BYTES = 8192
"""Number of bytes of the report that are read; the first core needs fewer."""


def _processor_description() -> str | None:
    """Description that distinguishes this processor from others; None if it cannot be read quickly.

    It consists of the system's report on the first core, and of the features that NumPy finds. NumPy queries the processor
    itself: under an emulator, this may have fewer features than the report.
    """
    from numpy._core import _multiarray_umath  # type: ignore[attr-defined]

    has_feature: dict[str, bool] = getattr(_multiarray_umath, "__cpu_features__", {})
    try:
        with _CPUINFO.open("rb", buffering=0) as file:
            report = file.read(_REPORT_BYTES) or b""  # an unbuffered file may return None
    except OSError:
        return None
    text = report.decode("utf-8", "replace")
    first_core, end_of_core, _ = text.partition("\n\n")
    lines = []
    for line in first_core.splitlines():
        field, _, _ = line.partition(":")
        if field.strip() not in _FIELDS_OF_ONE_CORE:
            lines.append(line)
    names_features = any(line.startswith(("flags", "Features")) for line in lines)
    is_complete = end_of_core != "" and names_features
    if not has_feature or not is_complete:
        return None
    features = [name for name, is_present in has_feature.items() if is_present]
    return "\n".join([platform.machine(), *lines, *features])


# ── Target processor: name, features, vector width, and fused products

# The target is the host, or a lesser processor that ``TWISTWRENCH_CPU`` names. With the same target, all machines of a cluster
# run the same code.

VARIABLE = "TWISTWRENCH_CPU"
"""Environment variable with the name of the target processor."""


@dataclass(frozen=True)
class Precision:
    """Floating-point type: its name in LLVM, its size, and its letter in NumPy."""

    llvm: str
    """Name in LLVM."""
    bytes: int
    """Size in bytes."""
    char: str
    """Letter in NumPy and in :mod:`struct`."""
    mantissa: int
    """Stored bits of the significand."""

    @property
    def bits(self) -> int:
        """Size in bits."""
        return 8 * self.bytes

    def rounded(self, value: float) -> float:
        """Nearest representable number; infinity above the largest, as NumPy rounds."""
        try:
            (rounded_value,) = struct.unpack(self.char, struct.pack(self.char, value))
        except OverflowError:
            return math.copysign(math.inf, value)
        return float(rounded_value)

    def pattern(self, value: float) -> int:
        """Bits of the nearest representable number as a signed integer; larger positive numbers have larger integers."""
        packed = struct.pack(f"<{self.char}", self.rounded(value))
        return int.from_bytes(packed, "little", signed=True)


DOUBLE = Precision("double", bytes=8, char="d", mantissa=52)
SINGLE = Precision("float", bytes=4, char="f", mantissa=23)


@dataclass(frozen=True)
class Machine:
    """Description of a processor for the compiler; triple, cpu and features are as in :class:`CompilerFacts`."""

    triple: str
    cpu: str
    features: str
    vector_bits: int
    """Size of the widest vectors."""
    fused: bool = True
    """True if the machine computes a b + c with one rounding. Otherwise code rounds twice, since emulation would be slow."""

    def narrowed(self, bits: int) -> Machine:
        """Copy of the machine, with vectors of ``bits`` bits."""
        return replace(self, vector_bits=bits)

    def lanes(self, precision: Precision) -> int:
        """Number of samples in a vector."""
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
    facts = compiler()
    return _machine(facts.triple, facts.cpu, facts.features, facts.present)


def choices() -> dict[str, Machine]:
    """Processors that ``TWISTWRENCH_CPU`` may name, by name: the host, and others whose code the host runs."""
    triple = host().triple
    machines = {"host": host()}
    if _is_x86(triple):
        present: frozenset[str] = frozenset()
        for level, added_features in X86_LEVELS.items():
            present |= {*added_features}
            if not _missing_features(level):
                machines[level] = _machine(triple, level, "", present)
    elif triple.startswith(("aarch64", "arm64")):
        machines["armv8-a"] = _machine(triple, "generic", "", frozenset())
    return machines


def chosen() -> Machine:
    """Target processor: the host, or the processor that ``TWISTWRENCH_CPU`` names.

    Raises ValueRangeError for an unknown name, or for a processor whose code the host cannot run.
    """
    name = os.environ.get(VARIABLE, "").strip().lower()
    if name in ("", "host"):
        return host()
    machines = choices()
    if name not in machines:
        reason = ""
        if name in X86_LEVELS and _is_x86(host().triple):
            reason = f" {name} wants {', '.join(_missing_features(name))}."
        raise ValueRangeError(
            f"{VARIABLE}: {os.environ[VARIABLE]!r} names no processor whose code this one ({host().cpu}) runs.{reason}"
            f" Allowed here: {', '.join(machines)}."
        )
    return machines[name]


def _machine(triple: str, cpu: str, features: str, present: frozenset[str]) -> Machine:
    """Machine with the widest vectors that the features ``present`` allow.

    All 64-bit processors of LLVM have vectors of 128 bits: SSE2, NEON or an equivalent.
    """
    if {"avx512f", "avx512dq"} <= present:
        use_all_bits = "-prefer-256-bit"  # LLVM would split vectors of 512 bits on some processors
        all_features = f"{features},{use_all_bits}" if features else use_all_bits
        return Machine(triple, cpu, all_features, vector_bits=512)
    fused = not _is_x86(triple) or bool({"fma", "fma4"} & present)
    vector_bits = 256 if "avx" in present else 128
    return Machine(triple, cpu, features, vector_bits, fused)


def _is_x86(triple: str) -> bool:
    return triple.startswith(("x86_64", "amd64", "i386", "i486", "i586", "i686"))


def _missing_features(level: str) -> list[str]:
    """Features that the host lacks, of an x86-64 level and of all levels below it."""
    present = compiler().present
    missing_features = []
    for name, features in X86_LEVELS.items():
        missing_features += [feature for feature in features if feature not in present]
        if name == level:
            break
    return missing_features
