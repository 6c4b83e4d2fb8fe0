"""``twistwrench.modern_robotics`` and the book's own package: the same names, arguments, shapes, and numbers away from its traps.

Tolerances: AGREE is 1e-12 of the largest entry. On random input the two differ by rounding, 1e-14 or so, and theirs loses some
digits where angles are small or near π, which random input rarely meets and the strategies here keep away from.
"""

from __future__ import annotations

import functools
import inspect
import warnings

import numpy as np
import pytest

import twistwrench as tw
import twistwrench.modern_robotics as mr
from twistwrench.modern_robotics import chains

AGREE = 1e-12
SEEDS = range(12)
MANY = range(12, 225)


@pytest.fixture(scope="module")
def book():
    return pytest.importorskip("modern_robotics", reason="the book's package is not installed")


def rotation(rng, least=0.1, most=3.0):
    w = rng.standard_normal(3)
    return tw.so3.exp(w / np.linalg.norm(w) * rng.uniform(least, most))


def pose(rng, **angle):
    return tw.se3.pose(rotation(rng, **angle), rng.standard_normal(3))


def two_poses(rng):
    """Poses from one of which to the other is a turn by at most 3 rad."""
    X = pose(rng)
    return X, X @ pose(rng)


def axes(rng, n):
    """Turning, sliding and helical axes, unit ones."""
    S = rng.standard_normal((6, n))
    S[:, rng.integers(n)][:3] = 0.0
    S /= np.where(np.any(S[:3], axis=0), np.linalg.norm(S[:3], axis=0), np.linalg.norm(S[3:], axis=0))
    return S


@functools.cache
def chain(n, seed):
    """Poses, inertias of physically consistent bodies, screws."""
    rng = np.random.default_rng([n, seed])
    steps = [pose(rng) for _ in range(n + 1)]
    points = [(rng.uniform(0.1, 1, 6), rng.standard_normal((6, 3))) for _ in range(n)]
    return steps, [tw.SpatialInertia.from_points(*p).matrix for p in points], axes(rng, n)


def lists(rng, n):
    """A random chain, one of three of n joints, which are compiled once."""
    steps, inertias, S = chain(n, int(rng.integers(3)))
    return [*steps], [G.copy() for G in inertias], S.copy()


def screws(rng, n):
    return lists(rng, n)[2]


def joints(rng, n):
    """Joint vectors whose entries are not tiny angles."""
    return rng.uniform(0.1, 2.0, n) * rng.choice([-1.0, 1.0], n)


def near(rng, M):
    return M + 0.02 * rng.standard_normal(M.shape)


def reach(rng, frame):
    """Inverse kinematics from half a degree away, of six general screws."""
    S, M, q = screws(rng, 6), pose(rng), joints(rng, 6)
    T = (mr.FKinBody if frame == "body" else mr.FKinSpace)(M, S, q)
    return S, M, T, q + 0.01 * rng.standard_normal(6), 1e-3, 1e-3


def motion(rng, n, N=7):
    return rng.uniform(0.1, 2.0, (N, n)), rng.standard_normal((N, n)), rng.standard_normal((N, n))


def control(rng, n=4):
    steps, inertias, S = lists(rng, n)
    model = lists(rng, n)[:2]
    q, dq, g = joints(rng, n), rng.standard_normal(n), rng.standard_normal(3)
    # Short and gentle: random chains thrash about, and thrashing amplifies rounding.
    return (
        q,
        dq,
        g,
        rng.standard_normal((4, 6)),
        steps,
        inertias,
        S,
        *motion(rng, n, 4),
        g + np.array([0.3, -0.2, 0.1]),  # what the controller believes, as it does in the next two
        *model,
        2.0,
        1.0,
        1.5,
        1e-3,
        2,
    )


def chapter_eight(*vectors):
    def arguments(rng):
        n = int(rng.integers(1, 7))
        given = {"g": rng.standard_normal(3), "F": rng.standard_normal(6), "q": joints(rng, n)}
        return [given.get(v, rng.standard_normal(n)) for v in vectors] + list(lists(rng, n))

    return arguments


ARGUMENTS = {
    "Adjoint": lambda rng: [pose(rng)],
    "AxisAng3": lambda rng: [rng.standard_normal(3)],
    "AxisAng6": lambda rng: [rng.standard_normal(6)],
    "CartesianTrajectory": lambda rng: [*two_poses(rng), 3.0, 5, int(rng.choice([3, 5]))],
    "ComputedTorque": lambda rng: (
        lambda n: [*(joints(rng, n) for _ in range(3)), rng.standard_normal(3), *lists(rng, n), *rng.standard_normal((3, n)), 1.3, 1.2, 1.1]
    )(4),
    "CubicTimeScaling": lambda rng: [2.5, float(rng.uniform(0, 2.5))],
    "DistanceToSE3": lambda rng: [near(rng, pose(rng))],
    "DistanceToSO3": lambda rng: [near(rng, rotation(rng))],
    "EndEffectorForces": chapter_eight("q", "F"),
    "EulerStep": lambda rng: [*rng.standard_normal((3, 5)), 0.01],
    "FKinBody": lambda rng: [pose(rng), screws(rng, 5), joints(rng, 5)],
    "FKinSpace": lambda rng: [pose(rng), screws(rng, 5), joints(rng, 5)],
    "ForwardDynamics": chapter_eight("q", "dq", "tau", "g", "F"),
    "ForwardDynamicsTrajectory": lambda rng: [
        joints(rng, 3), rng.standard_normal(3), rng.standard_normal((4, 3)), rng.standard_normal(3), rng.standard_normal((4, 6)), *lists(rng, 3), 1e-3, 2
    ],
    "GravityForces": chapter_eight("q", "g"),
    "IKinBody": lambda rng: reach(rng, "body"),
    "IKinSpace": lambda rng: reach(rng, "space"),
    "InverseDynamics": chapter_eight("q", "dq", "ddq", "g", "F"),
    "InverseDynamicsTrajectory": lambda rng: [*motion(rng, 4), rng.standard_normal(3), rng.standard_normal((7, 6)), *lists(rng, 4)],
    "JacobianBody": lambda rng: [screws(rng, 5), joints(rng, 5)],
    "JacobianSpace": lambda rng: [screws(rng, 5), joints(rng, 5)],
    "JointTrajectory": lambda rng: [*rng.standard_normal((2, 4)), 3.0, 6.0, int(rng.choice([3, 5]))],
    "MassMatrix": chapter_eight("q"),
    "MatrixExp3": lambda rng: [tw.so3.hat(rng.standard_normal(3))],
    "MatrixExp6": lambda rng: [tw.se3.hat(rng.standard_normal(6))],
    "MatrixLog3": lambda rng: [rotation(rng)],
    "MatrixLog6": lambda rng: [pose(rng)],
    "NearZero": lambda rng: [float(rng.choice([1e-7, -1e-5, 0.0]))],
    "Normalize": lambda rng: [rng.standard_normal(4)],
    "ProjectToSE3": lambda rng: [near(rng, pose(rng))],
    "ProjectToSO3": lambda rng: [near(rng, rotation(rng))],
    "QuinticTimeScaling": lambda rng: [2.5, float(rng.uniform(0, 2.5))],
    "RotInv": lambda rng: [rotation(rng)],
    "RpToTrans": lambda rng: [rotation(rng), rng.standard_normal(3)],
    "ScrewToAxis": lambda rng: [*rng.standard_normal((2, 3)), float(rng.standard_normal())],
    "ScrewTrajectory": lambda rng: [*two_poses(rng), 3.0, 5, int(rng.choice([3, 5]))],
    "SimulateControl": control,
    "TestIfSE3": lambda rng: [near(rng, pose(rng)) if rng.random() < 0.5 else pose(rng)],
    "TestIfSO3": lambda rng: [near(rng, rotation(rng)) if rng.random() < 0.5 else rotation(rng)],
    "TransInv": lambda rng: [pose(rng)],
    "TransToRp": lambda rng: [pose(rng)],
    "VecTose3": lambda rng: [rng.standard_normal(6)],
    "VecToso3": lambda rng: [rng.standard_normal(3)],
    "VelQuadraticForces": chapter_eight("q", "dq"),
    "ad": lambda rng: [rng.standard_normal(6)],
    "se3ToVec": lambda rng: [tw.se3.hat(rng.standard_normal(6))],
    "so3ToVec": lambda rng: [tw.so3.hat(rng.standard_normal(3))],
}  # fmt: skip
COMPILED = {
    "ComputedTorque",
    "SimulateControl",
    *(n for n in ARGUMENTS if "Forces" in n or "Dynamics" in n or "Kin" in n),
}
COMPILED |= {"MassMatrix", "JacobianBody", "JacobianSpace"}


def public(module):
    return {n for n, f in vars(module).items() if inspect.isfunction(f) and not n.startswith("_")}


def test_every_function_of_the_book_is_there_with_its_arguments_in_order(book):
    assert set(mr.__all__) == public(book) == set(ARGUMENTS)
    for name in mr.__all__:
        ours, theirs = (list(inspect.signature(getattr(m, name)).parameters.values()) for m in (mr, book))
        positional = [p.name for p in ours if p.kind is p.POSITIONAL_OR_KEYWORD]
        assert positional == [p.name for p in theirs], name


def same_kind(ours, theirs):
    """Tuples, lists, arrays and truth values where theirs are, of the same shapes."""
    if isinstance(theirs, (tuple, list)):
        assert type(ours) is type(theirs)
        assert len(ours) == len(theirs)
        for a, b in zip(ours, theirs, strict=True):
            same_kind(a, b)
    else:
        assert np.shape(ours) == np.shape(theirs)
        assert isinstance(ours, np.ndarray) == isinstance(theirs, np.ndarray)
        assert isinstance(ours, (bool, np.bool_)) == isinstance(theirs, (bool, np.bool_))


def gap(ours, theirs) -> float:
    if isinstance(theirs, (tuple, list)):
        return max(gap(a, b) for a, b in zip(ours, theirs, strict=True))
    a, b = np.asarray(ours, float), np.asarray(theirs, float)
    return float(np.abs(a - b).max() / max(1.0, np.abs(b).max()))


def nested(x):
    return [nested(row) for row in x] if isinstance(x, (list, np.ndarray)) and np.ndim(x) else x


@pytest.mark.parametrize("seeds", [SEEDS, pytest.param(MANY, marks=pytest.mark.slow)], ids=["quick", "10,000 in all"])
@pytest.mark.parametrize("name", sorted(ARGUMENTS))
def test_ours_equals_theirs_on_random_input(book, name, seeds, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "matplotlib.pyplot", None)  # SimulateControl would open a window
    for seed in seeds[: 3 if seeds is SEEDS and name in COMPILED else None]:
        given = ARGUMENTS[name](np.random.default_rng([seed, 1]))
        as_lists = [nested(x) for x in given]
        ours, from_lists, theirs = getattr(mr, name)(*given), getattr(mr, name)(*as_lists), getattr(book, name)(*given)
        same_kind(ours, theirs)
        assert gap(from_lists, ours) == 0, seed
        # theirs inverts M: what the condition of M amplifies is left to the test of that trap
        condition = np.linalg.cond(mr.MassMatrix(given[0], *given[5:8])) if name == "ForwardDynamics" else 1.0
        assert gap(ours, theirs) <= AGREE * max(1.0, condition / 1e3), seed


# ── batches ──

BATCHED = {
    "Adjoint", "AxisAng3", "AxisAng6", "CubicTimeScaling", "DistanceToSE3", "DistanceToSO3", "EulerStep", "MatrixExp3",
    "MatrixExp6", "MatrixLog3", "MatrixLog6", "NearZero", "Normalize", "ProjectToSE3", "ProjectToSO3", "RotInv", "RpToTrans",
    "ScrewToAxis", "TestIfSE3", "TestIfSO3", "TransInv", "TransToRp", "VecTose3", "VecToso3", "ad", "se3ToVec", "so3ToVec",
}  # fmt: skip


@pytest.mark.parametrize("name", sorted(BATCHED))
def test_a_batch_is_its_rows(name):
    """The rows go another way than single calls (plain floats): equal to a few units in the last place."""
    rows = [ARGUMENTS[name](np.random.default_rng([seed, 2])) for seed in range(6)]
    function = getattr(mr, name)
    batch = function(*(np.array(column).reshape(2, 3, *np.shape(column[0])) for column in zip(*rows, strict=True)))
    single = [function(*row) for row in rows]
    batch, single = (batch, single) if isinstance(batch, tuple) else ((batch,), [(s,) for s in single])
    for part, of_rows in zip(batch, zip(*single, strict=True), strict=True):
        expected = np.array(of_rows).reshape(2, 3, *np.shape(of_rows[0]))
        assert part.shape == expected.shape
        assert np.abs(np.asarray(part, float) - np.asarray(expected, float)).max() <= 4e-15 * max(
            1, np.abs(expected).max()
        )


@pytest.mark.parametrize(
    "name", ["InverseDynamics", "ForwardDynamics", "MassMatrix", "GravityForces", "EndEffectorForces"]
)
def test_dynamics_take_batches_of_everything_but_the_lists(name):
    rng = np.random.default_rng(3)
    rows = {"q": joints(rng, 15).reshape(5, 3), "g": rng.standard_normal((5, 3)), "F": rng.standard_normal((5, 6))}
    vectors = {
        "InverseDynamics": "q x x g F",
        "ForwardDynamics": "q x x g F",
        "MassMatrix": "q",
        "GravityForces": "q g",
        "EndEffectorForces": "q F",
    }
    given = [rows.get(v, rng.standard_normal((5, 3))) for v in vectors[name].split()]
    robot = lists(rng, 3)
    batch = getattr(mr, name)(*given, *robot)
    for i in range(5):  # kernels give the same bits whatever the batch
        assert np.array_equal(batch[i], getattr(mr, name)(*(x[i] for x in given), *robot))


# ── lists and their kernels ──


def test_other_gravity_and_other_wrenches_compile_nothing_anew():
    rng = np.random.default_rng(5)
    robot, q = lists(rng, 3), joints(rng, 3)
    mr.InverseDynamics(q, q, q, [0, 0, -9.81], np.zeros(6), *robot)
    found = chains.chain_of(*robot)
    kernel, before = found.kernel("inverse_dynamics"), chains._cached_chain.cache_info().misses
    for _ in range(3):
        g, F = rng.standard_normal(3), rng.standard_normal(6)
        tau = mr.InverseDynamics(q, q, q, g, F, *robot)
        same = tw.from_screws(None, robot[2], robot[0], robot[1], gravity=g)
        assert gap(tau, same.inverse_dynamics(q, q, q, wrench_by_robot={same.tip: F})) <= 1e-13
    assert chains._cached_chain.cache_info().misses == before
    assert chains.chain_of(*robot).kernel("inverse_dynamics") is kernel


def test_gravity_may_be_the_last_input_of_a_robots_kernel():
    robot, rng = tw.robots.ur5(), np.random.default_rng(4)
    (q, dq, tau), F, g = rng.standard_normal((3, 6)), rng.standard_normal(6), rng.standard_normal(3)
    options = {"wrenches": ("tool0",), "gravity": "input"}
    ddq = robot.kernel("forward_dynamics", **options)(q, dq, tau, F, g)
    fixed = robot.with_gravity(g).forward_dynamics(q, dq, tau, wrench_by_robot={"tool0": F})
    for other in (fixed, robot.reference("forward_dynamics", q, dq, tau, F, g, **options)):
        assert np.abs(ddq - other).max() <= 1e-12 * np.abs(ddq).max() * np.linalg.cond(robot.mass_matrix(q)) / 1e2
    for name, options in (("mass_matrix", {"gravity": "input"}), ("bias_forces", {"gravity": [0, 0, -9.81]})):
        with pytest.raises(tw.KernelError, match="gravity"):
            robot.kernel(name, **options)


def test_lists_are_known_by_what_is_in_them():
    """A list changed in place is another robot; a list of arrays, nested lists and one array are the same."""
    rng = np.random.default_rng(6)
    steps, inertias, S = lists(rng, 2)
    q = joints(rng, 2)
    M = mr.MassMatrix(q, steps, inertias, S)
    assert np.array_equal(M, mr.MassMatrix(q, np.array(steps), [G.tolist() for G in inertias], S.tolist()))
    inertias[1] *= 2.0
    assert mr.MassMatrix(q, steps, inertias, S)[1, 1] == pytest.approx(2.0 * M[1, 1])


def test_no_more_lists_are_kept_than_said():
    assert chains._cached_chain.cache_info().maxsize == chains.MAX_CACHED_CHAINS


def test_a_body_that_cannot_exist_is_accepted_with_a_warning():
    G = np.diag([1.0, 0.1, 0.1, 2.0, 2.0, 2.0])  # 1 > 0.1 + 0.1
    arguments = [0.3], [np.eye(4)] * 2, [G], np.array([[0, 0, 1.0, 0, 0, 0]]).T
    with pytest.warns(tw.ModelWarning, match="cannot exist"):
        assert mr.MassMatrix(*arguments)[0, 0] == pytest.approx(0.1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mr.MassMatrix(*arguments)  # said once


# ── what the book's package says of its arguments, and what it leaves to chance ──


def test_no_wrench_at_the_tip_is_a_plain_zero():
    """As the docstrings of the book's package promise; there it ends in an IndexError."""
    rng = np.random.default_rng(7)
    robot, q = lists(rng, 2), rng.uniform(0.2, 1.0, (4, 2))
    g, none = rng.standard_normal(3), np.zeros((4, 6))
    assert np.array_equal(
        mr.InverseDynamicsTrajectory(q, q, q, g, 0, *robot), mr.InverseDynamicsTrajectory(q, q, q, g, none, *robot)
    )
    simulated = [mr.ForwardDynamicsTrajectory(q[0], q[1], q, g, F, *robot, 0.01, 2)[0] for F in (0, none)]
    assert np.array_equal(*simulated)


def test_joint_motions_of_whole_numbers_give_torques_that_are_not():
    rng = np.random.default_rng(8)
    robot, q = lists(rng, 2), np.array([[1, 2], [3, 4]])
    tau = mr.InverseDynamicsTrajectory(q, q, q, [0, 0, -9.81], 0, *robot)
    assert np.array_equal(tau, mr.InverseDynamicsTrajectory(q * 1.0, q, q, [0, 0, -9.81], 0, *robot))
    assert np.abs(tau - np.round(tau)).max() > 1e-3


def test_control_is_drawn_only_when_asked(monkeypatch):
    pyplot = pytest.importorskip("matplotlib.pyplot", reason="matplotlib is not installed")
    shown = []
    monkeypatch.setattr(pyplot, "show", lambda: shown.append(pyplot.gcf()))
    pyplot.switch_backend("agg")
    arguments = control(np.random.default_rng(9))
    quiet = mr.SimulateControl(*arguments)
    assert not shown
    drawn = mr.SimulateControl(*arguments, plot=True)
    assert len(shown) == 1
    assert len(shown[0].axes[0].lines) == 2 * 4
    assert all(np.array_equal(a, b) for a, b in zip(quiet, drawn, strict=True))
    pyplot.close("all")
    monkeypatch.setitem(__import__("sys").modules, "matplotlib.pyplot", None)
    with pytest.raises(tw.MissingExtraError, match=r"plot=True.*\[plot\]"):
        mr.SimulateControl(*arguments, plot=True)


ROBOT = lists(np.random.default_rng(10), 2)
Z = np.zeros(2)
BAD = [
    ("MassMatrix", ([1.0, 2.0, 3.0], *ROBOT), tw.ShapeError, r"thetalist has shape \(3,\).*2 joints"),
    ("MassMatrix", (Z, ROBOT[0][:2], *ROBOT[1:]), tw.ShapeError, r"Mlist \(2, 4, 4\)"),
    ("MassMatrix", (Z, "three", *ROBOT[1:]), tw.TwistWrenchError, "Mlist"),
    ("MassMatrix", (Z, ROBOT[0], [np.ones((6, 6))] * 2, ROBOT[2]), tw.InertiaError, "link1"),
    ("InverseDynamics", (Z, Z, Z, [0, 0], np.zeros(6), *ROBOT), tw.ShapeError, "g has shape"),
    ("InverseDynamics", (Z, Z, Z, [0, 0, 1], np.zeros(3), *ROBOT), tw.ShapeError, "Ftip has shape"),
    ("ForwardDynamics", (Z, Z, Z, [0, 0, 1], np.zeros(6), ROBOT[0], np.zeros((2, 6, 6)), ROBOT[2]), tw.SingularMassMatrixError, "joint1"),
    ("InverseDynamicsTrajectory", (np.zeros((3, 2)), np.zeros((2, 2)), np.zeros((3, 2)), [0, 0, 1], 0, *ROBOT), tw.ShapeError, "dthetamat"),
    ("InverseDynamicsTrajectory", (*[np.zeros((3, 2))] * 3, [0, 0, 1], np.ones((2, 6)), *ROBOT), tw.ShapeError, "Ftipmat"),
    ("ForwardDynamicsTrajectory", (Z, Z, np.zeros((3, 2)), [0, 0, 1], 0, *ROBOT, 0.1, 0), tw.ValueRangeError, "intRes is 0"),
    ("ForwardDynamicsTrajectory", (np.zeros((3, 2)), Z, np.zeros((3, 2)), [0, 0, 1], 0, *ROBOT, 0.1, 1), tw.ShapeError, "one state"),
    ("InverseDynamics", (np.zeros((3, 2)), np.zeros((4, 2)), Z, [0, 0, 1], np.zeros(6), *ROBOT), tw.ShapeError, "do not broadcast"),
    ("EulerStep", (np.zeros((3, 2)), np.zeros((4, 2)), Z, 0.1), tw.ShapeError, "do not broadcast"),
    ("ComputedTorque", (Z, Z, Z, [0, 0, 1], *ROBOT, Z, Z, Z, [1, 2, 3], 1, 1), tw.ShapeError, "Kp has shape"),
    ("IKinBody", (ROBOT[2], np.eye(4), np.eye(4), np.zeros((3, 2)), 1, 1), tw.ShapeError, "thetalist0"),
    ("IKinBody", (ROBOT[2], np.eye(4), np.eye(4), Z, None, 1), tw.ValueRangeError, "eomg"),
    ("FKinSpace", (np.eye(3), ROBOT[2], Z), tw.ShapeError, "M has shape"),
    ("FKinSpace", (np.eye(4), np.zeros((4, 2)), Z), tw.ShapeError, "Slist has shape"),
    ("JacobianBody", (np.zeros((6, 2)), Z), tw.ModelError, "zero screw axis"),
    ("MatrixLog3", (np.diag([1.0, 1.0, 2.0]),), tw.ValueRangeError, "nearest one is"),
    ("MatrixLog6", (np.ones((4, 4)),), tw.ValueRangeError, "last row"),
    ("MatrixExp3", (np.zeros((2, 2)),), tw.ShapeError, "so3mat has shape"),
    ("MatrixLog3", (np.ones((3, 3)),), tw.ValueRangeError, "^MatrixLog3: R: not a rotation.*ProjectToSO3"),
    ("TransInv", (np.diag([1.0, 1.0, 2.0, 1.0]),), tw.ValueRangeError, "^TransInv: T: not a"),
    ("MatrixExp3", (np.eye(3),), tw.ValueRangeError, "^MatrixExp3: so3mat is not skew.* 2 of its largest.*VecToso3"),
    ("MatrixExp3", (np.array([np.zeros((3, 3)), np.eye(3)]),), tw.ValueRangeError, "^MatrixExp3: so3mat.*row 1 of the batch"),
    ("so3ToVec", (np.eye(3),), tw.ValueRangeError, "^so3ToVec: so3mat is not skew"),
    ("MatrixExp6", (np.eye(4),), tw.ValueRangeError, "^MatrixExp6: se3mat is not skew"),
    ("se3ToVec", (np.diag([0.0, 0.0, 0.0, 1.0]),), tw.ValueRangeError, "^se3ToVec: se3mat has no last row of zeros"),
    ("IKinSpace", (ROBOT[2], np.eye(4), np.full((4, 4), np.nan), Z, 1, 1), tw.ValueRangeError, r"^IKinSpace: T has the entry nan at \(0, 0\)"),
    ("IKinBody", (ROBOT[2], np.full((4, 4), np.inf), np.eye(4), Z, 1, 1), tw.ValueRangeError, "^IKinBody: M has the entry inf"),
    ("IKinBody", (ROBOT[2], np.eye(4), np.eye(4), [0.0, np.nan], 1, 1), tw.ValueRangeError, "^IKinBody: thetalist0 has the entry nan"),
    ("IKinSpace", (ROBOT[2], np.eye(4), np.eye(4), Z, 1, np.nan), tw.ValueRangeError, "^IKinSpace: ev is nan"),
    ("IKinSpace", (ROBOT[2], np.eye(4), np.eye(4), Z, -1, 1), tw.ValueRangeError, "^IKinSpace: eomg is -1"),
    ("Normalize", ([0.0, 0.0],), tw.ValueRangeError, "no direction"),
    ("JointTrajectory", ([1], [2], 1.0, 1, 3), tw.ValueRangeError, "N is 1"),
    ("JointTrajectory", ([1], [2], 1.0, 4, 4), tw.ValueRangeError, "method is 4"),
    ("JointTrajectory", ([1], [2], 0.0, 4, 3), tw.ValueRangeError, "Tf is 0"),
    ("JointTrajectory", ([1], [2, 3], 1.0, 4, 3), tw.ShapeError, "thetaend"),
    ("CubicTimeScaling", (0, 0.5), tw.ValueRangeError, "Tf is 0"),
    ("ScrewTrajectory", (np.eye(4)[None], np.eye(4), 1.0, 4, 3), tw.ShapeError, "Xstart"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "arguments", "error", "message"), BAD, ids=[f"{b[0]}: {b[3][:20]}" for b in BAD])
def test_bad_input_is_an_error_of_the_tree_that_names_it(name, arguments, error, message):
    with pytest.raises(error, match=message):
        getattr(mr, name)(*arguments)


def test_rounded_skew_symmetric_matrices_are_read_as_they_are():
    W = tw.so3.hat([0.3, -0.5, 0.8])
    W[0, 1] += 5e-3
    assert gap(mr.so3ToVec(W), [0.3, -0.5, 0.8]) == 0
    assert gap(mr.MatrixExp3(W), mr.MatrixExp3(tw.so3.hat([0.3, -0.5, 0.8]))) == 0
    noise = 1e-9 * np.eye(3)  # what is left of a difference of rotations
    assert not mr.so3ToVec(noise).any()
    assert np.isnan(mr.so3ToVec(np.full((3, 3), np.nan))).all()


def test_rounded_rotations_are_read_as_the_nearest_one():
    R = tw.so3.exp([0.3, -0.5, 0.8])
    assert gap(mr.MatrixLog3(R.round(3)), tw.so3.hat([0.3, -0.5, 0.8])) <= 1e-3
    T = tw.se3.pose(R.round(2), [1, 2, 3])
    assert gap(mr.TransInv(T) @ tw.se3.pose(R, [1, 2, 3]), np.eye(4)) <= 3e-2


@pytest.mark.parametrize("solve", [mr.IKinBody, mr.IKinSpace])
@pytest.mark.parametrize(("screw", "eomg", "ev"), [([0, 0, 1, 0, 0, 0], 0.2, 1e-9), ([0, 0, 0, 0, 0, 1], 1e-9, 0.2)])
def test_newtons_steps_end_within_eomg_of_angle_and_ev_of_distance(solve, screw, eomg, ev):
    """MR section 6.2.2."""
    given = np.array([screw], float).T, np.eye(4), np.eye(4), [0.1]
    theta, success = solve(*given, eomg, ev)
    assert success and theta.tolist() == [0.1]
    theta, success = solve(*given, ev, eomg)
    assert success and abs(theta[0]) <= 1e-9
