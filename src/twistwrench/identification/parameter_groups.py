"""Base parameters: the groups of parameters that torques tell, whatever the motion.

W on random states has columns that are sums of others. First come, first kept from the base outward; with W_b those kept and
W_d = W_b B the others, τ = W_b (x_b + B x_d): the groups are x_b + B x_d.

Source: Gautier, "Numerical calculation of the base inertial parameters of robots", J. Robotic Systems 8(4), 1991. The rank is
decided on random states with an absolute scale: of a log, columns that are nothing but rounding would look like any other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.printed_numbers import number
from ..typing import Array
from .unknown_parameters import UnknownParameters

_NOTHING = 1e-9
"""Share of a column's own length, or of the longest's, below which what others leave of it is rounding."""
_ROWS_PER_COLUMN = 3
_HELD = 1e-7
"""Share of its size by which a known value may be missed."""
_EXACT = 1e-7
"""Coefficients below that are rounding, in units of the columns' own lengths."""


@dataclass(frozen=True, eq=False)
class BaseParameters:
    """Base parameters of a robot: which parameters are kept, and what each kept one stands for.

    Attributes
    ----------
    unknown : UnknownParameters
    kept : (r,) array, numbers of the parameters kept
    grouping : (r, p) array; the groups are ``grouping @ x``
    felt : (nv, r) bool array, the kept columns that are not zero in the torque of each joint

    Examples
    --------
    >>> import twistwrench as tw
    >>> base = BaseParameters.of(UnknownParameters(tw.robots.pendulum(), friction=()))
    >>> base.names
    ('rod.Iyy + hinge.motor_inertia', 'rod.mcx', 'rod.mcz')
    """

    unknown: UnknownParameters
    kept: Array
    grouping: Array
    felt: Array

    @classmethod
    def of(cls, unknown: UnknownParameters, *, seed: int = 0) -> BaseParameters:
        """Base parameters from random states.

        Parameters
        ----------
        unknown : UnknownParameters
        seed : int, of the states

        Returns
        -------
        base : BaseParameters

        Examples
        --------
        >>> import twistwrench as tw
        >>> BaseParameters.of(UnknownParameters(tw.robots.planar_2r(), motor_inertia=False, friction=())).count
        6
        """
        robot, p = unknown.robot, len(unknown.names)
        nv = robot.nv
        rng = np.random.default_rng(seed)
        states = -(-_ROWS_PER_COLUMN * p // nv) + 8
        q = np.stack([robot.random_configuration(rng) for _ in range(states)])
        turning = np.array([b.joint.turning[0] for b in unknown.model.leaders])
        q = np.where(turning, rng.uniform(-np.pi, np.pi, q.shape), q)
        dq, ddq = rng.normal(size=(2, states, nv)) * 2.0
        ones = np.ones(nv)
        W = unknown.columns(np.arange(p), q, dq, ddq, 0.5 * ones)
        scale = unknown.scales(ones, ones, ones)
        free = np.flatnonzero(~unknown.held)
        kept, found = _kept((W * scale)[..., free].reshape(states * nv, len(free)))
        # W S z with x = S z: z_b + B z_d is the group, in units of x its kept parameter's.
        grouping = np.eye(p)  # what is known is a group of its own
        grouping[np.ix_(free[kept], free)] = _rounded(found) * scale[free[kept]][:, None] / scale[None, free]
        kept = np.sort(np.concatenate([free[kept], np.flatnonzero(unknown.held)]))
        return cls(unknown, kept, grouping[kept], (W[..., kept] != 0).any(axis=0))

    @property
    def held(self) -> Array:
        """(r,) bool, groups that are a parameter whose value is known."""
        return np.asarray(self.unknown.held[self.kept])

    def weak_sizes(self, sizes: Array) -> Array:
        """Sizes that groups could have at most, where parameters could have sizes (p,); next to none for what is known.

        Parameters
        ----------
        sizes : (p,) array

        Returns
        -------
        sizes : (r,) array

        Examples
        --------
        >>> import twistwrench as tw
        >>> base = BaseParameters.of(UnknownParameters(tw.robots.pendulum(), friction=(), known={"rod.mcx": 0.0}))
        >>> base.weak_sizes(np.ones(11)).round(3).tolist()
        [1.414, 0.0, 1.0]
        """
        return np.sqrt(self.grouping**2 @ sizes**2) * np.where(self.held, _HELD, 1.0)

    @property
    def count(self) -> int:
        """How many groups there are."""
        return len(self.kept)

    @property
    def names(self) -> tuple[str, ...]:
        """The groups in words: ``link_2.mcx + 0.225 link_3.m``, the parameter kept first."""
        return tuple(self._name(k) for k in range(self.count))

    def project(self, values: Array) -> Array:
        """Groups of given parameters.

        Parameters
        ----------
        values : (p,) array, a value of each unknown parameter

        Returns
        -------
        groups : (r,) array

        Examples
        --------
        >>> import twistwrench as tw
        >>> base = BaseParameters.of(UnknownParameters(tw.robots.planar_2r(), motor_inertia=False, friction=()))
        >>> base.project(base.unknown.file_values).shape
        (6,)
        """
        return np.asarray(self.grouping @ values)

    def _name(self, row: int) -> str:
        names, text = self.unknown.names, ""
        first = int(self.kept[row])
        order = [first, *(k for k in np.flatnonzero(self.grouping[row]).tolist() if k != first)]
        for k in order:
            value = float(self.grouping[row, k])
            size = "" if abs(abs(value) - 1.0) < 1e-6 else f"{number(abs(value), 6)} "
            sign = ("-" if value < 0 else "") if not text else (" - " if value < 0 else " + ")
            text += f"{sign}{size}{names[k]}"
        return text


def _kept(W: Array) -> tuple[Array, Array]:
    """Numbers of the columns that are no sums of those before them, and all columns in terms of these; (r,), (r, p).

    Gram and Schmidt's way, twice for each column, so that rounding stays where it is.
    """
    rows, p = W.shape
    lengths = np.linalg.norm(W, axis=0)
    longest = float(lengths.max(initial=0.0))
    Q = np.zeros((rows, p))
    kept: list[int] = []
    for k in range(p):
        if lengths[k] <= _NOTHING * longest:
            continue
        rest = W[:, k].copy()
        for _ in range(2):
            rest -= Q[:, : len(kept)] @ (Q[:, : len(kept)].T @ rest)
        size = float(np.linalg.norm(rest))
        if size > 1e3 * _NOTHING * lengths[k]:
            Q[:, len(kept)] = rest / size
            kept.append(k)
    which = np.array(kept, int)
    solved = np.linalg.lstsq(W[:, which], W, rcond=None)[0] if kept else np.zeros((0, p))
    relative = lengths[None, :] / np.maximum(lengths[which][:, None], 1e-300)
    solved[np.abs(solved) < _EXACT * np.maximum(relative, 1e-6)] = 0.0
    solved[:, which] = np.eye(len(which))
    return which, solved


def _rounded(grouping: Array) -> Array:
    return np.where(np.abs(grouping) < 1e-12, 0.0, grouping)
