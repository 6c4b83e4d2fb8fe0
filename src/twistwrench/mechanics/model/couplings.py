"""Coupled drives: motors that move several joints together, q̇_m = A q̇_j with a constant matrix A, and so τ_j = A'τ_m.

Armature, friction and effort of the model belong to its drives, (nv,) each. The entries of coupled joints hold the values of
the motors: the first joint of a coupling has the values of its first motor, and so on. If joints are not coupled, a drive's
velocity is the joint's. Motor velocities are those behind the gear: the rotor turns ``ratio`` times as fast.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import InitVar, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.errors import ModelError
from ...core.text import listed
from ...core.typing import Array
from .actuators import MAX_DRIVE_NUMBER

if TYPE_CHECKING:
    from .model import Model

_MIN_SINGULAR_RATIO = 1e-9
"""Singular value, as a share of the largest, below which a matrix has a lower rank; columns are scaled to length 1 first."""


@dataclass(frozen=True, eq=False)
class Coupling:
    """Motors that move joints of one degree together, as in a differential wrist: q̇_m = A q̇_j, τ_j = A'τ_m.

    Power is the same on both sides, τ_m'q̇_m = τ_j'q̇_j. A is constant; a linkage is closed by ``robot.close`` instead.
    """

    name: str
    """Name of the coupling, as in the actuator file."""
    motors: tuple[str, ...]
    """The motors, in the order of the rows of A."""
    joints: tuple[str, ...]
    """The joints, in the order of the columns of A."""
    motor_per_joint: Array
    """A (n, n): velocity of each motor per velocity of each joint [rad/rad, sliding joints: rad/m]."""
    inverted: InitVar[bool] = False
    """True if the matrix given is A⁻¹: velocity of each joint, in the rows, per velocity of each motor."""

    def __post_init__(self, inverted: bool) -> None:
        A = np.array(self.motor_per_joint, float)
        n = len(self.joints)
        motor_count = len(self.motors)
        for names, kind in ((self.motors, "motor"), (self.joints, "joint")):
            repeated_names = [name for name, count in Counter(names).items() if count > 1]
            if repeated_names:
                raise ModelError(f"coupling {self.name!r} names {kind} {repeated_names[0]!r} twice. Name each once.")
        if n == 0 or motor_count != n or A.shape != (n, n):
            shape = " × ".join(map(str, A.shape))
            raise ModelError(
                f"coupling {self.name!r} has a matrix of {shape} for {motor_count} motors and {n} joints. It needs as many "
                f"motors as joints, and a square matrix."
            )
        is_possible = np.isfinite(A).all() and np.abs(A).max() <= MAX_DRIVE_NUMBER
        if not is_possible:
            raise ModelError(f"coupling {self.name!r} has the matrix {A.tolist()}; its numbers must be finite.")
        column_lengths = np.linalg.norm(A, axis=0)
        unit_columns = A / np.where(column_lengths > 0, column_lengths, 1.0)  # zero columns stay zero
        sigma = np.linalg.svd(unit_columns, compute_uv=False)
        rank = int((sigma > _MIN_SINGULAR_RATIO * sigma[0]).sum())
        if rank < n:
            raise ModelError(
                f"coupling {self.name!r} has a singular matrix, of rank {rank} for {n} joints: some motion on one side moves "
                "nothing on the other. Check its rows; no row may be a combination of others."
            )
        if inverted:
            A = np.linalg.inv(A)
        A.setflags(write=False)
        object.__setattr__(self, "motor_per_joint", A)

    @property
    def joint_per_motor(self) -> Array:
        """A⁻¹ (n, n): velocity of each joint per velocity of each motor."""
        return np.linalg.inv(self.motor_per_joint)

    def label(self, motor: str) -> str:
        """Motor with the joints that it loads: ``motor m5 (wrist_2_joint and wrist_3_joint)``."""
        row = self.motor_per_joint[self.motors.index(motor)]
        loaded_joints = [joint for joint, entry in zip(self.joints, row, strict=True) if entry]
        names = listed(loaded_joints)
        if len(loaded_joints) < 3:
            names = " and ".join(loaded_joints)
        return f"motor {motor} ({names})"


def with_couplings(model: Model, couplings: Iterable[Coupling]) -> Model:
    """Model with joints driven by coupled motors; armature, friction and effort of these joints are removed.

    Raises :class:`~twistwrench.ModelError` for joints with another drive, and for motors with the name of a joint.
    """
    new_couplings = tuple(couplings)
    all_couplings = (*model.couplings, *new_couplings)
    _check_one_coupling_each(all_couplings, "motor")
    _check_one_coupling_each(all_couplings, "joint")
    joint_names = {body.joint.name for body in model.bodies}
    coupled_indices: list[int] = []  # in dq
    coupled_joints: set[str] = set()
    for coupling in new_couplings:
        coupled_joints.update(coupling.joints)
        coupled_indices += [model.drive_index(joint) for joint in coupling.joints]
        ambiguous_motors = [motor for motor in coupling.motors if motor in joint_names]
        if ambiguous_motors:
            raise ModelError(
                f"motor {ambiguous_motors[0]!r} of coupling {coupling.name!r} has the name of a joint. Rename the motor."
            )
    for actuator in model.actuators.values():
        if actuator.joint in coupled_joints and actuator.rotor is not None:
            raise ModelError(
                f"joint {actuator.joint!r} has an actuator of its own and is in a coupling. Keep one of them."
            )
    model_without_drives = _without_drives(model, coupled_indices, coupled_joints)
    return replace(model_without_drives, couplings=all_couplings)


def _check_one_coupling_each(couplings: Iterable[Coupling], kind: str) -> None:
    """Raise ModelError if a motor or joint, selected by ``kind``, is in two couplings."""
    coupling_names: dict[str, str] = {}  # name of its coupling, by motor or joint
    for coupling in couplings:
        members = coupling.motors if kind == "motor" else coupling.joints
        for member in members:
            if member in coupling_names:
                raise ModelError(
                    f"{kind} {member!r} is in couplings {coupling_names[member]!r} and {coupling.name!r}. Each {kind} belongs "
                    "to one coupling."
                )
            coupling_names[member] = coupling.name


def without_couplings(model: Model) -> Model:
    """Model without coupled motors: their joints have no armature, friction and effort."""
    indices = np.flatnonzero(coupled_entries(model)).tolist()
    return replace(_without_drives(model, indices, set(model.coupled_motors)), couplings=())


def _without_drives(model: Model, indices: list[int], joints: set[str]) -> Model:
    """Model without armature, friction and effort at some indices of dq, and without actuators of the named ``joints``."""
    effort = model.limits.effort.copy()
    armature = model.armature.copy()
    friction = model.friction
    effort[indices] = np.inf
    armature[indices] = 0.0
    for k in indices:
        friction = friction.replaced(k, viscous=0.0, coulomb=0.0, static=0.0, stribeck=1.0, load=0.0)
    actuators = {name: actuator for name, actuator in model.actuators.items() if actuator.joint not in joints}
    limits = replace(model.limits, effort=effort)
    return replace(model, limits=limits, armature=armature, friction=friction, actuators=actuators)


def refuse_couplings(model: Model, what: str) -> None:
    """Raise ModelError if joints of the model are coupled; ``what`` names the function, which needs one joint per motor."""
    if model.couplings:
        joints: list[str] = []
        for coupling in model.couplings:
            joints += coupling.joints
        names = [coupling.name for coupling in model.couplings]
        raise ModelError(
            f"{what} does not support coupled drives, and {listed(joints)} of robot {model.name!r} are coupled "
            f"({listed(names)}). Use the robot without couplings:, or another actuator file."
        )


def refuse_coupled(model: Model, joints: Iterable[str], what: str) -> None:
    """Raise ModelError if one of these joints is coupled. ``what`` ends the message: "cannot be locked alone"."""
    for coupling in model.couplings:
        coupled_joints = [joint for joint in coupling.joints if joint in joints]
        if coupled_joints:
            raise ModelError(
                f"joint {coupled_joints[0]!r} is moved by motors {listed(coupling.motors)} together with the other joints of "
                f"coupling {coupling.name!r}, and {what}."
            )


def coupled_entries(model: Model) -> Array:
    """True for entries of dq that belong to coupled joints, (nv,): friction, armature and effort there belong to motors."""
    is_coupled = np.zeros(model.nv, bool)
    for indices, _, _ in model.coupled:
        is_coupled[indices] = True
    return is_coupled


def drive_turns(model: Model) -> list[bool]:
    """True for entries of dq (nv,) whose drive turns: entries of coupled motors, and of joints that turn."""
    joint_turns = [turns for body in model.leaders for turns in body.joint.turning]
    return np.logical_or(joint_turns, coupled_entries(model)).tolist()


def joint_effort(model: Model, effort: Array) -> Array:
    """Efforts (nv,) that limit single joints: infinite for coupled joints, whose entries limit motors."""
    return np.where(coupled_entries(model), np.inf, effort)


# ── Velocities and torques, of joints and of drives: (..., nv) numbers or symbols


def motor_velocities(model: Model, dq: Any) -> Any:
    """Velocities of the drives, A q̇; joints that are not coupled keep theirs."""
    return _block_products(model, dq, inverse=False, transposed=True)


def joint_velocities(model: Model, u: Any) -> Any:
    """Velocities of the joints from those of the drives, A⁻¹ q̇_m."""
    return _block_products(model, u, inverse=True, transposed=True)


def motor_torques(model: Model, tau: Any) -> Any:
    """Torques of the drives from those of the joints, A⁻ᵀ τ."""
    return _block_products(model, tau, inverse=True, transposed=False)


def joint_torques(model: Model, tau: Any) -> Any:
    """Torques of the joints from those of the drives, A'τ_m."""
    return _block_products(model, tau, inverse=False, transposed=False)


def _block_products(model: Model, x: Any, *, inverse: bool, transposed: bool) -> Any:
    """x with the entries of each coupling multiplied by a matrix B from the right: A, A', A⁻¹ or A⁻ᵀ.

    For a single x of shape (nv,), x B is B'x: so A gives A'x.
    """
    if not model.coupled:
        return x
    products = np.array(x)
    for indices, A, A_inverse in model.coupled:
        B = A_inverse if inverse else A
        if transposed:
            B = B.T
        products[..., indices] = products[..., indices] @ B
    return products


def armature_matrix(model: Model) -> Array:
    """Armature of the drives as inertia of the joints, A' diag(a) A; (nv, nv), diagonal where no joints are coupled."""
    inertia = np.diag(model.armature)
    for indices, A, _ in model.coupled:
        inertia[np.ix_(indices, indices)] = A.T @ (model.armature[indices, None] * A)
    return inertia
