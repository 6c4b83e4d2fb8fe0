"""What LLVM says of itself and of the processor at hand, kept on disk.

Loading LLVM takes longer than all else that precedes a result from the cache, and all that is wanted of it then is these
four lines. Where it is loaded, it is asked itself.
"""

from __future__ import annotations

import platform
import sys
from functools import cache
from pathlib import Path
from typing import NamedTuple

from ..core import cache as disk

LOOP = "loop"
"""Name of the function that has the shape of a ufunc's inner loop."""


class CompilerFacts(NamedTuple):
    """LLVM and the processor it runs on, in LLVM's words."""

    version: str
    triple: str
    """What it makes code for."""
    cpu: str
    features: str
    """Of the processor: each name behind a ``+`` if it is there, else behind a ``-``."""

    @property
    def present(self) -> frozenset[str]:
        """The features that are there."""
        return frozenset(name[1:] for name in self.features.split(",") if name.startswith("+"))


def compiler() -> CompilerFacts:
    """LLVM's own words where it is loaded; else those it said before, with this processor, if they were kept."""
    return _asked() if "llvmlite.binding" in sys.modules else _kept()


def _asked() -> CompilerFacts:
    import llvmlite.binding as llvm

    features = llvm.get_host_cpu_features().flatten()
    triple = llvm.get_process_triple()
    if sys.platform == "win32" and not triple.endswith("-elf"):
        triple += "-elf"  # the calling convention of Windows in object files that our loader reads
    return CompilerFacts(str(llvm.llvm_version_info), triple, llvm.get_host_cpu_name(), features)


@cache
def _kept() -> CompilerFacts:
    about = _processor()
    if about is None:
        return _asked()
    key = disk.digest("compiler", *_llvmlite(), about).hex()
    words = (disk.load(key) or b"").decode().split("\n")
    if len(words) == len(CompilerFacts._fields):
        return CompilerFacts(*words)
    found = _asked()
    disk.store(key, "\n".join(found).encode())
    return found


def _llvmlite() -> list[str]:
    """Which llvmlite there is: its version, and size and time of its libraries."""
    import llvmlite

    folder = Path(str(llvmlite.__file__)).parent / "binding"
    stats = [path.stat() for path in sorted(folder.glob("*llvmlite*"))]
    return [llvmlite.__version__, *(f"{s.st_size} {s.st_mtime_ns}" for s in stats)]


_CPUINFO = Path("/proc/cpuinfo")
_OF_A_CORE = ("processor", "cpu MHz", "core id", "apicid", "initial apicid", "physical id", "bogomips", "BogoMIPS")
"""What the system says of one core, or of one moment."""


def _processor() -> str | None:
    """What tells this processor from others; None where the system has no short way to say it.

    The system's words are those of the machine; NumPy asks the processor itself, which an emulator may lend fewer features.
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
