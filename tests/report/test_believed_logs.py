"""Right logs are believed, wrong ones are not: the first word of ``torques``, and what ``identify`` makes of pauses and stamps."""

from __future__ import annotations

import json
import warnings

import numpy as np
import pytest
from click.testing import CliRunner
from quick import mostly_slow

import twistwrench as tw
from twistwrench.cli.main import main

LINK = (
    '<link name="{}"><inertial><origin xyz=".5 0 0"/><mass value="1"/>'
    '<inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
JOINT = (
    '<joint name="{}" type="revolute"><origin {}/><parent link="{}"/><child link="{}"/><axis xyz="0 1 0"/>'
    '<limit lower="-3.1" upper="3.1" velocity="{}" effort="{}"/></joint>'
)
TOOL = '<link name="tool"/><joint name="tf" type="fixed"><origin xyz="1 0 0"/><parent link="l2"/><child link="tool"/></joint>'


def arm(effort=(30, 10), velocity=5):
    """Two links of 1 kg and 1 m that turn about y: stretched out, gravity loads the joints with 19.6 and 4.9 N m."""
    links = '<link name="base"/>' + LINK.format("l1") + LINK.format("l2")
    joints = JOINT.format("shoulder", "", "base", "l1", velocity, effort[0])
    joints += JOINT.format("elbow", 'xyz="1 0 0"', "l1", "l2", velocity, effort[1])
    return f'<robot name="arm2">{links}{joints}{TOOL}</robot>'


def run(*arguments):
    return CliRunner().invoke(main, [str(x) for x in arguments], env={"COLUMNS": "200"})


def first_word(result):
    """The word before the colon, of the first line that is not a note."""
    return next(line for line in result.output.splitlines() if not line.startswith("note:")).partition(":")[0]


def write(path, head, *columns, form="%.9g"):
    np.savetxt(path, np.c_[columns], delimiter=",", header=",".join(head), comments="", fmt=form)
    return path


class Bench:
    """A robot with a motion that it makes with ease, and what a file of it is written from."""

    def __init__(self, name, folder):
        self.name, self.folder, self.options = name, folder, []
        if name == "arm":
            self.asked = folder / "arm.urdf"
            self.asked.write_text(arm())
            self.robot = tw.load(self.asked)
        else:
            self.asked, self.robot = name, getattr(tw.robots, name)()
        self.names = list(self.robot.joint_names)
        self.middle = {
            "arm": np.array([0.5, 0.55]),
            "ur5": np.array([0.3, -1.2, 1.1, -0.6, 0.4, 0.2]),
            "panda": np.array([0.1, -0.3, 0.2, -1.7, 0.1, 1.6, 0.3]),
        }[name]

    def move(self, t):
        """A quintic of 4 s from rest to rest."""
        s = (t / 4) ** 3 * (10 - 15 * t / 4 + 6 * (t / 4) ** 2)
        if self.name == "arm":
            return np.c_[s, 0.3 + 0.5 * s]
        return self.middle + (s[:, None] - 0.5) * 0.5 * np.cos(np.arange(len(self.names)))

    def waves(self, t):
        """Positions, velocities and accelerations of two sines a joint, and torques that were measured with noise."""
        n = np.arange(len(self.names))
        w = np.c_[1.3 + 0.3 * n, 2.9 - 0.2 * n]
        a, p = np.c_[0.3 - 0.02 * n, 0.12 + 0 * n], np.c_[n, 2 * n + 1]
        x = [(a * w**k * np.sin(w * t[:, None, None] + p + k * np.pi / 2)).sum(axis=2) for k in range(3)]
        x[0] += self.middle
        tau = self.robot.inverse_dynamics(*x)
        return *x, tau + np.random.default_rng(0).normal(0, 0.01 * tau.std(axis=0) + 1e-3, tau.shape)

    def file(self, *columns, head=None):
        return write(self.folder / "log.csv", ["time", *self.names, *(head or [])], *columns)

    def with_torques(self, t, q, tau):
        return self.file(t, q, tau, head=[f"{n}.torque" for n in self.names])

    def torques(self, path):
        return run("torques", self.asked, "--trajectory", path, *self.options)


# Right logs.


def rounded_stamps(b):
    """29: stamps rounded to 10 ms at 125 Hz, in steps of 0 or 10 ms."""
    t = np.arange(0, 4, 0.008)
    return b.file(np.round(t, 2), b.move(t))


def slow(b):
    """30: a row a second for ten minutes, in a column that says so."""
    t = np.arange(600.0)
    middle = np.c_[np.sin(t / 100), 0 * t + 0.3]
    path = (
        b.file(t, *middle.T)
        if b.name == "arm"
        else b.file(t, b.middle + 0.8 * np.sin(t[:, None] / 80 + np.arange(len(b.names))))
    )
    path.write_text(path.read_text().replace("time,", "time [s],", 1))
    return path


def noisy(b):
    """31: four decimals at 1 kHz with noise of 1e-3 rad and stamps off by up to 0.4 ms."""
    rng, t = np.random.default_rng(0), np.arange(0, 4, 0.001)
    stamps = np.round(t + rng.uniform(-4e-4, 4e-4, len(t)), 6)
    q = b.move(t)
    return b.file(stamps, np.round(q + rng.normal(0, 1e-3, q.shape), 4))


def gradient_ends(b):
    """32: velocities by ``np.gradient``, one-sided in the first and the last row."""
    rng, n = np.random.default_rng(2), np.arange(600) * 0.01
    t = n + rng.normal(0, 2e-4, 600)
    if b.name == "arm":
        b.asked.write_text(arm((90, 60)))
        q = np.c_[0.5 * np.sin(2.3 * t + 1.5) - 0.2, 0.5 * np.cos(1.9 * t)]
    else:
        q = b.waves(t)[0]
    q = q + rng.normal(0, 1e-5, q.shape)
    return b.file(t, q, np.gradient(q, n, axis=0), head=[f"{name}.vel" for name in b.names])


def one_stamp(b):
    """33: one stamp of 5000 is late by 1 ms."""
    t = np.arange(0, 20, 0.004)
    q, _, _, tau = b.waves(t)
    t[2500] += 0.001
    return b.with_torques(t, q, tau)


def pause(b):
    """34: nothing is logged for 2 s, while the motion goes on."""
    t = np.arange(0, 20, 0.004)
    q, _, _, tau = b.waves(t)
    kept = (t < 8) | (t >= 10)
    return b.with_torques(t[kept], q[kept], tau[kept])


def pause_and_stamp(b):
    """33 and 34 at once."""
    t = np.arange(0, 20, 0.004)
    q, _, _, tau = b.waves(t)
    kept = (t < 8) | (t >= 10)
    t[1000] -= 0.001
    return b.with_torques(t[kept], q[kept], tau[kept])


def four_decimals(b):
    """Positions of 100 Hz with four decimals."""
    t = np.arange(0, 4, 0.01)
    return b.file(t, np.round(b.move(t), 4))


RIGHT = [
    *((kind, name) for kind in (rounded_stamps, slow, noisy, gradient_ends, one_stamp, pause) for name in ("arm", "ur5", "panda")),
    (pause_and_stamp, "ur5"),
    (four_decimals, "panda"),
]  # fmt: skip


# Wrong logs.


def milliseconds(b):
    t = np.arange(0, 4, 0.01)
    return b.file(1000 * t, b.move(t))


def degrees(b):
    t = np.arange(0, 4, 0.01)
    return b.file(t, np.degrees(b.move(t)))


def swapped(b):
    """Positions of two neighbouring joints in each other's columns, beside torques that are right."""
    t = np.arange(0, 20, 0.01)
    q, _, _, tau = b.waves(t)
    return b.with_torques(t, q[:, [0, 2, 1, *range(3, q.shape[1])]], tau)


def turned_sign(b):
    t = np.arange(0, 20, 0.01)
    q, _, _, tau = b.waves(t)
    return b.with_torques(t, q, -tau)


def clipped(b):
    """23: measured torques that stand at one number."""
    if b.name == "arm":
        t = np.arange(0, 4, 0.01)
        return b.with_torques(t, b.move(t), np.c_[0 * t - 15, 0 * t - 4])
    t = np.arange(0, 20, 0.01)
    q, _, _, tau = b.waves(t)
    bound = 0.6 * np.abs(tau).max(axis=0)
    return b.with_torques(t, q, np.clip(tau, -bound, bound))


def velocities_in_degrees(b):
    t = np.arange(0, 10, 0.01)
    q, dq, _, _ = b.waves(t)
    return b.file(t, q, np.degrees(dq), head=[f"{n}.vel" for n in b.names])


def newton_millimetres(b):
    t = np.arange(0, 20, 0.01)
    q, _, _, tau = b.waves(t)
    return b.with_torques(t, q, 1000 * tau)


def jump(b):
    """All positions step by a radian for the second half."""
    t = np.arange(0, 4, 0.01)
    return b.file(t, b.move(t) + np.where(t > 2, 1.0, 0.0)[:, None])


def limits_in_degrees(b):
    """22."""
    t, limits = np.arange(0, 4, 0.01), b.robot.limits
    columns = np.c_[np.degrees(np.c_[limits.lower, limits.upper, limits.velocity]), limits.effort]
    rows = [",".join([name, *map(repr, row)]) for name, row in zip(b.names, columns.tolist(), strict=True)]
    table = b.folder / "limits.csv"
    table.write_text("\n".join(["joint,lower,upper,velocity,effort", *rows]) + "\n")
    b.options = ["--limits", table]
    return b.file(t, b.move(t))


def unassigned(b):
    """20: columns that vary and that no joint is given, and the option that holds joints still."""
    t = np.arange(0, 4, 0.01)
    b.options = ["--lock-missing"]
    head = [b.names[0], *(f"w{k}" for k in range(1, len(b.names)))]
    return write(b.folder / "log.csv", ["time", *head], t, b.move(t))


WRONG = [
    (milliseconds, "arm", "LOOK AGAIN"), (milliseconds, "ur5", "LOOK AGAIN"),
    (degrees, "arm", "LOOK AGAIN"), (degrees, "ur5", "LOOK AGAIN"),
    (swapped, "ur5", "UNSURE or LOOK AGAIN"), (swapped, "panda", "UNSURE or LOOK AGAIN"),
    (turned_sign, "ur5", "LOOK AGAIN"), (turned_sign, "panda", "LOOK AGAIN"),
    (clipped, "arm", "UNSURE or LOOK AGAIN"), (clipped, "ur5", "UNSURE or LOOK AGAIN"),
    (velocities_in_degrees, "arm", "LOOK AGAIN"), (velocities_in_degrees, "panda", "LOOK AGAIN"),
    (newton_millimetres, "arm", "LOOK AGAIN"), (newton_millimetres, "ur5", "LOOK AGAIN"),
    (jump, "arm", "UNSURE or LOOK AGAIN"), (jump, "ur5", "UNSURE or LOOK AGAIN"),
    (limits_in_degrees, "arm", "LOOK AGAIN"), (limits_in_degrees, "ur5", "LOOK AGAIN"),
    (unassigned, "ur5", "UNSURE or LOOK AGAIN"), (unassigned, "panda", "UNSURE or LOOK AGAIN"),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "name"), mostly_slow(RIGHT, 3), ids=lambda x: getattr(x, "__name__", x))
def test_right_logs_are_believed(kind, name, tmp_path):
    bench = Bench(name, tmp_path)
    result = bench.torques(kind(bench))
    assert first_word(result) == "OK" and result.exit_code == 0, result.output


@pytest.mark.parametrize(("kind", "name", "words"), mostly_slow(WRONG, 3), ids=lambda x: getattr(x, "__name__", x))
def test_wrong_logs_are_not_believed(kind, name, words, tmp_path):
    bench = Bench(name, tmp_path)
    result = bench.torques(kind(bench))
    assert first_word(result) in words.split(" or ") and result.exit_code != 0, result.output


# What identify makes of the log of findings 33 and 34.


def known_log(folder):
    """The robot's file, times, positions and torques of 20 s at 250 Hz, with viscous friction that the file lacks."""
    asked = folder / "big.urdf"
    asked.write_text(arm((300, 300), 50))
    t = np.arange(0, 20, 0.004)
    w, a, p = np.array([1.3, 2.9, 1.9, 3.7]), np.array([0.9, 0.4, 0.8, 0.5]), np.array([0, 1, 2, 0])
    x = [a * w**k * np.sin(w * t[:, None] + p + k * np.pi / 2) for k in range(3)]
    q, dq, ddq = (np.c_[v[:, 0] + v[:, 1], v[:, 2] + v[:, 3]] for v in x)
    tau = tw.load(asked).inverse_dynamics(q, dq, ddq) + 0.5 * dq + np.random.default_rng(0).normal(0, 0.05, q.shape)
    return asked, t, q, tau


HEAD = ["time", "shoulder", "elbow", "shoulder.torque", "elbow.torque"]


def identified(folder, asked, t, q, tau):
    """Held-out residual, first words and exit code of ``identify --out``, and whether the file was written."""
    out, told = folder / "new.urdf", folder / "found.json"
    log = write(folder / "log.csv", HEAD, t, q, tau)
    result = run("identify", asked, log, "--cutoff", 20, "--out", out, "--json", told)
    return json.loads(told.read_text())["held_out"]["all"], result, out.exists()


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    """Held-out residual of the log without a fault."""
    folder = tmp_path_factory.mktemp("clean")
    left, result, written = identified(folder, *known_log(folder))
    assert result.output.startswith("OK") and result.exit_code == 0 and written
    return left


@pytest.mark.slow
def test_a_log_with_one_wrong_stamp_is_identified_and_written(clean, tmp_path):
    asked, t, q, tau = known_log(tmp_path)
    t[2500] += 0.001
    left, result, written = identified(tmp_path, asked, t, q, tau)
    assert result.output.startswith("OK") and result.exit_code == 0 and written
    assert left < 1.2 * clean
    assert "the time stamp of 1 row is 0.001 s late, at t = 10.0010 s" in " ".join(result.output.split())
    assert "Left out: the time stamp of 1 row" in " ".join(
        run("torques", asked, "--trajectory", tmp_path / "log.csv").output.split()
    )


def test_a_row_with_one_wrong_position_is_left_out(clean, tmp_path):
    asked, t, q, tau = known_log(tmp_path)
    q[2500, 0] += 0.05
    left, result, written = identified(tmp_path, asked, t, q, tau)
    assert result.exit_code == 0 and written and left < 1.2 * clean
    assert "shoulder leaves its path by 2.86 degrees for a single row" in " ".join(result.output.split())


@pytest.mark.parametrize("seconds", mostly_slow([0.1, 2.0, 10.0], 2))
def test_a_pause_is_not_filled(clean, tmp_path, seconds):
    asked, t, q, tau = known_log(tmp_path)
    kept = (t < 8) | (t >= 8 + seconds)
    left, result, written = identified(tmp_path, asked, t[kept], q[kept], tau[kept])
    assert result.output.startswith("OK") and result.exit_code == 0 and written
    assert left < 1.2 * clean
    assert f"1 gap, {seconds + 0.004:.3g} s in all" in result.output


def test_rows_of_a_long_log_stay_out_of_its_pauses(clean, tmp_path, monkeypatch):
    """In windows, as for logs above 200,000 samples."""
    monkeypatch.setattr("twistwrench.identification.log_windows.MOST_STATES", 3000)
    asked, t, q, tau = known_log(tmp_path)
    kept = (t < 8) | (t >= 8.5)
    log = write(tmp_path / "log.csv", HEAD, t[kept], q[kept], tau[kept])
    found = tw.identification.identify(tw.load(asked), log, cutoff=20.0)
    assert found.verdict.ok and found.held_out.all < 1.2 * clean


def payload_log():
    """A clean log of a UR5 that carries 2 kg, as a motion of the empty one."""
    t, n = np.arange(0, 20, 0.005), np.arange(6)
    w = 2 * np.pi * 0.1 * np.array([1, 3, 5])
    phase = np.c_[n, 2 * n + 1, 3 * n + 2]
    x = [(0.35 * w**k * np.sin(w * t[:, None, None] + phase + k * np.pi / 2)).sum(axis=2) for k in range(3)]
    ur5 = tw.robots.ur5()
    loaded = ur5.with_payload(tw.SpatialInertia.from_com(2.0, [0.05, 0.02, 0.1]))
    q, dq, ddq = x
    tau = np.asarray(loaded.inverse_dynamics(q, dq, ddq))
    size = tau.std(axis=0)
    tau = tau + 0.1 * size * np.tanh(dq / 0.05) + np.random.default_rng(0).normal(0, 0.02 * size, tau.shape)
    return ur5, tw.Motion(t, q, dq, ddq, tau, robot=ur5, in_seconds=True)


@pytest.mark.parametrize(
    ("factor", "word"),
    [(1.0, "OK"), *(pytest.param(factor, "LOOK AGAIN", marks=pytest.mark.slow) for factor in (1e3, -1.0))],
)
def test_a_payload_is_not_another_unit(factor, word):
    """The file may be wrong by much: 2 kg at a light wrist are ten times what its links weigh. N mm and signs are found."""
    ur5, log = payload_log()
    other = tw.Motion(log.time, log.q, log.dq, log.ddq, factor * log.tau, robot=ur5, in_seconds=True)
    found = tw.identification.identify(ur5, other, cutoff=10.0, friction_speed=0.05, shift=0.0)
    assert found.verdict.word == word, found.doubts
    assert {doubt.kind for doubt in found.doubts if doubt.refuses} == {
        1.0: set(),
        1e3: {"gain"},
        -1.0: {"torque-sign"},
    }[factor]


def test_rates_of_arrays_are_looked_at():
    arm, t = tw.robots.pendulum(), np.arange(0, 4, 0.01)
    q, dq, ddq = np.sin(3 * t)[:, None], 3 * np.cos(3 * t)[:, None], -9 * np.sin(3 * t)[:, None]
    with pytest.warns(tw.ModelWarning, match=r"velocity column is 57\.3 times the slope"):
        motion = tw.Motion(t, q, np.degrees(dq), robot=arm)
    assert any(note.startswith("LOOK AGAIN") and "deg/s" in note for note in motion.notes)
    with pytest.warns(tw.ModelWarning, match="is next to nothing"):
        assert tw.Motion(t, q, 0 * dq, 0 * ddq, robot=arm).notes
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert tw.Motion(t, q, dq, ddq, robot=arm).notes == ()


# One number each of the findings that the lists above try.


def test_a_clipped_torque_column_is_named(tmp_path):
    bench = Bench("arm", tmp_path)
    said = " ".join(bench.torques(clipped(bench)).output.split())
    assert said.startswith("UNSURE: the measured torque of shoulder is exactly -15 N m in 100 % of the rows")


def test_rest_and_coarse_torques_are_not_cut_off(tmp_path):
    bench = Bench("arm", tmp_path)
    t = np.arange(0, 8, 0.01)
    q = bench.move(np.clip(t - 2, 0, 4))  # at rest for two seconds at both ends
    still = np.zeros_like(q)
    tau = bench.robot.inverse_dynamics(q, still, still)
    for measured in (tau, np.round(tau), np.round(tau / 2) * 2):
        assert first_word(bench.torques(bench.with_torques(t, q, measured))) == "OK"


def test_rounded_stamps_become_the_clock(tmp_path):
    bench = Bench("arm", tmp_path)
    motion = tw.Motion.from_file(rounded_stamps(bench), bench.robot)
    assert len(motion) == 500 and np.allclose(np.diff(motion.time), 0.008, rtol=1e-4)
    held = abs(float(bench.robot.gravity_forces([0.0, 0.3])[0]))  # at the start, where the torque is largest
    assert np.abs(motion.torques()[:, 0]).max() == pytest.approx(held, rel=2e-3)
    assert any("a steady clock of 125 Hz is taken" in note for note in motion.notes)
    t = np.repeat(np.arange(0, 4, 0.016), 2)  # each row twice: no clock is made of that
    again = tw.Motion.from_file(bench.file(t, bench.move(t)), bench.robot)
    assert len(again) == 250 and np.allclose(np.diff(again.time), 0.016)


def test_a_slow_log_is_asked_about(tmp_path):
    bench = Bench("arm", tmp_path)
    path = slow(bench)
    assert first_word(bench.torques(path)) == "OK"
    path.write_text(path.read_text().replace("time [s],", "time,", 1))
    result = bench.torques(path)
    assert first_word(result) == "UNSURE" and "as row numbers do" in " ".join(result.output.split())


def test_the_smoothed_answer_is_given_with_its_interval(tmp_path):
    bench = Bench("arm", tmp_path)
    path = noisy(bench)
    said = " ".join(bench.torques(path).output.split())
    assert "(95 %)" in said and "Without smoothing, noise would take 2 joints over a limit" in said
    bench.options = ["--smooth"]
    assert first_word(bench.torques(path)) == "OK"


def test_a_flattened_sample_counts_where_it_could_pass_a_limit(tmp_path):
    """A knock of 1 rad/s within a row could take a hundred newton metres and more; one of 0.03 rad/s could not."""
    bench = Bench("arm", tmp_path)
    bench.asked.write_text(arm((90, 60)))
    rng, t = np.random.default_rng(2), np.arange(600) * 0.01
    q = np.c_[0.5 * np.sin(2.3 * t + 1.5) - 0.2, 0.5 * np.cos(1.9 * t)] + rng.normal(0, 1e-5, (600, 2))
    dq = np.c_[1.15 * np.cos(2.3 * t + 1.5), -0.95 * np.sin(1.9 * t)] + rng.normal(0, 2e-3, (600, 2))
    for knock, word in ((0.03, "OK"), (1.0, "UNSURE")):
        knocked = dq.copy()
        knocked[300, 0] += knock
        result = bench.torques(bench.file(t, q, knocked, head=["shoulder.vel", "elbow.vel"]))
        assert first_word(result) == word, result.output
        assert "smoothing flattened samples" in " ".join(result.output.split())


@pytest.mark.parametrize("rows", [800, 2000])
def test_a_log_of_hardly_any_noise_is_identified(tmp_path, rows):
    """Filters leave motor inertias of -0.0003 kg m², which noise of 1e-5 of the torques makes surely negative."""
    bench = Bench("arm", tmp_path)
    arm, t = tw.robots.planar_2r(), np.arange(rows) * 0.01
    q, dq, ddq, _ = bench.waves(t)
    tau = arm.inverse_dynamics(q, dq, ddq)
    tau = tau + 1e-5 * tau.std(axis=0) * np.random.default_rng(0).normal(size=tau.shape)
    found = tw.identification.identify(arm, tw.Motion(t, q, tau=tau, robot=arm))
    assert found.verdict.word == "OK" and found.held_out.all < 1e-3, str(found.verdict)
