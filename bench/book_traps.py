"""Where the book's package loses digits: inputs with an answer known to 50 digits or exactly, and how far off a package is.

`run(package)` is the error of one package, in the unit named; NaN where it gives none. `ours` is the most that ours may be off,
`theirs` the least that theirs is: the tests hold both to it.
"""

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import mpmath
import numpy as np

TINY = 9e-7  # just under the 1e-6 that the package takes for zero
AXIS = np.array([0.6, -0.48, 0.64])  # of unit length
AXES = [AXIS, *(v / np.linalg.norm(v) for v in np.random.default_rng(3).standard_normal((9, 3)))]
DIGITS = 50


@dataclass(frozen=True)
class Trap:
    function: str
    what: str
    unit: str
    run: Callable[[Any], float]
    ours: float
    theirs: float

    def error(self, package: Any) -> float:
        """The error of a package; NaN also where it raises."""
        with warnings.catch_warnings(), np.errstate(all="ignore"), mpmath.workdps(DIGITS):
            warnings.simplefilter("ignore")
            try:
                return float(self.run(package))
            except (ArithmeticError, IndexError):
                return math.nan


def hat(w: Any) -> Any:
    x, y, z = (mpmath.mpf(float(c)) for c in w)
    return mpmath.matrix([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def hat6(V: Any) -> Any:
    X = mpmath.zeros(4)
    X[:3, :3] = hat(V[:3])
    X[:3, 3] = mpmath.matrix([mpmath.mpf(float(c)) for c in V[3:]])
    return X


def exact(X: Any) -> Any:
    """The exponential in 50 digits."""
    return mpmath.expm(X, method="taylor")


def rounded(X: Any) -> np.ndarray:
    return np.array(X.tolist(), float)


def off(found: Any, truth: Any) -> float:
    """The largest difference of an entry, taken in 50 digits."""
    found = np.asarray(found, float).reshape(truth.rows, truth.cols)
    return max(
        (abs(mpmath.mpf(float(found[i, j])) - truth[i, j]) for i in range(truth.rows) for j in range(truth.cols)),
        key=lambda x: math.inf if mpmath.isnan(x) else x,
    )


# ── exponentials and logarithms ──


def exp3(angle: float) -> Callable[[Any], float]:
    return lambda p: off(p.MatrixExp3(rounded(hat(angle * AXIS))), exact(hat(angle * AXIS)))


def exp6(angle: float) -> Callable[[Any], float]:
    V = np.r_[angle * AXIS, 0.0, 1.0, 0.0]
    return lambda p: off(p.MatrixExp6(rounded(hat6(V))), exact(hat6(V)))


def log3(angle: float) -> Callable[[Any], float]:
    return lambda p: max(off(p.MatrixLog3(rounded(exact(hat(angle * axis)))), hat(angle * axis)) for axis in AXES)


def log6(angle: float) -> Callable[[Any], float]:
    motions = [np.r_[angle * axis, 0.3, -0.2, 0.5] for axis in AXES]
    return lambda p: max(off(p.MatrixLog6(rounded(exact(hat6(V)))), hat6(V)) for V in motions)


def half_turn(p: Any) -> float:
    """A half turn whose trace rounds to less than -1: 1 + 2 cos θ has no arc cosine then."""
    R = np.diag([-1.0, -1.0, 1.0])
    R[0, 0] = R[1, 1] = np.nextafter(-1.0, -2.0)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, [0.1, 0.2, 0.3]
    X = np.asarray(p.MatrixLog6(T))
    return np.abs(np.abs(X[[1, 0], [0, 1]]) - np.pi).max() if np.isfinite(X).all() else math.nan


def unit_screw(p: Any) -> float:
    S, _ = p.AxisAng6(np.r_[TINY * AXIS, 0.0, 1.0, 0.0])
    return abs(np.linalg.norm(S[:3]) - 1.0)


def no_travel(p: Any) -> float:
    return np.abs(p.AxisAng6(np.r_[TINY * AXIS, 0.0, 0.0, 0.0])[0][:3] - AXIS).max()


def reflected(p: Any) -> float:
    """How much further than the nearest rotation the projection of a matrix with a negative determinant is."""
    mat = np.diag([0.1, 1.0, -1.0])
    return np.linalg.norm(p.ProjectToSO3(mat) - mat) - 1.1


def short(p: Any) -> float:
    return np.abs(p.Normalize(1e-200 * AXIS) - AXIS).max()


# ── chains ──

SCREW = np.array([[0.0, 0.0, 1.0, 0.0, -2.0, 0.0]]).T  # turning about a vertical line 2 m away
AWAY = np.array([[1.0, 0, 0, 1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])  # the tip, 1 m from that line
HANGING = np.array([[0.0, 1.0, 0.0, 0.0, 0.0, 0.0]]).T
BOB = np.diag([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])
POINT = [np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, -1.0], [0, 0, 0, 1]]), np.eye(4)]  # 1 kg, 1 m below the axis
GRAVITY = [0.0, 0.0, -10.0]


def reach(p: Any) -> float:
    return off(p.FKinSpace(AWAY, SCREW, [TINY]), exact(hat6(SCREW[:, 0]) * mpmath.mpf(TINY)) * mpmath.matrix(AWAY))


def slope(p: Any) -> float:
    """The speed of the tip by central differences of 1e-6 rad, against 1 m/rad."""
    T = [np.asarray(p.FKinSpace(AWAY, SCREW, [h])) for h in (-5e-7, 5e-7)]
    return abs((T[1] - T[0])[1, 3] / 1e-6 + 1.0)


def column(p: Any) -> float:
    """The second column of the space Jacobian, Ad(exp([S] θ)) S₂, for a second axis across the first."""
    S2 = np.array([1.0, 0, 0, 0, 0, 0])
    J = np.asarray(p.JacobianSpace(np.c_[SCREW[:, 0], S2], [TINY, 0.0]))
    T = exact(hat6(SCREW[:, 0]) * mpmath.mpf(TINY))
    R, t = T[:3, :3], T[:3, 3]
    w = R * mpmath.matrix([1, 0, 0])
    v = mpmath.matrix([t[1] * w[2] - t[2] * w[1], t[2] * w[0] - t[0] * w[2], t[0] * w[1] - t[1] * w[0]])
    return off(J[:, 1], mpmath.matrix([*w, *v]))


def pendulum(p: Any) -> float:
    """m g l sin θ of a hanging pendulum, relative."""
    tau = p.GravityForces([TINY], GRAVITY, POINT, [BOB], HANGING)[0]
    truth = 10 * mpmath.sin(mpmath.mpf(TINY))
    return abs(mpmath.mpf(float(tau)) / truth - 1)


def converged(p: Any) -> float:
    """The turn that is left where success is reported for eomg = 1e-12 rad."""
    axis = np.array([[0.0, 0.0, 1.0, 0.0, 0.0, 0.0]]).T
    wanted = rounded(exact(hat6(axis[:, 0]) * mpmath.mpf("0.7")))
    theta, success = p.IKinBody(axis, np.eye(4), wanted, [0.7 + 1e-8], 1e-12, 1e-3)
    return abs(theta[0] - 0.7) if success else math.nan


def residual(p: Any) -> float:
    """|M q̈ - τ| over |M| |q̈| with the exact M, in eps: what solving adds, whatever the condition.

    Two links turn about one line, the first with 1.3e-10 kg m², the second with 0.7; τ is what x = (1/3, 0.7) takes.
    """
    S, (near, far) = np.array([[0, 0, 1, 0, 0, 0]] * 2, float).T, (1.3e-10, 0.7)
    G = [np.diag([i, i, i, 1.0, 1.0, 1.0]) for i in (near, far)]
    tau = [float(mpmath.mpf(far) * (mpmath.mpf(1) / 3 + 0.7) + mpmath.mpf(near) * k) for k in (mpmath.mpf(1) / 3, 0)]
    ddq = p.ForwardDynamics([0.2, 0.4], [0.0, 0.0], tau, [0, 0, 0], np.zeros(6), [np.eye(4)] * 3, G, S)
    M = mpmath.matrix([[mpmath.mpf(near) + mpmath.mpf(far), far], [far, far]])
    x = mpmath.matrix([mpmath.mpf(float(a)) for a in ddq])
    r = M * x - mpmath.matrix([mpmath.mpf(t) for t in tau])
    return mpmath.norm(r, mpmath.inf) / (mpmath.mnorm(M, mpmath.inf) * mpmath.norm(x, mpmath.inf)) / np.finfo(float).eps


def asymmetry(p: Any) -> float:
    """The largest of |M - M'| over the largest entry, in eps, over some configurations of a chain of six."""
    rng = np.random.default_rng(0)
    steps = [rounded(exact(hat6(0.7 * rng.standard_normal(6)))) for _ in range(7)]
    S, G = rng.standard_normal((6, 6)), [np.diag([0.2, 0.3, 0.4, 2.0, 2.0, 2.0])] * 6
    masses = [np.asarray(p.MassMatrix(q, steps, G, S)) for q in rng.uniform(0.2, 2.0, (8, 6))]
    return max(np.abs(M - M.T).max() / np.abs(M).max() for M in masses) / np.finfo(float).eps


def whole_numbers(p: Any) -> float:
    """Torques along a motion given in whole numbers, against the same motion in floats."""
    q = np.array([[1], [2]])
    tau = [p.InverseDynamicsTrajectory(x, x, x, GRAVITY, np.zeros((2, 6)), POINT, [BOB], HANGING) for x in (q, 1.0 * q)]
    return np.abs(tau[0] - tau[1]).max()


def no_wrench(p: Any) -> float:
    """Ftipmat = 0, as the docstring offers it."""
    q = np.ones((2, 1))
    tau = p.InverseDynamicsTrajectory(q, 0 * q, 0 * q, GRAVITY, 0, POINT, [BOB], HANGING)
    return np.abs(tau - 10 * np.sin(1.0)).max()


@cache
def nearly_half_turns() -> list[Any]:
    """Poses, one for each axis."""
    return [rounded(exact(hat6(np.r_[(np.pi - 2e-8) * axis, 0.3, -0.2, 0.5]))) for axis in AXES]


def arrival(function: str) -> Callable[[Any], float]:
    """How far the last pose of a motion through nearly half a turn is from where it should end."""
    return lambda p: max(
        np.abs(getattr(p, function)(np.eye(4), X, 1.0, 5, 5)[-1] - X).max() for X in nearly_half_turns()
    )


TRAPS = (
    Trap("MatrixExp3", "turning 9e-7 rad", "entry", exp3(TINY), 3e-16, 5e-7),
    Trap("MatrixLog3", "turning 1e-8 rad", "rad", log3(1e-8), 1e-15, 6e-9),
    Trap("MatrixLog3", "π - 1e-6 rad", "rad", log3(math.pi - 1e-6), 2e-15, 1e-5),
    Trap("MatrixLog3", "π - 2e-8 rad", "rad", log3(math.pi - 2e-8), 2e-15, 0.1),
    Trap("MatrixExp6", "turning 9e-7 rad", "entry", exp6(TINY), 3e-16, 5e-7),
    Trap("MatrixLog6", "π - 2e-8 rad", "entry", log6(math.pi - 2e-8), 3e-15, 0.1),
    Trap("MatrixLog6", "a half turn, trace -1 - 4e-16", "rad", half_turn, 1e-15, math.inf),
    Trap("AxisAng6", "ω of 9e-7 beside v of 1: the length of ω in S", "1", unit_screw, 1e-15, 0.9),
    Trap("AxisAng6", "ω of 9e-7, v zero", "1", no_travel, 1e-15, math.inf),
    Trap("ProjectToSO3", "a reflection: further than the nearest", "1", reflected, 1e-15, 0.9),
    Trap("Normalize", "a vector of length 1e-200", "1", short, 1e-15, math.inf),
    Trap("FKinSpace", "a joint at 9e-7 rad, the tip 1 m away", "m", reach, 1e-15, 5e-7),
    Trap("FKinSpace", "speed by differences of 1e-6 rad", "m/rad", slope, 1e-9, 0.9),
    Trap("JacobianSpace", "a joint at 9e-7 rad", "m", column, 1e-15, 5e-7),
    Trap("IKinBody", "turn left at success, eomg = 1e-12", "rad", converged, 1e-12, 9e-9),
    Trap("GravityForces", "a pendulum at 9e-7 rad", "relative", pendulum, 1e-15, 0.9),
    Trap("MassMatrix", "M - M', six joints", "eps", asymmetry, 0.0, 0.4),
    Trap("ForwardDynamics", "M q̈ - τ, condition 2e10", "eps", residual, 4.0, 1e5),
    Trap("InverseDynamicsTrajectory", "a motion in whole numbers", "N m", whole_numbers, 0.0, 0.01),
    Trap("InverseDynamicsTrajectory", "Ftipmat = 0, as documented", "N m", no_wrench, 1e-14, math.inf),
    Trap("ScrewTrajectory", "the end, π - 2e-8 rad on", "entry", arrival("ScrewTrajectory"), 3e-15, 0.1),
    Trap("CartesianTrajectory", "the end, π - 2e-8 rad on", "entry", arrival("CartesianTrajectory"), 3e-15, 0.1),
)
"""In the order of the book. `theirs` of infinity: no finite answer at all."""
