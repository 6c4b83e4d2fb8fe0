"""Machine code in this process: compilation, loading, calls, threads and memory of results."""

from __future__ import annotations
