"""What tests of kernels share."""

from __future__ import annotations

import gc

import pytest


@pytest.fixture(scope="module", autouse=True)
def collect_new_objects_only() -> None:
    """Collections of these tests look at what they make themselves, not at what a worker keeps from earlier files."""
    gc.freeze()
