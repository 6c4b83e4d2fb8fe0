"""Other readings of a measurement file: units, order and sign of columns, conventions. Each alternative is fitted again."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..core.doubts import Doubt, doubt
from ..core.errors import TwistWrenchError
from ..core.numbers import number
from ..core.typing import Array
from ..formats.urdf import rpy_of_rotation
from ..mechanics.lie import quaternion, se3, so3
from .fit import CalibrationFit, CalibrationProblem
from .groups import fitted_in_groups
from .held_out import cross_validated
from .instrument import Offered
from .measurements import LENGTHS_MEASURED, Measurements, rotations_from_roll
from .result_view import millimetres

if TYPE_CHECKING:
    from .result import CalibratedRobot

# Alternatives are tried unless the fit explains the readings: "explained" means all of the next four.

_MAX_RESIDUAL = 1e-3
"""Residual [m] up to which a fit explains the readings."""
_MAX_ROTATION = 20e-3
"""Residual [rad] up to which a fit explains the readings."""
_MAX_RESIDUAL_SHARE = 0.2
"""Residual, as a share of the error before, up to which a fit explains the readings."""
_MAX_OUTLIER_SHARE = 0.05
"""Share of outliers up to which a fit explains the readings."""
_MAX_MISFIT_SHARE = 0.5
"""Largest misfit of a named alternative, as a share of that of the readings as given."""
_MAX_EQUAL_RATIO = 1.5
"""Ratio of misfits up to which two alternatives fit equally well."""
_LEVER = 0.3
"""Length [m] by which angles are multiplied in the misfit."""
_MISFIT_QUANTILE = 0.75
"""Quantile of the residuals that is the misfit; it is insensitive to outliers."""
_MAX_FULL_FITS = 3
"""Number of alternatives that are fitted with all parameters."""
_MAX_MISFIT = 10e-3
"""Misfit [m] above which an alternative explains nothing; if all are above it, the robot itself is doubted."""
_MAX_ERROR_RATIO = 0.8
"""Held-out error with sag or gears over the error without, below which they are offered."""
_ANGLE_ENTRIES = 3
"""Number of angles of a twist, which come first."""
_MAX_ZERO = 0.2
"""Zero [rad] above which the joint's convention is doubted, although the fit has found it."""
_MAX_COMPUTED_ERROR = 5e-6
"""Error before [m] below which the readings were computed with the file's own kinematics."""


class Alternative(NamedTuple):
    """Another reading of the measurements: units, columns or conventions."""

    kind: str
    """Kind of the doubt, without ``calibration-``."""
    joints: tuple[str, ...]
    """Joints whose readings change; empty if all change."""
    change: Callable[[Measurements], Measurements]
    """Function that returns the measurements as they are read otherwise."""
    value: float | None = None
    """Factor, angle or number of rows of the change; None if it has none."""
    unit: str = ""
    """Unit of the value; empty for a factor."""
    words: str = ""
    """Name of the alternative's unit, order or convention in the message."""


def computed_doubts(found: CalibratedRobot) -> list[Doubt]:
    """Doubt about readings that were computed with the file's own kinematics."""
    if found.before < _MAX_COMPUTED_ERROR and found.measures_tip:
        return [doubt("calibration-own-kinematics", before=number(1e6 * found.before, 2))]
    return []


def reading_doubts(found: CalibratedRobot) -> list[Doubt]:
    """Doubt about readings that fit much better with an alternative, or that no alternative explains."""
    fit = found.fit
    is_explained = _explains_readings(found)
    if is_explained and not _has_large_zero(found):
        return []
    problem = replace(fit.problem, independent=None)
    if is_explained:
        misfit_as_given = _misfit(found.plain)
        best = _best_convention(problem, misfit_as_given)
    else:
        misfit_as_given = _misfit(replace(problem, keep_outliers=True).solve())
        best = _best_alternative(problem, misfit_as_given)
    if best is not None:
        alternative, misfit = best
        better_reading = doubt(
            f"calibration-{alternative.kind}",
            alternative.joints,
            words=alternative.words,
            plain=millimetres(misfit_as_given),
            misfit=millimetres(misfit),
            found={"value": alternative.value, "unit": alternative.unit},
        )
        return [better_reading]
    if misfit_as_given > _MAX_MISFIT and not is_explained:
        found_value = {"value": misfit_as_given, "unit": "m"}
        return [doubt("calibration-wrong-robot", misfit=millimetres(misfit_as_given), found=found_value)]
    return []


def _explains_readings(found: CalibratedRobot) -> bool:
    """True if the fit has small residuals and few outliers, and is far better than the file unless the file is right."""
    fit = found.fit
    if fit.rms >= _MAX_RESIDUAL:
        return False
    rms_rotations = [float(np.sqrt(np.mean(angles**2))) for angles in fit.turns if angles.size]
    if max(rms_rotations, default=0.0) >= _MAX_ROTATION:
        return False
    if len(fit.outliers) > _MAX_OUTLIER_SHARE * fit.problem.count:
        return False
    return fit.rms < _MAX_RESIDUAL_SHARE * found.before or found.needs_nothing


def _has_large_zero(found: CalibratedRobot) -> bool:
    """True if the fit has moved the zero of a turning joint so far that the file has another convention for it."""
    own_entries = found.fit.problem.chain.own  # entry of each joint's own coordinate in its displacement
    displacements = found.fit.state.corrections.displacements
    for own_entry, displacement in zip(own_entries, displacements, strict=True):
        is_angle = own_entry < _ANGLE_ENTRIES
        if is_angle and abs(displacement[own_entry]) > _MAX_ZERO:
            return True
    return False


def _best_convention(problem: CalibrationProblem, misfit_as_given: float) -> tuple[Alternative, float] | None:
    """Alternative with which the file is nearly right, and its misfit [m]; None if there is none."""
    best, *_ = _fits_of_frames(problem)
    if best.misfit < _MAX_RESIDUAL_SHARE * misfit_as_given:
        return best.alternative, best.misfit
    return None


class _FrameFit(NamedTuple):
    """Fit of targets and tip alone, with the readings of an alternative."""

    misfit: float
    """Misfit [m]."""
    rank: int
    """Number of more usual alternatives."""
    alternative: Alternative


def _fits_of_frames(problem: CalibrationProblem) -> list[_FrameFit]:
    """Fits of targets and tip alone with each alternative, the least misfit first."""
    fits: list[_FrameFit] = []
    for rank, alternative in enumerate(_alternatives(problem)):
        misfit = _misfit_with(problem, alternative, frames_only=True)
        fits.append(_FrameFit(misfit, rank, alternative))
    return sorted(fits, key=lambda fit: (fit.misfit, fit.rank))


def _best_alternative(problem: CalibrationProblem, misfit_as_given: float) -> tuple[Alternative, float] | None:
    """Alternative that more than halves the misfit, and its misfit [m]; None if there is none.

    The three best by fits of targets and tip alone are fitted in full. Of equally good ones, the most usual is chosen.
    """
    frame_fits = _fits_of_frames(problem)[:_MAX_FULL_FITS]
    misfits = [_misfit_with(problem, fit.alternative, frames_only=False) for fit in frame_fits]
    least_misfit = min(misfits)
    max_misfit = min(_MAX_MISFIT_SHARE * misfit_as_given, _MAX_MISFIT)
    if not least_misfit < max_misfit:
        return None
    max_equal_misfit = max(_MAX_EQUAL_RATIO * least_misfit, _MAX_RESIDUAL)
    equal_indices = [k for k, misfit in enumerate(misfits) if misfit <= max_equal_misfit]
    # A full fit finds zeros by itself. Fits of targets and tip alone distinguish zeros of 90° and 180°.
    max_frames_misfit = _MAX_EQUAL_RATIO * frame_fits[equal_indices[0]].misfit
    candidates = [k for k in equal_indices if frame_fits[k].misfit <= max_frames_misfit]
    chosen = min(candidates, key=lambda k: frame_fits[k].rank)
    return frame_fits[chosen].alternative, misfits[chosen]


def _misfit_with(problem: CalibrationProblem, alternative: Alternative, *, frames_only: bool) -> float:
    """Misfit [m] with an alternative; infinite if it cannot be fitted."""
    try:
        measured = tuple(map(alternative.change, problem.measured))
        changed_problem = replace(problem, measured=measured, keep_outliers=True)
        return _misfit(changed_problem.solve(frames_only=frames_only))
    except (TwistWrenchError, np.linalg.LinAlgError):
        return math.inf


def _misfit(fit: CalibrationFit) -> float:
    """Upper quartile of the residuals [m], with angles times 0.3 m."""
    sizes = []
    for errors, angles in zip(fit.errors, fit.turns, strict=True):
        sizes.append(np.hypot(errors, _LEVER * angles) if angles.size else errors)
    return float(np.quantile(np.concatenate(sizes), _MISFIT_QUANTILE))


def _alternatives(problem: CalibrationProblem) -> Iterator[Alternative]:
    """All alternatives, the most usual first."""
    chain = problem.chain
    kinds = {measurement.kind for measurement in problem.measured}
    joints = chain.joints
    columns = chain.columns  # of the joints in q
    turning_columns = [column for column, turns in zip(columns, chain.turning, strict=True) if turns]
    if kinds & set(LENGTHS_MEASURED):
        for factor, unit in ((1e-3, "mm"), (1e-2, "cm"), (0.0254, "inches")):
            change = partial(_scale_readings, factor=factor)
            yield Alternative("unit", (), change, value=factor, words=unit)
    for factor, words in ((math.radians(1.0), "degrees"), (math.degrees(1.0), "rad")):
        change = partial(_q_times, columns=turning_columns, factor=factor)
        yield Alternative("degrees", (), change, value=factor, words=words)
    joints_with_columns = zip(joints, columns, strict=True)
    for (first_joint, i), (second_joint, j) in combinations(joints_with_columns, 2):
        yield Alternative("exchanged", (first_joint, second_joint), partial(_exchange_joints, i=i, j=j))
    for joint, column in zip(joints, columns, strict=True):
        yield Alternative("sign", (joint,), partial(_q_times, columns=[column], factor=-1.0))
    for joint, column in zip(joints, columns, strict=True):
        if column not in turning_columns:
            continue
        for degrees in (90.0, -90.0, 180.0):
            change = partial(_q_plus, k=column, offset=math.radians(degrees))
            yield Alternative("zero", (joint,), change, value=degrees, unit="°", words=number(degrees))
    if kinds & {"pose", "position"}:
        yield Alternative("left-handed", (), _mirror_readings)
    for rows_late, words in ((1, "late"), (-1, "early")):  # late readings belong to the row before
        change = partial(_shift_rows, rows=-rows_late)
        yield Alternative("row-shift", (), change, value=float(rows_late), unit="rows", words=words)
    if "pose" in kinds:
        yield Alternative("inverse", (), partial(_change_poses, change=se3.inverse))
        for shift, words in ((-1, "w, x, y, z in place of x, y, z, w"), (1, "x, y, z, w in place of w, x, y, z")):
            roll = partial(_roll_quaternions, shift=shift)
            yield Alternative("quaternion-order", (), partial(_change_poses, change=roll), words=words)
        for words, read in _ANGLE_CONVENTIONS.items():
            yield Alternative("angle-order", (), partial(_change_poses, change=read), words=words)


# ── Changes of measurements


def _scale_readings(m: Measurements, factor: float) -> Measurements:
    """Readings with lengths multiplied by a factor."""
    if m.poses is not None:
        m = replace(m, poses=np.asarray(se3.pose(m.rotations, factor * m.points)))
    if m.positions is not None:
        m = replace(m, positions=factor * m.positions)
    if m.distances is not None:
        m = replace(m, distances=factor * m.distances)
    return m


def _q_times(m: Measurements, columns: list[int], factor: float) -> Measurements:
    """Readings with columns of q multiplied by a factor."""
    q = m.q.copy()
    q[:, columns] *= factor
    return replace(m, q=q)


def _q_plus(m: Measurements, k: int, offset: float) -> Measurements:
    """Readings with an offset added to column k of q."""
    unit_row = np.eye(m.q.shape[1])[k]
    return replace(m, q=m.q + offset * unit_row)


def _exchange_joints(m: Measurements, i: int, j: int) -> Measurements:
    """Readings with two columns of q exchanged."""
    q = m.q.copy()
    q[:, [i, j]] = q[:, [j, i]]
    return replace(m, q=q)


def _shift_rows(m: Measurements, rows: int) -> Measurements:
    """Combine each reading with the configuration of the next row; of the row before, if ``rows`` is negative."""
    if m.pairs is not None or m.kind not in ("pose", "position", "distance"):
        return m
    without_first = m.taken(np.arange(1, len(m)))
    without_last = m.taken(np.arange(len(m) - 1))
    if rows > 0:
        return replace(without_last, q=without_first.q)
    return replace(without_first, q=without_last.q)


def _mirror_readings(m: Measurements) -> Measurements:
    """Readings in a left-handed frame: mirrored in the plane z = 0."""
    M = np.diag([1.0, 1.0, -1.0])
    if m.poses is not None:
        return replace(m, poses=np.asarray(se3.pose(M @ m.rotations @ M, m.points @ M)))
    if m.positions is not None:
        return replace(m, positions=m.points @ M)
    return m


def _change_poses(m: Measurements, change: Callable[[Array], Array]) -> Measurements:
    """Readings with changed poses; unchanged if they are not poses."""
    if m.poses is None:
        return m
    return replace(m, poses=np.asarray(change(m.poses)))


def _roll_quaternions(T: Array, shift: int) -> Array:
    """Poses whose quaternions have their entries shifted cyclically."""
    quaternions = np.stack([quaternion.from_matrix(R) for R in T[:, :3, :3]])
    R = quaternion.rotation(np.roll(quaternions, shift, axis=1))
    return np.asarray(se3.pose(R, T[:, :3, 3]))


def _read_again(T: Array, angles: Callable[[Array], Array], rotations: Callable[[Array], Array]) -> Array:
    """Poses with rotations from the same three angles, by another convention."""
    angles_of_file = np.stack([angles(R) for R in T[:, :3, :3]])
    return np.asarray(se3.pose(rotations(angles_of_file), T[:, :3, 3]))


def _moving_axes(angles: Array) -> Array:
    """Rx(roll) Ry(pitch) Rz(yaw)."""
    return np.swapaxes(rotations_from_roll(-angles), 1, 2)


def _rotations_from_yaw(angles: Array) -> Array:
    """Rotations of angles in the order yaw, pitch, roll."""
    return rotations_from_roll(angles[:, ::-1])


_ANGLE_CONVENTIONS: dict[str, Callable[[Array], Array]] = {
    "moving axes x, y, z": partial(_read_again, angles=rpy_of_rotation, rotations=_moving_axes),
    "the order yaw, pitch, roll": partial(_read_again, angles=rpy_of_rotation, rotations=_rotations_from_yaw),
    "a rotation vector": partial(_read_again, angles=rpy_of_rotation, rotations=so3.exp),
    "roll, pitch, yaw": partial(_read_again, angles=so3.log, rotations=rotations_from_roll),
}
"""Functions that read the orientations of poses (n, 4, 4) by another convention, by its name."""


def effect_doubts(found: CalibratedRobot) -> Iterator[Offered]:
    """Doubt about the first of sag and gear errors that lowers the held-out error by a fifth; nothing if neither does."""
    problem = found.fit.problem
    chain = problem.chain
    equation_count = 0
    for weights in found.fit.weights:  # (readings, rows of each); zero for outliers
        used_readings = int((weights[:, -1] > 0).sum())
        equation_count += used_readings * weights.shape[1]
    seed = int(found.settings["seed"])
    rms_without = cross_validated(found.fit, seed).rms
    for effect in ("sag", "gears"):
        unknown_count = found.rank + len(chain.joints)
        if effect in chain.assume or equation_count < 2 * unknown_count:
            continue
        chain_with_effect = replace(chain, assume=(*chain.assume, effect))
        try:
            fit = fitted_in_groups(replace(problem, chain=chain_with_effect, independent=None).solve())
        except (TwistWrenchError, np.linalg.LinAlgError):
            continue
        rms_with = cross_validated(fit, seed).rms
        if rms_with < _MAX_ERROR_RATIO * rms_without:
            reason = doubt(
                f"calibration-{effect}",
                plain=millimetres(rms_without),
                rms=millimetres(rms_with),
                found={"value": rms_with, "unit": "m"},
            )
            yield Offered(rms_with / rms_without, reason)
            return
