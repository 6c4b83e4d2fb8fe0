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

_MIN_WINDOW = 1.0 / 250.0
"""Shortest window as a share of the time-optimal duration; samples resolve longer windows."""
_MIN_NODE_INTERVAL = 1.0 / 1000.0
"""Least time between nodes as a share of the time-optimal duration."""
_SAMPLE_COUNT = 801
"""Number of samples of a motion during the search."""
_GRID_SIZE = 8
"""Number of lengths of each window on the grid of the first search."""
_MAX_SIMPLEX_TRIALS = 60
"""Largest number of trials of the simplex search, which begins at the best point of the grid."""
_FACTOR_COUNT = 24
"""Number of nodes with a factor of the rate."""
_MAX_PROGRAMMES = 10
"""Largest number of linear programmes."""
_FIRST_TRUST = 0.2
"""Initial trust region: largest change of a logarithm of a factor."""
_MIN_TRUST = 1e-3
"""Trust region at which the search ends."""


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
        """Shortest duration within the bounds that each sample of a shape requires."""
        return shortest_durations(robot, path, shape.stretched(1.0), bounds, sample_times, friction=friction)

    sample_times = np.linspace(0.0, 1.0, _SAMPLE_COUNT)
    with np.errstate(invalid="ignore"):
        t = np.cumsum(np.nan_to_num(2.0 * np.diff(nodes) / (rates[1:] + rates[:-1])))
    _, first_of_interval = np.unique(np.floor(t / t[-1] / _MIN_NODE_INTERVAL), return_index=True)
    inner = first_of_interval[:-1] + 1  # t begins at the second node
    s = np.concatenate([nodes[:1], nodes[inner], nodes[-1:]])
    rates = np.concatenate([rates[:1], rates[inner], rates[-1:]])
    s[-1] = 1.0
    rates[0] = 0.0
    rates[-1] = 0.0
    with_windows = _choose_windows(s, rates, durations)
    return with_windows, _improve(with_windows, durations)


def _choose_windows(s: Array, rates: Array, durations: Callable[[Averaged], Array]) -> Averaged:
    """Shape with the best two windows, for the rates as they are or with peaks replaced by coasts as long as both windows."""
    from scipy.optimize import minimize

    T = float((2.0 * np.diff(s) / (rates[1:] + rates[:-1])).sum())

    def shape(x: Array, *, coasts: bool) -> Averaged:
        """Shape with windows exp(x) T, the longer one first."""
        b, a = (np.sort(np.exp(np.clip(x, np.log(_MIN_WINDOW), 0.0))) * T).tolist()
        nodes, node_rates = s, rates
        if coasts:
            nodes, node_rates = with_coasts(s, rates, a + b)
        return Averaged(nodes, node_rates, (a, b), "jerk-limited")

    def duration(x: Array, coasts: bool) -> float:
        return float(durations(shape(x, coasts=coasts)).max())

    grid = np.linspace(np.log(_MIN_WINDOW), 0.0, _GRID_SIZE)
    trials = [(np.array([a, b]), coasts) for a in grid for b in grid[grid <= a] for coasts in (False, True)]
    start, coasts = min(trials, key=lambda trial: duration(*trial))
    simplex = start - 0.5 * (grid[1] - grid[0]) * np.array([[0, 0], [1, 0], [0, 1]])
    options: Any = {"maxfev": _MAX_SIMPLEX_TRIALS, "initial_simplex": simplex}
    optimum: Any = minimize(duration, start, (coasts,), "Nelder-Mead", options=options)
    return shape(np.asarray(optimum.x), coasts=coasts)


def with_coasts(nodes: Array, rates: Array, duration: float) -> tuple[Array, Array]:
    """Nodes and rates of a motion whose rate peaks are cut to coasts of at least ``duration``.

    After averaging over this time, the acceleration changes to a deceleration in two successive steps, by way of zero.

    Parameters
    ----------
    nodes, rates : (n,) arrays, as in :class:`Averaged`; the rates are zero at both ends

    Examples
    --------
    >>> s, ds = with_coasts(np.array([0.0, 0.5, 1.0]), np.array([0.0, 1.0, 0.0]), 1.0)
    >>> s.round(6).tolist(), ds.round(6).tolist(), round(float((s[2] - s[1]) / ds[1]), 6)
    ([0.0, 0.190983, 0.809017, 1.0], [0.0, 0.618034, 0.618034, 0.0], 1.0)
    """
    s = nodes
    x = rates**2  # linear in s between nodes

    def cut(peak: int, level: float) -> tuple[int, int, Array]:
        """Last node before a peak and first node after it below a level of x, and both ends (2,) of the cut in s."""
        before = int(np.flatnonzero(x[:peak] < level)[-1])
        after = peak + int(np.flatnonzero(x[peak:] < level)[0])
        i = np.array([before, after - 1])
        k = np.array([before + 1, after])
        ends = s[i] + (level - x[i]) / (x[k] - x[i]) * (s[k] - s[i])
        return before, after, ends

    def is_too_short(peak: int, level: float) -> bool:
        _, _, ends = cut(peak, level)
        return bool(np.ptp(ends) < np.sqrt(level) * duration)

    while True:
        peaks = 1 + np.flatnonzero((x[1:-1] >= x[:-2]) & (x[1:-1] >= x[2:]))
        peaks = peaks[np.argsort(-x[peaks], kind="stable")]  # highest first
        peak = next((k for k in peaks.tolist() if is_too_short(k, x[k] * (1 - 1e-9))), None)
        if peak is None:
            return s, np.sqrt(x)
        low, high = 0.0, float(x[peak])  # levels with a coast that is long enough, and too short
        for _ in range(50):
            middle = 0.5 * (low + high)
            if is_too_short(peak, middle):
                high = middle
            else:
                low = middle
        before, after, ends = cut(peak, low)
        s = np.concatenate([s[: before + 1], ends, s[after:]])
        x = np.concatenate([x[: before + 1], [low, low], x[after:]])


def _improve(shape: Averaged, durations: Callable[[Averaged], Array]) -> Averaged:
    """Shape of shorter duration, whose rates and windows are multiplied by factors.

    The logarithms x of the factors are found by successive linear programmes within a trust region.
    """
    from scipy.optimize import linprog

    s = np.union1d(shape.places, np.linspace(0.0, 1.0, 201))
    rates = np.sqrt(np.interp(s, shape.places, shape.rates**2))
    t = np.linspace(0.0, shape.duration, 2001)
    knots = np.interp(np.linspace(0.0, shape.duration, _FACTOR_COUNT), t, shape(t)[0])
    hats = np.stack([np.interp(s, knots, unit) for unit in np.eye(_FACTOR_COUNT)], axis=1)  # piecewise linear
    n = _FACTOR_COUNT + 2
    difference = 1e-4  # of x for slopes

    def with_factors(x: Array) -> Averaged:
        """Shape with factors exp(x) of both windows and of the rates at the knots."""
        a, b = (np.array(shape.windows) * np.exp(x[:2])).tolist()
        return Averaged(s, rates * np.exp(hats @ x[2:]), (a, b), shape.name)

    min_x = np.full(n, -np.inf)
    min_x[:2] = np.minimum(np.log(_MIN_WINDOW * shape.duration / np.array(shape.windows)), 0.0)
    balance = np.r_[0.0, 0.0, np.ones(_FACTOR_COUNT), 0.0][
        None
    ]  # a common factor of all rates only changes the duration
    x = np.zeros(n)
    trust = _FIRST_TRUST
    present = durations(with_factors(x))
    for _ in range(_MAX_PROGRAMMES):
        slopes = np.stack(
            [(durations(with_factors(x + difference * unit)) - present) / difference for unit in np.eye(n)], axis=1
        )
        # Unknowns are the step of x and the largest duration D: present + slopes @ step <= D.
        relevant = present > 0.5 * present.max()
        rows = np.column_stack([slopes, -np.ones(len(present))])[relevant]
        upper_bounds = -present[relevant]
        improved = present
        while trust > _MIN_TRUST:
            box = [(max(-trust, low), trust) for low in min_x - x]
            step = linprog(np.eye(n + 1)[n], rows, upper_bounds, balance, [0.0], bounds=[*box, (0.0, None)]).x
            if step is not None:
                improved = durations(with_factors(x + step[:n]))
                if improved.max() < present.max():
                    break
            trust /= 4.0
        else:  # no step within the smallest trust region improves
            break
        predicted_gain = present.max() - step[n]
        gain = present.max() - improved.max()
        if gain > 0.5 * predicted_gain:
            trust *= 1.5
        x = x + step[:n]
        present = improved
        if gain < 1e-4 * present.max():
            break
    return with_factors(x)


complete(globals())
