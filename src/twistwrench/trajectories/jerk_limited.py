"""Short motions of bounded jerk on a given path: the time-optimal motion averaged over time, improved by a local search.

Jerk limits make the time-optimal problem non-convex: H. Pham & Q.-C. Pham, "Time-optimal path tracking with jerk
constraints", ICRA 2017. Averaging s(t) over a time window keeps the path. The jerk is then the change of the
acceleration over the window, divided by its length. The result is not proven to be the shortest motion.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.glossary import complete
from ..core.typing import Array
from ..mechanics.algorithms.time_scalings import Averaged
from .trajectory import shortest_durations

if TYPE_CHECKING:
    from collections.abc import Callable

    from ..mechanics.model.limits import Limits
    from ..robot import Robot
    from .paths import JointPath

_MIN_WINDOW, _MIN_NODE_INTERVAL = 1.0 / 250.0, 1.0 / 1000.0
"""Shortest window, and least time between nodes, as shares of the time-optimal duration; samples resolve longer features."""
_INSTANTS = 801
"""Number of samples of a motion during the search."""
_GRID, _TRIALS = 8, 60
"""Grid of windows, and trials of the simplex search from the best of them."""
_FACTORS, _STEPS, _TRUST = 24, 10, 0.2
"""Number of nodes with a rate factor, number of linear programmes, and initial trust region of the log factors."""


def short_averages(
    robot: Robot, path: JointPath, nodes: Array, rates: Array, bounds: Limits, *, friction: bool
) -> tuple[Averaged, Averaged]:
    """Averages over time of a motion with given rates, optimised for a short duration within the bounds.

    Parameters
    ----------
    nodes, rates : (n,) arrays, s and ds/dt of the time-optimal motion

    Returns
    -------
    shapes : two Averaged, whose durations :func:`~twistwrench.trajectories.fitted` finds: the second is usually shorter

    Notes
    -----
    Longer windows take longer and lower the jerk; remaining violations are removed by a longer total duration. Windows
    are optimised first. Then factors of the rates and windows are optimised. Each step is a linear programme that
    minimises the largest duration required by any sample.
    """

    def durations(shape: Averaged) -> Array:
        return shortest_durations(robot, path, shape.stretched(1.0), bounds, instants, friction=friction)

    instants = np.linspace(0.0, 1.0, _INSTANTS)
    with np.errstate(invalid="ignore"):
        t = np.cumsum(np.nan_to_num(2.0 * np.diff(nodes) / (rates[1:] + rates[:-1])))
    first_of_interval = np.unique(np.floor(t / t[-1] / _MIN_NODE_INTERVAL), return_index=True)[1] + 1
    inner = first_of_interval[:-1]
    s, rates = (np.concatenate([x[:1], x[inner], x[-1:]]) for x in (nodes, rates))
    s[-1], rates[0], rates[-1] = 1.0, 0.0, 0.0
    with_windows = _choose_windows(s, rates, durations)
    return with_windows, _improve(with_windows, durations)


def _choose_windows(s: Array, rates: Array, durations: Callable[[Averaged], Array]) -> Averaged:
    """Best windows for the rates, either unchanged or with peaks replaced by coasts as long as both windows."""
    from scipy.optimize import minimize

    T = float((2.0 * np.diff(s) / (rates[1:] + rates[:-1])).sum())

    def shape(x: Array, *, coasts: bool) -> Averaged:
        b, a = (np.sort(np.exp(np.clip(x, np.log(_MIN_WINDOW), 0.0))) * T).tolist()
        nodes, node_rates = with_coasts(s, rates, a + b) if coasts else (s, rates)
        return Averaged(nodes, node_rates, (a, b), "jerk-limited")

    def duration(x: Array, coasts: bool) -> float:
        return float(durations(shape(x, coasts=coasts)).max())

    grid = np.linspace(np.log(_MIN_WINDOW), 0.0, _GRID)
    trials = [(np.array([a, b]), coasts) for a in grid for b in grid[grid <= a] for coasts in (False, True)]
    start, coasts = min(trials, key=lambda trial: duration(*trial))
    simplex = start - 0.5 * (grid[1] - grid[0]) * np.array([[0, 0], [1, 0], [0, 1]])
    options: Any = {"maxfev": _TRIALS, "initial_simplex": simplex}
    optimum: Any = minimize(duration, start, (coasts,), "Nelder-Mead", options=options)
    return shape(np.asarray(optimum.x), coasts=coasts)


def with_coasts(nodes: Array, rates: Array, duration: float) -> tuple[Array, Array]:
    """Nodes and rates of a motion whose rate peaks are cut to coasts of at least ``duration``.

    After averaging over that time, the change from acceleration to deceleration is two successive steps of
    acceleration.

    Parameters
    ----------
    nodes, rates : (n,) arrays, as in :class:`Averaged`; the rates are zero at both ends

    Examples
    --------
    >>> s, ds = with_coasts(np.array([0.0, 0.5, 1.0]), np.array([0.0, 1.0, 0.0]), 1.0)
    >>> s.round(6).tolist(), ds.round(6).tolist(), round(float((s[2] - s[1]) / ds[1]), 6)
    ([0.0, 0.190983, 0.809017, 1.0], [0.0, 0.618034, 0.618034, 0.0], 1.0)
    """
    s, x = nodes, rates**2  # linear in s between nodes

    def cut(p: int, level: float) -> tuple[int, int, Array]:
        before, after = int(np.flatnonzero(x[:p] < level)[-1]), p + int(np.flatnonzero(x[p:] < level)[0])
        i, k = np.array([before, after - 1]), np.array([before + 1, after])
        return before, after, s[i] + (level - x[i]) / (x[k] - x[i]) * (s[k] - s[i])

    def short(p: int, level: float) -> bool:
        return bool(np.ptp(cut(p, level)[2]) < np.sqrt(level) * duration)

    while True:
        peaks = 1 + np.flatnonzero((x[1:-1] >= x[:-2]) & (x[1:-1] >= x[2:]))
        peaks = peaks[np.argsort(-x[peaks], kind="stable")]
        p = next((k for k in peaks.tolist() if short(k, x[k] * (1 - 1e-9))), None)
        if p is None:
            return s, np.sqrt(x)
        low, high = 0.0, float(x[p])
        for _ in range(50):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if short(p, middle) else (middle, high)
        before, after, ends = cut(p, low)
        s = np.concatenate([s[: before + 1], ends, s[after:]])
        x = np.concatenate([x[: before + 1], [low, low], x[after:]])


def _improve(shape: Averaged, durations: Callable[[Averaged], Array]) -> Averaged:
    """Shape with rates and windows changed by factors, by successive linear programmes within a trust region."""
    from scipy.optimize import linprog

    s = np.union1d(shape.places, np.linspace(0.0, 1.0, 201))
    rates = np.sqrt(np.interp(s, shape.places, shape.rates**2))
    t = np.linspace(0.0, shape.duration, 2001)
    knots = np.interp(np.linspace(0.0, shape.duration, _FACTORS), t, shape(t)[0])
    hats = np.stack([np.interp(s, knots, one) for one in np.eye(_FACTORS)], axis=1)
    n, small = _FACTORS + 2, 1e-4

    def with_factors(x: Array) -> Averaged:
        """Shape with factors exp(x) of both windows and of the rates at the knots."""
        a, b = (np.array(shape.windows) * np.exp(x[:2])).tolist()
        return Averaged(s, rates * np.exp(hats @ x[2:]), (a, b), shape.name)

    shortest = np.full(n, -np.inf)
    shortest[:2] = np.minimum(np.log(_MIN_WINDOW * shape.duration / np.array(shape.windows)), 0.0)
    balance = np.r_[0.0, 0.0, np.ones(_FACTORS), 0.0][None]  # a common factor of all rates only changes the duration
    x, trust = np.zeros(n), _TRUST
    now = durations(with_factors(x))
    for _ in range(_STEPS):
        slopes = np.stack([(durations(with_factors(x + small * e)) - now) / small for e in np.eye(n)], axis=1)
        near = now > 0.5 * now.max()
        rows, right = np.column_stack([slopes, -np.ones(len(now))])[near], -now[near]
        new = now
        while trust > 1e-3:
            box = [(max(-trust, low), trust) for low in shortest - x]
            step = linprog(np.eye(n + 1)[n], rows, right, balance, [0.0], bounds=[*box, (0.0, None)]).x
            if step is not None:
                new = durations(with_factors(x + step[:n]))
                if new.max() < now.max():
                    break
            trust /= 4.0
        else:
            break
        predicted_gain, gain = now.max() - step[n], now.max() - new.max()
        if gain > 0.5 * predicted_gain:
            trust *= 1.5
        x, now = x + step[:n], new
        if gain < 1e-4 * now.max():
            break
    return with_factors(x)


complete(globals())
