"""Causes of faults in logs: corrections of states that remove one fault, and additional torques of joint laws.

A cause c with value β maps the states s of a log to c(s, β). If c is the fault, the robot's equations hold for c(s, β):

    gain g of joint k:        τ_k = g (W x)_k                         g = -1 is a wrong sign
    zero β of joint k:        q_k - β                                 W evaluated there
    tilt (β_x, β_y):          gravity exp([β]) g
    delay β:                  τ(t + β)
    low-pass ω:               W / (1 + s/ω)
    time scale s:             dq / s, ddq / s²
    elasticity β of joint k:  q_k - β τ̂_k, with its rates             τ̂ = W x̂, the fitted torque
    play 2 β of joint k:      q_k - β u(q_k), with its rates            u: place of the link in the play, -1 to 1
    zero β from t_1 on:       q_k - β 1(t ≥ t_1), with its rates       the step and its rates are low-passed

Joint laws add β e_k to the fitted torque. With R the rigid part of τ̂, and v_0 the speed of Coulomb friction, the columns e_k
are

    load friction |R_k| tanh(dq_k / v_0),   Stribeck fc_k tanh(dq_k / v_0) exp(-(dq_k / v_s)²),
    warming fc_k (t - t_0)/T tanh(dq_k / v_0),   drift (t - t_0)/T,   a delay of one joint -dτ̂_k/dt,
    gain drift (t - t_0)/T τ̂_k,   spring q_k - q̄_k,   offset from t_1 on 1(t ≥ t_1),   force on the tip -J' e.

Both causes and laws use the fitted torque, not the measured one, which contains the residual that they are to explain.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from typing import NamedTuple

import numpy as np

from ...core.doubts import doubt_table
from ...core.typing import Array
from ...mechanics.bodies.inertia import SpatialInertia
from ...mechanics.lie import so3
from ...mechanics.model.model import BASE, Model
from ..parameters import turning_joints
from .log_states import PORTION, LogStates

MIN_NEGATIVE_PART = 0.2
"""Size of a negative torque, as a share of its rms, from which it is clearly below zero."""
_MIN_ROWS_OF_SIGN = 0.1
"""Minimum share of rows with a torque clearly below zero, and of the other rows, for a torque of both signs."""
_MIN_DIVISOR = 1e-300
"""Divisor in place of zero."""
_PARAMETERS_PER_BODY = 10
_VALUE_STEP = 1e-3
"""Step of finite differences of most causes, in the unit of their value."""
_DEFLECTION_STEP = 1e-4
"""Step of finite differences of a deflection [rad, m]."""
_TIME_FACTORS = (2.0, 0.5, 10.0, 0.1)
"""Factors between the times of a log and the true ones that are tried."""
_MIN_LAG = 1e-6
"""Smallest time constant of a low-pass [s]."""
_MAX_LOG_FACTOR = 8.0
"""Largest logarithm of a factor that is tried."""


def _with_column(values: Array, k: int, change: Callable[[Array], Array]) -> Array:
    """Copy of the values whose column k is changed."""
    copy = values.copy()
    copy[:, k] = change(values[:, k])
    return copy


def gain(s: LogStates, k: int, g: float) -> LogStates:
    """Scale the torque of joint k by g."""
    is_joint = np.arange(len(s.gain)) == k
    return s.with_fields(gain=np.where(is_joint, g * s.gain, s.gain))


def positions_times(s: LogStates, k: int, factor: float) -> LogStates:
    """Scale the position of joint k with its rates, and the speed at which its dry friction changes sign."""
    factors = np.where(np.arange(len(s.gain)) == k, factor, 1.0)
    is_joint = np.arange(len(s.friction_speed)) == k
    friction_speed = np.where(is_joint, abs(factor) * s.friction_speed, s.friction_speed)
    return s.with_fields(q=s.q * factors, dq=s.dq * factors, ddq=s.ddq * factors, friction_speed=friction_speed)


def add_position(s: LogStates, k: int, j: int, sign: float) -> LogStates:
    """Add the position of joint j, times a sign, to the position of joint k: encoders of coupled drives count both."""
    q, dq, ddq = s.q.copy(), s.dq.copy(), s.ddq.copy()
    for values in (q, dq, ddq):
        values[:, k] += sign * values[:, j]
    return s.with_fields(q=q, dq=dq, ddq=ddq)


def torque_without_sign(s: LogStates, k: int, x: Array) -> Cause | None:
    """Cause: torque of joint k logged without its sign. Groups x (r,) predict the sign; None if it does not change."""
    torques, _ = s.torques(x)
    predicted = torques[:, k]
    rms = np.sqrt((predicted**2).mean())
    negative_share = float((predicted < -MIN_NEGATIVE_PART * rms).mean())
    if not _MIN_ROWS_OF_SIGN < negative_share < 1.0 - _MIN_ROWS_OF_SIGN:
        return None
    return Cause("unsigned", (k,), partial(_with_signs, k=k, signs=np.sign(predicted)))


def _with_signs(s: LogStates, k: int, signs: Array) -> LogStates:
    """Multiply the torque of joint k by a sign for each row of the log, (n,)."""
    if not s.pieces:  # random states without a log, to which these rows do not belong
        return s
    return s.with_fields(tau=_with_column(s.tau, k, lambda x: signs * x))


def zero(s: LogStates, k: int, beta: float) -> LogStates:
    """Subtract the zero error β from the position of joint k."""
    return s.with_fields(q=_with_column(s.q, k, lambda x: x - beta))


def exchanged_positions(s: LogStates, j: int, k: int) -> LogStates:
    """Exchange the positions of joints j and k."""
    order = np.arange(s.q.shape[1])
    order[[j, k]] = k, j
    return s.with_fields(q=s.q[:, order], dq=s.dq[:, order], ddq=s.ddq[:, order])


def exchanged_torques(s: LogStates, order: Array) -> LogStates:
    """Reorder the torques: joint j gets column ``order[j]``."""
    return s.with_fields(tau=s.tau[:, order])


def exchanged_joints(s: LogStates, j: int, k: int, order: Array) -> LogStates:
    """Exchange both positions and torques of joints j and k."""
    return exchanged_torques(exchanged_positions(s, j, k), order)


def tilt(s: LogStates, beta: Array) -> LogStates:
    """Turn the base about a horizontal axis, by a vector β (2,) along it, so that gravity is exp([β]) g in its frame."""
    horizontal_axes = _horizontal_axes(s.gravity)
    return s.with_fields(gravity=so3.exp(horizontal_axes.T @ beta) @ s.gravity)


def _horizontal_axes(gravity: Array) -> Array:
    """Two axes perpendicular to gravity, (2, 3)."""
    _, _, axes = np.linalg.svd(gravity[None])
    return np.asarray(axes[1:])  # the first is along gravity


def time_scale(s: LogStates, factor: float) -> LogStates:
    """Scale the rates for a log whose times are ``factor`` times the true ones.

    The speed at which dry friction changes sign is scaled, too. Otherwise, another time scale could fit slow motions better
    only because it changes the friction.
    """
    return s.with_fields(dq=s.dq * factor, ddq=s.ddq * factor**2, friction_speed=s.friction_speed * factor)


def behind(s: LogStates, beta: Array, lag: Array, rate: Array, acceleration: Array) -> LogStates:
    """Subtract β times ``lag`` (n, nv) from joint positions, and its derivatives from their rates: links lag behind motors."""
    if not s.pieces:  # random states without a log, to which these rows do not belong
        return s
    return s.with_fields(q=s.q - beta * lag, dq=s.dq - beta * rate, ddq=s.ddq - beta * acceleration)


def compliances(s: LogStates, torque: Array, largest: Array | None = None) -> Iterator[Cause]:
    """Elasticity of each joint, and of all joints, from fitted torques (n, nv).

    β is the deflection at the ``largest`` (nv,) torques.
    """
    if largest is None:
        largest = np.abs(torque).max(axis=0)
    torque_share = torque / np.maximum(largest, _MIN_DIVISOR)
    rate = s.slope(torque_share)
    acceleration = s.slope(rate)
    joint_count = torque.shape[1]
    for joints in _joint_sets(joint_count):
        is_deflected = np.isin(np.arange(joint_count), joints)
        correct = partial(
            behind, lag=torque_share * is_deflected, rate=rate * is_deflected, acceleration=acceleration * is_deflected
        )
        yield Cause("elasticity", joints, lambda s, beta, correct=correct: correct(s, beta), step=_DEFLECTION_STEP)


def _joint_sets(count: int) -> list[tuple[int, ...]]:
    """Sets of joints to try: each joint by itself, and all of several joints."""
    sets: list[tuple[int, ...]] = [(k,) for k in range(count)]
    if count > 1:
        sets.append(tuple(range(count)))
    return sets


_INITIAL_HALF_PLAY = 4e-3
"""Half of a play from which its fit starts [rad, m]."""
_MIN_HALF_PLAY = 0.1 * _INITIAL_HALF_PLAY
"""Smallest half of a play that is tried [rad, m]."""
_MIN_PULSE_SHARE = 0.05
"""Share of the squared accelerations that pulses of a play explain, from which they give its initial value."""


def side_in_play(positions: Array, half_play: float) -> Array:
    """Lead (n,) of the motor at ``positions`` (n,) over its link, as a share of half the gear's play β: -1 to 1.

    The link rests until the motor has crossed the play: q_link ← min(max(q_link, q - β), q + β).
    """
    motor_lead = np.empty(len(positions))
    link_position = float(positions[0])
    for k, motor_position in enumerate(positions.tolist()):
        link_position = min(max(link_position, motor_position - half_play), motor_position + half_play)
        motor_lead[k] = motor_position - link_position
    return motor_lead / half_play


def plays(s: LogStates) -> Iterator[Cause]:
    """Play of the gear of each joint; β is half of the play: the link lags behind its motor by β.

    Where the motor crosses the play, accelerations have pulses. If these explain a notable part of the accelerations, their
    coefficient in a regression is the initial value of β.
    """
    if s.unfiltered is None:
        return
    for k in range(s.dq.shape[1]):
        _, _, play_acceleration = _place_in_play(s, k, _INITIAL_HALF_PLAY)
        pulses = play_acceleration[:, k]
        ddq = s.ddq[:, k]
        pulse_square = float(pulses @ pulses)
        product = float(pulses @ ddq)
        initial_half_play = _INITIAL_HALF_PLAY
        if product > 0.0 and product**2 > _MIN_PULSE_SHARE * pulse_square * float(ddq @ ddq):
            initial_half_play = product / pulse_square
        yield Cause("backlash", (k,), partial(_remove_play, k=k), _MIN_HALF_PLAY, starts=(initial_half_play,))


def _remove_play(s: LogStates, beta: Array, k: int) -> LogStates:
    """Positions of link k instead of its motor's, with a play of 2 β."""
    if not s.pieces:  # random states without a log have no course in time
        return s
    half_play = max(abs(float(beta[0])), _MIN_HALF_PLAY)
    place, rate, acceleration = _place_in_play(s, k, half_play)
    return behind(s, beta, place, rate, acceleration)


def _place_in_play(s: LogStates, k: int, half_play: float) -> tuple[Array, Array, Array]:
    """Low-passed place (n, nv) of link k in a play, as :func:`side_in_play`, with its first and second derivatives."""
    assert s.unfiltered is not None, "states of a log have positions"
    sides = [side_in_play(s.unfiltered[piece, k], half_play) for piece in s.pieces]
    return _with_rates(s, s.low_passed(np.concatenate(sides)), k)


def _with_rates(s: LogStates, x: Array, k: int) -> tuple[Array, Array, Array]:
    """Course x (n,) of joint k with its first and second derivatives, (n, nv) each; 0 for the other joints."""
    rate = s.slope(x)
    acceleration = s.slope(rate)
    is_joint = np.arange(s.dq.shape[1]) == k
    return x[:, None] * is_joint, rate[:, None] * is_joint, acceleration[:, None] * is_joint


def jumps(s: LogStates) -> Iterator[Cause]:
    """Another zero of a joint from each jump of its position on."""
    for k, piece, begin in s.jumps:
        # 0 before the jump, 1 after it, and linear within one period around it
        share_in_piece = np.clip((s.time - begin) * s.rate + 0.5, 0.0, 1.0)
        jumped_share = share_in_piece * (s.piece == piece) + (s.piece > piece)
        step, rate, acceleration = _with_rates(s, s.low_passed(jumped_share), k)
        correct = partial(behind, lag=step, rate=rate, acceleration=acceleration)
        since = (piece, begin)
        yield Cause("zero-change", (k,), lambda s, beta, correct=correct: correct(s, beta), _VALUE_STEP, since=since)


# ── Causes by name


@dataclass(frozen=True, eq=False)
class Cause:
    """Correction of states to test."""

    kind: str
    joints: tuple[int, ...]
    """Indices of the joints."""
    correct: Callable[..., LogStates]
    """Function of states and of a value β that returns corrected states."""
    step: float = 0.0
    """Step of β in finite differences; 0 for a cause without a value."""
    size: int = 1
    """Number of components of β."""
    starts: tuple[float, ...] = (0.0,)
    """Values of β at which the search begins."""
    number: float | None = None
    """Value of a discrete cause, in the unit of the table of doubts."""
    cost: float = 0.0
    """Amount by which its significance S must exceed that of other causes."""
    since: tuple[int, float] | None = None
    """Piece and time [s] at which the cause begins; None for the whole log."""


class FittedTorques(NamedTuple):
    """Fitted torques of states: total and of the rigid bodies (n, nv), and Coulomb friction of each joint (nv,)."""

    whole: Array
    rigid: Array
    coulomb: Array

    @classmethod
    def from_groups(cls, s: LogStates, x: Array) -> FittedTorques:
        """Torques of the states ``s`` with groups ``x`` (r,)."""
        unknown = s.base.unknown
        parameters = s.base.kept  # index of each group's parameter
        coulomb = np.zeros(len(s.gain))
        for group, joints in unknown.coulomb_columns(parameters):  # these columns include static friction
            if unknown.kinds[int(parameters[group])] == "coulomb":
                coulomb[joints] += abs(float(x[group]))
        whole, rigid = s.torques(x)
        return cls(whole, rigid, coulomb)


@dataclass(frozen=True, eq=False)
class Law:
    """Joint law: a torque as a function of the states and their fitted torques, optionally from some time on."""

    kind: str
    joints: tuple[int, ...]
    """Indices of the joints."""
    values: Callable[[LogStates, FittedTorques], Array]
    """Function that returns the columns of the law for all joints, (n, nv) or (n, nv, k)."""
    speed: float = 0.0
    """Speed at which static friction has decayed (Stribeck speed)."""
    since: tuple[int, float] | None = None
    """Piece and time [s] at which the law begins to act."""

    def columns(self, s: LogStates, fitted: FittedTorques) -> Array:
        """Columns (n, nv, k) of the law, zero for joints to which it does not apply."""
        is_own_joint = np.isin(np.arange(len(s.gain)), self.joints)
        return self.everywhere(s, fitted) * is_own_joint[:, None]

    def everywhere(self, s: LogStates, fitted: FittedTorques) -> Array:
        """Columns (n, nv, k) of the law applied to all joints."""
        values = self.values(s, fitted)
        if values.ndim == 2:
            values = values[..., None]
        return values * self.acting(s)[:, None, None]

    def acting(self, s: LogStates) -> Array:
        """(n,) bool: states in which the law acts."""
        if self.since is None:
            return np.ones(len(s.time), bool)
        piece, time = self.since
        return np.asarray((s.piece > piece) | ((s.piece == piece) & (s.time >= time)))


def discrete_causes(s: LogStates, suspects: Sequence[int]) -> Iterator[Cause]:
    """Signs, units and exchanges of columns, zeros by quarters of a turn, mountings and units of time."""
    turning = turning_joints(s.base.unknown.model)
    for k in suspects:
        yield Cause("torque-sign", (k,), partial(gain, k=k, g=-1.0))
        yield Cause("position-sign", (k,), partial(positions_times, k=k, factor=-1.0))
        yield Cause("both-signs", (k,), lambda s, k=k: gain(positions_times(s, k, -1.0), k, -1.0))
        if s.gravity.any():
            yield Cause("no-gravity", (k,), partial(LogStates.with_fields, weightless=(*s.weightless, k)))
        if turning[k]:
            yield Cause("degrees", (k,), partial(positions_times, k=k, factor=np.pi / 180))
            for zero_error in (0.5 * np.pi, -0.5 * np.pi, np.pi):  # quarters of a turn
                degrees = float(np.degrees(zero_error))
                yield Cause("zero-turn", (k,), partial(zero, k=k, beta=zero_error), number=degrees)
        # Drives of wrists couple neighbouring joints. Other pairs are not tested, as each test makes others less significant.
        if k > 0 and turning[k - 1] and turning[k]:
            for sign in (-1.0, 1.0):
                yield Cause("coupled", (k, k - 1), partial(add_position, k=k, j=k - 1, sign=sign), number=sign)
    for j, k in combinations(suspects, 2):
        if turning[j] == turning[k]:
            yield from _exchanges(s, j, k)
    if s.gravity.any():
        yield from _mountings(s)
    for factor in _TIME_FACTORS:
        yield Cause("time-scale", (), partial(time_scale, factor=factor), number=factor)


def _exchanges(s: LogStates, j: int, k: int) -> Iterator[Cause]:
    """Exchanged columns of two joints: positions, torques, and both."""
    order = np.arange(len(s.gain))
    order[[j, k]] = k, j
    yield Cause("exchanged-positions", (j, k), partial(exchanged_positions, j=j, k=k))
    yield Cause("exchanged-torques", (j, k), partial(exchanged_torques, order=order))
    yield Cause("exchanged-joints", (j, k), partial(exchanged_joints, j=j, k=k, order=order))


def _mountings(s: LogStates) -> Iterator[Cause]:
    """Mountings on four walls and on the ceiling, and a robot without gravity."""
    strength = float(np.linalg.norm(s.gravity))
    down = s.gravity / strength
    horizontal_axes = _horizontal_axes(down)
    no_direction = 0.0 * down
    for direction in (*horizontal_axes, *-horizontal_axes, -down, no_direction):
        yield Cause("mounting", (), partial(LogStates.with_fields, gravity=strength * direction))


def continuous_causes(s: LogStates, *, wide: bool) -> Iterator[Cause]:
    """Gain, scale and zero of each joint, tilt of the base, delay and low-pass; with distant starts if ``wide``."""
    gains = _LOG_GAINS if wide else (0.0,)
    delays = _DELAYS if wide else (0.0,)
    for k, is_turning in enumerate(turning_joints(s.base.unknown.model)):
        yield Cause("gain", (k,), lambda s, beta, k=k: gain(s, k, _factor(beta)), _VALUE_STEP, starts=gains)
        yield Cause(
            "position-scale", (k,), lambda s, beta, k=k: positions_times(s, k, 1.0 / _factor(beta)), _VALUE_STEP
        )
        if is_turning:
            yield Cause("zero", (k,), lambda s, beta, k=k: zero(s, k, float(beta[0])), _VALUE_STEP)
    if s.gravity.any():
        yield Cause("tilt", (), tilt, _VALUE_STEP, size=2)
    yield Cause("late", (), _later, _VALUE_STEP, starts=delays)
    if wide:
        yield Cause("low-pass", (), _with_lag, _VALUE_STEP, starts=_LAGS, cost=1.0)


def _with_lag(s: LogStates, beta: Array) -> LogStates:
    """Low-pass the predicted torques with a time constant of β seconds, above zero."""
    return s.with_fields(lag=max(float(beta[0]), _MIN_LAG))


def _factor(beta: Array) -> float:
    """Factor whose logarithm is β, so that it stays positive; bounded against overflow."""
    return float(np.exp(np.clip(beta[0], -_MAX_LOG_FACTOR, _MAX_LOG_FACTOR)))


def _later(s: LogStates, beta: Array) -> LogStates:
    """Compare with torques that were logged β seconds later."""
    return s.with_fields(shift=s.shift + float(beta[0]))


_LOG_GAINS = (0.0, -3.0, 3.0)
"""Initial logarithms of a gain."""
_DELAYS = (0.0, -0.2, -0.12, -0.07, -0.03, 0.03, 0.07, 0.12, 0.2, 0.3)
"""Initial delays of the torques [s]."""
_LAGS = (0.02, 0.05, 0.1, 0.2)
"""Initial time constants of a low-pass [s]."""
STRIBECK_SPEEDS = (0.03, 0.1, 0.3)
"""Speeds at which static friction may have decayed [rad/s, m/s]."""


def laws(s: LogStates) -> Iterator[Law]:
    """Laws of each joint, and of all joints with one coefficient."""
    count = len(s.gain)
    stribeck_columns = {speed: partial(_stribeck, speed=speed) for speed in STRIBECK_SPEEDS}
    for joints in _joint_sets(count):
        yield Law("load-friction", joints, _load_friction)
        yield Law("warming", joints, _warming)
        for speed, values in stribeck_columns.items():
            yield Law("stribeck", joints, values, speed)
    for k in range(count):
        yield Law("late-joint", (k,), _delay_column)
        yield Law("drift", (k,), _drift)
        yield Law("spring", (k,), _spring)


def changes(s: LogStates) -> Iterator[Law]:
    """Laws that may begin within the log: gain and offset of a joint, delay of all torques, and a load on the tip."""
    all_joints = tuple(range(len(s.gain)))
    for k in all_joints:
        yield Law("gain-change", (k,), _whole)
        yield Law("offset-step", (k,), _offset)
    yield Law("late-change", all_joints, _delay_column)
    if _has_moving_tip(s):
        yield Law("load-change", all_joints, _load)


def laws_of_the_log(s: LogStates) -> Iterator[Law]:
    """Gains that change steadily, of each joint and of all, and a constant force on the tip, as of a hose."""
    count = len(s.gain)
    for joints in _joint_sets(count):
        yield Law("gain-drift", joints, _gain_drift)
    if _has_moving_tip(s):
        yield Law("force", tuple(range(count)), _force)


def _has_moving_tip(s: LogStates) -> bool:
    """True if the robot has a tip that moves."""
    model = s.base.unknown.model
    return model.tip is not None and model.frames[model.tip].body != BASE


def _force(s: LogStates, _fitted: FittedTorques) -> Array:
    """Columns -J' e of forces along the world's axes, which motors balance; forces that load no joint are left out."""
    J = np.asarray(s.base.unknown.robot.jacobian(s.q, kind="world_aligned"))
    J_v = J[:, 3:]
    columns = -J_v.swapaxes(1, 2)
    norms = np.linalg.norm(columns, axis=(0, 1))
    total_norm = max(float(np.linalg.norm(columns)), _MIN_DIVISOR)
    loads_joints = norms > _MIN_INDEPENDENT_SHARE * total_norm
    return np.asarray(columns[..., loads_joints])


def _load(s: LogStates, _fitted: FittedTorques) -> Array:
    """Columns of a mass m on the tip and of its first moments m c, without dependent ones; m c c' is neglected."""
    model = s.base.unknown.model
    frame = model.frames[str(model.tip)]
    first_column = _PARAMETERS_PER_BODY * frame.body
    own_columns = slice(first_column, first_column + _PARAMETERS_PER_BODY)
    body_columns: list[Array] = []
    for begin in range(0, len(s.time), PORTION):  # in portions, to limit memory
        span = slice(begin, begin + PORTION)
        Y = s.base.unknown.regressor(s.q[span], s.dq[span], s.ddq[span], s.gravity)
        body_columns.append(Y[:, :, own_columns])
    load_columns = np.concatenate(body_columns) @ _unit_loads(frame.pose)
    norms = np.maximum(np.linalg.norm(load_columns, axis=(0, 1)), _MIN_DIVISOR)
    unit_columns = (load_columns / norms).reshape(-1, 4)
    R = np.asarray(np.linalg.qr(unit_columns, mode="r"))
    is_independent = np.abs(np.diagonal(R)) > _MIN_INDEPENDENT_SHARE
    return np.asarray(load_columns[..., is_independent])


def _unit_loads(pose: Array) -> Array:
    """Derivatives (10, 4) of a body's parameters by a mass at a pose, and by the three first moments of this mass."""

    def parameters(com: Array) -> Array:
        """Parameters (10,) of a point mass of 1 kg at ``com`` in the frame of the pose."""
        return SpatialInertia.from_com(1.0, com, np.zeros((3, 3))).in_frame(pose).parameters

    steps = _COM_STEP * np.eye(3)
    # Central differences, in which the parts of m c c' cancel.
    by_moments = [0.5 * (parameters(step) - parameters(-step)) / _COM_STEP for step in steps]
    by_mass = parameters(np.zeros(3))
    return np.stack([by_mass, *by_moments], axis=1)


_COM_STEP = 1e-3
"""Step of finite differences [m]."""
_MIN_INDEPENDENT_SHARE = 1e-6
"""Share of a column that others do not span, below which the column is dependent."""


# ── Columns e of the laws, (n, nv), as in the module's equations


def _offset(_s: LogStates, fitted: FittedTorques) -> Array:
    """Constant torque."""
    return np.ones_like(fitted.whole)


def _gain_drift(s: LogStates, fitted: FittedTorques) -> Array:
    """Gain that changes steadily over the logs."""
    return _elapsed_share(s)[:, None] * fitted.whole


def _spring(s: LogStates, _fitted: FittedTorques) -> Array:
    """Spring about the mean position of each joint."""
    q = s.q[:, : len(s.gain)]
    return q - q.mean(axis=0)


def _whole(_s: LogStates, fitted: FittedTorques) -> Array:
    """Other gain."""
    return fitted.whole


def _load_friction(s: LogStates, fitted: FittedTorques) -> Array:
    """Dry friction in proportion to the torque of the rigid bodies."""
    return np.abs(fitted.rigid) * _dry(s)


def _delay_column(s: LogStates, fitted: FittedTorques) -> Array:
    """Delay of the torque."""
    return -s.slope(fitted.whole)


def _warming(s: LogStates, fitted: FittedTorques) -> Array:
    """Coulomb friction that changes steadily over the logs."""
    return _elapsed_share(s)[:, None] * _dry(s) * fitted.coulomb


def _drift(s: LogStates, fitted: FittedTorques) -> Array:
    """Offset that changes steadily over the logs."""
    return _elapsed_share(s)[:, None] * np.ones(fitted.whole.shape[1])


def _stribeck(s: LogStates, fitted: FittedTorques, *, speed: float) -> Array:
    """Static friction that decays with a Stribeck ``speed``."""
    return np.asarray(_dry(s) * np.exp(-((s.dq / speed) ** 2)) * fitted.coulomb)


def _dry(s: LogStates) -> Array:
    """Smoothed sign of each joint's velocity, the factor of dry friction."""
    return np.asarray(np.tanh(s.dq / s.friction_speed))


def _elapsed_share(s: LogStates) -> Array:
    """Elapsed share of the duration of the logs; 0.5 for states without time."""
    duration = np.ptp(s.time)
    if not duration:
        return np.full(len(s.time), 0.5)
    return (s.time - s.time.min()) / duration


_MIN_RUN = 0.3
"""Minimum duration of a run of rows [s]."""
_MAX_GAP = 0.2
"""Maximum gap inside a run [s]."""


def runs(time: Array, piece: Array, is_high: Array) -> list[tuple[int, int]]:
    """Runs of high rows within one piece: pairs of the first row and the row after the last.

    Runs are at least 0.3 s long; short gaps in them are bridged.
    """
    high_rows = np.flatnonzero(is_high)
    if not high_rows.size:
        return []
    is_gap = np.diff(time[high_rows]) > _MAX_GAP
    is_other_piece = np.diff(piece[high_rows]) != 0
    run_ends = np.flatnonzero(is_gap | is_other_piece)  # indices among the high rows
    first_rows = high_rows[np.append(0, run_ends + 1)]
    last_rows = high_rows[np.append(run_ends, len(high_rows) - 1)]
    is_long = time[last_rows] - time[first_rows] >= _MIN_RUN
    return list(zip(first_rows[is_long].tolist(), (last_rows[is_long] + 1).tolist(), strict=True))


def unit_of_value(kind: str, joints: Sequence[int], model: Model) -> str:
    """Unit of the value of a cause: of the table of doubts, but millimetres for displacements of sliding joints.

    No ``joints`` are all joints.
    """
    turning = turning_joints(model)
    if joints:
        turning = turning[list(joints)]
    if kind not in _DISPLACEMENTS or turning.all():
        return doubt_table()[kind].unit
    return "rad or m" if turning.any() else "mm"


def value_with_interval(kind: str, value: Array, half: Array, unit: str) -> tuple[float, tuple[float, float]]:
    """Value β (k,) and its interval of half-widths ``half`` (k,), in the unit by :func:`unit_of_value`.

    If β is a vector, the value is its magnitude.
    """
    size = float(value[0])
    direction = np.eye(len(value))[0]
    if len(value) > 1:
        size = float(np.linalg.norm(value))
        if size:
            direction = value / size
    half_width = float(np.sqrt(((direction * half) ** 2).sum()))
    to_unit = _TO_UNITS.get(kind, float)
    if kind in _DISPLACEMENTS:
        factor = _DISPLACEMENTS[kind] * _PER_RADIAN_OR_METRE[unit]
        to_unit = partial(operator.mul, factor)
    bounds = [float(to_unit(size - half_width)), float(to_unit(size + half_width))]
    low, high = sorted(bounds)  # some conversions decrease
    return float(to_unit(size)), (low, high)


_DISPLACEMENTS = {"elasticity": 1.0, "zero-change": 1.0, "backlash": 2.0}
"""Causes whose value is a displacement of joints, with its ratio to β [rad or m]."""
_PER_RADIAN_OR_METRE = {"deg": float(np.degrees(1.0)), "mm": 1e3, "rad or m": 1.0}
"""Units of displacements, in a radian or a metre."""
_TO_UNITS: Mapping[str, Callable[[float], float]] = {  # functions of β, by kind; β itself for others
    **dict.fromkeys(("zero", "tilt"), np.degrees),
    **dict.fromkeys(("late", "late-change", "late-joint"), lambda seconds: 1e3 * seconds),
    "gain-change": lambda share: 1.0 + share,
    "low-pass": lambda seconds: 1.0 / (2.0 * np.pi * max(seconds, 1e-9)),
    **dict.fromkeys(("load-friction", "stribeck", "warming", "gain-drift"), lambda share: 100.0 * share),
    **dict.fromkeys(("gain", "position-scale"), lambda logarithm: float(np.exp(np.clip(logarithm, -30.0, 30.0)))),
}
