"""Values that are known stay, a payload is found alone, and few groups predict what all of them do."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner
from identification_logs import coloured, fourier_states, known_log

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.identification import BaseParameters, UnknownParameters, identify
from twistwrench.identification.body_changes import BodyChanges
from twistwrench.identification.consistent import PositivePrior, PositiveProblem
from twistwrench.identification.essential_groups import _elimination_order
from twistwrench.identification.parameters import FRICTION
from twistwrench.identification.payload import known_but_for, payload_from, unknown_of
from twistwrench.mechanics.model.actuation import with_friction

ARM = tw.robots.planar_2r()
UR5 = tw.robots.ur5().lock({"shoulder_pan_joint": 0.0, "elbow_joint": 1.0, "wrist_3_joint": 0.0})
BOX = tw.SpatialInertia.from_com(2.0, (0.02, -0.03, 0.1), np.diag([0.01, 0.012, 0.008]))


def run(*arguments):
    return CliRunner().invoke(main, ["identify", *map(str, arguments)])


@pytest.fixture(scope="module")
def planar():
    return known_log(ARM, 3, seconds=10.0, rate=100.0)


@pytest.fixture(scope="module")
def free(planar):
    return identify(ARM, planar.motion, cutoff=10.0)


@pytest.mark.slow
def test_what_is_known_stays_and_is_a_group_of_its_own(planar, free):
    known = {"link2.m": 1.0, "joint1.viscous": float(planar.drives["viscous"][0])}
    found = identify(ARM, planar.motion, cutoff=10.0, known=known)
    assert found.base.count == free.base.count + 1  # link2.m was a part of other groups
    for name, value in known.items():
        assert abs(found.parameters[name][0] - value) < 1e-6 and found.parameters[name][1] < 1e-6
        assert abs(found.consistent.value(name) - value) < 1e-5
    assert not any(" link2.m " in f"{group} " for group in found.groups)
    assert any(" link2.m " in f"{group} " for group in free.groups)
    assert found.verdict.ok and found.to_dict()["held"] == pytest.approx(known)


@pytest.fixture(scope="module")
def with_known_friction(planar):
    known = {"joint1.viscous": float(planar.drives["viscous"][0])}
    return identify(ARM, planar.motion, cutoff=10.0, known=known, method="ols", friction_speed=0.05, shift=0.0)


def test_what_is_known_makes_the_rest_no_less_sure(planar, with_known_friction):
    """Textbook's deviations, which only the equations decide."""
    found = with_known_friction
    before = identify(ARM, planar.motion, cutoff=10.0, method="ols", friction_speed=0.05, shift=0.0)
    surer = found.covariance.textbook / before.covariance.textbook
    assert found.groups == before.groups and surer.max() < 1.01
    assert surer[found.groups.index("joint1.coulomb")] < 0.9  # which a slow motion confuses with it


def test_each_group_stands_beside_its_own_value_in_the_file(with_known_friction):
    found = with_known_friction
    table = found.tables[f"{found.free_count} groups of parameters"].to_dict()
    file = {name: parameter["prior"] for name, parameter in found.to_dict()["parameters"].items()}
    assert table["file"] == [file[name] for name in table["group"]]
    assert file.keys() - set(table["group"]) == {"joint1.viscous"}


@pytest.fixture(scope="module")
def with_other_mass(planar):
    return identify(ARM, planar.motion, cutoff=10.0, known={"link2.m": 1.3}, friction_speed=0.05, shift=0.0)


def test_a_held_mass_stands_beside_that_of_the_file(with_other_mass):
    """The file has 1 kg for each link; 1.3 kg are the caller's, not the file's."""
    bodies = {body["link"]: body for body in with_other_mass.to_dict()["bodies"]}
    assert [bodies[link]["file_mass"] for link in ("link1", "link2")] == [1.0, 1.0]
    assert bodies["link2"]["mass"] == pytest.approx(1.3, abs=1e-6)
    assert not bodies["link2"]["mass_changed"]


def test_rounding_errors_of_a_held_mass_are_no_change():
    """A change of 1e-9 kg of a held mass has no deviation; the other mass is 0.5 ± 0.1 kg off, and is sure alone and in the sum."""
    masses = np.array([1.0 + 1e-9, 2.5])
    C = np.diag([0.0, 0.01])
    is_held = np.array([True, False])
    found = BodyChanges(("a", "b"), np.array([1.0, 2.0]), masses, C, np.zeros(2), np.zeros(2, bool), None, is_held)
    assert found.is_heavier.tolist() == [False, True] and found.is_sum_heavier
    alone = BodyChanges(("a",), np.ones(1), masses[:1], C[:1, :1], np.zeros(1), np.zeros(1, bool), None, is_held[:1])
    assert not alone.is_heavier.any() and not alone.is_sum_heavier


def test_a_wrong_value_is_held_all_the_same(planar):
    found = identify(ARM, planar.motion, cutoff=10.0, known={"joint2.coulomb": 5.0})
    assert abs(found.parameters["joint2.coulomb"][0] - 5.0) < 1e-5
    assert not found.verdict.ok


@pytest.fixture(scope="module")
def loaded_log():
    t, q, dq, ddq = fourier_states(UR5, 15.0, 100.0, np.random.default_rng(1))
    tau = UR5.with_payload(BOX, "tool0").inverse_dynamics(q, dq, ddq) + np.array([0.5, 0.0, -0.2])
    return tw.Motion(t, q, tau=tau + 0.1 * coloured(len(t), UR5.nv, 100.0, np.random.default_rng(2)), robot=UR5)


def test_a_payload_alone(loaded_log):
    found = identify(UR5, loaded_log, cutoff=10.0, payload_only="tool0")
    payload = found.payload
    assert found.verdict.ok, found.verdict
    assert abs(payload.mass - 2.0) < 4 * payload.mass_deviation < 0.1
    told = payload.com_deviations < 0.01
    assert told.sum() >= 2 and (np.abs(payload.com - BOX.com) < 4 * payload.com_deviations)[told].all()
    with pytest.raises(tw.TwistWrenchError, match="payload"):
        found.write("nowhere.urdf")


def test_a_payload_of_nothing(loaded_log):
    """A log without a payload: a mass of nothing, within what it is said to be sure to."""
    t, q, dq, ddq = fourier_states(UR5, 15.0, 100.0, np.random.default_rng(1))
    tau = UR5.inverse_dynamics(q, dq, ddq) + 0.1 * coloured(len(t), UR5.nv, 100.0, np.random.default_rng(2))
    payload = identify(UR5, tw.Motion(t, q, tau=tau, robot=UR5), cutoff=10.0, payload_only="tool0").payload
    assert abs(payload.mass) < 4 * payload.mass_deviation


def test_few_groups_predict_what_all_of_them_do(free):
    """Of an arm whose links' centres of mass are on their axes: these two groups are nothing."""
    essential = free.essential
    assert {"link1.mcy", "link2.mcy"}.isdisjoint(essential.names)
    assert len(essential.names) < free.base.count and essential.held_out <= 1.01 * min(s for _, s in essential.curve)
    shares = [share for _, share in essential.curve]
    assert shares[-1] > 3 * shares[0]  # one group alone predicts little


def test_the_command(planar, tmp_path):
    planar.motion.to_csv(tmp_path / "log.csv")
    out = tmp_path / "found.json"
    said = run("planar_2r", tmp_path / "log.csv", "--cutoff", 10, "--known", "link2.mass=1 kg", "--all", "--json", out)
    assert said.exit_code == 0, said.output
    assert "essential groups" in said.output and "held at known values" in said.output
    found = json.loads(out.read_text())
    assert found["held"] == {"link2.m": pytest.approx(1.0)} and 5 < len(found["essential"]) < found["base_parameters"]
    said = run(
        "planar_2r", tmp_path / "log.csv", "--cutoff", 10, "--payload-only", "link2", "--json", out, "--overwrite"
    )
    assert "payload at link2" in said.output
    assert json.loads(out.read_text())["payload"]["frame"] == "link2"


BAD = {
    "no such parameter": (("--known", "link9.m=1"), "link9.m"),
    "no value": (("--known", "link2.m"), "NAME=VALUE"),
    "no such kind": (("--known", "link2.visc=1"), "no parameter named 'visc'. Did you mean 'viscous'"),
    "another unit": (("--known", "link2.m=1 lb"), "lb"),
    "no number": (("--known", "link2.m=nan"), "finite"),
    "no such frame": (("--payload-only", "hand"), "hand"),
    "a frame that stands": (("--payload-only", "base"), "does not move"),
    "a robot of a payload": (("--payload-only", "link2", "--out", "new.urdf"), "--out"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_line(case, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    options, word = BAD[case]
    said = run("planar_2r", "demo", *options)
    assert said.exit_code == 2 and word in said.output and not list(tmp_path.iterdir()), said.output


def test_friction_that_a_payload_leaves_is_that_of_the_robot():
    arm = tw.Robot(with_friction(ARM.model, {"joint1": {"viscous": 3.0, "coulomb": 7.0}, "joint2": {}}))
    known = known_but_for(arm, "link2")
    assert (known["joint1.viscous"], known["joint1.coulomb"]) == (3.0, 7.0)
    assert known["link1.m"] == ARM.model.bodies[0].inertia.mass and "link2.m" not in known


def test_deviations_of_a_centre_are_those_of_small_changes():
    """c = (m c) / m depends on the mass too: its deviations are those by central differences of the centre by the groups."""
    given = {"motor_inertia": True, "friction": FRICTION, "motor_side": None, "known": None, "stribeck_speed": 0.1}
    base = BaseParameters.from_unknowns(unknown_of(UR5, payload_only="tool0", **given))
    loaded = BaseParameters.from_unknowns(unknown_of(UR5.with_payload(BOX, "tool0"), payload_only="tool0", **given))
    values = base.project(base.unknown.file_values) + (
        loaded.project(loaded.unknown.file_values) - base.project(base.unknown.file_values)
    )
    C = np.diag(np.where(base.held, 0.0, 1e-2) ** 2 * np.linspace(1.0, 3.0, base.count))
    found = payload_from(UR5, "tool0", base, values, C)
    np.testing.assert_allclose(found.mass, 2.0, rtol=1e-6)
    J = [
        (payload_from(UR5, "tool0", base, values + h, C).com - payload_from(UR5, "tool0", base, values - h, C).com)
        / 2e-6
        for h in 1e-6 * np.eye(base.count)
    ]
    np.testing.assert_allclose(found.com_deviations, np.sqrt((np.array(J).T @ C @ np.array(J)).diagonal()), rtol=1e-4)


def test_a_body_keeps_a_known_mass_where_the_rows_tell_nothing():
    """Without any row the prior holds the file's bodies, and the known value holds the mass: 10 % more than the file's."""
    mass = 1.1 * UR5.model.bodies[1].inertia.mass
    base = BaseParameters.from_unknowns(UnknownParameters(UR5, known={"wrist_1_link.m": mass}))
    sizes = base.unknown.scales(*np.ones((3, UR5.nv)))
    prior = PositivePrior.from_values(base, np.zeros(base.count), sizes)
    nothing = np.zeros((base.count, base.count)), np.zeros(base.count), 0.0
    (fit,) = PositiveProblem(base, prior, *nothing, sizes).path([1e-2])
    assert fit.values[base.unknown.names.index("wrist_1_link.m")] == pytest.approx(mass, rel=1e-3)


def test_the_group_that_explains_least_is_left_out_first():
    """0.1² · 100 = 1 is explained by the first, 0.5² · 1 = 0.25 by the second, although its value is larger."""
    N, x = np.diag([100.0, 1.0]), np.array([0.1, 0.5])
    assert _elimination_order((N, N @ x, 2.0), np.full(2, 1e3), np.zeros(2, bool)).tolist() == [1, 0]
