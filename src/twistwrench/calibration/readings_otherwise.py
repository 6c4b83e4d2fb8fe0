"""Readings taken otherwise: units, order and sign of columns, conventions. Each alternative is fitted again."""

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

_MIN_RESIDUAL, _MIN_TURN, _MIN_RESIDUAL_SHARE = 1e-3, 20e-3, 0.2
"""Residual [m], [rad], and as a share of the error before, from which readings are taken otherwise."""
_MANY_OUTLIERS = 0.05
_MAX_MISFIT_SHARE = 0.5
"""Largest misfit of a named alternative, as a share of that of the readings as given."""
_MAX_EQUAL_RATIO = 1.5
"""Ratio of misfits up to which alternatives are equal, as below 1 mm: that which fits targets and tip alone is named."""
_LEVER = 0.3
"""Length [m] by which angles count in the misfit."""
_FULL_FITS = 3
_NOTHING_FITS = 10e-3
"""Misfit [m] of all readings above which the robot itself is doubted, and an alternative explains nothing."""
_GAIN = 0.8
"""Held-out error with sag or gears over the error without, below which they are offered."""
_ANGLE_ENTRIES = 3
"""Number of angles of a twist, which come first."""
_LARGE_ZERO = 0.2
"""Zero [rad] above which the joint's convention is doubted, although the fit has found it."""
_EXACT = 5e-6
"""Error [m] before, below which readings are the file's own kinematics."""


class Alternative(NamedTuple):
    """Readings taken otherwise."""

    kind: str
    joints: tuple[str, ...]
    change: Callable[[Measurements], Measurements]
    value: float | None = None
    unit: str = ""
    words: str = ""


def computed_doubts(found: CalibratedRobot) -> list[Doubt]:
    """Doubt of readings that are the file's own kinematics."""
    if found.before < _EXACT and found.measures_tip:
        return [doubt("calibration-own-kinematics", before=number(1e6 * found.before, 2))]
    return []


def reading_doubts(found: CalibratedRobot) -> list[Doubt]:
    """Doubts of readings that fit much better if taken otherwise; of readings that no alternative explains."""
    fit = found.fit
    turn = max((float(np.sqrt(np.mean(t**2))) for t in fit.turns if t.size), default=0.0)
    many = len(fit.outliers) > _MANY_OUTLIERS * fit.problem.count
    improved = fit.rms < _MIN_RESIDUAL_SHARE * found.before or found.needs_nothing
    explained = fit.rms < _MIN_RESIDUAL and turn < _MIN_TURN and improved and not many
    if explained and not _has_large_zero(found):
        return []
    problem = replace(fit.problem, independent=None)
    if explained:
        plain = _misfit(found.plain)
        best = _best_convention(problem, plain)
    else:
        plain = _misfit(replace(problem, keep_outliers=True).solve())
        best = _best(problem, plain)
    if best is not None:
        one, misfit = best
        return [
            doubt(
                f"calibration-{one.kind}", one.joints, words=one.words, plain=millimetres(plain), misfit=millimetres(misfit),
                found={"value": one.value, "unit": one.unit},
            )
        ]  # fmt: skip
    if plain > _NOTHING_FITS and not explained:
        return [doubt("calibration-wrong-robot", misfit=millimetres(plain), found={"value": plain, "unit": "m"})]
    return []


def _has_large_zero(found: CalibratedRobot) -> bool:
    """True if the fit has moved a zero by more than a calibration does: by a convention of the joint."""
    chain, twists = found.fit.problem.chain, found.fit.state.corrections.displacements
    return any(own < _ANGLE_ENTRIES and abs(x[own]) > _LARGE_ZERO for own, x in zip(chain.own, twists, strict=True))


def _best_convention(problem: CalibrationProblem, plain: float) -> tuple[Alternative, float] | None:
    """Alternative with which the file is nearly right, where the fit has moved a zero all the way."""
    misfit, _, alternative = _by_misfit(problem)[0]
    if misfit < _MIN_RESIDUAL_SHARE * plain:
        return alternative, misfit
    return None


def _by_misfit(problem: CalibrationProblem) -> list[tuple[float, int, Alternative]]:
    """Misfit with targets and tip alone, number and alternative; the best first, equal ones in their order."""
    fits = []
    for k, alternative in enumerate(_alternatives(problem)):
        fits.append((_misfit_with(problem, alternative, frames_only=True), k, alternative))
    return sorted(fits, key=lambda entry: entry[:2])


def _best(problem: CalibrationProblem, plain: float) -> tuple[Alternative, float] | None:
    """Alternative that more than halves the misfit: the three best of targets and tip alone are fitted in full."""
    best = _by_misfit(problem)[:_FULL_FITS]
    full = [_misfit_with(problem, one, frames_only=False) for _, _, one in best]
    alike = [k for k, misfit in enumerate(full) if misfit <= max(_MAX_EQUAL_RATIO * min(full), _MIN_RESIDUAL)]
    if not min(full) < min(_MAX_MISFIT_SHARE * plain, _NOTHING_FITS):
        return None
    # Targets and tip alone tell zeros of 90° and 180°.
    usual = [k for k in alike if best[k][0] <= _MAX_EQUAL_RATIO * best[alike[0]][0]]
    chosen = min(usual, key=lambda k: best[k][1])
    return best[chosen][2], full[chosen]


def _misfit_with(problem: CalibrationProblem, one: Alternative, *, frames_only: bool) -> float:
    """Misfit with an alternative; infinite if it cannot be fitted."""
    try:
        measured = tuple(map(one.change, problem.measured))
        return _misfit(replace(problem, measured=measured, keep_outliers=True).solve(frames_only=frames_only))
    except (TwistWrenchError, np.linalg.LinAlgError):
        return math.inf


def _misfit(fit: CalibrationFit) -> float:
    """Upper quartile of the residuals [m], with angles times 0.3 m: outliers do not matter."""
    sizes = []
    for error, turn in zip(fit.errors, fit.turns, strict=True):
        sizes.append(np.hypot(error, _LEVER * turn) if turn.size else error)
    return float(np.quantile(np.concatenate(sizes), 0.75))


def _alternatives(problem: CalibrationProblem) -> Iterator[Alternative]:
    """All readings taken otherwise, the most usual first."""
    chain, kinds = problem.chain, {m.kind for m in problem.measured}
    joints, columns = chain.joints, chain.columns
    turning = [k for k, turns in zip(columns, chain.turning, strict=True) if turns]
    if kinds & set(LENGTHS_MEASURED):
        for factor, unit in ((1e-3, "mm"), (1e-2, "cm"), (0.0254, "inches")):
            yield Alternative("unit", (), partial(_scale_readings, factor=factor), factor, "", unit)
    for factor, words in ((math.radians(1.0), "degrees"), (math.degrees(1.0), "rad")):
        yield Alternative("degrees", (), partial(_q_times, columns=turning, factor=factor), factor, "", words)
    for (a, i), (b, j) in combinations(zip(joints, columns, strict=True), 2):
        yield Alternative("exchanged", (a, b), partial(_exchange_joints, i=i, j=j))
    for joint, k in zip(joints, columns, strict=True):
        yield Alternative("sign", (joint,), partial(_q_times, columns=[k], factor=-1.0))
    for joint, k in zip(joints, columns, strict=True):
        if k not in turning:
            continue
        for degrees in (90.0, -90.0, 180.0):
            yield Alternative(
                "zero", (joint,), partial(_q_plus, k=k, offset=math.radians(degrees)), degrees, "°", number(degrees)
            )
    if kinds & {"pose", "position"}:
        yield Alternative("left-handed", (), _mirror_readings)
    for rows, words in ((1, "late"), (-1, "early")):
        yield Alternative("row-shift", (), partial(_shift_rows, rows=rows), float(rows), "rows", words)
    if "pose" in kinds:
        yield Alternative("inverse", (), partial(_change_poses, change=se3.inverse))
        for places, words in ((-1, "w, x, y, z in place of x, y, z, w"), (1, "x, y, z, w in place of w, x, y, z")):
            yield Alternative(
                "quaternion-order",
                (),
                partial(_change_poses, change=partial(_roll_quaternions, places=places)),
                None,
                "",
                words,
            )
        for words, read in _ANGLES.items():
            yield Alternative("angle-order", (), partial(_change_poses, change=read), None, "", words)


def _scale_readings(m: Measurements, factor: float) -> Measurements:
    if m.poses is not None:
        m = replace(m, poses=np.asarray(se3.pose(m.rotations, factor * m.points)))
    if m.positions is not None:
        m = replace(m, positions=factor * m.positions)
    if m.distances is not None:
        m = replace(m, distances=factor * m.distances)
    return m


def _q_times(m: Measurements, columns: list[int], factor: float) -> Measurements:
    q = m.q.copy()
    q[:, columns] *= factor
    return replace(m, q=q)


def _q_plus(m: Measurements, k: int, offset: float) -> Measurements:
    return replace(m, q=m.q + offset * np.eye(m.q.shape[1])[k])


def _exchange_joints(m: Measurements, i: int, j: int) -> Measurements:
    q = m.q.copy()
    q[:, [i, j]] = q[:, [j, i]]
    return replace(m, q=q)


def _shift_rows(m: Measurements, rows: int) -> Measurements:
    if m.pairs is not None or m.kind not in ("pose", "position", "distance"):
        return m
    ahead, behind = m.taken(np.arange(1, len(m))), m.taken(np.arange(len(m) - 1))
    return replace(behind, q=ahead.q) if rows > 0 else replace(ahead, q=behind.q)


def _mirror_readings(m: Measurements) -> Measurements:
    M = np.diag([1.0, 1.0, -1.0])
    if m.poses is not None:
        return replace(m, poses=np.asarray(se3.pose(M @ m.rotations @ M, m.points @ M)))
    if m.positions is not None:
        return replace(m, positions=m.points @ M)
    return m


def _change_poses(m: Measurements, change: Callable[[Array], Array]) -> Measurements:
    if m.poses is None:
        return m
    return replace(m, poses=np.asarray(change(m.poses)))


def _roll_quaternions(T: Array, places: int) -> Array:
    quat = np.stack([quaternion.from_matrix(R) for R in T[:, :3, :3]])
    return np.asarray(se3.pose(quaternion.rotation(np.roll(quat, places, axis=1)), T[:, :3, 3]))


def _read_again(T: Array, angles: Callable[[Array], Array], rotations: Callable[[Array], Array]) -> Array:
    return np.asarray(se3.pose(rotations(np.stack([angles(R) for R in T[:, :3, :3]])), T[:, :3, 3]))


def _moving_axes(angles: Array) -> Array:
    """Rx(roll) Ry(pitch) Rz(yaw)."""
    return np.swapaxes(rotations_from_roll(-angles), 1, 2)


def _rotations_from_yaw(angles: Array) -> Array:
    return rotations_from_roll(angles[:, ::-1])


_ANGLES: dict[str, Callable[[Array], Array]] = {
    "moving axes x, y, z": partial(_read_again, angles=rpy_of_rotation, rotations=_moving_axes),
    "the order yaw, pitch, roll": partial(_read_again, angles=rpy_of_rotation, rotations=_rotations_from_yaw),
    "a rotation vector": partial(_read_again, angles=rpy_of_rotation, rotations=so3.exp),
    "roll, pitch, yaw": partial(_read_again, angles=so3.log, rotations=rotations_from_roll),
}
"""Orientations read by other conventions."""


def effect_doubts(found: CalibratedRobot) -> Iterator[Offered]:
    """Sag and gear errors that lower the held-out error by a fifth."""
    problem, chain = found.fit.problem, found.fit.problem.chain
    rows = sum(int((W[:, -1] > 0).sum()) * W.shape[1] for W in found.fit.weights)
    plain = cross_validated(found.fit, int(found.settings["seed"])).rms
    for effect in ("sag", "gears"):
        if effect in chain.assume or rows < 2 * (found.rank + len(chain.joints)):
            continue
        with_effect = replace(problem, chain=replace(chain, assume=(*chain.assume, effect)), independent=None)
        try:
            fit = fitted_in_groups(with_effect.solve())
        except (TwistWrenchError, np.linalg.LinAlgError):
            continue
        rms = cross_validated(fit, int(found.settings["seed"])).rms
        if rms < _GAIN * plain:
            named = doubt(
                f"calibration-{effect}",
                plain=millimetres(plain),
                rms=millimetres(rms),
                found={"value": rms, "unit": "m"},
            )
            yield Offered(rms / plain, named)
            return
