"""Logs without noise of every drive that an actuator file can describe: nothing is doubted."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from identification_logs import fourier_states

import twistwrench as tw
from twistwrench.identification import identify, motor_side

ARM = tw.robots.planar_3r()
ROTOR = {"inertia": "2 kg cm^2"}
LAW = {"viscous": "0.5 N m s/rad", "coulomb": "0.6 N m"}
FADING = LAW | {"static": "0.9 N m", "stribeck": "0.1 rad/s"}
STRIBECK = {"friction": ("viscous", "coulomb", "stribeck", "offset"), "stribeck_speed": 0.1}
DRIVES = {
    "gear with a rotor": ({"ratio": 50, "efficiency": 0.7, "rotor": ROTOR, "friction": LAW}, {}),
    "motor that turns against its joint": ({"ratio": -50, "rotor": ROTOR}, {}),
    "rotor with mass, apart from the links": ({"ratio": 50, "rotor": ROTOR | {"extra": True, "mass": "0.5 kg"}}, {}),
    "rotor at a place": ({"ratio": 50, "rotor": ROTOR | {"place": ["0.1 m", "0 m", "0 m"]}}, {}),
    "reflected inertia": ({"reflected_inertia": "0.2 kg m^2"}, {}),
    "static friction": ({"friction": FADING}, STRIBECK),
    "friction behind the gear": (
        {"friction": {"viscous": "0.5 N m s/rad"}, "link_friction": {"coulomb": "0.6 N m"}},
        {},
    ),
}
COUPLED = {"ratio": 1, "friction": LAW, "reflected_inertia": "0.02 kg m^2"}
MATRICES = [[[1.4, 0.5], [1.0, -0.8]], [[1, 1], [1, -1]], [[1, -2], [0, 1]], [[2, 0], [-1, 1]]]


def perfect_log(content, of):
    """Twenty seconds of the arm with these drives, as a log of the robot ``of``."""
    t, q, dq, ddq = fourier_states(ARM, 20.0, 200.0, np.random.default_rng(1))
    tau = ARM.with_actuators(content).inverse_dynamics(q, dq, ddq, friction=True)
    return tw.Motion(t, q, dq, ddq, tau, robot=of, in_seconds=True)


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow) for n in DRIVES])
def test_no_doubt_about_a_perfect_log_of_a_drive(name):
    entry, options = DRIVES[name]
    log = perfect_log({"actuators": dict.fromkeys(ARM.joint_names, entry)}, ARM)
    assert identify(ARM, log, cutoff=20.0, **options).doubts == ()


CASES = [
    pytest.param(k, form, known, marks=() if (k, form, known) == (0, "motor_per_joint", "robot") else pytest.mark.slow)
    for k, form, known in product(range(4), ("motor_per_joint", "joint_per_motor"), ("robot", "log"))
]


@pytest.mark.parametrize(("k", "form", "known"), CASES)
def test_no_doubt_about_a_perfect_log_of_coupled_drives(k, form, known):
    """A group such as a - 2 b may be negative; the coupling is known from the robot, or from the side of the log."""
    coupling = {"motors": ["a", "b"], "joints": list(ARM.joint_names[1:]), form: MATRICES[k]}
    content = {"couplings": {"both": coupling}, "actuators": {"a": COUPLED, "b": COUPLED}}
    if known == "robot":
        seen = ARM.with_actuators(content | {"actuators": {}})
        found = identify(seen, perfect_log(content, seen), cutoff=20.0)
    else:
        side = motor_side(ARM.model, content | {"log": {"side": "motor"}})
        found = identify(ARM, perfect_log(content, ARM), motor_side=side, cutoff=20.0)
    assert found.doubts == ()
