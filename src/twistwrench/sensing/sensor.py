"""Six-axis force-torque sensor with a load: frames, gravity, and readings."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.doubts import doubt
from ..core.errors import FrameError, InertiaError, ModelWarning, ShapeError, ValueRangeError
from ..core.glossary import complete
from ..core.gravity import GRAVITY
from ..core.typing import Array
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.lie import quaternion, so3
from ..mechanics.lie.labelled import frame_name
from ..mechanics.lie.twist_wrench import Pose, Twist, Wrench

_LABELLED_TYPES: dict[str, type] = {"pose": Pose, "V": Twist, "dV": Twist}
"""Labelled type of each argument; all other arguments are wrenches."""


def plain_arrays(given: dict[str, Any], frame: str | None = None, *, turned: bool = False) -> dict[str, Any]:
    """Plain arrays of the arguments ``given``, after a check of the frames of labelled ones; others are unchanged.

    ``pose``, ``V`` and ``dV`` belong to {f}, whose name is ``frame`` if known. Other arguments are wrenches in the sensor's
    axes {s}, which coincide with {f} unless the mounting is ``turned``.
    """
    frames: dict[str, str] = {}  # by argument, of those that belong to {f}
    if frame is not None:
        frames["the sensor"] = frame
    wrench_frames: dict[str, str] = {}  # by argument, of those that belong to {s}
    plain = dict(given)
    for name, x in given.items():
        if not isinstance(x, Pose | Twist | Wrench):
            continue
        expected_type = _LABELLED_TYPES.get(name, Wrench)
        if not isinstance(x, expected_type):
            raise FrameError(f"{name} is a {type(x).__name__}, expected a {expected_type.__name__} or plain numbers.")
        if isinstance(x, Pose):
            plain[name] = x.matrix
            frames[name] = x.of
        elif isinstance(x, Twist):
            plain[name] = x.values
            frames[name] = x.frame
        else:
            plain[name] = x.values
            wrench_frames[name] = x.frame
    if not turned:
        frames |= wrench_frames
        wrench_frames = {}
    if len(set(frames.values())) > 1:
        texts = []
        for name, frame_of_argument in frames.items():
            preposition = "of" if name == "pose" else "in"
            texts.append(f"{name} {preposition} {frame_of_argument!r}")
        raise FrameError(
            f"{', '.join(texts)}: a sensor's equation holds in one frame, that of the sensor. Move the others first, with "
            "a Pose."
        )
    for name, wrench_frame in wrench_frames.items():
        if wrench_frame in frames.values():
            raise FrameError(
                f"{name} in {wrench_frame!r}: readings are in the sensor's own axes, which the mounting turns against "
                f"{wrench_frame!r}. Give them under a name of their own."
            )
    return plain


MAX_ROTATION_ERROR = 1e-3
"""Largest deviation of a rotation: accepts numbers with four decimals and rejects wrong columns."""


def checked_rotations(pose: ArrayLike, where: str = "pose") -> Array:
    """Rotations (..., 3, 3) of rotations or poses (..., 4, 4), projected onto the rotation group."""
    matrices = arguments.real(pose, where)
    if matrices.shape[-2:] not in ((3, 3), (4, 4)):
        raise ShapeError(f"{where} has shape {matrices.shape}, expected rotations (..., 3, 3) or poses (..., 4, 4).")
    R = np.asarray(arguments.finite(matrices[..., :3, :3], where), float)
    deviation = np.abs(np.swapaxes(R, -1, -2) @ R - np.eye(3))
    message = (
        f"{where} is not a rotation: RᵀR is {{gap}} off the identity, allowed {{allowed}}; check the order of its entries "
        "(row by row) and its decimals"
    )
    arguments.refuse(deviation, MAX_ROTATION_ERROR, message)
    # RᵀR is nearly the identity, so the determinant is nearly 1 or -1.
    negative_determinant = np.maximum(-np.linalg.det(R), 0.0)[..., None, None]  # as matrices (1, 1), like the deviation
    message = f"{where} mirrors: its determinant is -{{gap}}; the frame must be right-handed"
    arguments.refuse(negative_determinant, 0.5, message)
    return np.asarray(so3.project(R))


def rotations_of_quaternions(quat: ArrayLike, where: str = "quaternion") -> Array:
    """Rotations (..., 3, 3) of unit quaternions (..., 4), scalar first."""
    quat = np.asarray(arguments.finite(quat, where, 4), float)
    length_error = np.abs(np.linalg.norm(quat, axis=-1) - 1.0)
    deviation = length_error[..., None, None]  # as matrices (1, 1), which are checked
    message = (
        f"{where} is not of unit length: off from 1 by {{gap}}, allowed {{allowed}}; check which columns are qw, qx, qy, "
        "qz (qw is the scalar), or normalise them"
    )
    arguments.refuse(deviation, MAX_ROTATION_ERROR, message)
    return quaternion.rotation(quat)


def gravity_in_frame(pose: ArrayLike, gravity: ArrayLike = GRAVITY) -> Array:
    """Gravity in the axes of {f}, from the pose of {f} in {w}.

    Returns
    -------
    gravity : (..., 3) array [m/s²]

    Examples
    --------
    >>> from twistwrench import so3
    >>> import numpy as np
    >>> np.round(gravity_in_frame(so3.exp([np.pi / 2, 0, 0])), 6).tolist()  # tool rotated by 90° about x
    [0.0, -9.81, 0.0]
    """
    g = np.asarray(arguments.finite(gravity, "gravity", 3), float)
    R = checked_rotations(pose)
    g_f = np.swapaxes(R, -1, -2) @ g[..., None]
    return np.asarray(g_f[..., 0])


def rotations_to_gravity(directions: ArrayLike) -> Array:
    """Smallest rotations R_wf (..., 3, 3) by which gravity, along -z of {w}, has the given directions (..., 3) in {f}."""
    d = np.asarray(directions, float)
    d = d / np.linalg.norm(d, axis=-1, keepdims=True)
    # Quaternion of the rotation from d to -z, of any length: (1 + cos, d × -z) with cos = -d_z and
    # d × -z = (-d_y, d_x, 0). It is zero if d is opposite to -z; then a half turn about x takes its place.
    quat = np.stack([1.0 - d[..., 2], -d[..., 1], d[..., 0], np.zeros(d.shape[:-1])], axis=-1)
    is_opposite = np.linalg.norm(quat, axis=-1, keepdims=True) < 1e-9  # zero but for rounding errors
    return quaternion.rotation(np.where(is_opposite, [0.0, 1.0, 0.0, 0.0], quat))


# The load obeys ``F = G dV - ad(V)' G V`` (Modern Robotics eq. 8.40) under its weight and the sensor's wrench, so its
# wrench on the sensor is ``F_on = G (0, g) - G dV + ad(V)' G V``. Quantities are in {f}; wrenches are (m, f) in N m and
# N, twists (omega, v).

Sign = Literal["on_sensor", "by_sensor"]
"""Wrench that a sensor reads, see :attr:`ForceTorqueSensor.sign`."""
Inertia = Literal["given", "accept", "unknown"]
"""State of a load's rotational inertia, see :attr:`ForceTorqueSensor.inertia`."""

MIN_MOUNTING_TURN = 1e-9
"""Largest entry of R_fs minus the identity for which {s} and {f} coincide."""


def sign_factor(sign: str) -> float:
    """+1 for wrenches of the load on the sensor, -1 for wrenches of the sensor on the load."""
    arguments.choice(sign, "sign", get_args(Sign))
    return 1.0 if sign == "on_sensor" else -1.0


def load_regressor(gravity: ArrayLike, V: ArrayLike | None = None, dV: ArrayLike | None = None) -> Array:
    """Regressor Y with F_on = Y π: wrench of a load with the ten parameters π on the sensor.

    ``gravity`` (..., 3) [m/s²] in {f}; twist V (..., 6) of {f} and its rate dV (..., 6), None for zero → (..., 6, 10).
    Source: Atkeson, An and Hollerbach, "Estimation of inertial parameters of manipulator loads and links", 1986.
    """
    g = np.asarray(gravity, float)
    at_rest = np.zeros(6)
    V = at_rest if V is None else np.asarray(V, float)
    dV = at_rest if dV is None else np.asarray(dV, float)
    shape = np.broadcast_shapes(g.shape[:-1], V.shape[:-1], dV.shape[:-1])
    V = np.broadcast_to(V, (*shape, 6))
    w = V[..., :3]
    v = V[..., 3:]
    alpha = np.broadcast_to(dV[..., :3], (*shape, 3))
    d = dV[..., 3:] + so3.cross(w, v) - g  # acceleration of the origin minus gravity
    W = so3.hat(w)
    Y = np.zeros((*shape, 6, 10))  # columns: mass, first moment h, six entries of I
    Y[..., 3:, 0] = -d  # force of the mass
    Y[..., :3, 1:4] = so3.hat(d)  # moment h × -d
    Y[..., 3:, 1:4] = -(so3.hat(alpha) + W @ W)  # force of the first moment
    Y[..., :3, 4:] = -(_inertia_product_matrix(alpha) + W @ _inertia_product_matrix(w))  # moment -(I α + ω × I ω)
    return Y


def _inertia_product_matrix(x: Array) -> Array:
    """Matrix L with I x = L (Ixx, Ixy, Iyy, Ixz, Iyz, Izz); (..., 3) → (..., 3, 6)."""
    L = np.zeros((*x.shape[:-1], 3, 6), x.dtype)
    L[..., 0, [0, 1, 3]] = x
    L[..., 1, [1, 2, 4]] = x
    L[..., 2, [3, 4, 5]] = x
    return L


@dataclass(frozen=True, eq=False)
class ForceTorqueSensor:
    """Force-torque sensor with its bias and load.

    ``reading = bias ± R' (F_on + contact wrench)``.

    Examples
    --------
    >>> from twistwrench import SpatialInertia
    >>> sensor = ForceTorqueSensor(load=SpatialInertia.from_com(3.0, (0, 0, 0.1)), bias=[0, 0, 0, 5, 0, 0])
    >>> sensor.predict(np.eye(3)).round(6).tolist()  # upright, with 3 kg below
    [0.0, 0.0, 0.0, 5.0, 0.0, -29.43]
    >>> sensor.compensate([0, 0, 0, 5, 0, -39.43], np.eye(3)).round(6).tolist()
    [0.0, 0.0, 0.0, 0.0, 0.0, -10.0]
    >>> sensor.contact_wrench([0, 0, 0, 0, 0, -10]).tolist(), sensor.missing_signals(None, None)
    ([0.0, 0.0, 0.0, 0.0, 0.0, -10.0], None)
    """

    load: SpatialInertia = field(default_factory=SpatialInertia.zero)
    """Inertia of the load in {f}, the frame whose poses are given."""
    bias: ArrayLike = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    """Reading (6,) [N m, N] without load."""
    sign: Sign = "on_sensor"
    """``on_sensor``: readings are wrenches of the load on the sensor; ``by_sensor``: of the sensor on the load."""
    mounting: ArrayLike = field(default_factory=lambda: np.eye(3))
    """R_fs (3, 3): the sensor's axes in {f}; the identity if they coincide."""
    frame: str | None = None
    """Name of {f}, against which labelled poses, twists and wrenches are checked; None: only against each other."""
    inertia: Inertia = "given"
    """State of the load's rotational inertia.

    ``given``: it must be physically consistent, else :class:`~twistwrench.InertiaError`; ``accept``: it is used
    unchecked; ``unknown``: its numbers are placeholders, so moments in motion are not predicted.
    """

    def __post_init__(self) -> None:
        if not isinstance(self.load, SpatialInertia):
            raise InertiaError(f"a sensor's load is a SpatialInertia, got {type(self.load).__name__}.")
        arguments.choice(self.inertia, "inertia", get_args(Inertia))
        one_reading = arguments.one(self.bias, "bias", 6)  # not a batch
        bias = np.array(arguments.finite(one_reading, "bias"), float)
        if not np.isfinite(self.load.parameters.astype(float)).all():
            raise ValueRangeError("the sensor's load has a value that is not a finite number.")
        defects = "; ".join(self.load.defects())
        if defects and (self.inertia == "given" or self.load.mass < 0):
            raise InertiaError(
                f"no load has this inertia: {defects}. See nearest_consistent() and repair(); the keyword inertia "
                "accepts it as it is, if the mass is not negative."
            )
        sign_factor(self.sign)
        if self.frame is not None:
            frame_name(self.frame, "the frame of a sensor")
        R = checked_rotations(self.mounting, "mounting")
        if R.shape != (3, 3):
            raise ShapeError(f"mounting has shape {np.shape(self.mounting)}, expected one rotation (3, 3).")
        bias.setflags(write=False)
        R.setflags(write=False)
        object.__setattr__(self, "bias", bias)
        object.__setattr__(self, "mounting", R)

    def predict(
        self,
        pose: ArrayLike,
        V: ArrayLike | None = None,
        dV: ArrayLike | None = None,
        *,
        gravity: ArrayLike = GRAVITY,
    ) -> Array:
        """Predicted reading without contact; arguments broadcast.

        Returns
        -------
        reading : (..., 6) array, (m, f) in the sensor's axes [N m, N]

        Raises
        ------
        FrameError
            A :class:`~twistwrench.Pose` or :class:`~twistwrench.Twist` has another frame than {f} or than the others.
        """
        plain = self._plain_arrays(pose=pose, V=V, dV=dV)
        V = _optional_vectors(plain["V"], "V")
        dV = _optional_vectors(plain["dV"], "dV")
        g = gravity_in_frame(plain["pose"], gravity)
        _check_broadcast(gravity=g, V=V, dV=dV)
        F_on = load_regressor(g, V, dV) @ self.load.parameters.astype(float)
        R = np.asarray(self.mounting)  # F_s = R_fs' F_f, written for rows; origins coincide
        F_s = np.concatenate([F_on[..., :3] @ R, F_on[..., 3:] @ R], axis=-1)
        return np.asarray(self.bias) + sign_factor(self.sign) * F_s

    def compensate(
        self,
        readings: ArrayLike,
        pose: ArrayLike,
        V: ArrayLike | None = None,
        dV: ArrayLike | None = None,
        *,
        gravity: ArrayLike = GRAVITY,
    ) -> Array:
        """Gravity and inertia compensation: readings without bias, weight and inertial load.

        Parameters
        ----------
        readings : (..., 6) array_like or Wrench [N m, N]
            A labelled :class:`~twistwrench.Wrench` must be in the sensor's axes, which are those of {f} unless the
            mounting is turned.

        Returns
        -------
        compensated : (..., 6) array, wrench of contacts, in the sign and axes of the readings [N m, N]

        Warns
        -----
        ModelWarning
            There is motion and the load's inertia is unknown.
        """
        plain = self._plain_arrays(readings=readings, pose=pose, V=V, dV=dV)
        plain_readings = np.asarray(arguments.real(plain.pop("readings"), "readings", 6), float)
        predicted = self.predict(**plain, gravity=gravity)
        self.warn_of_motion(plain["V"], plain["dV"])
        _check_broadcast(readings=plain_readings, predicted=predicted)
        return plain_readings - predicted

    def contact_wrench(self, compensated: ArrayLike) -> Array:
        """Contact wrench on the load, from compensated readings of either sign.

        Parameters
        ----------
        compensated : (..., 6) array_like or Wrench, in the sensor's axes [N m, N]

        Returns
        -------
        F : (..., 6) array, (m, f) in {f} [N m, N]

        Raises
        ------
        FrameError
            The sensor has a ``frame``, and a labelled wrench is in another.
        """
        plain = self._plain_arrays(compensated=compensated)["compensated"]
        F_s = sign_factor(self.sign) * np.asarray(arguments.real(plain, "compensated", 6), float)
        Rt = np.asarray(self.mounting).T  # F_f = R_fs F_s, for rows
        return np.concatenate([F_s[..., :3] @ Rt, F_s[..., 3:] @ Rt], axis=-1)

    def missing_signals(self, V: ArrayLike | None, dV: ArrayLike | None) -> str | None:
        """Explain which moments remain in a motion because the load's inertia is unknown.

        Returns
        -------
        text : str, or None if the compensation is complete
        """
        if self.inertia != "unknown":
            return None
        for x in (V, dV):
            if x is not None and np.asarray(x, float)[..., :3].any():  # an angular part
                return str(doubt("sensor-file-inertia"))
        return None

    def warn_of_motion(self, V: ArrayLike | None, dV: ArrayLike | None) -> None:
        """Issue the text of :meth:`missing_signals` as a warning.

        Warns
        -----
        ModelWarning
            There is motion and the load's inertia is unknown.

        Examples
        --------
        >>> from twistwrench import SpatialInertia
        >>> sensor = ForceTorqueSensor(SpatialInertia.from_com(3.0, (0, 0, 0.1)), bias=[0, 0, 0, 5, 0, 0])
        >>> sensor.warn_of_motion(None, None)
        """
        text = self.missing_signals(V, dV)
        if text:
            warnings.warn(text, ModelWarning, stacklevel=3)

    def _plain_arrays(self, **given: Any) -> dict[str, Any]:
        """Plain arrays of labelled arguments, after a check of their frames against the sensor's."""
        mounting_turn = float(np.abs(np.asarray(self.mounting) - np.eye(3)).max())
        return plain_arrays(given, self.frame, turned=mounting_turn > MIN_MOUNTING_TURN)


def checked_sensor(sensor: Any, taker: str) -> ForceTorqueSensor:
    """Return a ForceTorqueSensor unchanged; otherwise raise :class:`~twistwrench.ShapeError` naming the caller."""
    if isinstance(sensor, ForceTorqueSensor):
        return sensor
    raise ShapeError(f"{taker} takes a ForceTorqueSensor, got {arguments.value_text(sensor)}.")


def _optional_vectors(x: ArrayLike | None, name: str) -> Array | None:
    """Checked vectors (..., 6), or None."""
    if x is None:
        return None
    return np.asarray(arguments.real(x, name, 6), float)


def _check_broadcast(**arrays: Array | None) -> None:
    """Raise ShapeError unless the batches of vectors broadcast."""
    batch_shapes = {name: x.shape[:-1] for name, x in arrays.items() if x is not None}
    try:
        np.broadcast_shapes(*batch_shapes.values())
    except ValueError:
        listed = ", ".join(f"{name} {shape}" for name, shape in batch_shapes.items())
        raise ShapeError(f"these batches do not broadcast: {listed}.") from None


complete(globals())
