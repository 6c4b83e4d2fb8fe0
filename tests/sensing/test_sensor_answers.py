"""Functions of ``tw.sensing`` and the commands ``sensor`` give the same answers, on every surface."""

from __future__ import annotations

import json
import math
import re
import shutil
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from click.testing import CliRunner
from scipy import stats

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.core.answers.answer import Answer
from twistwrench.core.numbers import estimate, number
from twistwrench.core.text import words_of_the_shell

BIAS = [0.21, -0.14, 0.05, 4.2, -7.5, 11]
IDENTIFY = {
    "at rest": ("demo", {}, []),
    "in motion": ("demo-motion", {}, []),
    "inertia": ("demo-motion", {"inertia": True}, ["--with-inertia"]),
    "mounting": (
        "demo-motion",
        {"inertia": True, "assume": "orientation"},
        ["--with-inertia", "--assume", "orientation"],
    ),
    "two causes": (
        "demo-motion",
        {"inertia": True, "assume": ("delay", "drift")},
        ["--with-inertia", "--assume", "delay", "--assume", "drift"],
    ),
    "known bias": ("demo", {"bias": BIAS}, ["--bias", ",".join(map(str, BIAS))]),
    "known noise": ("demo", {"noise": [0.01, 0.3]}, ["--noise", "0.01,0.3"]),
    "six noises": ("demo", {"noise": [0.01] * 3 + [0.3] * 3}, ["--noise", "0.01,0.01,0.01,0.3,0.3,0.3"]),
    "outliers": ("demo-motion", {"outliers": "keep"}, ["--keep-outliers"]),
    "no gravity of a planet": ("demo", {"gravity": 60.0}, ["--gravity", "60"]),
}
"""Log, arguments of the function, and words of the command."""
COMPENSATE = {
    "at rest": ("demo", "demo", {}, []),
    "in motion": ("demo-motion", "demo", {}, []),
    "contacts": ("demo-motion", "demo", {"false_alarms": 1e-6}, ["--contacts", "1e-6"]),
    "many alarms": ("demo-motion", "demo", {"false_alarms": 0.1}, ["--contacts", "0.1"]),
    "no contact": ("demo", "demo", {"false_alarms": 1e-6}, ["--contacts", "1e-6"]),
    "other gravity": ("demo", "demo", {"gravity": 5.0}, ["--gravity", "5"]),
    "without inertia": ("demo-motion", "rest.json", {}, []),
    "contacts without inertia": ("demo-motion", "rest.json", {"false_alarms": 1e-6}, ["--contacts", "1e-6"]),
    "file at rest": ("demo", "rest.json", {}, []),
    "negated": ("negated.csv", "demo", {"false_alarms": 1e-6}, ["--contacts", "1e-6"]),
}
"""Log, sensor, arguments and words."""
POSES = {
    "six": ({}, []),
    "three after a log": ({"count": 3, "log": "demo"}, ["demo", "--count", "3"]),
    "twenty": ({"count": 20}, ["--count", "20"]),
    "one": ({"count": 1}, ["--count", "1"]),
    "upright": ({"within": math.radians(1.0)}, ["--within", "1"]),
    "tilted": ({"within": math.radians(60.0), "mass": 3.0}, ["--within", "60", "--mass", "3"]),
    "after a motion": ({"log": "demo-motion", "count": 2}, ["demo-motion", "--count", "2"]),
    "noise": ({"noise": (0.02, 0.5)}, ["--noise", "0.02,0.5"]),
    "light": ({"mass": 0.01, "count": 2}, ["--mass", "0.01", "--count", "2"]),
    "on the moon": ({"gravity": 1.62}, ["--gravity", "1.62"]),
}


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Folder with a sensor identified at rest and a log of the other sign."""
    folder, found = tmp_path_factory.mktemp("sensor"), tw.sensing.identify("demo")
    found.write(folder / "rest.json")
    log = tw.sensing.read_log(found.sources()["LOG"])
    tw.sensing.write_log(replace(log, readings=-log.readings), folder / "negated.csv")
    return folder


@pytest.fixture
def folder(written, tmp_path, monkeypatch):
    """Working folder with copies of these files."""
    monkeypatch.chdir(tmp_path)
    return shutil.copytree(written, tmp_path, dirs_exist_ok=True)


def same_answer(ask, *words):
    """Word, reasons, exit code, sentences and tables with all digits are those of the command."""
    result = CliRunner().invoke(main, ["sensor", *words, "--json", "answer.json", "--overwrite"])
    assert result.exit_code in (0, 1), result.output
    with open("answer.json", encoding="utf-8") as file:
        printed = json.load(file)
    with words_of_the_shell():  # doubts are worded when they are found
        answer = ask()
        data = answer.to_dict()
    assert isinstance(answer, Answer)
    assert answer.verdict.exit_code == result.exit_code == printed["exit_code"]
    for key in ("verdict", "reasons", "sentences", "tables", "notes", "facts", "call"):
        assert data[key] == printed[key], key


@pytest.mark.parametrize("name", IDENTIFY)
def test_identify_is_the_command(name, folder):
    log, options, words = IDENTIFY[name]
    same_answer(partial(tw.sensing.identify, log, **options), "identify", log, *words)


@pytest.mark.parametrize("name", COMPENSATE)
def test_compensate_is_the_command(name, folder):
    log, sensor, options, words = COMPENSATE[name]
    same_answer(partial(tw.sensing.compensate, log, sensor, **options), "compensate", log, "--sensor", sensor, *words)


@pytest.mark.parametrize("name", POSES)
def test_propose_poses_is_the_command(name, folder):
    options, words = POSES[name]
    same_answer(partial(tw.sensing.propose_poses, **options), "poses", *words)


def test_a_sensor_is_given_by_file_by_its_identification_or_with_its_noise(folder):
    found = tw.sensing.identify("demo")
    log = tw.sensing.read_log(found.sources()["LOG"])
    answers = [
        tw.sensing.compensate("demo", "rest.json", false_alarms=1e-3),
        tw.sensing.compensate(log, found, false_alarms=1e-3),
        tw.sensing.compensate(log, found.sensor, noise=found.noise, uncertainty=found.uncertainty, false_alarms=1e-3),
    ]
    assert len({answer.headline for answer in answers}) == 1
    for answer in answers:
        np.testing.assert_allclose(answer.rest, found.rest(log), atol=1e-9)
    assert tw.sensing.compensate(log, "rest.json", noise=(0.5, 9.0)).noise == (0.5, 9.0) != found.noise
    with pytest.raises(tw.ValueRangeError, match="noise=…"):
        tw.sensing.compensate(log, found.sensor)
    with pytest.raises(tw.ShapeError, match="Identification or the path"):
        tw.sensing.compensate(log, 7)


def test_files_of_the_answers_are_those_of_the_commands(folder):
    found, rest = tw.sensing.identify("demo"), tw.sensing.compensate("demo-motion", "demo")
    poses = tw.sensing.propose_poses(4, log="demo")
    written = [found.write("a.json"), found.to_csv("a.csv"), rest.to_csv("b.csv"), poses.to_csv("c.csv")]
    for words in (
        "identify demo --save A.json --csv A.csv",
        "compensate demo-motion --sensor demo --csv B.csv",
        "poses demo --count 4 --csv C.csv",
    ):
        assert CliRunner().invoke(main, ["sensor", *words.split()]).exit_code == 0
    for path in written:
        name = path.name[0].upper() + path.name[1:]
        assert path.read_bytes() == path.with_name(name).read_bytes(), name


TITLES = {
    "sensor identify": "Readings before and after",
    "sensor compensate": "Readings before and after",
    "sensor poses": "Next poses",
}


@pytest.mark.parametrize(
    "answer",
    [
        lambda: tw.sensing.identify("demo-motion"),
        lambda: tw.sensing.compensate("demo-motion", "demo", false_alarms=1e-6),
        lambda: tw.sensing.propose_poses(3, within=0.01),
        lambda: tw.sensing.propose_poses(25),
    ],
    ids=["identify", "compensate", "few poses", "many poses"],
)
def test_every_surface_has_the_word_and_the_sentence(answer, tmp_path, monkeypatch):
    answer = answer()
    pictures = [*answer.pictures()]
    monkeypatch.setattr(type(answer), "pictures", lambda _: pictures)  # drawn once
    sentence = answer.headline.partition(": ")[2]
    page, card = answer.to_html(tmp_path / "page.html").read_text("utf-8"), answer._repr_html_()
    for text in (page, card):
        assert sentence in re.sub(r"<[^>]+>", "", text).replace("&#x27;", "'")
    assert re.sub(r"\s+", " ", str(answer)).startswith(answer.headline)
    assert len(str(answer).splitlines()) <= 45
    assert str(answer.verdict.word) in repr(answer)
    shown = answer.verdict.ok or answer.call != "sensor poses"
    assert [picture.title for picture in pictures] == [TITLES[answer.call]] * shown
    if shown:
        assert answer.plot(tmp_path / "picture.svg").stat().st_size > 10_000
    else:
        with pytest.raises(tw.ValueRangeError, match="has no picture"):
            answer.plot()
    assert "<script" not in card


def test_doubts_speak_python_to_python_and_options_to_the_shell(folder):
    """Arguments are those of the function in Python, and options of its command in the shell."""
    spelled = {
        "--with-inertia": (lambda: tw.sensing.compensate("demo-motion", "rest.json"), "inertia=True"),
        "--contacts 1e-6": (lambda: tw.sensing.compensate("demo-motion", "demo"), "false_alarms=1e-6"),
        "--within": (lambda: tw.sensing.propose_poses(3, within=0.01), "within=…"),
    }
    for option, (ask, argument) in spelled.items():
        told = re.sub(r"\s+", " ", str(ask()))
        assert argument in told
        assert "--" not in told
        with words_of_the_shell():
            assert option in re.sub(r"\s+", " ", str(ask()))
    with pytest.raises(tw.ValueRangeError, match="sign='on_sensor'") as caught:
        tw.sensing.identify("demo", sign="by_sensor")
    assert "--" not in str(caught.value)


@pytest.mark.parametrize(
    ("ask", "error", "words"),
    [
        (lambda: tw.sensing.identify(7), tw.ShapeError, "takes a ReadingLog"),
        (lambda: tw.sensing.identify("none.csv"), tw.NotFoundError, "none.csv"),
        (lambda: tw.sensing.identify("demo", gravity=-1), tw.ValueRangeError, "gravity=-1 is not a valid magnitude"),
        (lambda: tw.sensing.identify("demo", assume="gain"), tw.ValueRangeError, "orientation"),
        (lambda: tw.sensing.identify("demo", outliers="drop"), tw.ValueRangeError, "trim"),
        (lambda: tw.sensing.compensate("demo", "none.json"), tw.NotFoundError, "none.json"),
        (lambda: tw.sensing.compensate("demo", "demo", false_alarms=2), tw.ValueRangeError, "between 0 and 1"),
        (lambda: tw.sensing.propose_poses(0), tw.ValueRangeError, "count"),
        (lambda: tw.sensing.propose_poses(mass=0), tw.ValueRangeError, "mass=0 is not a valid mass"),
        (lambda: tw.sensing.propose_poses(log=3), tw.ShapeError, "propose_poses takes a ReadingLog"),
    ],
)
def test_bad_input_is_one_clear_error(ask, error, words):
    with pytest.raises(error, match=words):
        ask()


def test_ends_of_a_centres_interval_are_where_the_quotient_is_just_not_excluded():
    """Fieller: at each end c of the interval, h - m c is Student's t times its own deviation from zero."""
    found = tw.sensing.identify("demo")
    part = slice(found.fit.unknowns.load.start, found.fit.unknowns.load.start + 4)
    (m, *h), C = found.fit.estimate[part], found.fit.covariance[part, part]
    for k, ends in enumerate(found.com_intervals):
        t = stats.t.isf(0.025, found.fit.com_known[k])
        for c in ends:
            variance = C[1 + k, 1 + k] - 2.0 * c * C[0, 1 + k] + c * c * C[0, 0]
            assert (h[k] - m * c) ** 2 == pytest.approx(t * t * variance, rel=1e-6)
    assert found.facts()["noise of a reading"].startswith(f"{number(found.noise[1], 2)} N, ")  # forces first
    (row,) = (line for line in str(found).splitlines() if "centre of mass z" in line)
    half = 5e2 * float(np.ptp(found.com_intervals[2]))  # mm
    assert row.split()[-1] == estimate(1e3 * found.sensor.load.com[2], half)[1]
    assert np.argmax(found.noise) == 1


def test_a_drift_is_told_by_the_second_if_the_log_has_times():
    tool = tw.sensing.ForceTorqueSensor(tw.SpatialInertia.from_com(3.0, (0, 0, 0.1)))
    log = tw.sensing.simulate(tool, 20)
    for time, unit in ((10.0 * np.arange(20), "N/s"), (None, "N/reading")):
        text = str(tw.sensing.identify(replace(log, time=time), assume="drift"))
        assert re.search(rf"drift fx +{unit} ", text), text
