"""The sensor commands: the files they read and write, their options, their exit codes."""

from __future__ import annotations

import gzip
import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.mechanics.lie import quaternion
from twistwrench.sensing.compensation import compensate
from twistwrench.sensing.files import read_log, read_sensor, read_sensor_file, write_log, write_sensor
from twistwrench.sensing.identification import identify
from twistwrench.sensing.log import ReadingLog
from twistwrench.sensing.sensor import ForceTorqueSensor, rotations_to_gravity
from twistwrench.sensing.simulated_logs import simulate

SENSOR = ForceTorqueSensor(tw.SpatialInertia.from_com(3.0, (0.02, -0.01, 0.1)), [0.1, 0.2, -0.3, 5, -3, 8])
READINGS = "mx,my,mz,fx,fy,fz"
BUNDLED = Path(tw.sensing.__file__).parent
DEMO_MOTION, DEMO_SENSOR = BUNDLED / "demo_motion.csv", BUNDLED / "demo_sensor.json"


@pytest.fixture
def run():
    def run(*arguments):
        result = CliRunner().invoke(main, ["sensor", *map(str, arguments)])
        assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
        assert "Traceback" not in result.output
        return result.exit_code, " ".join(result.output.split())

    return run


@pytest.fixture
def log():
    return simulate(SENSOR, 12, rng=3)


def test_identify_then_compensate(run, tmp_path, log):
    write_log(log, tmp_path / "log.csv")
    sensor, rest, picture = tmp_path / "sensor.json", tmp_path / "rest.csv", tmp_path / "picture.png"
    code, said = run("identify", tmp_path / "log.csv", "--save", sensor, "--csv", rest, "--plot", picture)
    assert code == 0, said
    assert f"OK: {identify(log).mass_text}" in said
    assert picture.read_bytes().startswith(b"\x89PNG")
    found = identify(log)
    np.testing.assert_allclose(np.loadtxt(rest, delimiter=",", skiprows=1), log.compensated(found.sensor), atol=1e-9)
    read, noise = read_sensor(sensor)
    np.testing.assert_allclose(read.load.parameters, found.sensor.load.parameters, rtol=1e-9)
    assert noise == pytest.approx(found.noise)
    code, said = run("compensate", tmp_path / "log.csv", "--sensor", sensor, "--contacts", "1e-4")
    assert (code, "no contact" in said) == (0, True)


def test_exit_code_1_says_look_again(run, tmp_path):
    write_log(simulate(SENSOR, 12, touch={4: [0, 1, 0, 9, 0, 0]}), tmp_path / "log.csv")
    code, said = run("identify", tmp_path / "log.csv")
    assert (code, "LOOK AGAIN" in said, "contradict: 4 (from 0)" in said) == (1, True, True)
    assert run("identify", tmp_path / "log.csv", "--keep-outliers")[0] == 0


def test_the_bundled_push_is_found(run, tmp_path):
    code, said = run(
        "compensate", "demo-motion", "--sensor", "demo", "--contacts", "1e-6", "--plot", tmp_path / "p.png"
    )
    assert code == 1
    assert "CONTACT: 19 of 301 readings, 4.020 to 4.380 s" in said
    assert run("compensate", "demo-motion", "--sensor", "demo")[0] == 0


def test_every_unknown_can_be_asked_for(run):
    code, said = run("identify", "demo-motion", "--with-inertia", "--assume", "orientation", "--noise", "0.01,0.3")
    assert code == 1  # the push
    assert "mounting turned about z" in said
    assert "Izz about the origin" in said
    code, said = run("identify", "demo", "--bias", "0.21,-0.14,0.05,4.2,-7.5,11")
    assert (code, "given" in said) == (0, True)


def test_poses(run, tmp_path):
    out = tmp_path / "poses.csv"
    code, said = run("poses", "demo", "--count", 4, "--within", 60, "--mass", 3, "--csv", out)
    assert (code, "Next poses" in said) == (0, True)
    table = np.loadtxt(out, delimiter=",", skiprows=1)
    np.testing.assert_allclose(-quaternion.rotation(table[:, :4])[:, 2], table[:, 4:], atol=1e-12)
    assert run("poses")[0] == 0


def test_logs_read_the_same_however_orientations_are_written(tmp_path, log):
    R = rotations_to_gravity(log.gravity)
    quat = quaternion.from_matrix(R)
    np.savetxt(tmp_path / "q.csv", np.hstack([quat, log.readings]), delimiter=",", comments="", fmt="%.17g",
               header=f"qw,qx,qy,qz,{READINGS}")  # fmt: skip
    np.savetxt(tmp_path / "r.csv", np.hstack([log.readings[:, ::-1], R.reshape(-1, 9)]), delimiter=",", comments="",
               fmt="%.17g", header="fz [N],fy [N],fx [N],Tz [Nm],Ty [Nm],Tx [Nm],r11,r12,r13,r21,r22,r23,r31,r32,r33")  # fmt: skip
    write_log(log, tmp_path / "g.csv")
    for name in "qrg":
        read = read_log(tmp_path / f"{name}.csv")
        np.testing.assert_allclose(read.gravity, log.gravity, atol=1e-12)
        np.testing.assert_allclose(read.readings, log.readings, rtol=1e-15)


def test_logs_in_motion_come_back(tmp_path):
    log = simulate(SENSOR, 30, motion=1.0)
    write_log(log, tmp_path / "log.csv")
    read = read_log(tmp_path / "log.csv")
    for part in ("readings", "V", "dV", "time"):
        np.testing.assert_array_equal(getattr(read, part), getattr(log, part))


def test_logs_are_read_in_every_dialect_of_motions(tmp_path):
    write_log(simulate(SENSOR, 5), tmp_path / "log.csv")
    text, wanted = (tmp_path / "log.csv").read_text(), read_log(tmp_path / "log.csv")
    for written in (
        text.encode("utf-8-sig"),
        text.encode("utf-16"),
        text.replace(",", ";").replace(".", ",").encode(),
        text.replace(",", "\t").encode(),
        gzip.compress(text.encode()),
    ):
        (tmp_path / "other.csv").write_bytes(written)
        read = read_log(tmp_path / "other.csv")
        assert np.array_equal(read.readings, wanted.readings) and np.array_equal(read.gravity, wanted.gravity)


ROW = "0,0,-1,0,0,0,0,0,-30"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "the log is empty"),
        (f"gx,gy,gz,{READINGS}\n", "no readings after the header"),
        ("gx,gy,gz,mx,my,mz,fx,fy\n", "no column for fz"),
        (f"{READINGS}\n0,0,0,0,0,0\n", "no orientation"),
        (f"qw,qx,qy,{READINGS}\n", "no column for qz"),
        (f"gx,gy,gz,wx,{READINGS}\n", "no column for wy"),
        (f"gx,gy,gz,qw,{READINGS}\n", "more than one orientation"),
        ("gx,gy,gz,mx,my,mz,force_x,fy,fz\n", "Column 'force_x' is not known: did you mean 'fx'"),
        (f"q_w,qx,qy,qz,{READINGS}\n", "Column 'q_w' is not known: did you mean 'qw'"),
        (f"roll,pitch,yaw,{READINGS}\n", "roll, pitch, yaw: angles have many conventions"),
        (f"gx,gy,gz,label,{READINGS}\n0,0,-1,a,0,0\n", "line 2 has 6 values, and the header names 10"),
        (
            f"gx,gy,gz,time,{READINGS}\n0,0,-1,1,0,0,0,0,0,-30\n\n0,0,-1,1,0,0,0,0,0,-30\n",
            "line 4: time 1 s is not after the 1 s",
        ),
        (
            f"gx,gy,gz,time,{READINGS}\n0,0,-1,1,0,0,0,0,0,-30\n0,0,-1,0.5,0,0,0,0,0,-30\n",
            "line 3: time 0.5 s is not after the 1 s",
        ),
        ("gx,gy,gz,mx [kgf m],my,mz,fx,fy,fz\n", "Convert it to N m (SI units)"),
        (f"gx,gy,gz,gx,{READINGS}\n", "there 2 times"),
        ("gx,gy,gz,mx,my,mz,fx [g],fy [g],fz [g]\n", "column 'fx' is in 'g'. Convert it to N (SI units)"),
        ("1,2,3,4,5,6,7,8,9\n", "the header is missing"),
        ("gx;gy;gz\n", "no column for mx"),
        (f"gx,gy,gz,{READINGS}\n0,0,-1,0\n", "line 2 has 4 values, and the header names 9"),
        (f"gx,gy,gz,{READINGS}\n{ROW}\n0,0,-1,0,nan,0,0,0,0\n", "line 3, column 'my' is 'nan'"),
        (f"gx,gy,gz,{READINGS}\n0,0,-1,0,,0,0,0,0\n", "line 2, column 'my' is blank"),
        (f"gx,gy,gz,{READINGS}\n0,0,0,0,0,0,0,0,0\n", "are zero. Give the direction"),
        (f"qw,qx,qy,qz,{READINGS}\n0,0,0,1.3,0,0,0,0,0,0\n", "not of unit length: off from 1 by 0.3"),
        (f"gx,gy,gz,{READINGS}\n{ROW}\n", "1 reading, and 10 unknowns"),
        (f"gx,gy,gz,{READINGS}\n" + 4 * f"{ROW}\n", "cannot be distinguished"),
    ],
)
def test_bad_logs_end_in_one_line_that_says_what_to_do(run, tmp_path, text, said):
    path = tmp_path / "log.csv"
    path.write_text(text)
    code, output = run("identify", path)
    assert code == 2
    assert said.lower() in output.lower(), output


def test_a_log_in_grams_is_noticed(run, tmp_path, log):
    log.readings[:, 3:] *= 102
    write_log(log, tmp_path / "log.csv")
    code, said = run("identify", tmp_path / "log.csv")
    assert (code, "LOOK AGAIN" in said, "forces are in grams (multiply fx, fy, fz by 0.00980665)" in said) == (1, 1, 1)
    write_sensor(SENSOR, tmp_path / "sensor.json", (0.01, 0.3))
    code, said = run("compensate", tmp_path / "log.csv", "--sensor", tmp_path / "sensor.json", "--contacts", "1e-6")
    assert (code, "LOOK AGAIN" in said, "forces are in grams" in said) == (1, 1, 1)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["identify", "nowhere.csv"], "no log 'nowhere.csv'"),
        (["identify", "demo", "--bias", "1,2"], "--bias '1,2': expected 6 numbers"),
        (["identify", "demo", "--noise", "x"], "--noise 'x': expected 2 or 6 numbers"),
        (["identify", "demo", "--sign", "by_sensor"], "Use --sign on_sensor: the residual is then noise of"),
        (["identify", "demo", "--gravity", "0"], "--gravity 0.0"),
        (["identify", "demo", "--plot", "x.exe"], "Choose one of .png, .pdf, .svg"),
        (["identify", "demo", "--plot", "x.jpg"], "pictures of kind 'jpg' are not made"),
        (["identify", "demo", "--noise", "0.01,-0.3"], "two positive numbers"),
        (["identify", "demo", "--save", "nowhere/s.json"], "no such folder"),
        (["identify", "demo", "--save", "same", "--csv", "same"], "--csv 'same' would overwrite"),
        (["compensate", "demo", "--sensor", "demo", "--csv", "nowhere/s.csv"], "no such folder"),
        (["poses", "--csv", "nowhere/p.csv"], "no such folder"),
        (["poses", "--within", "nan"], "not a valid largest tilt"),
        (["poses", "--noise", "0,1"], "two positive numbers"),
        (["identify", "demo", "--with-inertia"], "shows only in motion"),
        (["identify", "demo", "--assume", "delay"], "a delay shows only in motion"),
        (["identify", "demo", "--assume", "gain"], "'gain' is not one of 'orientation', 'drift', 'tilt', 'delay'"),
        (["compensate", "demo", "--sensor", "nowhere.json"], "identify LOG --save"),
        (["compensate", "demo", "--sensor", "demo", "--contacts", "2"], "between 0 and 1"),
        (["poses", "--mass", "-1"], "--mass -1.0"),
        (["poses", "--count", "0"], "give a whole number of at least 1"),
    ],
)
def test_bad_options(run, tmp_path, monkeypatch, arguments, said):
    monkeypatch.chdir(tmp_path)
    code, output = run(*arguments)
    assert code == 2
    assert said in output, output


def test_broken_sensor_files(tmp_path):
    path = tmp_path / "sensor.json"
    for text in ("", "{}", '{"load": [1]}'):
        path.write_text(text)
        with pytest.raises(tw.ValueRangeError):
            read_sensor(path)
    write_sensor(SENSOR, path, (0.01, 0.3))
    assert read_sensor(path)[0].load.mass == 3.0


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("noise", [0.01, math.nan], "two numbers from 0 on"),
        ("noise", [-0.01, 0.3], "two numbers from 0 on"),
        ("noise", 0.3, "two numbers from 0 on"),
        ("load", [-1.0] + 9 * [0.0], "mass, -1.0 kg, is negative"),
        ("load", [math.nan] + 9 * [0.0], "not a finite number"),
        ("bias", [1, 2], "expected \\(6,\\)"),
        ("sign", "up", "on_sensor, by_sensor"),
        ("mounting", 2 * np.eye(3).tolist(), "mounting"),
        ("frame", 7, "the frame of a sensor is 7"),
    ],
)
def test_sensor_files_with_bad_values_say_which(run, tmp_path, key, value, said):
    path = tmp_path / "sensor.json"
    write_sensor(SENSOR, path, (0.01, 0.3))
    path.write_text(json.dumps({**json.loads(path.read_text()), key: value}))
    with pytest.raises(tw.ValueRangeError, match=said):
        read_sensor(path)
    assert run("compensate", "demo", "--sensor", path)[0] == 2


def test_a_weightless_load_can_be_saved_and_read(run, tmp_path):
    for seed in range(6):  # by noise, some masses come out below zero
        write_log(simulate(ForceTorqueSensor(bias=[0, 0, 0, 1, 2, 3]), 12, rng=seed), tmp_path / "log.csv")
        code, said = run("identify", tmp_path / "log.csv", "--save", tmp_path / "sensor.json", "--overwrite")
        assert (code, "LOOK AGAIN" in said) == (1, True)
        assert read_sensor(tmp_path / "sensor.json")[0].load.mass >= 0


@pytest.mark.parametrize("option", ["--save", "--csv", "--plot"])
def test_outputs_over_inputs_are_refused_and_nothing_is_touched(run, tmp_path, option, log):
    path = tmp_path / "log.png"
    write_log(log, path)
    before = path.read_bytes()
    code, said = run("identify", path, option, tmp_path / "." / "log.png")
    assert (code, f"{option} " in said, "would overwrite the file of LOG" in said) == (2, True, True)
    assert path.read_bytes() == before
    write_sensor(SENSOR, tmp_path / "sensor.json", (0.01, 0.3))
    write_log(log, path)
    code, said = run("compensate", path, "--sensor", tmp_path / "sensor.json", "--csv", tmp_path / "sensor.json")
    assert (code, "would overwrite the file of --sensor" in said) == (2, True)


def test_a_picture_without_a_kind_is_a_png(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, said = run("identify", "demo", "--plot", "picture")
    assert (code, "wrote picture.png" in said) == (0, True)
    for kind, start in (("pdf", b"%PDF"), ("svg", b"<?xml")):
        assert run("identify", "demo", "--plot", f"picture.{kind}")[0] == 0
        assert (tmp_path / f"picture.{kind}").read_bytes().startswith(start)


def test_the_wrong_sign_and_mounting_are_said_with_the_way_out(run, tmp_path, log):
    code, said = run("identify", "demo", "--sign", "by_sensor")
    assert (code, "Use --sign on_sensor: the residual is then noise of" in said) == (2, True)
    turned = ForceTorqueSensor(SENSOR.load, SENSOR.bias, mounting=tw.so3.exp([0.4, 0.2, 0.3]))
    write_log(simulate(turned, 12), tmp_path / "log.csv")
    code, said = run("identify", tmp_path / "log.csv")
    assert (code, "LOOK AGAIN" in said, "orientation" in said, "turned by 3" in said) == (1, True, True, True)
    assert run("identify", tmp_path / "log.csv", "--assume", "orientation")[0] == 0


# ── what a sensor file explains ──


@pytest.fixture
def static_file(run, tmp_path):
    path = tmp_path / "static.json"
    assert run("identify", "demo", "--save", path)[0] == 0
    return path


def test_a_static_identification_does_not_claim_to_know_the_inertia(run, static_file):
    assert json.loads(static_file.read_text())["inertia"] == "unknown"
    assert read_sensor(static_file)[0].inertia == "unknown"
    code, said = run("compensate", "demo-motion", "--sensor", static_file)
    assert (code, "inertia not identified: " in said, "Identify with --with-inertia from a log in motion" in said) == (
        1,
        1,
        1,
    )
    assert "LOOK AGAIN: the load's inertia is left in the moments" in said
    assert "inertia not identified" not in run("compensate", "demo", "--sensor", static_file)[1]


def test_contacts_in_motion_are_looked_for_in_forces_where_inertia_is_unknown(run, static_file, tmp_path):
    code, said = run("compensate", "demo-motion", "--sensor", static_file, "--contacts", "1e-6")
    assert (code, "CONTACT: 12 of 301 readings, 4.080 to 4.300 s; up to 6.353 N" in said) == (1, True)  # the push alone
    assert "moments are not looked at" in said
    quiet = read_log(DEMO_MOTION).rows(slice(0, 200))  # before the push
    write_log(quiet, tmp_path / "quiet.csv")
    code, said = run("compensate", tmp_path / "quiet.csv", "--sensor", static_file, "--contacts", "1e-6")
    assert (code, "OK: no contact force; moments were not looked at" in said) == (0, True)


def test_an_inertia_from_a_log_in_motion_is_known(run, tmp_path):
    path = tmp_path / "s.json"
    run("identify", "demo-motion", "--with-inertia", "--save", path)
    assert read_sensor(path)[0].inertia == "given"
    code, said = run("compensate", "demo-motion", "--sensor", path, "--contacts", "1e-6")
    assert (code, "CONTACT: 19 of 301" in said, "not identified" in said) == (1, True, False)


def test_a_file_that_says_nothing_of_inertia_knows_none_if_it_has_none(static_file):
    content = json.loads(static_file.read_text())
    del content["inertia"]
    static_file.write_text(json.dumps(content))
    assert read_sensor(static_file)[0].inertia == "unknown"
    assert read_sensor(DEMO_SENSOR)[0].inertia == "given"


def test_a_sensor_file_keeps_covariance_and_degrees_of_freedom(run, static_file):
    found, uncertainty = identify(read_log(BUNDLED / "demo_poses.csv")), read_sensor_file(static_file).uncertainty
    assert uncertainty.unknowns == found.fit.unknowns.names
    for name in ("covariance", "freedom", "noise", "noise_freedom"):
        np.testing.assert_array_equal(getattr(uncertainty, name), getattr(found.uncertainty, name))
    assert (uncertainty.noise_freedom > 9).all()
    known = identify(read_log(BUNDLED / "demo_poses.csv"), noise=(0.01, 0.3))
    write_sensor(known.sensor, static_file, known.noise, known.uncertainty)
    assert np.isinf(read_sensor_file(static_file).uncertainty.noise_freedom).all()


def test_older_sensor_files_are_read_and_said_to_lack_covariance(run, static_file, tmp_path):
    content = json.loads(static_file.read_text())
    uncertainty = content.pop("uncertainty")
    static_file.write_text(json.dumps(content))
    assert read_sensor_file(static_file).uncertainty is None
    code, said = run("compensate", "demo", "--sensor", static_file, "--contacts", "1e-6")
    assert (code, "lacks the covariance" in said) == (0, True)
    for key, value in (("covariance", [[1.0]]), ("noise", [1, 2]), ("unknowns", ["mass"]), ("freedom", "many")):
        static_file.write_text(json.dumps({**content, "uncertainty": {**uncertainty, key: value}}))
        assert run("compensate", "demo", "--sensor", static_file)[0] == 2


def test_drift_delay_and_tilt_can_be_asked_for(run, tmp_path):
    code, said = run("identify", "demo-motion", "--with-inertia", "--assume", "delay", "--assume", "drift")
    assert (code, "readings are late by" in said, "drift fz" in said) == (1, True, True)  # the push is left out
    code, said = run("identify", "demo-motion", "--assume", "tilt")
    assert (code, "a tilt of the base shows only in orientations" in said) == (2, True)
    code, said = run("identify", "demo", "--noise", "0.01,0.01,0.01,0.3,0.3,0.3")
    assert code == 0


def test_an_answer_always_begins_with_a_verdict_and_its_reasons(run, tmp_path):
    code, said = run("compensate", "demo", "--sensor", "demo")
    assert (code, said.startswith("OK: 12 of 12 readings are explained")) == (0, True)
    code, said = run("compensate", "demo-motion", "--sensor", "demo")
    assert (code, said.startswith("OK: 282 of 301 readings are explained")) == (0, True)
    assert "--contacts 1e-6" in said
    code, said = run("compensate", "demo-motion", "--sensor", "demo", "--contacts", "1e-6")
    assert (code, said.startswith("CONTACT: ")) == (1, True)
    code, said = run("identify", "demo")
    assert (code, said.startswith("OK: 2.986")) == (0, True)
    few = simulate(SENSOR, 3, noise=(0.01, 0.3), rng=1)
    write_log(few, tmp_path / "few.csv")
    code, said = run("identify", tmp_path / "few.csv")
    assert (code, said.startswith("UNSURE: ")) == (1, True)
    assert said.index("! 3 orientations are too few") < said.index("Load and sensor")


def slipped(log, how):
    R = tw.so3.exp(np.outer(np.linspace(0, 6, len(log)), [0.3, 0.8, 0.5]))
    gravity = (np.swapaxes(R, 1, 2) @ [0, 0, -9.81], R @ [0, 0, -9.81])
    if how == "transposed":
        return ReadingLog.from_arrays(
            ReadingLog.from_arrays(log.readings, gravity=gravity[0]).predicted(SENSOR), gravity=gravity[1]
        )
    changed = {
        "kg and kg m": {"readings": log.readings / 9.80665},
        "gravity up": {"gravity": -log.gravity},
        "swapped": {"readings": np.roll(log.readings, 3, axis=1)},
        "zeroed": {"readings": log.readings + np.array([0.2, 0, 0, 3, 0, -5])},
        "sign": {"readings": -log.readings},
        "another tool": {"readings": log.predicted(ForceTorqueSensor(tw.SpatialInertia.from_com(1.0, (0.05, 0, 0))))},
    }
    return replace(log, **changed[how])


@pytest.mark.parametrize(
    ("how", "why"),
    [
        ("kg and kg m", "forces are in kilograms and moments in kg m (multiply all six by 9.80665)"),
        ("gravity up", "gx, gy, gz point up, as an accelerometer logs them (negate them)"),
        ("swapped", "forces and moments are swapped"),
        ("zeroed", "the bias has moved by mx 0.198, my -0.00216, mz -0.000906, fx 2.9"),
        ("sign", "readings have the sign by_sensor"),
        ("another tool", "12 of 12 readings are off by more than its noise"),
        ("transposed", "not of the world in the sensor"),
    ],
)
@pytest.mark.parametrize("contacts", [[], ["--contacts", "1e-6"]])
def test_a_log_that_the_sensor_file_does_not_explain_is_no_contact(run, tmp_path, log, how, why, contacts):
    write_sensor(SENSOR, tmp_path / "sensor.json", (0.01, 0.3))
    write_log(slipped(log, how), tmp_path / "log.csv")
    code, said = run("compensate", tmp_path / "log.csv", "--sensor", tmp_path / "sensor.json", *contacts)
    assert code == 1
    assert why in said, said
    assert said.startswith("LOOK AGAIN: this sensor file does not explain this log. ! ")
    assert "CONTACT" not in said


def test_a_hand_that_lifts_the_tool_for_a_while_is_a_contact(run, tmp_path):
    # Twice the weight, upwards, in a third of the readings: the root mean square is then larger after than before.
    still = simulate(SENSOR, 60)
    log = simulate(SENSOR, 60, touch={k: [0, 0, 0, *(-6.0 * still.gravity[k])] for k in range(20)})
    sensor = replace(SENSOR, bias=np.zeros(6))
    log = replace(log, readings=log.readings - np.asarray(SENSOR.bias))
    assert np.linalg.norm(log.compensated(sensor)) > np.linalg.norm(log.readings)
    write_sensor(sensor, tmp_path / "sensor.json", (0.01, 0.3))
    write_log(log, tmp_path / "log.csv")
    code, said = run("compensate", tmp_path / "log.csv", "--sensor", tmp_path / "sensor.json", "--contacts", "1e-6")
    assert (code, "CONTACT: 20 of 60 readings, readings 0 to 19" in said) == (1, True)


def test_a_log_that_is_not_explained_has_no_contacts():
    log = simulate(SENSOR, 12)
    assert compensate(log, SENSOR, noise=(0.01, 0.3), false_alarms=1e-6).verdict.ok
    found = compensate(replace(log, gravity=-log.gravity), SENSOR, noise=(0.01, 0.3), false_alarms=1e-6)
    assert found.doubtful
    assert not found.hits.any()


def test_a_motion_without_twists_is_recognised(run, tmp_path):
    log = read_log(DEMO_MOTION)
    write_log(replace(log, V=None, dV=None), tmp_path / "log.csv")
    for arguments in (["identify"], ["compensate", "--sensor", "demo", "--contacts", "1e-6"]):
        code, said = run(arguments[0], tmp_path / "log.csv", *arguments[1:])
        assert (code, "It may be in motion" in said, "Add columns wx, wy, wz" in said) == (1, True, True)
        assert "CONTACT:" not in said


def test_one_mass_has_one_interval_in_a_report(run, tmp_path):
    code, said = run("identify", "demo")
    assert code == 0
    assert re.search(r"mass kg 2\.986 0\.022 ", said)
    assert "OK: 2.986 ± 0.022 kg (95 %) at" in said
    write_log(simulate(ForceTorqueSensor(bias=[0, 0, 0, 1, 2, 3]), 12, rng=3), tmp_path / "log.csv")
    code, said = run("identify", tmp_path / "log.csv")
    found = identify(read_log(tmp_path / "log.csv"))
    low, high = found.mass_interval
    mass, half = f"{(low + high) / 2:.3f}", f"{(high - low) / 2:.2g}"  # both to the second digit of the interval
    assert said.count(f"{mass} ± {half} kg (95 %)") == 2  # the remark and the verdict
    assert f"mass kg {mass} {half}" in said


def test_other_columns_are_ignored_and_noted(run, tmp_path, log):
    write_log(log, tmp_path / "log.csv")
    head, *rows = (tmp_path / "log.csv").read_text().splitlines()
    wider = [f"{head},label,tme", *(f"{row},pose {k},{k}" for k, row in enumerate(rows))]
    (tmp_path / "log.csv").write_text("\n".join(wider) + "\n")
    np.testing.assert_array_equal(read_log(tmp_path / "log.csv").readings, log.readings)
    code, said = run("identify", tmp_path / "log.csv")
    assert code == 0
    assert "ignored: 'label', 'tme' (did you mean 'time'?)" in said


def test_poses_that_tell_nothing_are_not_proposed(run):
    for within, said_of_mass in (
        (0, "the mass or the centre of mass"),
        (1, "the mass (± 1.6 kg) or the centre of mass"),
    ):
        code, said = run("poses", "--within", within)
        assert (code, "LOOK AGAIN" in said, "Next poses" in said) == (1, True, False)
        assert f"cannot determine {said_of_mass}" in said
        assert "Allow larger tilts by --within" in said
    assert run("poses", "--count", 1)[0] == 1
    code, said = run("poses", "demo", "--within", 0, "--mass", 3)  # the log tells what these do not
    assert (code, "Next poses" in said) == (0, True)
