"""Hypothesis strategies for ``@given``: robots and states. Needs the extra ``test``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ..core.errors import MissingExtraError
from ..robot import Robot
from . import KINDS, State, random_robot, random_state

if TYPE_CHECKING:
    from hypothesis.strategies import SearchStrategy


def seeds() -> SearchStrategy[int]:
    """Seeds of random generators; failing examples shrink to small numbers."""
    return _strategies().integers(0, 2**32 - 1)


def robots(joints: int = 4, kinds: Sequence[str] = KINDS, **options: Any) -> SearchStrategy[Robot]:
    """Random robots with one to ``joints`` joints; further options as for :func:`~twistwrench.testing.random_robot`.

    >>> robots(joints=2).map(lambda robot: robot.nv > 0).example()  # doctest: +SKIP
    True
    """
    st = _strategies()
    return st.builds(
        lambda seed, count: random_robot(seed, count, kinds, **options), seed=seeds(), count=st.integers(1, joints)
    )


def robots_with_states(
    joints: int = 4, kinds: Sequence[str] = KINDS, **options: Any
) -> SearchStrategy[tuple[Robot, State]]:
    """Random robots, each with a random state."""
    st = _strategies()
    return st.builds(
        lambda robot, seed: (robot, random_state(robot, seed)), robot=robots(joints, kinds, **options), seed=seeds()
    )


def _strategies() -> Any:
    try:
        from hypothesis import strategies
    except ImportError:
        raise MissingExtraError.from_extra(
            "hypothesis", "test", "Drawing robots (twistwrench.testing.strategies)"
        ) from None
    return strategies
