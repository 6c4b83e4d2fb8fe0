"""What to do stands beside what is wrong: in the verdict, in the data, and in the words of the caller."""

from __future__ import annotations

import json
import pickle
import re

import numpy as np
import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.core.doubts import doubt_table
from twistwrench.core.verdict import Reason, Verdict, Word


def without_efforts(tmp_path):
    path = tmp_path / "arm.urdf"
    text = tw.robots.path_of("ur5").read_text("utf-8")
    path.write_text(re.sub(r'effort="[^"]*"', 'effort="0"', text), "utf-8")
    return path


def test_missing_limits_say_what_to_do(tmp_path):
    """In Python ``limits=``, in the shell ``--limits``; the remedy is the end of the reason, and of the data."""
    path = without_efforts(tmp_path)
    demo = tw.robots.path_of("ur5").with_name("ur5_demo.csv")
    found = tw.check(path, demo)
    (remedy,) = found.verdict.remedies
    assert (
        found.verdict.word == "UNSURE" and "limits='limits.csv'" in remedy and found.verdict.reasons[0].endswith(remedy)
    )
    assert found.to_dict()["remedies"] == [remedy]
    CliRunner().invoke(main, ["torques", str(path), str(demo), "--json", str(tmp_path / "a.json")])
    (spoken,) = json.loads((tmp_path / "a.json").read_text())["remedies"]
    assert "--limits limits.csv" in spoken and "limits=" not in spoken


def test_a_legged_robot_in_the_air_is_told_of_its_feet():
    """The remedy names the feet, the stand and the free base."""
    robot = tw.load(tw.robots.path_of("quadruped"), floating_base=None)
    still = tw.Motion(np.linspace(0.0, 1.0, 20), np.tile(robot.neutral, (20, 1)), robot=robot)
    found = tw.check(robot, still).verdict
    assert found.word == "UNSURE" and "looks legged" in found.reasons[0]
    assert "feet='auto'" in found.remedies[0] and "floating_base=False" in found.remedies[0]


def test_answers_without_a_reason_have_no_remedy():
    """OK needs nothing."""
    assert tw.check("ur5", "demo").verdict.remedies == () == tuple(tw.check("ur5", "demo").to_dict()["remedies"])


def test_each_doubt_with_a_remedy_keeps_it_in_the_verdict():
    """The sentence ends with it."""
    found = tw.calibration.calibrate(
        "ur5", tw.calibration.Measurements.from_file("demo", tw.robots.ur5()).taken(slice(0, 12))
    )
    assert found.verdict.word == "UNSURE" and found.verdict.remedies
    assert all(any(reason.endswith(remedy) for reason in found.verdict.reasons) for remedy in found.verdict.remedies)
    assert sum(bool(row.remedy) for row in doubt_table().values()) > 60


def test_a_reason_survives_pickling_and_joining():
    """Workers send verdicts; reasons are text all the same."""
    one = Verdict.from_reasons(unsure=[Reason("a; do b", "do b"), "c"])
    again = pickle.loads(pickle.dumps(one))
    assert again == one and again.remedies == ("do b",) and str(again) == "UNSURE: a; do b; c"
    assert one.joined(Verdict.from_reasons(unsure=[Reason("d; do b", "do b")])).remedies == ("do b",)


SEVEREST_FIRST = ("LOOK AGAIN", "COLLISION", "OVER LIMIT", "UNSURE", "OK", "DONE")


@pytest.mark.parametrize("severe", range(6))
@pytest.mark.parametrize("mild", range(6))
def test_the_more_severe_of_two_verdicts_is_that_on_both_whichever_comes_first(severe, mild):
    """As of the reasons of one verdict: false numbers, links that touch, limits, doubts; what was judged before what was not."""
    one, other = (
        Verdict(Word(SEVEREST_FIRST[rank]), (name,) if rank < 4 else ()) for rank, name in ((severe, "a"), (mild, "b"))
    )
    if severe == mild:
        assert one.joined(other) == Verdict(one.word, one.reasons + other.reasons)
        return
    worse = one if severe < mild else other
    assert one.joined(other) == other.joined(one) == worse
    parts = {"LOOK AGAIN": "look_again", "COLLISION": "collision", "OVER LIMIT": "over", "UNSURE": "unsure"}
    reasons = {parts[verdict.word]: [*verdict.reasons] for verdict in (one, other) if verdict.word in parts}
    if reasons:
        assert Verdict.from_reasons(**reasons) == worse


@pytest.mark.parametrize("word", ["OK", "DONE"])
def test_a_verdict_without_reasons_has_none(word):
    assert Verdict(tw.core.verdict.Word(word)).remedies == ()
