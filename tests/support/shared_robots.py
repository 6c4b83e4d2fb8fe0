"""Robots that are built once for many test files of a worker."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable
from typing import Any

from twistwrench.compiler.runtime import jit


def shared(build: Callable[..., Any]) -> Callable[..., Any]:
    """Cache of a builder. Robots keep their kernels: files that run on NumPy or judge machine code get others than the rest."""

    @functools.cache
    def build_once(_jit: str | None, _level: int, *args: Any, **options: Any) -> Any:
        return build(*args, **options)

    @functools.wraps(build)
    def built(*args: Any, **options: Any) -> Any:
        return build_once(os.environ.get("TWISTWRENCH_JIT"), jit.CODE_GENERATION_LEVEL, *args, **options)

    return built
