"""Closed mechanisms, made once a module."""

from __future__ import annotations

import pytest
from mechanisms import closed_platform, four_bar


@pytest.fixture(scope="module")
def linkage():
    return four_bar().close("rocker_pin", "coupler_pin", "vx vz")


@pytest.fixture(scope="module")
def platform():
    return closed_platform()
