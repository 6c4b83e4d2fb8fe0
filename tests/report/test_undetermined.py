"""What no log tells of a robot: in the JSON, the page and the table of the docs, and true by geometry."""

import html
import json

import numpy as np

import twistwrench as tw
from twistwrench.core.doubts import undetermined_table
from twistwrench.identification import BaseParameters, UnknownParameters, identify
from twistwrench.identification.undetermined import undetermined_quantities

LEFT = 0.02


def told_of(robot, **options):
    return undetermined_quantities(BaseParameters.from_unknowns(UnknownParameters(robot, **options)), LEFT)


def test_zeros_of_the_last_joint_and_of_a_vertical_first_one():
    assert "shoulder_pan_joint, wrist_3_joint:" in told_of(tw.robots.ur5())["zero"]
    assert "joint3:" in told_of(tw.robots.planar_3r())["zero"]  # gravity is in the plane: the first zero is told


def test_both_signs_of_a_spherical_shoulder_are_two_half_turns_beside_it():
    """R_z(a + π) R_y(-b) R_z(c + π) = R_z(a) R_y(b) R_z(c), and a half turn about the vertical is not told."""
    assert "of panda_joint2," in told_of(tw.robots.panda())["sign-of-both"]
    assert "of wrist_3_joint," in told_of(tw.robots.ur5())["sign-of-both"]
    assert "sign-of-both" not in told_of(tw.robots.planar_3r())


def test_known_values_tell_what_they_are_said_to():
    arm = tw.robots.planar_2r()
    assert "gain-of-all" in told_of(arm) and "clock-rate" in told_of(arm)
    known = {"link2.m": 1.0, "joint1.motor_inertia": 0.1, "joint2.motor_inertia": 0.1}
    names = UnknownParameters(arm).names
    link = next(name for name in names if name.endswith(".m"))
    known = {name: value for name, value in {link: 1.0, **known}.items() if name in names}
    found = told_of(arm, known=known)
    assert "gain-of-all" not in found and "clock-rate" not in found
    assert "asymmetric-friction" not in told_of(arm, friction=("viscous", "coulomb"))


def test_no_residual_is_asked_about():
    base = BaseParameters.from_unknowns(UnknownParameters(tw.robots.pendulum()))
    near, far = undetermined_quantities(base, 2e-4), undetermined_quantities(base, 2e-3)
    assert "0.02 % of them" in near["fed-forward"] and "fed-forward" not in far


def test_json_and_report_list_them(tmp_path):
    arm, t = tw.robots.pendulum(), np.arange(0, 10, 0.01)
    q = (np.sin(1.3 * t) + 0.5 * np.sin(3.1 * t))[:, None]
    tau = tw.Motion(t, q, robot=arm).torques() + 0.05 * np.random.default_rng(0).normal(size=q.shape)
    found = identify(arm, tw.Motion(t, q, tau=tau, robot=arm), cutoff=5.0, friction_speed=0.03, shift=0.0)
    assert json.loads(found.to_json())["undetermined"] == found.undetermined and set(found.undetermined) < set(
        undetermined_table()
    )
    sentences = found.to_dict()["sentences"]
    at = sentences.index("Not determined by this log:")
    assert sentences[at + 1 :] == [f"• {sentence}" for sentence in found.undetermined.values()]
    page = found.report(tmp_path / "report.html").read_text("utf-8")
    assert "Not determined by this log" in page and html.escape(found.undetermined["clock-rate"]) in page
