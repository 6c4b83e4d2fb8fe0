"""All ways of calling a method with one state that reach its kernel at once: the bits, the types, the errors of the ufunc."""

from __future__ import annotations

import ctypes
import gc
import inspect
import pickle
import sys
import threading
import weakref

import numpy as np
import pytest
from quick import mostly_slow

import twistwrench as tw
from twistwrench.compiler.lowering.ir_builder import LlvmWriter
from twistwrench.compiler.lowering.target_machine import DOUBLE, SINGLE, chosen
from twistwrench.compiler.runtime import batch_threads, dispatch, gufunc
from twistwrench.compiler.runtime.dispatch_ir import has_nonfinite
from twistwrench.compiler.runtime.jit import assemble
from twistwrench.testing import random_state

INPUTS = {
    "inverse_dynamics": 3, "forward_dynamics": 3, "mass_matrix": 1, "bias_forces": 2, "gravity_forces": 1,
    "inverse_dynamics_derivatives": 3, "forward_dynamics_derivatives": 3, "kinetic_energy": 2, "potential_energy": 1,
    "jacobian": 1, "forward_kinematics": 1, "link_poses": 1, "regressor": 3, "momentum": 2, "joint_wrenches": 3,
}  # fmt: skip
SCALARS = ("kinetic_energy", "potential_energy")


@pytest.fixture(params=["panda", "quadruped"])
def robot(request):
    return getattr(tw.robots, request.param)()


@pytest.fixture
def direct(monkeypatch):
    """Counts the calls that came the long way."""
    calls = []
    call = batch_threads.call
    monkeypatch.setattr(batch_threads, "call", lambda *given: (calls.append(1), call(*given))[1])
    return calls


def states(robot, name, count, seed=0):
    return list(zip(*random_state(robot, np.random.default_rng(seed), (count,))[: INPUTS[name]], strict=True))


def usual(robot):
    return {"frame": robot.frame_names[-1]} if robot.tip is None else {}


def options_of(robot, name):
    return usual(robot) if name in ("jacobian", "forward_kinematics") else {}


def same(found, expected):
    """Equal to the bit, of the same types and shapes."""
    if isinstance(expected, tuple):
        assert type(found) is tuple
        assert len(found) == len(expected)
        for one, other in zip(found, expected, strict=True):
            same(one, other)
        return
    assert type(found) is type(expected)
    assert found.dtype == expected.dtype
    assert found.shape == expected.shape
    assert found.tobytes() == expected.tobytes()


def warm(call, times=3):
    for _ in range(times):
        call()


@pytest.fixture(autouse=True)
def at_once(monkeypatch):
    """Long programs wait for no more calls than short ones."""
    monkeypatch.setattr(dispatch, "LONG_PROGRAM", 1_000_000)


# ── bits ──


SHORT = [name for name in INPUTS if not name.endswith("_derivatives") and name != "regressor"]  # in few seconds


@pytest.mark.parametrize(
    ("robot", "name"),
    mostly_slow([("panda", name) for name in INPUTS] + [("quadruped", name) for name in SHORT], 5),
    indirect=["robot"],
)
def test_single_batch_and_out_give_the_same_bits(robot, direct, name):
    for dtype in (np.float64, np.float32):
        of_one_type(robot, direct, name, dtype)


def of_one_type(robot, direct, name, dtype):
    options = options_of(robot, name)
    kernel = robot.kernel(name, **options)
    given = [[x.astype(dtype) for x in state] for state in states(robot, name, 12)]
    batch = kernel(*(np.stack(x) for x in zip(*given, strict=True)))
    warm(lambda: getattr(robot, name)(*given[0], **options))
    one = [x[None] for x in given[0]]
    warm(lambda: getattr(robot, name)(*one, **options))
    method = getattr(robot, name)
    direct.clear()
    for k, state in enumerate(given):
        expected = kernel(*state)
        of_batch = tuple(x[k] for x in batch) if isinstance(batch, tuple) else batch[k]
        found = method(*state, **options)
        same(found, expected)
        same(found, of_batch)
        same(method(*(x[None] for x in state), **options), kernel(*(x[None] for x in state)))
        room = tuple(np.empty_like(np.asarray(x)) for x in (expected if isinstance(expected, tuple) else (expected,)))
        out = room if len(room) > 1 else room[0]
        given_back = method(*state, out=out, **options)
        if len(room) == 1:
            assert given_back is out
        else:
            assert all(a is b for a, b in zip(given_back, room, strict=True))
        for place, value in zip(room, expected if isinstance(expected, tuple) else (expected,), strict=True):
            assert place.tobytes() == value.tobytes()
    assert not direct


@pytest.mark.parametrize(
    "name", ["inverse_dynamics", "forward_dynamics", "inverse_dynamics_derivatives", "mass_matrix"]
)
def test_huge_angles_and_what_is_no_number(name):
    robot = tw.robots.panda()
    method, kernel = getattr(robot, name), robot.kernel(name)
    warm(lambda: method(*states(robot, name, 1)[0]))
    method = getattr(robot, name)
    for scale in (1e3, 1e8, 1e12, 1e200):
        for state in states(robot, name, 6):
            state[0][...] *= scale
            with np.errstate(all="ignore"):
                same(method(*state), kernel(*state))
    for bad in (np.nan, np.inf):
        state = states(robot, name, 1)[0]
        state[0][2] = bad
        with np.errstate(all="ignore"):
            same(method(*state), kernel(*state))


@pytest.mark.parametrize("scale", [1.0, 1e3, 1e6])
def test_one_lane_has_the_bits_of_many_in_float32(scale):
    robot = tw.robots.panda()
    kernel = robot.kernel("inverse_dynamics")
    given = [[(x * scale).astype(np.float32) for x in state] for state in states(robot, "inverse_dynamics", 20)]
    whole = kernel(*(np.stack(x) for x in zip(*given, strict=True)))
    for k, state in enumerate(given):
        same(robot.inverse_dynamics(*state), whole[k])


# ── options ──


def test_frames_and_kinds_by_name_or_place(robot, direct):
    q = robot.random_configuration(3)
    frames = robot.frame_names[-3:]
    for frame in frames:
        for kind in ("body", "space"):
            expected = robot.kernel("jacobian", frame=frame, kind=kind)(q)
            ways = [
                lambda f=frame, k=kind: robot.jacobian(q, frame=f, kind=k),
                lambda f=frame, k=kind: robot.jacobian(q, f, k),
                lambda f=frame, k=kind: robot.jacobian(kind=k, q=q, frame=f),
            ]
            for way in ways:
                warm(way)
            direct.clear()
            for way in ways:
                same(way(), expected)
            assert not direct
    with pytest.raises(tw.UnknownNameError):
        robot.jacobian(q, frame="nowhere")
    with pytest.raises(tw.UnknownNameError):
        robot.jacobian(q, frames[0], "sideways")
    with pytest.raises(TypeError):
        robot.jacobian(q, frames[0], frame=frames[0])
    with pytest.raises(TypeError):
        robot.jacobian(q, nothing=1)


def test_an_option_that_is_left_out_has_its_default_whatever_was_asked_for_before():
    robot = tw.robots.panda()
    q = robot.random_configuration(3)
    expected = {kind: robot.kernel("jacobian", frame=robot.tip, kind=kind)(q) for kind in ("body", "space")}
    for _ in range(2):
        warm(lambda: robot.jacobian(q, kind="space"))
        same(robot.jacobian(q), expected["body"])
        warm(lambda: robot.jacobian(q))
        same(robot.jacobian(q, kind="space"), expected["space"])


def test_more_ways_than_stand_in_a_row_still_work(monkeypatch):
    monkeypatch.setattr(dispatch, "MAX_CHAIN_LENGTH", 4)
    robot = tw.robots.panda()
    q = robot.random_configuration(3)
    expected = {frame: robot.kernel("jacobian", frame=frame)(q) for frame in robot.frame_names}
    assert len(expected) > dispatch.MAX_CHAIN_LENGTH
    for _ in range(3):
        for frame in robot.frame_names:
            same(robot.jacobian(q, frame=frame), expected[frame])
    way, count = robot.jacobian, 0
    while dispatch.is_made_here(way):
        way, count = way.__self__.kept["fallback"], count + 1
    assert count == dispatch.MAX_CHAIN_LENGTH


def test_friction_is_an_option(direct):
    robot = tw.robots.panda()
    q, dq, ddq = states(robot, "inverse_dynamics", 1)[0]
    warm(lambda: robot.inverse_dynamics(q, dq, ddq))
    warm(lambda: robot.inverse_dynamics(q, dq, ddq, friction=True))
    direct.clear()
    same(robot.inverse_dynamics(q, dq, ddq, friction=True), robot.kernel("inverse_dynamics", friction=True)(q, dq, ddq))
    same(robot.inverse_dynamics(q, dq, ddq, friction=False), robot.kernel("inverse_dynamics")(q, dq, ddq))
    assert not direct


@pytest.mark.parametrize(
    ("side", "dtype"),
    mostly_slow([("wrench_by_robot", np.float64), ("wrench_on_robot", np.float64), ("wrench_on_robot", np.float32)], 3),
)
@pytest.mark.parametrize(
    ("robot", "name"),
    [("panda", "forward_dynamics"), ("panda", "inverse_dynamics_derivatives"), ("quadruped", "inverse_dynamics")],
    indirect=["robot"],
)
def test_wrenches_at_frames(robot, name, side, dtype):
    """They come the long way, behind a builtin that serves calls without them."""
    frames = sorted(robot.frame_names[-2:])
    rng = np.random.default_rng(5)
    for named in (frames[:1], frames):
        state = [x.astype(dtype) for x in states(robot, name, 1)[0]]
        warm(lambda: getattr(robot, name)(*state))  # noqa: B023
        for _ in range(5):
            wrenches = {frame: rng.normal(size=6).astype(dtype) for frame in named}
            signed = [F if side == "wrench_by_robot" else -F for F in wrenches.values()]
            same(
                getattr(robot, name)(*state, **{side: wrenches}),
                robot.kernel(name, wrenches=tuple(named))(*state, *signed),
            )
        same(getattr(robot, name)(*state, **{side: {}}), robot.kernel(name)(*state))
        both = {"wrench_by_robot": wrenches, "wrench_on_robot": wrenches}
        np.testing.assert_allclose(
            getattr(robot, name)(*state, **both)[0], robot.kernel(name)(*state)[0], rtol=1e-3, atol=1e-2
        )
        with pytest.raises(tw.ShapeError):
            getattr(robot, name)(*state, **{side: {named[0]: np.zeros(5)}})
        with pytest.raises(tw.UnknownNameError):
            getattr(robot, name)(*state, **{side: {"nowhere": np.zeros(6)}})


# ── arguments ──


def test_lists_and_tuples_of_floats(direct):
    robot = tw.robots.panda()
    q, dq, ddq = states(robot, "inverse_dynamics", 1)[0]
    expected = robot.kernel("inverse_dynamics")(q, dq, ddq)
    warm(lambda: robot.inverse_dynamics(q, dq, ddq))
    direct.clear()
    same(robot.inverse_dynamics(q.tolist(), dq.tolist(), ddq.tolist()), expected)
    same(robot.inverse_dynamics(tuple(q.tolist()), dq, list(ddq)), expected)  # of NumPy's floats, too
    out = np.empty(7)
    assert robot.inverse_dynamics(q.tolist(), dq, ddq, out=out) is out
    same(out, expected)
    assert not direct
    same(robot.inverse_dynamics([0, *q[1:].tolist()], dq, ddq), robot.inverse_dynamics([0.0, *q[1:]], dq, ddq))
    for wrong in ([0.0] * 6, [], ["a"] * 7, [None] * 7, [[0.0] * 7] * 2 + [[1.0]], {1.0: 2.0}):
        with pytest.raises(tw.ShapeError):
            robot.inverse_dynamics(wrong, dq, ddq)


def test_out_that_overlaps_cannot_be_written_or_does_not_fit():
    robot = tw.robots.panda()
    q, dq, ddq = states(robot, "inverse_dynamics", 1)[0]
    kernel = robot.kernel("inverse_dynamics")
    expected = kernel(q, dq, ddq)
    warm(lambda: robot.inverse_dynamics(q, dq, ddq))
    place = q.copy()
    assert robot.inverse_dynamics(place, dq, ddq, out=place) is place
    same(place, expected)
    room = np.empty(14)
    room[:7], shifted = q, room[3:10]
    assert robot.inverse_dynamics(room[:7], dq, ddq, out=shifted) is shifted
    same(shifted.copy(), expected)
    wide = np.zeros((7, 2))[:, 0]
    assert robot.inverse_dynamics(q, dq, ddq, out=wide) is wide
    same(wide.copy(), expected)
    fixed = np.empty(7)
    fixed.flags.writeable = False
    for out in (fixed, np.empty(6), np.empty(7, int), [0.0] * 7, "x", (np.empty(7), np.empty(7))):
        with pytest.raises(tw.ShapeError, match="out="):
            robot.inverse_dynamics(q, dq, ddq, out=out)
    same(robot.inverse_dynamics(q, dq, ddq, out=None), expected)
    warm(lambda: robot.inverse_dynamics_derivatives(q, dq, ddq))
    block = np.empty((7, 7))
    with pytest.raises(tw.ShapeError, match="share memory"):
        robot.inverse_dynamics_derivatives(q, dq, ddq, out=(block, block))


def test_names_of_inputs_and_missing_ones(direct):
    robot = tw.robots.panda()
    q, dq, ddq = states(robot, "inverse_dynamics", 1)[0]
    warm(lambda: robot.inverse_dynamics(q, dq, ddq))
    direct.clear()
    same(robot.inverse_dynamics(q, ddq=ddq, dq=dq), robot.kernel("inverse_dynamics")(q, dq, ddq))
    assert not direct
    for given, named in (((q, dq), {}), ((q, dq), {"dq": dq}), ((q, dq, ddq), {"q": q})):
        with pytest.raises(TypeError):
            robot.inverse_dynamics(*given, **named)
    with pytest.raises(tw.ValueRangeError, match="actuated= is for a robot with constraints"):
        robot.inverse_dynamics(q, dq, ddq, q)


def test_a_batch_of_one_is_not_a_batch_of_many(robot):
    q, dq, ddq = random_state(robot, np.random.default_rng(0), (1, 5))
    for _ in range(4):
        for shape in ((1, 5), (1, 1), (1,), (5, 1)):
            rows = np.prod(shape)
            given = [x.reshape(5, -1)[:rows].reshape(*shape, -1) for x in (q, dq, ddq)]
            same(robot.inverse_dynamics(*given), robot.kernel("inverse_dynamics")(*given))


# ── life ──


@pytest.mark.slow
def test_nothing_leaks_in_any_way():
    robot = tw.robots.panda()
    q, dq, ddq = states(robot, "inverse_dynamics", 1)[0]
    out, several, F = np.empty(7), (np.empty((7, 7)), np.empty((7, 7))), np.zeros(6)
    bad, tip, listed = np.full(7, np.nan), robot.tip, q.tolist()

    def all_ways(robot):
        robot.inverse_dynamics(q, dq, ddq, out=out)
        robot.inverse_dynamics(listed, dq, ddq)
        robot.inverse_dynamics(bad, dq, ddq)
        robot.inverse_dynamics(bad, dq, ddq, out=out)
        robot.inverse_dynamics(q, dq, ddq, wrench_on_robot={tip: F})
        robot.inverse_dynamics_derivatives(q, dq, ddq)
        robot.inverse_dynamics_derivatives(bad, dq, ddq)
        robot.inverse_dynamics_derivatives(q, dq, ddq, out=several)
        robot.kinetic_energy(q, dq)
        robot.jacobian(q, frame=tip)
        robot.jacobian(q[None])

    with np.errstate(all="ignore"):
        for _ in range(5):
            all_ways(robot)
        things = (q, dq, out, several, several[0], F, tip, np.dtype(float), listed)
        gc.collect()
        gc.collect()  # what is behind a kernel of an earlier test, its model too, goes after the kernel
        before = [sys.getrefcount(x) for x in things]
        for _ in range(300):
            all_ways(robot)
    gc.collect()
    assert all(abs(sys.getrefcount(x) - n) < 5 for x, n in zip(things, before, strict=True))
    kept = weakref.ref(robot)
    del robot
    gc.collect()
    assert kept() is None


def test_a_method_with_many_ways_pickles_and_outlives_its_robot():
    robot = tw.robots.panda()
    q = robot.random_configuration(0)
    for frame in robot.frame_names[:4]:
        warm(lambda f=frame, method=robot.jacobian: method(q, frame=f))
    method, expected = robot.jacobian, robot.kernel("jacobian", frame=robot.frame_names[2])(q)
    frame = robot.frame_names[2]
    same(pickle.loads(pickle.dumps(method))(q, frame=frame), expected)
    del robot
    gc.collect()
    same(method(q, frame=frame), expected)


def test_ways_may_be_made_by_many_threads_at_once():
    robot = tw.robots.panda()
    q = robot.random_configuration(0)
    frames = robot.frame_names[-4:]
    expected = {frame: robot.kernel("jacobian", frame=frame)(q) for frame in frames}
    gate, wrong = threading.Barrier(4), []

    def work(k):
        gate.wait(60)
        for n in range(200):
            frame = frames[(n + k) % 4]
            if not np.array_equal(robot.jacobian(q, frame=frame), expected[frame]):
                wrong.append(frame)

    crowd = [threading.Thread(target=work, args=(k,)) for k in range(4)]
    for thread in crowd:
        thread.start()
    for thread in crowd:
        thread.join(60)
    assert not wrong


def test_long_programs_wait_for_more_calls_and_are_compiled_once(monkeypatch):
    robot = tw.robots.planar_2r()
    monkeypatch.setattr(dispatch, "LONG_PROGRAM", 1)
    monkeypatch.setattr(dispatch, "INSTRUCTIONS_PER_CALL", 4)
    monkeypatch.setattr(gufunc, "LONGEST_SCALAR", 1)
    q, dq, ddq = states(robot, "inverse_dynamics", 1)[0]
    wanted = len(robot.program("inverse_dynamics").instructions) // 4
    assert wanted > 3  # more calls than a short program waits for
    for k in range(wanted):
        assert dispatch.is_made_here(robot.inverse_dynamics) == (k > wanted)
        robot.inverse_dynamics(q, dq, ddq)
    assert dispatch.is_made_here(robot.inverse_dynamics)
    same(robot.inverse_dynamics(q, dq, ddq), robot.kernel("inverse_dynamics")(q, dq, ddq))
    assert not gufunc.owner_of(robot.kernel("inverse_dynamics")).scalar


@pytest.mark.parametrize("precision", [DOUBLE, SINGLE], ids=lambda p: p.char)
@pytest.mark.parametrize("size", [1, 3, 8, 17, 100, 128, 140, 145, 169, 272, 277])
def test_one_result_that_is_not_finite_is_found_wherever_it_stands(size, precision):
    """A few vectors are looked at one by one, many in a loop of two, and the last overlaps those before."""
    w = LlvmWriter(precision, 1)
    found, _ = has_nonfinite(w, "%data", size, "entry")
    body = "\n".join(w.lines)
    code = assemble(f"define i1 @looked(ptr %data) {{\nentry:\n{body}\n  ret i1 {found}\n}}\n", "looked", chosen())
    looked = ctypes.CFUNCTYPE(ctypes.c_bool, ctypes.c_void_p)(code.address)
    x = np.random.default_rng(0).standard_normal(size).astype(precision.char)
    assert not looked(x.ctypes.data)
    for k in range(size):
        for odd in (np.nan, np.inf, -np.inf):
            y = x.copy()
            y[k] = odd
            assert looked(y.ctypes.data), k


def test_a_list_of_another_length_is_no_state():
    """As an array of it is none, also once calls with lists go directly to the loop."""
    robot = tw.robots.planar_2r()
    warm(lambda: robot.gravity_forces([0.1, 0.2]))
    assert dispatch.is_made_here(robot.gravity_forces)
    for wrong in ([0.1], [0.1, 0.2, 0.3], (0.1, 0.2, 0.3)):
        with pytest.raises(tw.ShapeError):
            robot.gravity_forces(wrong)


def test_an_option_by_keyword_alone_has_no_place():
    """As Python refuses it at the first call, so after many."""
    robot, room = tw.robots.planar_2r(), np.zeros(2)
    assert inspect.signature(robot.gravity_forces).parameters["out"].kind is inspect.Parameter.KEYWORD_ONLY
    warm(lambda: robot.gravity_forces([0.1, 0.2], out=room))
    warm(lambda: robot.gravity_forces([0.1, 0.2]))
    with pytest.raises(TypeError, match="positional argument"):
        robot.gravity_forces([0.1, 0.2], room)
