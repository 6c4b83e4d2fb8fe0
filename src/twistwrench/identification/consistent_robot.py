"""A robot of bodies that can exist, near the file's, as the logs have it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..algorithms.regressor import PARAMETER_NAMES
from ..bodies.inertia import SpatialInertia
from ..core.printed_numbers import number
from ..listing import listed
from ..model.actuation import with_friction
from ..robot import Robot
from ..typing import Array
from .normal_equations import Information, Prior
from .parameter_groups import BaseParameters
from .positive_bodies import STRENGTHS, PositiveFit, PositivePrior, PositiveProblem

_NEAR_BEST = 1.01
"""Times the least residual held out, that a stronger pull to the file may leave."""


@dataclass(frozen=True, eq=False)
class ConsistentRobot:
    """Consistent robot: bodies that can exist, friction and motor inertias that are positive.

    Attributes
    ----------
    base : BaseParameters
    fit : PositiveFit, the one chosen
    curve : tuple of (γ, share), |τ - τ̂| / |τ| of fifths held out for each strength that was tried
    of_file : float, the same of the file's bodies with friction fitted
    repaired : tuple of str, links whose inertia in the file had to be thickened first
    """

    base: BaseParameters
    fit: PositiveFit
    curve: tuple[tuple[float, float], ...]
    of_file: float
    repaired: tuple[str, ...]

    @property
    def held_out(self) -> float:
        """|τ - τ̂| / |τ| of fifths held out, at the strength chosen."""
        return dict(self.curve)[self.fit.strength]

    def value(self, name: str) -> float:
        """A parameter by its name.

        Parameters
        ----------
        name : str, such as ``link_2.m``

        Returns
        -------
        value : float

        Raises
        ------
        ValueError
            There is none of that name.

        Examples
        --------
        >>> fit = PositiveFit(1.0, np.arange(28.0), 0.0, 0)
        >>> import twistwrench as tw
        >>> from twistwrench.identification.unknown_parameters import UnknownParameters
        >>> base = BaseParameters.of(UnknownParameters(tw.robots.planar_2r()))
        >>> ConsistentRobot(base, fit, ((1.0, 0.1),), 0.2, ()).value("joint1.viscous")
        11.0
        """
        return float(self.fit.values[self.base.unknown.names.index(name)])

    @property
    def inertias(self) -> tuple[SpatialInertia, ...]:
        """Of each moving body, fixed links fused, in its own frame; zero of what only stands between two joints of a link."""
        unknown = self.base.unknown
        values = np.zeros((len(unknown.model.bodies), len(PARAMETER_NAMES)))
        mine = unknown.of_bodies >= 0
        values.reshape(-1)[unknown.of_bodies[mine]] = self.fit.values[mine]
        return tuple(map(SpatialInertia.from_parameters, values))

    def of_joints(self, kind: str) -> dict[str, float]:
        """Numbers of one kind by joint; joints without one are left out.

        Parameters
        ----------
        kind : str, ``motor_inertia``, ``viscous``, ``coulomb``, ``stribeck`` or ``offset``

        Returns
        -------
        numbers : {joint: number}

        Examples
        --------
        >>> fit = PositiveFit(1.0, np.arange(28.0), 0.0, 0)
        >>> import twistwrench as tw
        >>> from twistwrench.identification.unknown_parameters import UnknownParameters
        >>> base = BaseParameters.of(UnknownParameters(tw.robots.planar_2r()))
        >>> ConsistentRobot(base, fit, ((1.0, 0.1),), 0.2, ()).of_joints("offset")
        {'joint1': 13.0, 'joint2': 27.0}
        """
        names = self.base.unknown.names
        return {
            joint: float(self.fit.values[names.index(f"{joint}.{kind}")])
            for joint in self.base.unknown.model.velocity_names
            if f"{joint}.{kind}" in names
        }

    def outside(self, interval: Array, deviations: Array) -> list[str]:
        """Sentence on groups that the pull to the file takes out of their intervals.

        Parameters
        ----------
        interval : (r, 2) array, of each group
        deviations : (r,) array

        Returns
        -------
        sentences : list of str, one or none

        Examples
        --------
        >>> fit = PositiveFit(1.0, np.arange(28.0), 0.0, 0)
        >>> import twistwrench as tw
        >>> from twistwrench.identification.unknown_parameters import UnknownParameters
        >>> base = BaseParameters.of(UnknownParameters(tw.robots.planar_2r()))
        >>> found = ConsistentRobot(base, fit, ((1.0, 0.1),), 0.2, ())
        >>> found.outside(base.project(fit.values)[:, None] + [-1.0, 1.0], np.ones(base.count))
        []
        """
        low, high = interval.T
        values = self.base.project(self.fit.values)
        out = np.maximum(values - high, low - values) / np.maximum(deviations, 1e-300)
        worst = [int(k) for k in np.argsort(-out) if out[k] > 0]
        if not worst:
            return []
        groups = [f"{self.base.names[k]} {number(values[k])} ({number(low[k])} to {number(high[k])})" for k in worst]
        return [
            f"bodies that can exist, pulled to the file's, put {len(worst)} of {len(values)} groups outside their 95 % "
            f"intervals: {listed(groups, 3, '; ')}. Torques held out are predicted as well; a smaller pull (consistent_at, "
            "--keep-close) stays nearer to the log"
        ]

    @property
    def of_several_joints(self) -> dict[str, float]:
        """Friction and motor inertia of motors that turn several joints at once, by name: no file has a place for them."""
        unknown = self.base.unknown
        kinds = {"motor_inertia", "viscous", "coulomb", "stribeck"}
        return {
            name: float(value)
            for name, value in zip(unknown.names, self.fit.values, strict=True)
            if "+" in name
            and name.rpartition(".")[2] in kinds
            and name.rpartition(".")[0] not in unknown.model.velocity_names
        }

    @property
    def robot(self) -> Robot:
        """The robot with these bodies, and with friction and motor inertias as its joints feel them."""
        model = self.base.unknown.model
        bodies = tuple(replace(body, inertia=G) for body, G in zip(model.bodies, self.inertias, strict=True))
        laws: dict[str, dict[str, float]] = {joint: {} for joint in model.velocity_names}
        for law in ("viscous", "coulomb"):
            for joint, value in self.of_joints(law).items():
                laws[joint][law] = value
        for joint, value in self.of_joints("stribeck").items():
            static = laws[joint].get("coulomb", 0.0) + value
            laws[joint] |= {"static": static, "stribeck": self.base.unknown.stribeck_speed}
        given = self.of_joints("motor_inertia")
        armature = np.array([given.get(joint, 0.0) for joint in model.velocity_names])
        return Robot(with_friction(replace(model, bodies=bodies, armature=armature), laws))


def consistent_robot(
    base: BaseParameters,
    values: Array,
    sizes: Array,
    folds: Sequence[Information],
    weak: Prior,
    strength: float | None = None,
) -> ConsistentRobot:
    """The robot of bodies that can exist whose pull to the file is the strongest that predicts as well as any.

    ``folds`` are N, c and |τ|² of fifths of the rows; ``strength`` None: chosen on them.
    """
    prior = PositivePrior.of(base, values, sizes)
    parts = [fold for fold in folds if fold[2] > 0]
    total = sum_of(parts)
    strengths = (
        STRENGTHS
        if strength is None
        else tuple(sorted({*(s for s in STRENGTHS if s > strength), strength}, reverse=True))
    )
    left = np.zeros(len(strengths))
    of_file = 0.0
    for k, part in enumerate(parts):
        rest = sum_of([p for j, p in enumerate(parts) if j != k]) if len(parts) > 1 else total
        fits = PositiveProblem(base, prior, *rest, sizes).path(strengths)
        left += [_squares(part, base.project(fit.values)) for fit in fits]
        of_file += _squares(part, file_with_drives(base, rest, weak))
    shares = np.sqrt(left / total[2])
    chosen = len(strengths) - 1 if strength is not None else int(np.argmax(shares <= _NEAR_BEST * shares.min()))
    fit = PositiveProblem(base, prior, *total, sizes).path(strengths[: chosen + 1])[-1]
    curve = tuple(zip(strengths, shares.tolist(), strict=True))
    return ConsistentRobot(base, fit, curve, float(np.sqrt(of_file / total[2])), prior.repaired)


def sum_of(parts: Sequence[Information]) -> Information:
    """Of the information of several parts."""
    N, c, y = parts[0]
    for other in parts[1:]:
        N, c, y = N + other[0], c + other[1], y + other[2]
    return N, c, y


def _squares(part: Information, x: Array) -> float:
    N, c, y = part
    return max(y - 2.0 * float(c @ x) + float(x @ N @ x), 0.0)


def file_with_drives(base: BaseParameters, rest: Information, weak: Prior) -> Array:
    """The file's bodies with the drives that fit best."""
    x = base.project(base.unknown.file_values)
    drives = np.flatnonzero(base.unknown.of_bodies[base.kept] < 0)
    if drives.size:
        N, c, _ = rest
        solver = Prior(np.zeros(len(drives)), weak.size[drives])
        x[drives] += solver.solve(N[np.ix_(drives, drives)], (c - N @ x)[drives])
    return x
