"""Where and with what the benchmark ran."""

import datetime
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

PACKAGES = ("twistwrench", "numpy", "llvmlite", "scipy", "pin", "mujoco", "modern_robotics", "example-robot-data")


def describe() -> dict[str, Any]:
    cpu = _cpu()
    return {
        "date": datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d"),
        "cpu": cpu.get("model name") or platform.processor() or platform.machine(),
        "family": " ".join(f"{name} {cpu[name]}" for name in ("cpu family", "model") if name in cpu),
        "vectors": _vectors(cpu.get("flags", "").split()),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "versions": {name: found for name in PACKAGES if (found := _version(name))},
    }


def _cpu() -> dict[str, str]:
    """The first processor's entries of /proc/cpuinfo, where there is such a file."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().split("\n\n")[0].splitlines() if cpuinfo.exists() else []
    pairs = (line.split(":", 1) for line in lines if ":" in line)
    return {name.strip(): value.strip() for name, value in pairs}


def _vectors(flags: list[str]) -> str:
    """The widest registers, which set how many states a kernel computes side by side."""
    if "avx512f" in flags:
        return "AVX-512, 8 doubles"
    if "avx2" in flags:
        return "AVX2, 4 doubles"
    return "unknown"


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
