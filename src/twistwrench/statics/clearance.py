"""Clearance: smallest distances between the links of a robot. Capsules around the links prune pairs before coal is used.

The distance of two capsules is a lower bound of the distance of the shapes inside. Only pairs with a bound below the
smallest distance found so far are evaluated, so the result holds for all pairs. Meshes are evaluated as triangles,
since convex hulls can touch where the meshes are far apart. Without coal the capsule bounds are returned. Motion
between configurations is not checked.

Source: Montaut et al., "GJK++: Leveraging Acceleration Methods for Faster Collision Detection", 2024, for distances by coal.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.answers.blocks import Block, Headline
from ..core.errors import MissingExtraError, ModelError, ModelWarning
from ..core.glossary import complete
from ..core.numbers import quantity, seconds
from ..core.text import listed
from ..core.typing import Array
from ..core.verdict import Verdict
from ..mechanics.model.description import frames_to_user
from ..robot import Robot
from .link_pairs import Exact, LinkPairs

STEP = 0.01
"""Time between evaluated rows of a motion [s]; rows between them are skipped."""
_MAX_LISTED_PAIRS = 4
"""Largest number of pairs or links that a sentence lists."""
_ADVICE_ON_COAL = f"decided by coal: {MissingExtraError.advice('clearance')}"
"""Advice for pairs that capsules alone do not decide."""


@dataclass(frozen=True, eq=False)
class Clearance:
    """Smallest distance between links, for each configuration of a batch.

    Examples
    --------
    >>> import twistwrench as tw
    >>> found = tw.robots.ur5().clearance([0, -1, 1, 0, 0, 0], exact=False)
    >>> len(found.unknown), float(found.distance)  # its file has no shapes
    (7, nan)
    """

    distance: Array
    """(...) smallest distance [m], 0 in contact; a lower bound unless :attr:`exact`.

    Without pairs it is inf, or NaN if links are :attr:`unknown`.
    """
    pair: Array
    """(..., 2) names of the two links; empty without pairs."""
    exact: bool
    """True if coal evaluated the shapes, False if the distances are those of capsules around them."""
    unknown: tuple[str, ...]
    """Links with mass whose shape is missing or cannot be read."""
    undecided: tuple[str, ...] = ()
    """Pairs left out because their capsules always overlap; empty if coal is used."""
    touching: tuple[str, ...] = ()
    """Pairs left out because they are in contact in 95 % of random configurations."""
    hidden: tuple[str, ...] = ()
    """Pairs of links of which one may be inside the other, which has a mesh that is not closed, in some configuration."""


# ── Clearance of configurations, along motions, and of inverse kinematics


def clearance_of(robot: Robot, q: ArrayLike, exact: Exact, srdf: str | Path | None) -> Clearance:
    """Clearance of configurations: :meth:`twistwrench.Robot.clearance`."""
    configurations = arguments.finite(q, "clearance: q", robot.nq, names=robot.coordinate_names)
    pairs = LinkPairs.from_robot(robot, exact, srdf)
    rows = np.asarray(configurations, float).reshape(-1, robot.nq)
    all_nearest = pairs.nearest(rows)
    distances = np.array([nearest.distance for nearest in all_nearest])
    if len(pairs.links):
        pair_indices = np.array([nearest.pair for nearest in all_nearest], int)
        names = pairs.names[pair_indices]
    else:
        names = np.full((len(all_nearest), 2), "")
        if pairs.unknown:
            distances = np.full(len(all_nearest), np.nan)
    hidden: frozenset[int] = frozenset().union(*(nearest.hidden for nearest in all_nearest))
    shape = configurations.shape[:-1]
    return Clearance(
        distance=distances.reshape(shape),
        pair=names.reshape(*shape, 2),
        exact=pairs.shapes is not None,
        unknown=pairs.unknown,
        undecided=pairs.undecided,
        touching=pairs.touching,
        hidden=pairs.pair_texts(hidden),
    )


@dataclass(frozen=True)
class PathClearance:
    """Smallest distance between links along a motion, and its verdict."""

    pairs: LinkPairs
    asked: float
    """Required distance [m]."""
    distance: float = np.inf
    """Smallest distance [m]."""
    pair: tuple[str, str] = ("", "")
    """Nearest links; empty without pairs."""
    time: float = np.nan
    """Time of the smallest distance [s]."""
    step: float = 0.0
    """Longest interval between evaluated rows [s]."""
    hidden: frozenset[int] = frozenset()
    """Indices of pairs of which one link may be inside the other."""

    @classmethod
    def along(
        cls, robot: Robot, samples: Iterable[tuple[Array, Array]], asked: float, srdf: str | Path | None = None
    ) -> PathClearance:
        """Smallest distance over portions of times (n,) [s] and configurations (n, nq), at rows about :data:`STEP` apart."""
        pairs = LinkPairs.from_robot(robot, "auto", srdf)
        result = cls(pairs, arguments.positive(asked, "clearance", "m", zero=True))
        for time, q in samples:
            steps = np.diff(time)
            stride = 1  # from one evaluated row to the next
            if len(steps):
                usual_step = max(float(np.median(steps)), 1e-9)  # not zero
                stride = max(1, int(STEP / usual_step + 1e-9))  # a whole ratio is not rounded down
            rows = np.unique(np.append(np.arange(0, len(time), stride), len(time) - 1))
            longest_step = max(result.step, float(np.diff(time[rows]).max(initial=0.0)))
            nearest, k = pairs.nearest_row(q[rows], result.distance)  # k is -1 if no row is nearer than those before
            result = replace(result, step=longest_step, hidden=result.hidden | nearest.hidden)
            if k >= 0:
                first, second = pairs.names[nearest.pair].tolist()
                result = replace(result, distance=nearest.distance, pair=(first, second), time=float(time[rows[k]]))
        return result

    @property
    def words(self) -> str:
        """Nearest links, their distance with its time, and the method of evaluation, as a text."""
        if not self.pair[0]:
            if self.pairs.unknown:
                return "Closest links: not known"
            return "Closest links: no two can touch"
        if self.pairs.shapes is not None:
            method = "exact"
            distance_text = f"{quantity(self.distance, 'm', 3)} at" if self.distance > 0.0 else "in contact from"
        else:
            method = "capsules around the links"
            distance_text = "capsules overlap from"
            if self.distance > 0.0:
                distance_text = f"at least {quantity(self.distance, 'm', 3)} at"
        step_text = ""
        if self.step:
            step_text = f", every {quantity(1000.0 * self.step, 'ms', 3)}"
        return (
            f"Closest links: {' – '.join(self.pair)}, {distance_text} t = {seconds(self.time)} s ({method}{step_text})"
        )

    @property
    def lines(self) -> list[str]:
        """Sentences on the nearest links and on the pairs left out because they are always in contact."""
        lines = [f"{self.words}."]
        left_out_pairs = listed(self.pairs.touching, _MAX_LISTED_PAIRS, "; ")
        if left_out_pairs:
            lines.append(f"Not judged, as in contact in 95 % of configurations: {left_out_pairs}.")
        return lines

    def blocks(self) -> Iterator[Block]:
        """Verdict unless OK, and the nearest links."""
        if not self.verdict.ok:
            yield Headline.from_verdict(self.verdict)
        yield from self.lines

    @cached_property
    def verdict(self) -> Verdict:
        """COLLISION in contact, OVER LIMIT if too near, UNSURE if only capsules decide or shapes are missing."""
        collision: list[str] = []
        over: list[str] = []
        unsure: list[str] = []
        links = " and ".join(self.pair)
        when = f"at t = {seconds(self.time)} s"
        required_distance = quantity(self.asked, "m", 3)
        is_exact = self.pairs.shapes is not None
        if self.distance <= 0.0 and is_exact:
            collision.append(f"{links} are in contact {when}")
        elif self.distance < self.asked and is_exact:
            distance = quantity(self.distance, "m", 3)
            over.append(f"{links} come within {distance} {when}, and {required_distance} are required")
        elif self.distance <= self.asked and not is_exact:
            event = f"come within {required_distance}" if self.distance > 0.0 else "touch"
            unsure.append(f"{links} may {event} {when} (capsules; {_ADVICE_ON_COAL})")
        if self.pairs.undecided:
            pairs = listed(self.pairs.undecided, _MAX_LISTED_PAIRS, "; ")
            unsure.append(f"capsules always overlap and are not judged: {pairs} ({_ADVICE_ON_COAL})")
        if self.hidden:
            pairs = listed(self.pairs.pair_texts(self.hidden), _MAX_LISTED_PAIRS, "; ")
            unsure.append(f"a mesh is not closed, so it is not known whether one link is inside the other: {pairs}")
        if self.pairs.unknown:
            unknown_count = len(self.pairs.unknown)
            link_count = unknown_count + self.pairs.known
            unsure.append(
                f"clearance not known of {unknown_count} of {link_count} links, whose shapes are not in the file or "
                f"could not be read: {listed(self.pairs.unknown, _MAX_LISTED_PAIRS)}"
            )
        return Verdict.from_reasons(collision=collision, over=over, unsure=unsure)


def distances_for_search(robot: Robot) -> Callable[[Array], Clearance]:
    """Function for inverse kinematics that returns the clearance of configurations.

    Warns of links without shapes, and raises ModelError if no link has a shape.
    """
    pairs = LinkPairs.from_robot(robot)
    if pairs.unknown and not pairs.known:
        raise ModelError(f"the clearance of robot {robot.name!r} is not known: no link has a shape that could be read.")
    for doubt in PathClearance(pairs, 0.0).verdict.reasons:
        warnings.warn(f"inverse_kinematics: {doubt}.", ModelWarning, stacklevel=frames_to_user())
    return lambda q: clearance_of(robot, q, "auto", None)


complete(globals())
