"""Memory of the process that asks."""

from __future__ import annotations

import re
import sys
from pathlib import Path


def peak_memory() -> float:
    """Largest resident memory of this process [MiB]; a child begins with its own, where ``ru_maxrss`` begins with its parent's."""
    if sys.platform.startswith("linux"):
        return int(re.search(r"VmHWM:\s+(\d+)", Path("/proc/self/status").read_text("ascii"))[1]) / 1024
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1 << 20)
