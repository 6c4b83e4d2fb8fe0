"""What the torques command says of motors: figures against the motor formulas on every row, verdicts, pictures, errors."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.mechanics.algorithms.motor_loads import MotorLoads
from twistwrench.motion.differentiation import Differentiation
from twistwrench.motion.load_case import LoadCase, Payload
from twistwrench.motion.motion_log import MotionLog
from twistwrench.reports.motors import Demand, MotorFigures
from twistwrench.reports.torque_analysis import analyse

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

FOLDER = Path(tw.__file__).parent / "robots"
DEMO, MOTION = FOLDER / "ur5_demo.yaml", FOLDER / "ur5_demo.csv"


@pytest.fixture(scope="module")
def robot():
    return tw.robots.ur5().with_actuators(DEMO)


def analysed(robot, payload, chunk=None):
    load = LoadCase(robot, (Payload(payload),) if payload else ())
    plan = Differentiation.plan(MotionLog.open(MOTION, robot.model), robot.model)
    return analyse(load, plan, robot.limits, chunk=chunk), plan, load


def test_figures_are_those_of_every_row(robot):
    report, plan, load = analysed(robot, 5.0)
    states = list(plan.states(10_000))
    loads = [load.motor_loads(s) for s in states]
    time = np.concatenate([s.time for s in states])
    current, voltage, power = (np.concatenate([getattr(x, n) for x in loads]) for n in ("current", "voltage", "power"))
    assert len(report.motors) == 6
    for k, use in enumerate(report.motors):
        peak, rms, volts, *_ = use.demands
        assert peak.value == pytest.approx(np.abs(current[:, k]).max())
        assert peak.time == time[np.abs(current[:, k]).argmax()]
        squares = np.trapezoid(current[:, k] ** 2, time) / (time[-1] - time[0])
        assert rms.value == pytest.approx(np.sqrt(squares))
        assert volts.value == pytest.approx(np.abs(voltage[:, k]).max())
        assert use.power == pytest.approx(np.abs(power[:, k]).max())
        assert use.heat == pytest.approx(use.motor.resistance * squares)


@pytest.mark.parametrize(
    ("value", "over", "open_"), [(10.29, False, True), (10.31, True, False), (9.71, False, True), (9.69, False, False)]
)
def test_a_motor_is_over_its_rating_beyond_three_deviations_of_the_load(value, over, open_):
    """10 A, and a load that is known to 0.1 A; of normal errors one in 740 is larger."""
    demand = Demand("current", value, 10.0, "A", sigma=0.1)
    assert (demand.over, demand.open) == (over, open_)


def test_portions_of_rows_do_not_matter(robot):
    whole, *_ = analysed(robot, 5.0)
    pieces, *_ = analysed(robot, 5.0, chunk=97)
    for a, b in zip(whole.motors, pieces.motors, strict=True):
        assert [d.value for d in a.demands] == pytest.approx([d.value for d in b.demands], rel=1e-9)


def test_the_points_of_a_long_motion_are_few_and_evenly_spread(robot):
    edges = np.cumsum([0, 1, 5000, 3, 7001, 12000, 999]).tolist()
    n, parts = edges[-1], []
    time = np.arange(n, dtype=float)
    for rows in map(slice, edges[:-1], edges[1:]):
        speed = np.repeat(time[rows, None], 6, axis=1)
        parts.append(MotorFigures.from_rows(robot.model, rows, time, MotorLoads(*[speed] * 6)))
    speed = MotorFigures.from_parts(parts).uses(robot.model)[0].speed
    assert 1000 < len(speed) <= 4096
    assert len(set(np.diff(speed).tolist())) == 1
    assert speed[0] == 0
    assert n - speed[-1] <= np.diff(speed)[0]


def test_the_split_has_friction_that_grows_with_the_load(robot):
    report, *_ = analysed(robot, 5.0)
    for joint in report.joints:
        assert sum(joint.terms.values()) == pytest.approx(joint.peak, rel=1e-9, abs=1e-9)
    assert abs(report.joints[1].terms["friction"]) > 10


def run(*arguments):
    return CliRunner().invoke(main, ["torques", "ur5", "--trajectory", "demo", *map(str, arguments)])


def test_verdicts_and_exit_codes(tmp_path):
    good = run("--actuators", "demo")
    assert good.exit_code == 0, good.output
    assert "MOTORS OK: all limits kept. Closest:" in good.output
    weak = tmp_path / "weak.yaml"
    weak.write_text(DEMO.read_text().replace("current_continuous: 7.0 A", "current_continuous: 3.0 A"))
    bad = run("--actuators", weak, "--payload", 3)
    assert bad.exit_code == 1
    assert "MOTOR TOO SMALL: shoulder_lift_joint, rms current" in bad.output
    silent = tmp_path / "silent.yaml"
    silent.write_text("actuators: {elbow_joint: {motor: {torque_constant: 0.1 N m/A}}}")
    assert "MOTORS: their limits are not known" in run("--actuators", silent).output


def test_why_splits_the_worst_peak_by_link(robot):
    report, _, load = analysed(robot, 5.0)
    k = report.worst
    row = report.around[int(np.argmin(np.abs(report.around.time - report.joints[k].time)))]
    why = load.explain(row)
    assert why.torque[k] == pytest.approx(report.joints[k].peak, rel=1e-12)
    assert why.contribution("payload at tool0")[k] == pytest.approx(report.joints[k].terms["payload"], rel=1e-9)
    output = run("--payload", 5, "--why").output
    assert "Why shoulder_lift_joint at t = 1.808 s" in output
    assert "payload at tool0" in output


def test_a_motion_without_motor_columns_takes_elastic_gears_as_stiff(tmp_path):
    path = tmp_path / "elastic.yaml"
    path.write_text(
        "actuators: {elbow_joint: {ratio: 101, stiffness: 10 kN m/rad, rotor: {inertia: 210 g cm^2}, "
        "motor: {torque_constant: 0.1 N m/A}}}"
    )
    result = run("--actuators", path)
    assert result.exit_code == 0, result.output
    assert "the elastic gears of elbow_joint are taken to be stiff" in result.output
    assert "OK: all limits kept" in result.output
    header, *rows = [line for line in MOTION.read_text().splitlines() if not line.startswith("#")]
    k = header.split(",").index("elbow_joint")
    header, *rows = (",".join(line.split(",")[:7]) for line in (header, *rows))  # positions only
    moved = tmp_path / "moved.csv"
    moved.write_text("\n".join([f"{header},elbow_joint.motor", *(f"{row},{row.split(',')[k]}" for row in rows)]))
    arguments = ["torques", "ur5", "--trajectory", str(moved), "--actuators", str(path)]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 0, result.output
    assert "elbow_joint.motor" in result.output


def test_the_picture_is_drawn(tmp_path):
    result = run("--actuators", "demo", "--kind", "motors", "--plot", tmp_path / "motors.png")
    assert result.exit_code == 0, result.output
    assert (tmp_path / "motors.png").stat().st_size > 20_000
    one = tmp_path / "one.yaml"
    one.write_text("actuators: {wrist_2_joint: {motor: {torque_constant: 0.1 N m/A}}}")
    assert run("--actuators", one, "--kind", "motors", "--plot", tmp_path / "one.svg").exit_code == 0


@pytest.mark.parametrize("friction", [True, False])
def test_the_title_says_where_friction_is_left_out(robot, friction):
    from twistwrench.viz.plots.torques import report_title

    load = LoadCase(robot, (Payload(5.0),), friction=friction)
    plan = Differentiation.plan(MotionLog.open(MOTION, robot.model), robot.model)
    said = report_title(analyse(load, plan, robot.limits))
    assert said == "ur5 · ur5_demo · payload 5 kg" + ("" if friction else " · without friction")


def test_limits_of_torque_are_drawn_on_the_sides_that_come_near_them(robot, tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    from twistwrench.viz import style
    from twistwrench.viz.plots.torques import plot_report

    drawn, report = [], analysed(robot, 5.0)[0]
    monkeypatch.setattr(style, "save", lambda figure, _path: drawn.append(figure))
    plot_report(report, tmp_path / "torques.png")
    sides = []
    for k, (joint, axis) in enumerate(zip(report.joints, drawn[0].axes[:6], strict=True)):
        least, greatest = report.envelope[1][:, k].min(), report.envelope[2][:, k].max()
        levels = [line.get_ydata()[0] for line in axis.lines]
        for side, extreme in ((-1, -least), (1, greatest)):
            assert (side * joint.limit in levels) == (extreme >= 0.3 * joint.limit)
        sides.append((-least >= 0.3 * joint.limit, greatest >= 0.3 * joint.limit))
    assert {(True, False), (False, True)} & set(sides)


def test_regions_of_motors_are_the_same_turned_by_half_a_turn(robot, tmp_path, monkeypatch):
    """A motor that runs backwards has the same limits the other way."""
    pytest.importorskip("matplotlib")
    from twistwrench.viz import style
    from twistwrench.viz.plots.torques import plot_motors

    drawn = []
    monkeypatch.setattr(style, "save", lambda figure, _path: drawn.append(figure))
    plot_motors(analysed(robot, 5.0)[0], tmp_path / "motors.png")
    regions = [p.vertices for axis in drawn[0].axes[:6] for c in axis.collections[:2] for p in c.get_paths()]
    assert len(regions) == 2 * 6
    for corners in regions:
        assert corners.min(axis=0) == pytest.approx(-corners.max(axis=0), rel=1e-9)
        right, left = (corners[corners[:, 0] * side > 0.9 * corners[:, 0].max()] for side in (1, -1))
        assert right[:, 1].max() == pytest.approx(-left[:, 1].min(), rel=1e-9)
        assert right[:, 1].min() == pytest.approx(-left[:, 1].max(), rel=1e-9)


@pytest.mark.parametrize(("way", "push", "beyond"), [(1, -1, 0), (-1, 1, 0), (1, 1, 2), (-1, -1, 2)])
def test_near_its_no_load_speed_a_motor_brakes_and_does_not_drive(robot, tmp_path, monkeypatch, way, push, beyond):
    pytest.importorskip("matplotlib")
    from twistwrench.viz import style
    from twistwrench.viz.plots.torques import plot_motors

    drawn, report = [], analysed(robot, 5.0)[0]
    monkeypatch.setattr(style, "save", lambda figure, _path: drawn.append(figure))
    motor = replace(report.motors[0].motor, speed=np.inf, resistance=0.5, voltage=48.0)
    speed, torque = 0.95 * 48.0 / motor.torque_constant, 0.9 * motor.torque_constant * motor.current_peak
    points = {"time": np.arange(2.0), "speed": way * np.full(2, speed), "torque": push * np.full(2, torque)}
    use = replace(report.motors[0], motor=motor, **points)
    plot_motors(replace(report, motors=(use,)), tmp_path / "motors.png")
    red = [len(line.get_xdata()) for line in drawn[0].axes[0].lines if line.get_label() == "beyond the motor"]
    assert sum(red) == beyond


def test_errors_of_the_command(tmp_path):
    for arguments, text in (
        (("--kind", "motors", "--plot", tmp_path / "m.png"), "Add --actuators"),
        (("--actuators", tmp_path / "none.yaml"), "no actuator file"),
        (("--actuators", "demo", "--kind", "motors", "--plot", tmp_path / "none" / "m.png"), "no such folder"),
    ):
        result = run(*arguments)
        assert result.exit_code == 2
        assert text in result.output
    bare = tmp_path / "bare.yaml"
    bare.write_text("actuators: {elbow_joint: {ratio: 100}}")
    result = run("--actuators", bare, "--kind", "motors", "--plot", tmp_path / "m.png")
    assert result.exit_code == 2
    assert "describes no motor" in result.output
    shutil.copy(DEMO, tmp_path / "own.yaml")
    clash = run("--actuators", tmp_path / "own.yaml", "--csv", tmp_path / "own.yaml")
    assert clash.exit_code == 2
    panda = CliRunner().invoke(main, ["info", "panda", "--actuators", "demo"])
    assert panda.exit_code == 2
    assert "no actuator file is bundled with 'panda'. With: ur5" in panda.output


def test_info_lists_the_actuators():
    result = CliRunner().invoke(main, ["info", "ur5", "--actuators", "demo", "--lock", "elbow_joint=0.5"])
    assert result.exit_code == 0, result.output
    assert "5 moving bodies and 5 rotors" in result.output
    assert "Actuators" in result.output
