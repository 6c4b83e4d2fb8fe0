"""Verification of a robot's dynamics by laws of mechanics, by the algorithms on floats, and by another library.

Residuals are relative by norm: the largest difference over the largest entry of the compared quantity, worst case over
all states. Numerical derivatives are accurate to about 1e-12 of the differentiated function.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.answers.answer import Answer
from ..core.errors import MissingExtraError, ModelError, ModelWarning, NotFoundError, RobotFileError, TwistWrenchError
from ..core.third_party import capture_stderr
from ..core.typing import Array
from ..core.verdict import Verdict, Word
from ..formats import format_of_file, load_model, usd_path
from ..formats.source import read_robot_text
from ..formats.xacro import xacro_in
from ..mechanics.algorithms.inverse_dynamics import closed_form
from ..mechanics.lie.adjoint import ad
from ..mechanics.model.assembly import ROOT_JOINT
from ..mechanics.model.couplings import refuse_couplings
from ..robot import Robot, load
from ..robot.convert import mujoco_rates, pinocchio_rates, to_mujoco, to_pinocchio
from ..robot.task_space_methods import require_robot
from . import State, derivative, derivative_along, random_state, relative_gap

if TYPE_CHECKING:
    from ..core.answers.blocks import Block

__all__ = ["Check", "VerifyReport", "verify"]

Residual = Callable[[Robot, State], float]


ROUNDING = 1e-10
"""Tolerance between two float64 computations: some thousand operations with errors of 1e-16, and a margin for cancellation."""
DIFFERENCES = 1e-9
"""Tolerance if one side is a numerical derivative."""


@dataclass(frozen=True)
class Check:
    """Check of a robot's dynamics: compared quantities, residual and tolerance."""

    name: str
    """Name of the check."""
    compares: str
    """Both sides of the comparison, as text."""
    residual: float = np.nan
    """Largest relative difference over all states."""
    tolerance: float = ROUNDING
    """Largest residual that passes."""
    skipped: str = ""
    """Reason for skipping the check; empty if it was made."""

    @property
    def passed(self) -> bool:
        """True if the check was made and agreed."""
        return not self.skipped and bool(self.residual <= self.tolerance)

    @property
    def failed(self) -> bool:
        """True if the check was made and disagreed; a residual of NaN disagrees."""
        return not self.skipped and not self.passed


@dataclass(frozen=True, eq=False, repr=False)
class VerifyReport(Answer):
    """Report of :func:`verify` on one robot: OK, or LOOK AGAIN if a check disagrees.

    Examples
    --------
    >>> import twistwrench as tw
    >>> tw.verify(tw.robots.planar_2r(), states=2).verdict.ok
    True
    """

    call = "verify"

    robot: str
    """Name of the robot."""
    states: int
    """Number of random states."""
    seed: int
    """Seed of the random states."""
    checks: tuple[Check, ...]
    """One entry per check."""

    @property
    def passed(self) -> bool:
        """True if no check failed; skipped checks do not count."""
        return not any(check.failed for check in self.checks)

    @property
    def verdict(self) -> Verdict:
        """OK, or LOOK AGAIN with the checks that disagree."""
        failed = [check.name for check in self.checks if check.failed]
        if failed:
            return Verdict(Word.LOOK_AGAIN, (f"checks that disagree: {', '.join(failed)}",))
        return Verdict(Word.OK)

    @property
    def robot_name(self) -> str:
        """Name of the robot."""
        return self.robot

    def blocks(self) -> Iterator[Block]:
        """Verdict, and a table of the checks.

        Returns
        -------
        blocks : iterator of Block
        """
        from .verify_view import verification_view

        return verification_view(self)


def verify(robot: Robot | str | Path, states: int = 4, seed: int = 0) -> VerifyReport:
    """Compare the robot's dynamics with independent formulas and, if installed, with Pinocchio or MuJoCo on its file.

    Parameters
    ----------
    robot : Robot, path of a robot file, or name of a known robot
    states : int
        Number of random states.
    seed : int
        Seed of the random states.

    Returns
    -------
    report : VerifyReport; skipped checks give their reason, and no check raises an error

    Examples
    --------
    >>> import twistwrench as tw
    >>> verify(tw.robots.planar_2r(), states=2).passed
    True
    """
    if isinstance(robot, str | Path):
        robot = load(robot)
    robot = require_robot(robot, "verify")
    rng = np.random.default_rng(seed)
    motions = [random_state(robot, rng) for _ in range(max(states, 1))]
    checks = [_check(robot, motions, *row) for row in _LAWS]
    for name, prepare in _PEERS:
        compares = f"inverse dynamics and mass matrix, {name}'s"
        try:  # loading makes rotations of nine digits exact; this is not a dynamics error
            checks.append(_check(robot, motions, name, compares, ROUNDING + 100.0 * file_gap(robot), prepare(robot)))
        except TwistWrenchError as problem:
            checks.append(Check(name, compares, skipped=str(problem)))
    return VerifyReport(robot.name, len(motions), seed, tuple(checks))


def _check(robot: Robot, motions: list[State], name: str, compares: str, tolerance: float, residual: Residual) -> Check:
    if robot.nv == 0:
        return Check(name, compares, skipped="the robot has no moving joints")
    try:
        worst = float(np.max([residual(robot, at) for at in motions]))
    except (TwistWrenchError, ArithmeticError, np.linalg.LinAlgError) as problem:
        return Check(name, compares, skipped=str(problem))
    return Check(name, compares, worst, tolerance)


# ── Laws of mechanics ──


def torque_size(robot: Robot, at: State, tau: Array) -> float:
    """Size of the terms that add up to τ, which determines the rounding error if they cancel.

    A single revolute or prismatic joint has c = 0, the difference of terms as large as M dq².
    """
    M = np.abs(robot.mass_matrix(at.q))
    products = M.max(initial=0.0) * float(np.max(np.abs(at.dq), initial=0.0)) ** 2
    return float(max(np.abs(tau).max(initial=0.0), (M @ np.abs(at.ddq)).max(initial=0.0), products))


def closed_form_gap(robot: Robot, at: State) -> float:
    """Gap between inverse dynamics and the block matrices of MR section 8.4."""
    tau = closed_form(robot.model, at.q, at.dq).inverse_dynamics(at.ddq)
    return relative_gap(robot.inverse_dynamics(*at), tau, torque_size(robot, at, tau))


def lagrange_gap(robot: Robot, at: State) -> float:
    """Gap between inverse dynamics and :func:`lagrange_torques`, relative to the larger of torques and energies."""
    tau = lagrange_torques(robot, at)
    return relative_gap(robot.inverse_dynamics(*at), tau, max(float(np.abs(tau).max()), _energies(robot, at)))


def lagrange_torques(robot: Robot, at: State) -> Array:
    """Joint torques (nv,) from kinetic and potential energy only: Lagrange's equations, MR section 8.1.

    With p = ∂K/∂dq, which for the quadratic K is exactly K(dq + e) - K(dq) - K(e),

        τ = dp/dt - ∂(K - P)/∂q - [V, ·]' p,

    with derivatives by q along ``robot.add``. The last term accounts for velocities of planar and floating joints,
    which are not coordinate rates (Hamel, 1904); [V, ·] is the bracket of the joint's own twists.
    """
    q, dq, ddq = at
    unit = np.eye(robot.nv)

    def momenta(t: Array) -> Array:
        x, v = robot.add(q, np.multiply.outer(t, dq))[:, None], (dq + np.multiply.outer(t, ddq))[:, None]
        K = robot.kinetic_energy
        return np.asarray(K(x, v + unit) - K(x, v) - K(x, unit))

    def lagrangian(x: Array) -> Array:
        return np.asarray(robot.kinetic_energy(x, dq) - robot.potential_energy(x))

    p = momenta(np.zeros(1))[0]
    tau = derivative(momenta, _rate(dq)) - derivative_along(robot, lagrangian, q, unit)
    for body in robot.model.leaders:
        mine, axes = body.places[1], body.joint.axes
        if body.joint.nv > 1:
            bracket = np.array([axes @ (ad(dq[mine] @ axes) @ S) for S in axes])  # row a: [V, S_a] in the joint's axes
            tau[mine] -= bracket @ p[mine]
    return tau


def power_gap(robot: Robot, at: State) -> float:
    """Gap between the power of the joints and the rate of the energy, relative to the larger of powers and energies."""
    q, dq, ddq = at

    def energy(t: Array) -> Array:
        x = robot.add(q, np.multiply.outer(t, dq))
        return np.asarray(robot.kinetic_energy(x, dq + np.multiply.outer(t, ddq)) + robot.potential_energy(x))

    powers = robot.inverse_dynamics(*at) * dq
    size = max(float(np.abs(powers).max()), _energies(robot, at))
    return relative_gap(powers.sum(), derivative(energy, _rate(dq)), size)


def skewness_gap(robot: Robot, at: State) -> float:
    """Deviation of dM/dt - 2C from skew symmetry, dM/dt = C + C', relative to their entries and those of M."""
    M, C = robot.mass_matrix(at.q), robot.coriolis_matrix(at.q, at.dq)
    dM = derivative_along(robot, robot.mass_matrix, at.q, at.dq)
    return relative_gap(C + C.T, dM, float(max(np.abs(dM).max(), np.abs(C).max(), np.abs(M).max())))


def coriolis_gap(robot: Robot, at: State) -> float:
    """Gap between C dq and the velocity products of inverse dynamics, relative to the summands of C dq and to M dq²."""
    C = robot.coriolis_matrix(at.q, at.dq)
    at_rest = at._replace(ddq=np.zeros(robot.nv))
    return relative_gap(C @ at.dq, robot.coriolis_forces(at.q, at.dq), torque_size(robot, at_rest, C * at.dq))


def round_trip_gap(robot: Robot, at: State) -> float:
    """Gap of torques after forward and inverse dynamics; unlike M⁻¹, M q̈ is not large for nearly massless links."""
    tau = robot.inverse_dynamics(*at)
    ddq = robot.forward_dynamics(at.q, at.dq, tau)
    size = float(np.abs(robot.mass_matrix(at.q) * ddq).max() + np.abs(tau).max())
    return relative_gap(robot.inverse_dynamics(at.q, at.dq, ddq), tau, size)


def _compiled(robot: Robot, at: State) -> float:
    return _against(robot, at, robot.reference("inverse_dynamics", *at), robot.reference("mass_matrix", at.q))


def _against(robot: Robot, at: State, tau: Array, M: Array) -> float:
    size = torque_size(robot, at, tau)
    return max(relative_gap(robot.inverse_dynamics(*at), tau, size), relative_gap(robot.mass_matrix(at.q), M))


def _rate(dq: Array) -> float:
    return max(1.0, float(np.abs(dq).sum()))


def _energies(robot: Robot, at: State) -> float:
    return abs(float(robot.kinetic_energy(at.q, at.dq))) + abs(float(robot.potential_energy(at.q)))


_LAWS: tuple[tuple[str, str, float, Residual], ...] = (
    ("closed form", "inverse dynamics, block matrices of MR section 8.4", ROUNDING, closed_form_gap),
    ("energies", "inverse dynamics, Lagrange's equations from K and P", DIFFERENCES, lagrange_gap),
    ("power", "torques times velocities, rate of K + P", DIFFERENCES, power_gap),
    ("Ṁ − 2C skew", "Coriolis matrix, rate of the mass matrix", DIFFERENCES, skewness_gap),
    ("C dq = c", "Coriolis matrix, inverse dynamics", ROUNDING, coriolis_gap),
    ("forward∘inverse", "forward dynamics, inverse dynamics", ROUNDING, round_trip_gap),
    ("compiled", "kernels, the algorithms on plain floats", ROUNDING, _compiled),
)

# ── Other libraries ──


def _file_of(robot: Robot, library: str, kind: str) -> Path:
    """Path of the robot's file. Raises NotFoundError without one, RobotFileError if it is of another format."""
    path = Path(robot.model.source)
    if not robot.model.source or not path.is_file():
        raise NotFoundError(f"robot {robot.name!r} has no file that another library could read; load it from a path.")
    if _is_expanded(path):
        raise RobotFileError(f"{path.name} is xacro; with {library}, {kind.upper()} files are compared.")
    own_kind = format_of_file(path)
    if own_kind != kind:
        raise RobotFileError(f"{path.name} is {own_kind.upper()}; with {library}, {kind.upper()} files are compared.")
    return path


def _is_expanded(path: Path) -> bool:
    """True for a file that requires xacro."""
    return usd_path(path) is None and bool(xacro_in(read_robot_text(path)[0]))


def _floats(robot: Robot) -> bool:
    return any(body.joint.name == ROOT_JOINT for body in robot.model.bodies)


def file_gap(robot: Robot) -> float:
    """Largest deviation of the robot's parameters from its file, at most about 1e-9, since loading normalises rotations.

    Raises ModelError for a robot edited after loading, or loaded with locked joints or repaired inertias.
    """
    model = robot.model
    refuse_couplings(model, "comparison with the file")
    mimic = "follow" if any(body.follows for body in model.bodies) else "independent"
    if not model.source or not Path(model.source).is_file() or _is_expanded(Path(model.source)):
        return 0.0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        filed = load_model(
            Path(model.source), floating_base=_floats(robot) or None, mimic=mimic, inertia="accept", snap=0.0
        )
    if [b.joint.name for b in filed.bodies] != [b.joint.name for b in model.bodies]:
        raise ModelError("joints differ from those of the file: some are locked, or driven by actuators with rotors.")
    gaps = [0.0]
    for mine, theirs in zip(model.bodies, filed.bodies, strict=True):
        size = np.abs(theirs.inertia.parameters).max() or 1.0
        gaps.append(float(np.abs(mine.placement - theirs.placement).max()))
        gaps.append(float(np.abs(mine.inertia.parameters - theirs.inertia.parameters).max() / size))
    if max(gaps) > 1e-7:
        raise ModelError("numbers differ from those of the file: a payload is carried, or inertias were repaired.")
    return max(gaps)


def _pinocchio(robot: Robot) -> Residual:
    path = _file_of(robot, "Pinocchio", "urdf")
    try:
        import pinocchio
    except ImportError:
        raise MissingExtraError.from_extra("pin", "peers", "Comparing with Pinocchio") from None
    root = [pinocchio.JointModelFreeFlyer()] if _floats(robot) else []
    model = _read_by("Pinocchio", path, lambda: pinocchio.buildModelFromUrdf(str(path), *root))
    model.gravity.linear = robot.gravity
    data, P = model.createData(), pinocchio_rates(robot, model)

    def residual(robot: Robot, at: State) -> float:
        q, dq, ddq = to_pinocchio(robot, model, *at)
        M = np.triu(pinocchio.crba(model, data, q))  # crba fills only the upper triangle
        M = M + np.triu(M, 1).T
        return _against(robot, at, P.T @ pinocchio.rnea(model, data, q, dq, ddq), P.T @ M @ P)

    return residual


def _mujoco(robot: Robot) -> Residual:
    path = _file_of(robot, "MuJoCo", "mjcf")
    try:
        import mujoco
    except ImportError:
        raise MissingExtraError.from_extra("mujoco", "peers", "Comparing with MuJoCo") from None
    model = _read_by("MuJoCo", path, lambda: mujoco.MjModel.from_xml_path(str(path)))
    kept = ("mjDSBL_GRAVITY", "mjDSBL_EULERDAMP", "mjDSBL_SPRING")
    for name, flag in mujoco.mjtDisableBit.__members__.items():  # contacts, limits and friction are not compared
        if name not in kept:
            model.opt.disableflags |= int(flag.value)
    model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    model.opt.gravity[:] = robot.gravity
    model.opt.density = model.opt.viscosity = 0.0  # the file reader warns of fluids
    data, M = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    mujoco_rates(robot, model, robot.neutral)  # raises if the joints do not match

    def residual(robot: Robot, at: State) -> float:
        data.qpos[:], data.qvel[:], data.qacc[:] = to_mujoco(robot, model, *at)
        P = mujoco_rates(robot, model, at.q)
        mujoco.mj_inverse(model, data)
        mujoco.mj_fullM(model, data, M)
        return _against(robot, at, P.T @ data.qfrc_inverse, P.T @ M @ P)

    return residual


def _read_by(library: str, path: Path, read: Callable[[], Any]) -> Any:
    """Result of another library's reader; RobotFileError for any exception, with the text from standard error."""
    problem: Exception | None = None
    with capture_stderr() as written:
        try:
            return read()
        except Exception as raised:  # any exception of its parsers
            problem = raised
    more = f"; it wrote: {written}" if str(written) else ""
    raise RobotFileError(f"{library} does not read {path.name}: {' '.join(str(problem).split())[:200]}{more}")


_PEERS: tuple[tuple[str, Callable[[Robot], Residual]], ...] = (("Pinocchio", _pinocchio), ("MuJoCo", _mujoco))
