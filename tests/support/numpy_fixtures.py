"""A fixture for files whose robots are used a few times each: a pytest plugin."""

from __future__ import annotations

import pytest


@pytest.fixture(scope="module")
def on_numpy():
    """Programs run on NumPy here: nothing to compile, and that compiled ones agree is another test's business."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TWISTWRENCH_JIT", "0")
        yield
