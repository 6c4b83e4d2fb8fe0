"""Every example in the docstrings of the book's package, version 1.1.1: the same input, the printed output, to its last digit.

Only numbers are taken from there. ``DIGITS`` is half a unit of the last decimal printed, and rounding of the input on top
where that is what was printed (1.57079632 for π/2, 1.6858 for a length).
"""

from __future__ import annotations

import numpy as np
import pytest

import twistwrench.modern_robotics as mr

PI = np.pi
R = [[0, 0, 1], [1, 0, 0], [0, 1, 0]]
T = [[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 3], [0, 0, 0, 1]]
SKEW = [[0, -3, 2], [3, 0, -1], [-2, 1, 0]]
TWIST = [[0, -3, 2, 4], [3, 0, -1, 5], [-2, 1, 0, 6], [0, 0, 0, 0]]
SCREW = [[0, 0, 0, 0], [0, 0, -1.57079632, 2.35619449], [0, 1.57079632, 0, 2.35619449], [0, 0, 0, 0]]
NEAR_R = [[0.675, 0.150, 0.720], [0.370, 0.771, -0.511], [-0.630, 0.619, 0.472]]
NEAR_T = [
    [0.675, 0.150, 0.720, 1.2],
    [0.370, 0.771, -0.511, 5.4],
    [-0.630, 0.619, 0.472, 3.6],
    [0.003, 0.002, 0.010, 0.9],
]
FAR_R = [[1.0, 0.0, 0.0], [0.0, 0.1, -0.95], [0.0, 1.0, 0.1]]
FAR_T = [[1.0, 0.0, 0.0, 1.2], [0.0, 0.1, -0.95, 1.5], [0.0, 1.0, 0.1, -0.9], [0.0, 0.0, 0.1, 0.98]]
PROJECTED = [
    [0.67901136, 0.14894516, 0.71885945],
    [0.37320708, 0.77319584, -0.51272279],
    [-0.63218672, 0.61642804, 0.46942137],
]

# Three joints: turning, sliding, and a helical one of pitch 0.1.
M = [[-1, 0, 0, 0], [0, 1, 0, 6], [0, 0, -1, 2], [0, 0, 0, 1]]
BLIST = np.array([[0, 0, -1, 2, 0, 0], [0, 0, 0, 0, 1, 0], [0, 0, 1, 0, 0, 0.1]]).T
SLIST = np.array([[0, 0, 1, 4, 0, 0], [0, 0, 0, 0, 1, 0], [0, 0, -1, -6, 0, -0.1]]).T
REACHED = [[0, 1, 0, -5], [1, 0, 0, 4], [0, 0, -1, 1.68584073], [0, 0, 0, 1]]
WANTED = [[0, 1, 0, -5], [1, 0, 0, 4], [0, 0, -1, 1.6858], [0, 0, 0, 1]]
ANGLES = [PI / 2.0, 3, PI]
FOUR = np.array([[0, 0, 1, 0, 0.2, 0.2], [1, 0, 0, 2, 0, 3], [0, 1, 0, 0, 2, 1], [1, 0, 0, 0.2, 0.3, 0.4]]).T
FOUR_ANGLES = [0.2, 1.1, 0.1, 1.2]

# The three-link robot, whose first screw is of length √2.
G = [0, 0, -9.8]
MLIST = [
    [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.089159], [0, 0, 0, 1]],
    [[0, 0, 1, 0.28], [0, 1, 0, 0.13585], [-1, 0, 0, 0], [0, 0, 0, 1]],
    [[1, 0, 0, 0], [0, 1, 0, -0.1197], [0, 0, 1, 0.395], [0, 0, 0, 1]],
    [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.14225], [0, 0, 0, 1]],
]
GLIST = [
    np.diag([0.010267, 0.010267, 0.00666, 3.7, 3.7, 3.7]),
    np.diag([0.22689, 0.22689, 0.0151074, 8.393, 8.393, 8.393]),
    np.diag([0.0494433, 0.0494433, 0.004095, 2.275, 2.275, 2.275]),
]
THREE = np.array([[1, 0, 1, 0, 1, 0], [0, 1, 0, -0.089, 0, 0], [0, 1, 0, -0.089, 0, 0.425]]).T
LISTS = MLIST, GLIST, THREE
Q, DQ, DDQ, ONES = [0.1, 0.1, 0.1], [0.1, 0.2, 0.3], [2, 1.5, 1], [1, 1, 1, 1, 1, 1]
MASSES = [
    [22.5433380, -0.307146754, -0.00718426391],
    [-0.307146754, 1.96850717, 0.432157368],
    [-0.00718426391, 0.432157368, 0.191630858],
]
CONTROL = ([0.2, 0.2, 0.2], G, *LISTS, [1.0, 1.0, 1.0], [2, 1.2, 2], [0.1, 0.1, 0.1], 1.3, 1.2, 1.1)

JOINTS_FROM, JOINTS_TO = [1, 0, 0, 1, 1, 0.2, 0, 1], [1.2, 0.5, 0.6, 1.1, 2, 2, 0.9, 1]
JOINTS = [
    [1, 0, 0, 1, 1, 0.2, 0, 1],
    [1.0208, 0.052, 0.0624, 1.0104, 1.104, 0.3872, 0.0936, 1],
    [1.0704, 0.176, 0.2112, 1.0352, 1.352, 0.8336, 0.3168, 1],
    [1.1296, 0.324, 0.3888, 1.0648, 1.648, 1.3664, 0.5832, 1],
    [1.1792, 0.448, 0.5376, 1.0896, 1.896, 1.8128, 0.8064, 1],
    [1.2, 0.5, 0.6, 1.1, 2, 2, 0.9, 1],
]
X_START = [[1, 0, 0, 1], [0, 1, 0, 0], [0, 0, 1, 1], [0, 0, 0, 1]]
X_END = [[0, 0, 1, 0.1], [1, 0, 0, 0], [0, 1, 0, 4.1], [0, 0, 0, 1]]
SCREWED = [
    X_START,
    [[0.904, -0.25, 0.346, 0.441], [0.346, 0.904, -0.25, 0.529], [-0.25, 0.346, 0.904, 1.601], [0, 0, 0, 1]],
    [[0.346, -0.25, 0.904, -0.117], [0.904, 0.346, -0.25, 0.473], [-0.25, 0.904, 0.346, 3.274], [0, 0, 0, 1]],
    X_END,
]
STRAIGHT = [
    X_START,
    [[0.937, -0.214, 0.277, 0.811], [0.277, 0.937, -0.214, 0], [-0.214, 0.277, 0.937, 1.651], [0, 0, 0, 1]],
    [[0.277, -0.214, 0.937, 0.289], [0.937, 0.277, -0.214, 0], [-0.214, 0.937, 0.277, 3.449], [0, 0, 0, 1]],
    X_END,
]

# name, arguments, what is printed, how near: half of the last decimal printed
EXAMPLES = [
    ("NearZero", (-1e-7,), True, 0),
    ("Normalize", ([1, 2, 3],), [0.26726124, 0.53452248, 0.80178373], 5e-9),
    ("RotInv", (R,), [[0, 1, 0], [0, 0, 1], [1, 0, 0]], 0),
    ("VecToso3", ([1, 2, 3],), SKEW, 0),
    ("so3ToVec", (SKEW,), [1, 2, 3], 0),
    ("AxisAng3", ([1, 2, 3],), ([0.26726124, 0.53452248, 0.80178373], 3.7416573867739413), 5e-9),
    ("MatrixExp3", (SKEW,), [[-0.69492056, 0.71352099, 0.08929286], [-0.19200697, -0.30378504, 0.93319235], [0.69297817, 0.6313497, 0.34810748]], 5e-9),
    ("MatrixLog3", (R,), [[0, -1.20919958, 1.20919958], [1.20919958, 0, -1.20919958], [-1.20919958, 1.20919958, 0]], 5e-9),
    ("RpToTrans", ([[1, 0, 0], [0, 0, -1], [0, 1, 0]], [1, 2, 5]), [[1, 0, 0, 1], [0, 0, -1, 2], [0, 1, 0, 5], [0, 0, 0, 1]], 0),
    ("TransToRp", (T,), ([[1, 0, 0], [0, 0, -1], [0, 1, 0]], [0, 0, 3]), 0),
    ("TransInv", (T,), [[1, 0, 0, 0], [0, 0, 1, -3], [0, -1, 0, 0], [0, 0, 0, 1]], 0),
    ("VecTose3", ([1, 2, 3, 4, 5, 6],), TWIST, 0),
    ("se3ToVec", (TWIST,), [1, 2, 3, 4, 5, 6], 0),
    ("Adjoint", (T,), [[1, 0, 0, 0, 0, 0], [0, 0, -1, 0, 0, 0], [0, 1, 0, 0, 0, 0], [0, 0, 3, 1, 0, 0], [3, 0, 0, 0, 0, -1], [0, 0, 0, 0, 1, 0]], 0),
    ("ScrewToAxis", ([3, 0, 0], [0, 0, 1], 2), [0, 0, 1, 0, -3, 2], 0),
    ("AxisAng6", ([1, 0, 0, 1, 2, 3],), ([1.0, 0.0, 0.0, 1.0, 2.0, 3.0], 1.0), 0),
    ("MatrixExp6", (SCREW,), [[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 3], [0, 0, 0, 1]], 2e-8),  # π/2 given with eight decimals, 3 m away
    ("MatrixLog6", (T,), [[0, 0, 0, 0], [0, 0, -1.57079633, 2.35619449], [0, 1.57079633, 0, 2.35619449], [0, 0, 0, 0]], 5e-9),
    ("ProjectToSO3", (NEAR_R,), PROJECTED, 5e-9),
    ("ProjectToSE3", (NEAR_T,), [[*PROJECTED[0], 1.2], [*PROJECTED[1], 5.4], [*PROJECTED[2], 3.6], [0, 0, 0, 1]], 5e-9),
    ("DistanceToSO3", (FAR_R,), 0.08835, 5e-6),
    ("DistanceToSE3", (FAR_T,), 0.134931, 5e-7),
    ("TestIfSO3", (FAR_R,), False, 0),
    ("TestIfSE3", (FAR_T,), False, 0),
    ("FKinBody", (M, BLIST, ANGLES), REACHED, 5e-9),
    ("FKinSpace", (M, SLIST, ANGLES), REACHED, 5e-9),
    ("JacobianBody", (FOUR, FOUR_ANGLES), [[-0.04528405, 0.99500417, 0, 1], [0.74359313, 0.09304865, 0.36235775, 0], [-0.66709716, 0.03617541, -0.93203909, 0], [2.32586047, 1.66809, 0.56410831, 0.2], [-1.44321167, 2.94561275, 1.43306521, 0.3], [-2.06639565, 1.82881722, -1.58868628, 0.4]], 5e-9),
    ("JacobianSpace", (FOUR, FOUR_ANGLES), [[0, 0.98006658, -0.09011564, 0.95749426], [0, 0.19866933, 0.4445544, 0.28487557], [1, 0, 0.89120736, -0.04528405], [0, 1.95218638, -2.21635216, -0.51161537], [0.2, 0.43654132, -2.43712573, 2.77535713], [0.2, 2.96026613, 3.23573065, 2.22512443]], 5e-9),
    ("IKinBody", (BLIST, M, WANTED, [1.5, 2.5, 3], 0.01, 0.001), ([1.57073819, 2.999667, 3.14153913], True), 5e-9),
    ("IKinSpace", (SLIST, M, WANTED, [1.5, 2.5, 3], 0.01, 0.001), ([1.57073783, 2.99966384, 3.1415342], True), 5e-9),
    ("ad", ([1, 2, 3, 4, 5, 6],), [[0, -3, 2, 0, 0, 0], [3, 0, -1, 0, 0, 0], [-2, 1, 0, 0, 0, 0], [0, -6, 5, 0, -3, 2], [6, 0, -4, 3, 0, -1], [-5, 4, 0, -2, 1, 0]], 0),
    ("InverseDynamics", (Q, DQ, DDQ, G, ONES, *LISTS), [74.69616155, -33.06766016, -3.23057314], 5e-9),
    ("MassMatrix", (Q, *LISTS), MASSES, 5e-8),  # nine figures of 22.5
    ("VelQuadraticForces", (Q, DQ, *LISTS), [0.26453118, -0.05505157, -0.00689132], 5e-9),
    ("GravityForces", (Q, G, *LISTS), [28.40331262, -37.64094817, -5.4415892], 5e-9),
    ("EndEffectorForces", (Q, ONES, *LISTS), [1.40954608, 1.85771497, 1.392409], 5e-9),
    ("ForwardDynamics", (Q, DQ, [0.5, 0.6, 0.7], G, ONES, *LISTS), [-0.97392907, 25.58466784, -32.91499212], 5e-9),
    ("EulerStep", (Q, DQ, DDQ, 0.1), ([0.11, 0.12, 0.13], [0.3, 0.35, 0.4]), 1e-15),
    ("CubicTimeScaling", (2, 0.6), 0.216, 1e-15),
    ("QuinticTimeScaling", (2, 0.6), 0.16308, 1e-15),
    ("JointTrajectory", (JOINTS_FROM, JOINTS_TO, 4, 6, 3), JOINTS, 1e-15),
    ("ScrewTrajectory", (X_START, X_END, 5, 4, 3), SCREWED, 5e-4),
    ("CartesianTrajectory", (X_START, X_END, 5, 4, 5), STRAIGHT, 5e-4),
    ("ComputedTorque", (Q, DQ, *CONTROL), [133.00525246, -29.94223324, -3.03276856], 5e-9),
]  # fmt: skip

SHOWN_LATER = {
    "InverseDynamicsTrajectory",
    "ForwardDynamicsTrajectory",
    "SimulateControl",
}  # they print no numbers, or long ones


def same(found, printed, near) -> None:
    if isinstance(printed, tuple):
        assert isinstance(found, tuple)
        assert len(found) == len(printed)
        for f, p in zip(found, printed, strict=True):
            same(f, p, near)
    else:
        assert np.shape(found) == np.shape(printed)
        # 2e-15: printed halves of a digit, and the last bits of numbers near 6
        assert np.abs(np.asarray(found, float) - np.asarray(printed, float)).max() <= near + 2e-15


@pytest.mark.parametrize(("name", "arguments", "printed", "near"), EXAMPLES, ids=[e[0] for e in EXAMPLES])
def test_examples_of_the_books_package_come_out_to_the_printed_digits(name, arguments, printed, near):
    same(getattr(mr, name)(*arguments), printed, near)
    lists_too = tuple(x.tolist() if isinstance(x, np.ndarray) else x for x in arguments)
    same(getattr(mr, name)(*lists_too), printed, near)


def test_no_function_is_without_its_example():
    assert {name for name, *_ in EXAMPLES} | SHOWN_LATER == set(mr.__all__)


TORQUES = [
    [3.63, -6.58, -5.57], [3.74, -5.55, -5.5], [4.31, -0.68, -5.19], [5.18, 5.63, -4.31], [5.85, 8.17, -2.59],
    [5.78, 2.79, -1.7], [4.99, -5.3, -1.19], [4.08, -9.41, 0.07], [3.56, -10.1, 0.97], [3.49, -9.41, 1.23],
]  # fmt: skip


def test_motion_under_the_ten_rows_of_torque():
    """The last row, as the package prints it when its example is run; seven decimals."""
    theta, dtheta = mr.ForwardDynamicsTrajectory(Q, DQ, TORQUES, G, np.ones((10, 6)), *LISTS, 0.1, 8)
    assert theta.shape == dtheta.shape == (10, 3)
    assert theta[0].tolist() == Q
    assert dtheta[0].tolist() == DQ
    # The motion amplifies rounding, 1e-16, by no more than a million in 72 steps.
    assert np.abs(theta[-1] - [-0.4638099, 3.6317879, -7.6319005]).max() <= 5e-8 + 1e-10
    assert np.abs(dtheta[-1] - [-0.1455669, -4.5714998, -3.4313511]).max() <= 5e-8 + 1e-10


def wanted_motion(start, end, Tf, N):
    """A quintic motion and its differences, as the package's long examples make them."""
    theta = mr.JointTrajectory(start, end, Tf, N, 5)
    step = Tf / (N - 1.0)
    dtheta, ddtheta = np.zeros((N, 3)), np.zeros((N, 3))
    dtheta[1:] = np.diff(theta, axis=0) / step
    ddtheta[1:] = np.diff(dtheta, axis=0) / step
    return theta, dtheta, ddtheta, step


def long_examples():
    """Name and arguments of the two examples that print curves rather than numbers."""
    theta, dtheta, ddtheta, _ = wanted_motion([0, 0, 0], [PI / 2] * 3, 3, 1000)
    yield "InverseDynamicsTrajectory", (theta, dtheta, ddtheta, G, np.ones((1000, 6)), *LISTS)
    theta, dtheta, ddtheta, step = wanted_motion(Q, [PI / 2, PI, 1.5 * PI], 1, 100)
    wrong_M = np.array(MLIST, float)
    wrong_M[:, :3, 3] = [[0, 0, 0.1], [0.3, 0.2, 0], [0, -0.2, 0.4], [0, 0, 0.2]]
    wrong_G = [np.diag(d) for d in ([0.1, 0.1, 0.1, 4, 4, 4], [0.3, 0.3, 0.1, 9, 9, 9], [0.1, 0.1, 0.1, 3, 3, 3])]
    model = [0.8, 0.2, -8.8], wrong_M, wrong_G
    yield "SimulateControl", (Q, DQ, G, np.ones((100, 6)), *LISTS, theta, dtheta, ddtheta, *model, 20, 10, 18, step, 8)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "arguments"), [pytest.param(*e, id=e[0]) for e in long_examples()])
def test_long_examples_equal_what_the_package_computes(name, arguments, monkeypatch):
    book = pytest.importorskip("modern_robotics", reason="the book's package is not installed")
    monkeypatch.setitem(__import__("sys").modules, "matplotlib.pyplot", None)  # its plot would open a window
    ours, theirs = np.array(getattr(mr, name)(*arguments)), np.array(getattr(book, name)(*arguments))
    assert ours.shape == theirs.shape
    if (
        name == "InverseDynamicsTrajectory"
    ):  # its first rows turn by less than 1e-6 rad, which the package takes for nothing
        tiny = np.abs(arguments[0][:, 0]) * np.sqrt(2) < 1.01e-6
        assert 1e-6 < np.abs(ours - theirs)[tiny].max() < 1e-4  # 90 N m / rad, times the angle left out
        ours, theirs = ours[~tiny], theirs[~tiny]
    # 800 Euler steps of a stiffly controlled arm: rounding does not grow, for the controller pulls errors in.
    assert np.abs(ours - theirs).max() <= 1e-9 * np.abs(theirs).max()
