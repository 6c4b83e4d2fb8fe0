"""What a simulation refuses, what it keeps when something fails, its files and its command."""

from __future__ import annotations

import json
import re
from io import StringIO

import numpy as np
import pytest
from click.testing import CliRunner
from motions import SLED
from printed_blocks import printed
from quick import mostly_slow

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.core.verdict import ExitCode
from twistwrench.motion.motion_log import MotionLog
from twistwrench.simulation import Event, JointStops, Plane, SimulationResult
from twistwrench.simulation.forces import System
from twistwrench.simulation.methods.adaptive import Stepper
from twistwrench.simulation.run import Run
from twistwrench.testing import random_robot, random_state


@pytest.fixture(scope="module")
def arm():
    return tw.robots.planar_2r()


BAD = [
    ({"q0": [0, 0, 0]}, tw.ShapeError, "q0 has shape (3,)"),
    ({"q0": [[0, 0], [1, 1]]}, tw.ShapeError, "one state"),
    ({"q0": [0, np.nan]}, tw.ValueRangeError, "q0 has the entry nan"),
    ({"q0": "up"}, tw.TwistWrenchError, "q0"),
    ({"q0": [[0], [0, 1]]}, tw.TwistWrenchError, "q0"),
    ({"dq0": [0, np.inf]}, tw.ValueRangeError, "dq0 has the entry inf"),
    ({"dq0": [0]}, tw.ShapeError, "dq0"),
    ({"duration": 0}, tw.ValueRangeError, "duration is 0"),
    ({"duration": np.nan}, tw.ValueRangeError, "duration is nan"),
    ({"duration": np.inf}, tw.ValueRangeError, "duration is inf"),
    ({"duration": "long"}, tw.TwistWrenchError, "duration"),
    ({"dt": -1e-3}, tw.ValueRangeError, "dt is -0.001"),
    ({"dt": 1e-12}, tw.ValueRangeError, "states"),
    ({"every": 0}, tw.ValueRangeError, "every is 0"),
    ({"every": 1.5}, tw.ValueRangeError, "every is 1.5"),
    ({"method": "rk5"}, tw.UnknownNameError, "rk4"),
    ({"tau": [1.0]}, tw.ShapeError, "tau has shape (1,)"),
    ({"tau": [1.0, np.nan]}, tw.ValueRangeError, "tau has the entry nan"),
    ({"tau": lambda t: [0, 0]}, tw.ValueRangeError, "tau is a function of (t)"),
    ({"controller": 3.0}, tw.ValueRangeError, "must be a function of (t, q, dq)"),
    ({"controller": lambda q, dq: 0}, tw.ValueRangeError, "is called with the time"),
    ({"wrench_on_robot": [0] * 6}, tw.ShapeError, "dict"),
    ({"wrench_on_robot": {"nowhere": [0] * 6}}, tw.UnknownNameError, "nowhere"),
    ({"wrench_on_robot": {"tip": [0] * 5}}, tw.ShapeError, "tip"),
    ({"wrench_on_robot": {"tip": [np.nan] * 6}}, tw.ValueRangeError, "nan"),
    ({"wrench_on_robot": {"tip": np.zeros((4, 6))}}, tw.ShapeError, "tip"),
    ({"wrench_on_robot": {"tip": tw.Wrench([0] * 6, "base")}}, tw.FrameError, "base"),
    ({"rtol": 0}, tw.ValueRangeError, "rtol is 0"),
    ({"atol": -1}, tw.ValueRangeError, "atol is -1"),
    ({"max_step": 0}, tw.ValueRangeError, "max_step is 0"),
    ({"contacts": "ground"}, tw.ValueRangeError, "contacts is 'ground'"),
    ({"contacts": [3]}, tw.ValueRangeError, "contacts has 3"),
    ({"contacts": Plane("nowhere")}, tw.UnknownNameError, "nowhere"),
    ({"contacts": JointStops(1e4)}, tw.ValueRangeError, "no limits of position"),
    ({"contacts": JointStops(1e4, joints="joint9")}, tw.UnknownNameError, "joint9"),
    ({"limits": "stop"}, tw.ValueRangeError, "no limits of position"),
    ({"limits": "bounce"}, tw.ValueRangeError, "limits is 'bounce'"),
    ({"events": 5}, tw.ValueRangeError, "events is 5"),
    ({"events": [5]}, tw.ValueRangeError, "function of (t, q, dq)"),
    ({"progress": "yes"}, tw.ValueRangeError, "progress is 'yes'"),
]


@pytest.mark.parametrize(("given", "kind", "says"), BAD, ids=[f"{k}-{next(iter(b))}" for k, (b, *_) in enumerate(BAD)])
def test_what_cannot_be_meant_is_refused_before_anything_runs(arm, given, kind, says):
    with pytest.raises(kind, match=re.escape(says)):
        arm.simulate(**given)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Plane("tip", normal=[0, 0, 0]), "normal is zero"),
        (lambda: Plane("tip", points=[0, 0]), "points"),
        (lambda: Plane("tip", points=np.zeros((2, 2, 3))), "points"),
        (lambda: Plane("tip", points=np.zeros((0, 3))), "points"),
        (lambda: Plane("tip", stiffness=-1), "stiffness"),
        (lambda: Plane("tip", exponent=0.5), "exponent"),
        (lambda: Plane("tip", dissipation=np.nan), "dissipation"),
        (lambda: Plane("tip", friction=-0.1), "friction"),
        (lambda: Plane("tip", slip=0), "slip"),
        (lambda: Plane("tip", height=np.inf), "height"),
        (lambda: JointStops(0), "stiffness"),
        (lambda: Event(lambda t: 0), "event"),
        (lambda: Event(lambda t, q, dq: 0, direction="left"), "direction"),
    ],
)
def test_impossible_surroundings_are_refused(make, says):
    with pytest.raises(tw.TwistWrenchError, match=says):
        make()


def test_robots_that_cannot_move_or_start_are_refused(arm):
    with pytest.raises(tw.ValueRangeError, match="no joint that moves"):
        arm.lock(dict.fromkeys(arm.joint_names, 0.0)).simulate()
    with pytest.raises(tw.ValueRangeError, match="quaternion of zeros"):
        tw.robots.floating_box().simulate(np.zeros(7))
    panda = tw.robots.panda()
    with pytest.raises(
        tw.ValueRangeError, match="outside already: joint 'panda_joint4' is at 0 rad, beyond its upper limit"
    ):
        panda.simulate(limits="stop")


def test_quaternions_of_any_length_are_taken():
    box = tw.robots.floating_box()
    found = box.simulate([3.0, 0, 0, 4.0, 0, 0, 0], None, 0.1, 0.1)
    np.testing.assert_allclose(found.q[0, :4], [0.6, 0, 0, 0.8])


@pytest.mark.parametrize("size", [1e160, 1e300, 1e-160, 1e-300, 5e-324])
@pytest.mark.parametrize("method", ["dopri5", "rk4", "variational"])
def test_quaternions_whose_squares_no_float_holds_are_taken_too(size, method):
    box = tw.robots.floating_box()
    found = box.simulate([size, 0, 0, -size, 0, 0, 0], None, 0.1, 0.1, method=method)
    np.testing.assert_allclose(found.q[0, :4], np.array([1, 0, 0, -1]) / np.sqrt(2), rtol=1e-15)
    assert np.isfinite(found.q).all()


@pytest.mark.parametrize("q0", [[1, 0, 0, 0, 1e200, 0, 0], [1, 0, 0, 0, 1e308, 1e308, 1e308]])
@pytest.mark.parametrize("method", ["dopri5", "rk4", "variational"])
def test_enormous_numbers_end_in_a_result_or_in_an_error_of_ours(q0, method):
    box = tw.robots.floating_box()
    for dq0 in (None, [1e200] * 6):
        try:
            assert len(box.simulate(q0, dq0, 0.1, 0.01, method=method, contacts=Plane("box")))
        except tw.TwistWrenchError as problem:
            assert str(problem)


# ── nothing is lost ──


def fails(value):
    """A law of (t, q, dq) that does what it should until 0.5 s."""

    def law(t, q, dq):
        if t < 0.5:
            return np.zeros(2)
        if isinstance(value, Exception):
            raise value
        return value

    return law


@pytest.mark.parametrize("method", ["dopri5", "rk4", "variational"])
@pytest.mark.parametrize(
    ("value", "says"),
    [
        (ZeroDivisionError("by nothing"), "ZeroDivisionError: by nothing"),
        (np.array([0, np.nan]), "not finite at place 1"),
        (np.array([np.inf, 0]), "not finite at place 0"),
        (np.zeros(3), r"shape \(3,\)"),
        (0.0, r"shape \(\)"),
        (None, r"gave None at t = .*, expected real numbers of shape \(2,\)"),
        (["a", "b"], "expected real numbers"),
        ([1j, 0], "expected real numbers"),
        ([[1], [1, 2]], "ShapeError: the controller is not an array of real numbers"),
    ],
)
def test_a_controller_that_fails_says_when_and_nothing_is_lost(arm, method, value, says):
    with pytest.raises(tw.SimulationError, match=says) as caught:
        arm.simulate([1, 1], None, 1.0, 0.05, controller=fails(value), method=method)
    found = caught.value.result
    assert "the controller" in str(caught.value)
    assert "t = 0.5 s" in str(caught.value)
    assert not found.completed
    assert found.stopped == str(caught.value)
    assert len(found) == 11
    whole = arm.simulate([1, 1], None, 0.5, 0.05, controller=lambda t, q, dq: [0, 0], method=method)
    np.testing.assert_allclose(found.q, whole.q, atol=1e-7)


@pytest.mark.parametrize("where", ["tau", "wrench_on_robot", "events"])
def test_other_functions_that_fail_do_the_same(arm, where):
    law = {
        "tau": fails([np.nan, 0]),
        "wrench_on_robot": {"tip": lambda t, q, dq: np.zeros(6 if t < 0.5 else 5)},
        "events": lambda t, q, dq: 1.0 if t < 0.5 else np.nan,
    }[where]
    for method in ("rk4", "dopri5"):
        with pytest.raises(tw.SimulationError) as caught:
            arm.simulate([1, 1], None, 1.0, 0.05, method=method, max_step=0.05, **{where: law})
        found = caught.value.result
        assert 0.4 < found.times[-1] <= 0.5 + 1e-12
        assert np.isfinite(found.q).all()


def test_the_first_call_may_fail_too(arm):
    with pytest.raises(tw.SimulationError, match="t = 0 s") as caught:
        arm.simulate([1, 1], controller=lambda t, q, dq: 1 / 0)
    assert len(caught.value.result) == 1
    np.testing.assert_array_equal(caught.value.result.q[0], [1, 1])
    assert isinstance(caught.value.__cause__, ZeroDivisionError)


@pytest.mark.parametrize("method", ["rk4", "euler", "semi_implicit", "variational", "midpoint"])
def test_steps_too_long_stop_with_time_and_joint(method):
    ur5 = tw.robots.ur5()
    with pytest.raises(tw.SimulationError, match=r"joint '(shoulder|elbow|wrist)\w+'.*smaller dt") as caught:
        ur5.simulate(None, None, 200.0, 0.5, method=method)
    found = caught.value.result
    assert re.search(r"\d s", str(caught.value))
    assert np.isfinite(found.q).all()
    assert len(found) >= 1


LONG_STEPS = ["rk4", "euler", "semi_implicit", "variational", "midpoint"]


@pytest.mark.parametrize(
    ("kinds", "method"), mostly_slow([((k,), m) for k in ("floating", "planar") for m in LONG_STEPS], 4)
)
def test_steps_too_long_on_groups_end_in_the_same_error(method, kinds):
    """Sines of infinite angles, quaternions of no direction: nothing raw comes out."""
    robot = random_robot(4, joints=2, kinds=kinds, floating_base=True)
    state = random_state(robot, 1)
    with pytest.raises(tw.SimulationError, match="smaller dt"):
        robot.simulate(state.q, 1e3 * state.dq, 200.0, 1.0, method=method)


def test_what_grows_without_bound_is_not_blamed_on_the_step_of_an_adaptive_method():
    """dq = exp(3 t) until 1e6."""
    wheel = tw.robots.pendulum().with_gravity([0, 0, 0])
    with pytest.raises(tw.SimulationError, match="push the way it moves") as caught:
        wheel.simulate([0.0], [1.0], 30.0, 0.1, tau=lambda t, q, dq: 3.0 * dq)
    found = caught.value.result
    assert found.times[-1] < np.log(1e6) / 3.0
    np.testing.assert_allclose(found.dq[:, 0], np.exp(3.0 * found.times), rtol=1e-5)


def test_a_spring_too_stiff_for_the_step_is_found_out():
    entry = {"ratio": 50, "stiffness": "1000 kN m/rad", "rotor": {"inertia": "1e-4 kg m^2", "extra": True}}
    robot = tw.robots.pendulum()
    name = robot.joint_names[0]
    robot = robot.with_actuators({"actuators": {name: entry}})
    with pytest.raises(tw.SimulationError, match="unstable") as caught:
        robot.simulate([0.5, 0.5], None, 5.0, 0.01, method="rk4")
    assert len(caught.value.result) > 1
    assert robot.simulate([0.5, 0.5], None, 0.01, 1e-5, method="rk4").relative_drift < 1e-6


def test_a_force_without_bound_ends_the_adaptive_method_with_the_joint():
    """1 / |1 - t| has no integral: no step over it is short enough."""
    wheel = tw.robots.pendulum().with_gravity([0, 0, 0])
    with pytest.raises(tw.SimulationError, match=r"steps shrink.*most of all in joint 'hinge'") as caught:
        wheel.simulate([0.0], [1.0], 2.0, 0.01, tau=lambda t, q, dq: [1 / (abs(1 - t) + 1e-300)])
    assert caught.value.result.times[-1] == pytest.approx(1.0, abs=1e-9)
    assert caught.value.result.dq[-1, 0] == pytest.approx(1 - np.log(1 - caught.value.result.times[-1]), rel=1e-3)


def test_an_interrupt_keeps_what_was_computed(arm):
    def law(t, q, dq):
        if t > 0.35:
            raise KeyboardInterrupt
        return [0, 0]

    with pytest.raises(KeyboardInterrupt) as caught:
        arm.simulate([1, 1], None, 1.0, 0.1, controller=law, method="rk4")
    assert len(caught.value.result) == 5
    assert caught.value.result.stopped == "interrupted"


@pytest.mark.parametrize("method", ["dopri5", "rk4", "semi_implicit"])
@pytest.mark.parametrize("kind", ["tau", "controller", "events", "wrench_on_robot"])
def test_an_interrupt_before_the_first_step_keeps_the_first_state(arm, method, kind):
    """Whichever function it comes in, and if it comes again whenever that function is called."""

    def law(t, q, dq):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as caught:
        arm.simulate([1, 1], method=method, **{kind: {arm.tip: law} if kind == "wrench_on_robot" else law})
    assert len(caught.value.result) == 1
    np.testing.assert_array_equal(caught.value.result.q[0], [1, 1])


@pytest.mark.parametrize("problem", [KeyboardInterrupt(), tw.SimulationError("no")])
@pytest.mark.parametrize("method", ["dopri5", "rk4"])
def test_what_ends_a_run_before_anything_was_computed_keeps_the_first_state(arm, monkeypatch, problem, method):
    def begin(*_, **__):
        raise problem

    monkeypatch.setattr(Stepper, "__init__", begin)
    monkeypatch.setattr(Run, "begin", begin)
    with pytest.raises(type(problem)) as caught:
        arm.simulate([1, 1], method=method)
    assert len(caught.value.result) == 1
    assert not caught.value.result.completed


def test_functions_cannot_change_the_state_they_are_shown(arm):
    def law(t, q, dq):
        q[:], dq[:] = 0.0, 0.0
        return [0.0, 0.0]

    for method in ("rk4", "variational"):
        found = arm.simulate([1, 1], None, 0.3, 0.01, method=method, controller=law, tau=law)
        still = arm.simulate([1, 1], None, 0.3, 0.01, method=method, tau=lambda t, q, dq: [0.0, 0.0])
        np.testing.assert_array_equal(found.q, still.q)


def test_a_motion_gone_wrong_is_remarked_on(arm):
    found = arm.simulate([1, 1], None, 2.0, 0.02, method="euler")
    assert "the energy drift is" in found.remarks[-1]
    assert "the energy drift is" in repr(found)


def test_progress_is_told(arm):
    told = []
    arm.simulate([1, 1], None, 0.1, 0.01, method="rk4", progress=told.append)
    np.testing.assert_allclose(told, 0.1 * np.arange(1, 11), atol=1e-12)


# ── files ──


@pytest.fixture(scope="module")
def result():
    box = tw.robots.floating_box()
    return box.simulate(
        None, [1, 2, 3, 0, 0, 1.0], 0.5, 0.01, contacts=Plane("box", height=-0.1), events=lambda t, q, dq: q[6]
    )


def same(one, other):
    for name, value in vars(one).items():
        if name in ("events", "simulated"):  # a file has no robot in it
            continue
        if name == "work":
            assert value.keys() == other.work.keys()
            assert all(np.array_equal(value[w], other.work[w]) for w in value)
        elif isinstance(value, np.ndarray):
            np.testing.assert_array_equal(value, getattr(other, name), strict=True)
        else:
            assert value == getattr(other, name), name
    assert [(e.name, e.time) for e in one.events] == [(e.name, e.time) for e in other.events]
    for a, b in zip(one.events, other.events, strict=True):
        np.testing.assert_array_equal(np.r_[a.q, a.dq], np.r_[b.q, b.dq])
    assert repr(one) == repr(other)


@pytest.mark.parametrize("kind", ["csv", "npz"])
def test_files_give_every_bit_back(result, tmp_path, kind):
    assert result.events
    path = getattr(result, f"to_{kind}")(tmp_path / f"motion.{kind}")
    read = SimulationResult.load(path)
    same(result, read)
    with pytest.raises(tw.ValueRangeError, match=r"result\.with_robot\(robot\)\.motion"):
        _ = read.motion
    np.testing.assert_array_equal(read.with_robot(tw.robots.floating_box()).motion.q, result.motion.q)
    with pytest.raises(tw.ValueRangeError, match="coordinates differ"):
        read.with_robot(tw.robots.ur5())


def test_the_csv_is_a_motion_for_other_commands(result, tmp_path):
    box = tw.robots.floating_box()
    opened = MotionLog.open(result.to_csv(tmp_path / "motion.csv"), box.model)
    motion = opened.motion(opened.table)
    for name in ("q", "dq", "ddq"):
        np.testing.assert_array_equal(getattr(motion, name), getattr(result, name))
    np.testing.assert_array_equal(motion.time, result.times)


def test_files_that_are_something_else_are_refused(result, tmp_path):
    csv, npz = result.to_csv(tmp_path / "a.csv"), result.to_npz(tmp_path / "a.npz")
    with pytest.raises(tw.NotFoundError, match="nothing"):
        SimulationResult.load(tmp_path / "nothing.npz")
    (tmp_path / "short.npz").write_bytes(npz.read_bytes()[:300])
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    lines = csv.read_text().splitlines(keepends=True)
    (tmp_path / "other.csv").write_text("time,a\n0,1\n")
    (tmp_path / "torn.csv").write_text("".join(lines)[:-30])
    (tmp_path / "worse.csv").write_text("".join([lines[0], "# {}\n", *lines[2:]]))
    (tmp_path / "empty.csv").write_text("".join(lines[:3]))
    (tmp_path / "binary.csv").write_bytes(bytes(range(256)))
    names = ("short.npz", "other.npz", "other.csv", "torn.csv", "worse.csv", "empty.csv", "binary.csv")
    for name in names:
        with pytest.raises(tw.TrajectoryError, match=name):
            SimulationResult.load(tmp_path / name)
    with pytest.raises(tw.ValueRangeError, match="folder"):
        result.to_csv(tmp_path)
    with pytest.raises(tw.ValueRangeError):
        result.to_npz(tmp_path / "no folder" / "a.npz")


SAID_WRONGLY = [
    ("robot", 3), ("coordinate_names", "abc"), ("velocity_names", [1, 2]), ("stopped", None), ("completed", "yes"),
    ("method", ["rk4"]), ("dt", "0.1"), ("steps", 1.5), ("steps", True), ("rejected", None), ("evaluations", {}),
    ("remarks", "none"), ("relative_error", "small"), ("error_estimate", 3.0), ("error_estimate", ["a"] * 6),
    ("events", 5), ("events", [5]), ("events", [{"name": 1, "time": 0.0, "q": [0] * 7, "dq": [0] * 6}]),
    ("events", [{"name": "e", "time": "now", "q": [0] * 7, "dq": [0] * 6}]),
    ("events", [{"name": "e", "time": 0.0, "q": [0] * 3, "dq": [0] * 6}]),
    ("events", [{"name": "e", "time": 0.0, "q": ["a"] * 7, "dq": [0] * 6}]),
]  # fmt: skip


@pytest.mark.parametrize("lost", [1, 3, 40])
def test_a_csv_that_ends_within_its_last_line_is_refused(tmp_path, lost):
    """A number that has lost its last digits is a number."""
    path = tw.robots.pendulum().simulate([0.3], [0.0], 0.1, 0.01).to_csv(tmp_path / "run.csv")
    path.write_bytes(path.read_bytes()[:-lost])
    with pytest.raises(tw.TrajectoryError, match="cut short"):
        SimulationResult.load(path)


@pytest.mark.parametrize("kind", ["csv", "npz"])
@pytest.mark.parametrize(("word", "value"), SAID_WRONGLY, ids=[f"{k}-{w}" for k, (w, _) in enumerate(SAID_WRONGLY)])
def test_files_whose_words_are_of_another_type_are_refused(result, tmp_path, kind, word, value):
    path = getattr(result, f"to_{kind}")(tmp_path / "a")
    if kind == "csv":
        first, said, *rest = path.read_text().split("\n")
        path.write_text("\n".join([first, "# " + json.dumps({**json.loads(said[1:]), word: value}), *rest]))
    else:
        with np.load(path) as archive:
            arrays = dict(archive)
        arrays["said"] = np.array(json.dumps({**json.loads(str(arrays["said"])), word: value}))
        with path.open("wb") as file:
            np.savez(file, **arrays)
    with pytest.raises(tw.TrajectoryError):
        SimulationResult.load(path)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("q", np.zeros((3, 7))),
        ("times", np.zeros((51, 1))),
        ("dq", np.array(["a"] * 51)),
        ("work_torques", np.float64(0)),
    ],
)
def test_archives_whose_arrays_do_not_fit_are_refused(result, tmp_path, name, value):
    path = result.to_npz(tmp_path / "a.npz")
    with np.load(path) as archive:
        arrays = {**archive, name: value}
    np.savez(path, **arrays)
    with pytest.raises(tw.TrajectoryError):
        SimulationResult.load(path)


def test_a_csv_whose_words_are_nested_without_end_is_refused(result, tmp_path):
    first, _, rest = result.to_csv(tmp_path / "a.csv").read_text().split("\n", 2)
    (tmp_path / "deep.csv").write_text(f"{first}\n# {'[' * 200_000}\n{rest}")
    with pytest.raises(tw.TrajectoryError, match=r"deep\.csv"):
        SimulationResult.load(tmp_path / "deep.csv")


def test_files_from_before_the_error_was_estimated_are_read(result, tmp_path):
    path = result.to_csv(tmp_path / "a.csv")
    first, said, rest = path.read_text().split("\n", 2)
    words = json.loads(said[1:])
    del words["relative_error"], words["error_estimate"]
    path.write_text(f"{first}\n# {json.dumps(words)}\n{rest}")
    again = SimulationResult.load(path)
    assert np.isnan(again.error_estimate).all()
    assert np.isnan(again.relative_error)
    np.testing.assert_array_equal(again.q, result.q)


def test_a_file_is_known_by_what_is_in_it(result, tmp_path):
    for name in ("plain", "text.csv"):
        assert np.array_equal(SimulationResult.load(result.to_npz(tmp_path / name)).q, result.q)


@pytest.mark.parametrize("method", ["dopri5", "rk4"])
@pytest.mark.parametrize("controller", [None, lambda t, q, dq: [0, 0]])
def test_the_last_state_is_at_the_duration_to_the_last_bit(arm, method, controller):
    """70 times 0.7 / 70 is more than 0.7."""
    found = arm.simulate([1, 1], duration=0.7, dt=0.01, method=method, controller=controller)
    assert found.times[-1] == 0.7
    assert len(found) == 71


def test_an_event_is_a_number_and_no_question(arm):
    with pytest.raises(tw.SimulationError, match=r"gave False .* number whose sign changes"):
        arm.simulate([1, 1], events=Event(lambda t, q, dq: q[0] > 2.0, "over"))


def test_pictures_are_drawn(result, tmp_path):
    pytest.importorskip("matplotlib")
    assert result.plot(tmp_path / "motion").read_bytes()[:4] == b"\x89PNG"


def test_pictures_have_a_panel_for_each_unit_and_no_colour_twice(tmp_path, monkeypatch):
    """Lengths, angles and quaternions apart; the eight that move most in colours or dashes of their own."""
    pytest.importorskip("matplotlib")
    from twistwrench.viz import style

    drawn = []
    monkeypatch.setattr(style, "save", lambda figure, path: drawn.append(figure))
    dog = tw.robots.quadruped()
    dog.simulate(None, np.ones(dog.nv), 0.02, 0.01).plot(tmp_path / "a.png")
    cart = tw.robots.cart_pole()
    cart.simulate(None, np.ones(cart.nv), 0.02, 0.01).plot(tmp_path / "b.png")
    shown = [{a.get_title(loc="left"): [x.get_label() for x in a.lines] for a in f.axes[:-2]} for f in drawn]
    assert {title: len(labels) for title, labels in shown[0].items()} == {
        "Angles [rad]: the 8 of 12 that move most": 12, "Positions [m]": 3, "Orientations: quaternions": 4,
    }  # fmt: skip
    assert shown[0]["Orientations: quaternions"] == [f"root_joint.q{x}" for x in "wxyz"]
    assert sorted(map(len, shown[1].values())) == [1, 1]
    for axes in (a for f in drawn for a in f.axes[:-2]):
        looks = [(x.get_color(), str(x._dash_pattern)) for x in axes.lines if x.get_color() != style.PALE]
        assert len(set(looks)) == len(looks) <= style.MAX_COLOURED


def test_a_joint_has_one_colour_in_every_picture(tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    from twistwrench.viz import style

    drawn = []
    monkeypatch.setattr(style, "save", lambda figure, path: drawn.append(figure))
    arm = tw.robots.ur5()
    arm.simulate(None, np.ones(arm.nv), 0.02, 0.01).plot(tmp_path / "a.png")
    tw.trajectories.move(arm, np.zeros(6), np.full(6, 0.3)).plot(tmp_path / "b.png")
    for figure in drawn:
        shown = {line.get_label(): line.get_color() for axis in figure.axes for line in axis.lines}
        assert [shown[name] for name in arm.joint_names] == list(style.SERIES[:6])


LONG = "a_rather_long_namespace/and_a_long_name_of_a_link_"


@pytest.fixture(scope="module")
def with_long_names():
    """A simulation of the quadruped, some of whose joints have long names."""
    text = tw.robots.path_of("quadruped").read_text().replace("FL_", LONG + "FL_")
    robot = tw.load(text, floating_base=True)
    assert robot.nv == tw.robots.quadruped().nv
    return robot.simulate(None, -1.23456e-5 * np.arange(1.0, robot.nv + 1), 0.02, 0.01)


@pytest.mark.parametrize("width", [60, 80, 110])
def test_tables_fold_names_and_cut_no_number(with_long_names, width):
    """In a terminal of any width, and in a pipe."""
    from rich.console import Console

    found = with_long_names
    console = Console(width=width, record=True, file=StringIO())
    console.print(printed(found.blocks(), console.width))
    said = console.export_text()
    assert max(map(len, said.splitlines())) <= width
    numbers = set(re.findall(r"(?<![\w.])-?\d[\d.]*(?:e[-+]\d+)?(?![\w.])", said))
    for x in (found.q[-1], found.dq[-1], found.q.min(axis=0)):
        assert {f"{v:.4g}" if abs(v) > 1e-12 else "0" for v in x} <= numbers
    assert "…" not in said.split("Energies")[0]
    names = "".join(line.split()[0] for line in said.splitlines() if line.split())  # folded names, put together again
    assert f"{LONG}FL_thigh_joint" in names


# ── the command ──


def twistwrench(*arguments):
    return CliRunner().invoke(main, ["simulate", *map(str, arguments)])


def test_the_command_prints_and_writes(tmp_path):
    done = twistwrench(
        "planar_2r", "--duration", 0.5, "--step", 0.01, "--method", "rk4", "--at", "joint1=90", "--velocity", "joint2=-180",
        "--torque", "joint1=3", "--degrees", "--csv", tmp_path / "a.csv", "--npz", tmp_path / "a.npz",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    for word in ("joint1", "drift", "DONE: simulated 0.5 s.", "wrote", "50 steps"):
        assert word in done.output
    found = SimulationResult.load(tmp_path / "a.npz")
    np.testing.assert_allclose(found.q[0], [np.pi / 2, 0])
    np.testing.assert_allclose(found.dq[0], [0, -np.pi])
    np.testing.assert_allclose(found.tau[0], [3, 0])
    assert "joint1 [deg],joint2 [deg],joint1.vel [deg/s]" in (tmp_path / "a.csv").read_text()
    again = SimulationResult.load(tmp_path / "a.csv")
    for name in ("q", "dq", "ddq", "tau"):
        np.testing.assert_allclose(getattr(again, name), getattr(found, name), rtol=1e-14, atol=1e-14)
    for flags in ([], ["--degrees"]):  # the header names its unit, so the file means the same either way
        motion = tw.Motion.from_file(tmp_path / "a.csv", tw.robots.planar_2r(), degrees=bool(flags))
        np.testing.assert_allclose(motion.q, found.q, rtol=1e-14, atol=1e-14)
        torques = CliRunner().invoke(main, ["torques", "planar_2r", "--trajectory", str(tmp_path / "a.csv"), *flags])
        assert torques.exit_code == 1 and torques.output.startswith("UNSURE: no torque limit"), torques.output
        assert "cut off" not in torques.output  # the given torque is constant, and so is the computed one
    with pytest.raises(tw.ValueRangeError, match="has no robot that defines its angles"):
        again.to_csv(tmp_path / "b.csv", degrees=True)


def test_a_start_inside_the_ground_is_remarked_on_with_its_point_and_depth():
    """k d^n of 1e5 · 0.3^1.5 N against a weight of 60 N; and what stands at rest, or lands, is not a reason to speak."""
    command = ("floating_box", "--duration", 0.01, "--ground", 0, "--touch", "box", "--touch", "box:0.1,0,0.05")
    inside = twistwrench(*command, "--at", "root_joint=1,0,0,0,0,0,-0.3")
    said = " ".join(inside.output.split())
    assert "point (0, 0, 0) of 'box' starts 0.3 m below the plane" in said
    for height in (0.0, -0.001, 0.3):  # at 1e5 N/m^1.5 it rests at 0.7 mm or more
        fine = twistwrench(*command, "--at", f"root_joint=1,0,0,0,0,0,{height}")
        assert fine.exit_code == 0 and "below the plane" not in fine.output
    box = tw.robots.floating_box().with_gravity([0, 0, 0])
    found = box.simulate([1, 0, 0, 0, 0, 0, -0.01], duration=1e-3, contacts=Plane("box"))
    assert "starts 0.01 m below" in found.remarks[0]


def test_degrees_are_those_of_planar_joints_too(tmp_path):
    """As in the report: theta is an angle, x and y are not."""
    (tmp_path / "sled.urdf").write_text(SLED)
    for given in (["--at", "slide=1,2,90"], ["--at", "1,2,90"]):
        place = tmp_path / "sled.npz"
        done = twistwrench(
            tmp_path / "sled.urdf", "--degrees", *given, "--duration", 0.01, "--npz", place, "--overwrite"
        )
        assert done.exit_code == 0, done.output
        np.testing.assert_allclose(SimulationResult.load(place).q[0], [1, 2, np.pi / 2])
    done = twistwrench(
        tmp_path / "sled.urdf",
        "--degrees",
        "--velocity",
        "slide=90,1,2",
        "--duration",
        0.01,
        "--npz",
        place,
        "--overwrite",
    )
    assert done.exit_code == 0, done.output
    np.testing.assert_allclose(SimulationResult.load(place).dq[0], [np.pi / 2, 1, 2])


def test_an_interrupted_command_shows_and_writes_what_there_is(tmp_path, monkeypatch):
    rates, pressed = System.rates, iter([KeyboardInterrupt])

    def until_half(self, t, y, out):
        if t > 0.5:
            for interrupt in pressed:
                raise interrupt
        rates(self, t, y, out)

    monkeypatch.setattr(System, "rates", until_half)
    done = twistwrench("planar_2r", "--step", 0.01, "--method", "midpoint", "--npz", tmp_path / "a.npz")
    assert done.exit_code == ExitCode.INTERRUPTED, done.output
    assert "interrupted" in done.output
    assert 0.5 <= SimulationResult.load(tmp_path / "a.npz").times[-1] <= 0.52


@pytest.mark.parametrize("problem", [KeyboardInterrupt(), tw.SimulationError("no")])
def test_a_command_that_ends_before_its_first_step_shows_the_first_state(monkeypatch, problem):
    def begin(*_, **__):
        raise problem

    monkeypatch.setattr(Stepper, "__init__", begin)
    done = twistwrench("planar_2r")
    interrupted = isinstance(problem, KeyboardInterrupt)
    assert done.exit_code == (ExitCode.INTERRUPTED if interrupted else ExitCode.NO), done.output
    assert done.stderr == ("interrupted\n" if interrupted else "")
    assert "1 states to 0 s" in done.output


def test_the_command_knows_the_ground_and_what_is_carried():
    done = twistwrench(
        "floating_box", "--duration", 0.4, "--ground", -0.2, "--touch", "box", "--payload", 1, "--step", 0.01
    )
    assert done.exit_code == 0, done.output
    assert "box touches the plane at 0.20" in done.output
    assert "work of contacts" in done.output


@pytest.mark.parametrize("mu", [0.0, 0.3])
def test_the_ground_of_the_command_has_the_friction_it_was_given(tmp_path, mu):
    """A box that slides on four feet loses mu g of its speed in a second, whatever it weighs."""
    feet = [x for a in (-1, 1) for b in (-1, 1) for x in ("--touch", f"box:{a},{b},0")]
    done = twistwrench(
        "floating_box", "--duration", 0.5, "--ground", 0, "--contact", f"1e4,1,{mu}", *feet, "--velocity",
        "root_joint=0,0,0,3,0,0", "--step", 0.01, "--npz", tmp_path / "a.npz",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    lost = 3.0 - SimulationResult.load(tmp_path / "a.npz").dq[-1, 3]
    assert lost == pytest.approx(mu * 9.81 * 0.5, rel=0.1, abs=1e-9)  # it comes down on its feet first


def test_the_command_says_first_how_it_ended_and_what_was_not_simulated(tmp_path):
    """A joint that falls past its stop, with friction in the file: both are said above all numbers."""
    text = tw.robots.path_of("pendulum").read_text()
    stop = '<limit lower="-0.2" upper="2"/><dynamics damping="0.1"/></joint>'
    (tmp_path / "r.urdf").write_text(text.replace("</joint>", stop, 1).replace('type="continuous"', 'type="revolute"'))
    done = twistwrench(tmp_path / "r.urdf", "--at", "1.0", "--duration", 1.5, "--step", 0.01)
    words = " ".join(done.stdout.split())
    assert words.startswith("DONE: simulated 1.5 s. Energy drift")
    assert "! hinge is at -0.945" in words and "limit -0.2. Nothing held the joint" in words
    assert "with friction" in words and "work of friction" in words
    held = twistwrench(tmp_path / "r.urdf", "--at", "1.0", "--duration", 1.5, "--stop-at-limits", "--no-friction")
    words = " ".join(held.stdout.split())
    assert re.match(r"STOPPED at t = [\d.]+ s: hinge reached its lower position limit, -0.2 rad", words)
    assert "Nothing held" not in words
    assert "without friction" in words and "work of friction" not in words


def test_the_command_writes_what_it_has_when_a_step_is_unstable(tmp_path):
    done = twistwrench("ur5", "--method", "rk4", "--step", 0.3, "--duration", 30, "--csv", tmp_path / "a.csv")
    assert done.exit_code == 1, done.output
    assert "STOPPED" in done.output
    assert "unstable" in done.output
    assert len(SimulationResult.load(tmp_path / "a.csv")) > 1


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--at", "joint9=1"], "joint9"),
        (["--at", "joint1"], "JOINT=VALUE"),
        (["--at", "joint1=1", "--at", "joint1=2"], "given twice"),
        (["--velocity", "joint1=fast"], "expected 1 number"),
        (["--at", "1,2,3"], "2 numbers"),
        (["--touch", "tip"], "--ground"),
        (["--contact", "1e5,0.3,0.5"], "--ground"),
        (["--ground", "0", "--contact", "1,2"], "--contact"),
        (["--method", "magic"], "magic"),
        (["--step", "0"], "dt is 0"),
        (["--csv", "no/such/folder/a.csv"], "no such folder"),
    ],
)
def test_bad_input_of_the_command_is_one_line(arguments, says):
    done = twistwrench("planar_2r", *arguments)
    assert done.exit_code == 2
    assert says in done.output
    assert done.output.startswith("error: ")
    assert done.output.count("\n") == 1


@pytest.mark.parametrize("keyword", ["tau", "controller"])
def test_labelled_torques_of_a_function_are_not_read_by_position(keyword):
    """As labelled constants are refused: other labels in another order would be other torques."""
    pd = pytest.importorskip("pandas")
    arm = tw.robots.planar_2r()
    torques = pd.Series([1.0, 2.0], index=["joint2", "joint1"])
    with pytest.raises(tw.SimulationError, match="named columns"):
        arm.simulate([0.0, 0.0], duration=0.1, dt=0.01, **{keyword: lambda t, q, dq: torques})
