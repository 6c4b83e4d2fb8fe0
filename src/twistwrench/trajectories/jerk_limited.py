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
_KNOT_COUNT = 24
"""Number of knots, evenly spaced in time, at which the rate has a factor."""
_SHAPE_NODE_COUNT = 201
"""Number of evenly spaced nodes in s at which factors change the rates, beside the nodes of the shape."""
_SHAPE_SAMPLE_COUNT = 2001
"""Number of samples of s(t) from which the knots follow."""
_MAX_PROGRAMMES = 10
"""Largest number of linear programmes."""
_FIRST_TRUST = 0.2
"""Initial trust region: largest change of a logarithm of a factor."""
_MIN_TRUST = 1e-3
"""Trust region at which the search ends."""
_MIN_RELATIVE_GAIN = 1e-4
"""Gain of a linear programme, over the duration, below which the search ends."""
_SLOPE_STEP = 1e-4
"""Change of a logarithm of a factor from which slopes follow."""
_MIN_RELEVANT_SHARE = 0.5
"""Share of the largest required duration from which a sample is in the linear programme."""
_TRUST_DIVISOR = 4.0
"""Divisor of the trust region after a step that does not improve."""
_MIN_GAIN_SHARE = 0.5
"""Share of the predicted gain above which the trust region grows."""
_TRUST_GROWTH = 1.5
"""Factor by which the trust region grows."""
_TOP_MARGIN = 1e-9
"""Distance below the top of a peak at which its length is measured, as a share of its height."""
_BISECTION_STEPS = 50
"""Number of halvings of the interval in which the level of a coast lies."""


def short_averages(
    robot: Robot, path: JointPath, nodes: Array, rates: Array, bounds: Limits, *, friction: bool
) -> tuple[Averaged, Averaged]:
    """Averages over time of a motion with these rates, optimised for a short duration within the bounds.

    Parameters
    ----------
    nodes, rates : (n,) arrays, s and ds/dt of the time-optimal motion

    Returns
    -------
    shapes : two Averaged, whose durations :func:`~twistwrench.trajectories.fitted` finds: the second is usually shorter

    Notes
    -----
    Longer windows take longer and lower the jerk; remaining violations are removed by a longer total duration. Windows
    are optimised first, and then factors of rates and windows. Each step of the second search is a linear programme that
    minimises the largest duration required by any sample.
    """

    def durations(shape: Averaged) -> Array:
        """Shortest durations (samples,) within the bounds that the samples of a shape require."""
        return shortest_durations(robot, path, shape.stretched(1.0), bounds, sample_times, friction=friction)

    sample_times = np.linspace(0.0, 1.0, _SAMPLE_COUNT)
    with np.errstate(invalid="ignore"):
        step_times = 2.0 * np.diff(nodes) / (rates[1:] + rates[:-1])
    t = np.cumsum(np.nan_to_num(step_times))
    interval_numbers = np.floor(t / t[-1] / _MIN_NODE_INTERVAL)
    _, first_of_interval = np.unique(interval_numbers, return_index=True)  # one node for each interval
    inner_nodes = first_of_interval[:-1] + 1  # t begins at the second node
    s = np.concatenate([nodes[:1], nodes[inner_nodes], nodes[-1:]])
    rates = np.concatenate([rates[:1], rates[inner_nodes], rates[-1:]])
    s[-1] = 1.0
    rates[0] = 0.0
    rates[-1] = 0.0
    with_windows = _choose_windows(s, rates, durations)
    return with_windows, _improve(with_windows, durations)


def _choose_windows(s: Array, rates: Array, durations: Callable[[Averaged], Array]) -> Averaged:
    """Shape with the best two windows, from these rates, or from rates whose peaks are coasts as long as both windows."""
    from scipy.optimize import minimize

    T = float((2.0 * np.diff(s) / (rates[1:] + rates[:-1])).sum())

    def shape(x: Array, *, coasts: bool) -> Averaged:
        """Shape with windows exp(x) T, the longer one first."""
        windows = np.exp(np.clip(x, np.log(_MIN_WINDOW), 0.0)) * T
        shorter, longer = np.sort(windows).tolist()
        nodes, node_rates = s, rates
        if coasts:
            nodes, node_rates = with_coasts(s, rates, longer + shorter)
        return Averaged(nodes, node_rates, (longer, shorter), "jerk-limited")

    def duration(x: Array, coasts: bool) -> float:
        """Shortest duration within the bounds of the shape with these windows."""
        return float(durations(shape(x, coasts=coasts)).max())

    grid = np.linspace(np.log(_MIN_WINDOW), 0.0, _GRID_SIZE)
    trials: list[tuple[Array, bool]] = []
    for log_longer in grid:
        for log_shorter in grid[grid <= log_longer]:
            x = np.array([log_longer, log_shorter])
            trials += [(x, False), (x, True)]
    start, coasts = min(trials, key=lambda trial: duration(*trial))
    half_step = 0.5 * (grid[1] - grid[0])
    simplex = start - half_step * np.array([[0, 0], [1, 0], [0, 1]])
    options: Any = {"maxfev": _MAX_SIMPLEX_TRIALS, "initial_simplex": simplex}
    optimum: Any = minimize(duration, start, args=(coasts,), method="Nelder-Mead", options=options)
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
        """True if a coast at this level of x takes less than ``duration``."""
        _, _, ends = cut(peak, level)
        return bool(np.ptp(ends) < np.sqrt(level) * duration)

    while True:
        peaks = 1 + np.flatnonzero((x[1:-1] >= x[:-2]) & (x[1:-1] >= x[2:]))
        peaks = peaks[np.argsort(-x[peaks], kind="stable")]  # highest first
        # Just below its top, so that a peak that is a coast already is measured along its length.
        peak = next((k for k in peaks.tolist() if is_too_short(k, x[k] * (1 - _TOP_MARGIN))), None)
        if peak is None:
            return s, np.sqrt(x)
        low_level = 0.0  # its coast is long enough
        high_level = float(x[peak])  # its coast is too short
        for _ in range(_BISECTION_STEPS):
            middle = 0.5 * (low_level + high_level)
            if is_too_short(peak, middle):
                high_level = middle
            else:
                low_level = middle
        before, after, ends = cut(peak, low_level)
        s = np.concatenate([s[: before + 1], ends, s[after:]])
        x = np.concatenate([x[: before + 1], [low_level, low_level], x[after:]])


def _improve(shape: Averaged, durations: Callable[[Averaged], Array]) -> Averaged:
    """Shape of shorter duration, whose rates and windows are multiplied by factors.

    The logarithms x of the factors are found by successive linear programmes within a trust region.
    """
    from scipy.optimize import linprog

    s = np.union1d(shape.places, np.linspace(0.0, 1.0, _SHAPE_NODE_COUNT))
    rates = np.sqrt(np.interp(s, shape.places, shape.rates**2))
    t = np.linspace(0.0, shape.duration, _SHAPE_SAMPLE_COUNT)
    s_at_t, _, _ = shape(t)
    knots = np.interp(np.linspace(0.0, shape.duration, _KNOT_COUNT), t, s_at_t)
    # Logarithms of the factors at s: piecewise linear between the knots.
    hat_functions = np.stack([np.interp(s, knots, unit) for unit in np.eye(_KNOT_COUNT)], axis=1)
    n = _KNOT_COUNT + 2  # number of factors: of both windows, then of the rates

    def with_factors(x: Array) -> Averaged:
        """Shape with factors exp(x) of both windows and of the rates at the knots."""
        longer, shorter = (np.array(shape.windows) * np.exp(x[:2])).tolist()
        return Averaged(s, rates * np.exp(hat_functions @ x[2:]), (longer, shorter), shape.name)

    min_x = np.full(n, -np.inf)
    min_x[:2] = np.minimum(np.log(_MIN_WINDOW * shape.duration / np.array(shape.windows)), 0.0)
    # The mean of the rates' logarithms stays: a common factor of all rates only changes the duration.
    sum_of_rate_logs = np.r_[0.0, 0.0, np.ones(_KNOT_COUNT), 0.0][None]
    largest_duration = np.eye(n + 1)[n]  # the last unknown, which is minimised
    x = np.zeros(n)
    trust = _FIRST_TRUST
    current_durations = durations(with_factors(x))
    for _ in range(_MAX_PROGRAMMES):
        slope_columns = []
        for unit in np.eye(n):
            changed_durations = durations(with_factors(x + _SLOPE_STEP * unit))
            slope_columns.append((changed_durations - current_durations) / _SLOPE_STEP)
        slopes = np.stack(slope_columns, axis=1)
        # Unknowns are the step of x and the largest duration D: current_durations + slopes @ step <= D.
        is_relevant = current_durations > _MIN_RELEVANT_SHARE * current_durations.max()
        rows = np.column_stack([slopes, -np.ones(len(current_durations))])[is_relevant]
        upper_bounds = -current_durations[is_relevant]
        new_durations = current_durations
        while trust > _MIN_TRUST:
            box = [(max(-trust, low), trust) for low in min_x - x]
            bounds = [*box, (0.0, None)]
            optimum = linprog(
                largest_duration, A_ub=rows, b_ub=upper_bounds, A_eq=sum_of_rate_logs, b_eq=[0.0], bounds=bounds
            )
            step = optimum.x  # None if there is none
            if step is not None:
                new_durations = durations(with_factors(x + step[:n]))
                if new_durations.max() < current_durations.max():
                    break
            trust /= _TRUST_DIVISOR
        else:  # no step within the smallest trust region improves
            break
        predicted_gain = current_durations.max() - step[n]
        gain = current_durations.max() - new_durations.max()
        if gain > _MIN_GAIN_SHARE * predicted_gain:
            trust *= _TRUST_GROWTH
        x = x + step[:n]
        current_durations = new_durations
        if gain < _MIN_RELATIVE_GAIN * current_durations.max():
            break
    return with_factors(x)


complete(globals())
