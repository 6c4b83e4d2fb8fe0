"""Robots that are built once for many test files of a worker."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable
from typing import Any


def shared(build: Callable[..., Any]) -> Callable[..., Any]:
    """Cache of a builder: files that run on NumPy do not get the robots of those that compile, which keep their kernels."""

    @functools.cache
    def build_once(_jit: str | None, *args: Any, **options: Any) -> Any:
        return build(*args, **options)

    @functools.wraps(build)
    def built(*args: Any, **options: Any) -> Any:
        return build_once(os.environ.get("TWISTWRENCH_JIT"), *args, **options)

    return built
