"""The processor code is made for: its name, its features, the width of its vectors."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

__all__ = ["Machine", "Precision", "host"]


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


DOUBLE = Precision("double", 8, "d", 52)
SINGLE = Precision("float", 4, "f", 23)


@dataclass(frozen=True)
class Machine:
    """What the compiler is told about a processor."""

    triple: str
    cpu: str
    features: str
    vector_bits: int

    def lanes(self, precision: Precision) -> int:
        """Samples computed side by side."""
        return self.vector_bits // precision.bits


@cache
def host() -> Machine:
    """The processor this process runs on."""
    import llvmlite.binding as llvm

    features = llvm.get_host_cpu_features()
    if features.get("avx512f") and features.get("avx512dq"):
        bits = 512
    elif features.get("avx2") and features.get("fma"):
        bits = 256
    else:  # SSE2 and NEON; every 64-bit processor LLVM serves has one of them or an equal
        bits = 128
    wide = ",-prefer-256-bit" if bits == 512 else ""
    return Machine(llvm.get_process_triple(), llvm.get_host_cpu_name(), features.flatten() + wide, bits)
