"""Programs as source text: C99 and CUDA C++."""

from __future__ import annotations
