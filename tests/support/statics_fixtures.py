"""Arms at rest: one with closed forms, and three to try laws on.

PYTEST_DONT_REWRITE: tests import from it before it is a plugin.
"""

from __future__ import annotations

import pytest

import twistwrench as tw

STRONG = [50.0, 20.0]
"""N m: limits of the two-link arm."""


@pytest.fixture
def arm():
    return tw.robots.planar_2r()


@pytest.fixture(params=["ur5", "panda", "planar_2r"])
def robot(request, bundled):
    return bundled(request.param)
