"""Every numbered example runs, its numbers obey their laws, and its picture shows something and is kept."""

from __future__ import annotations

import ast
import re
import runpy
import sys
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from places import ROOT

import twistwrench as tw

pytest.importorskip("matplotlib")
SCRIPTS = sorted((ROOT / "examples").glob("[0-9][0-9]_*.py"))


class Ran(NamedTuple):
    """What a script left behind."""

    names: dict[str, Any]
    said: str
    pixels: np.ndarray

    def numbers(self, pattern: str) -> list[float]:
        found = re.search(pattern.replace("#", r"(-?[\d.]+(?:e[-+]\d+)?)"), self.said)
        assert found, f"{pattern!r} not in {self.said!r}"
        return [float(x) for x in found.groups()]


@pytest.fixture
def ran(tmp_path, monkeypatch, capsys):
    """Run the script of that number as the shell would, with small settings where it has them."""
    from matplotlib.image import imread

    def run(number: int) -> Ran:
        script = SCRIPTS[number - 1]
        assert script.name.startswith(f"{number:02}_")
        quick = ["--quick"] if "--quick" in script.read_text("utf-8") else []
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", [str(script), "picture.png", *quick])
        names = runpy.run_path(str(script), run_name="__main__")
        assert [p.name for p in tmp_path.iterdir()] == ["picture.png"]
        assert Path("picture.png").read_bytes().startswith(b"\x89PNG")
        return Ran(names, capsys.readouterr().out, imread("picture.png")[..., :3])

    return run


def assert_shows_something(pixels: np.ndarray) -> None:
    """Ink in the left and in the right half, neither of them filled, and curves in colours on the right."""
    assert pixels.shape[0] > 500
    assert pixels.shape[1] > 1000
    halves = np.array_split(pixels[80:], 2, axis=1)
    for half in halves:
        assert 0.02 < (half < 0.9).any(axis=-1).mean() < 0.75
    assert (np.ptp(halves[1], axis=-1) > 0.2).mean() > 0.005


@pytest.mark.slow
def test_the_fall_keeps_its_energy_as_well_as_its_method(ran):
    """Schemes of order 4 and of order 2, and Euler's two; and good ones agree on where the arm is."""
    example = ran(1)
    drift = {m: example.numbers(rf"{m} +drift #")[0] for m in example.names["methods"]}
    assert 100 * max(drift["variational"], drift["rk4"]) < drift["midpoint"] < 1e-3
    assert 40 * drift["midpoint"] < min(drift["euler"], drift["semi_implicit"])
    falls = example.names["falls"]
    np.testing.assert_allclose(falls["variational"].q, falls["rk4"].q, atol=1e-5)
    assert np.abs(falls["rk4"].q - falls["rk4"].q[0]).max() > 1
    assert_shows_something(example.pixels)


def test_the_flip_has_the_period_of_eulers_equations(ran):
    """Integrated here, apart from the flight and from the elliptic integral."""
    from scipy.integrate import solve_ivp

    example = ran(2)
    a, b, c = example.names["sides"]
    I = np.array([b * b + c * c, a * a + c * c, a * a + b * b]) / 12  # of 1 kg
    euler = lambda t, w: np.cross(I * w, w) / I  # noqa: E731
    crosses = lambda t, w: w[1]  # noqa: E731
    start = [0, example.names["spin"], example.names["push"]]
    solved = solve_ivp(euler, (0, 12), start, "DOP853", events=crosses, rtol=1e-12, atol=1e-14)
    period = solved.t_events[0][2] - solved.t_events[0][0]
    np.testing.assert_allclose(example.numbers("period # s, closed form # s"), period, rtol=1e-6)
    assert max(example.numbers("momentum #, energy # ")) < 1e-9
    assert_shows_something(example.pixels)


def test_the_payload_takes_one_joint_to_its_limit_and_none_beyond(ran):
    example = ran(3)
    mass, moment, second = example.numbers("carries # kg; .* at # s, the next at #%")
    names = example.names
    loaded = tw.robots.ur5().with_payload(tw.SpatialInertia.from_com(names["mass"], com=(0, 0, 0.05)))
    shares = np.abs(loaded.inverse_dynamics(names["q"], names["dq"], names["ddq"])) / loaded.limits.effort
    assert shares.max() == pytest.approx(1.0, abs=1e-9)
    k, joint = np.unravel_index(shares.argmax(), shares.shape)
    assert names["names"][joint] in example.said
    assert (mass, moment) == (round(names["mass"], 2), round(names["t"][k], 3))
    assert second == round(100 * np.delete(shares, joint, axis=1).max())
    assert_shows_something(example.pixels)


@pytest.mark.slow
def test_what_controllers_do_not_know_stays_as_an_error_of_its_kind(ran):
    """At rest: Kp e = Δg under PD, M Kp e = Δg under computed torque, K x_e = m g under impedance."""
    example = ran(4)
    names, end = example.names, example.names["move"].duration
    empty, loaded, goal, w = names["empty"], names["loaded"], names["move"](end)[0], names["w"]
    for law in ("PD and gravity", "computed torque", "impedance"):
        known = example.numbers(rf"{law} *, load known *: hand off by *# mm at most, *# mm")
        unknown = example.numbers(rf"{law} *, load unknown *: hand off by *# mm at most, *# mm")
        assert 10 * known[1] < unknown[1] < unknown[0] < 50
        assert known[0] < unknown[0]
    rest = {law: names["runs"][law, "unknown"].q[-1] for law in names["laws"]}

    def load(q):
        return loaded.gravity_forces(q) - empty.gravity_forces(q)

    def near(torque, law):
        np.testing.assert_allclose(torque, load(rest[law]), atol=0.03 * np.abs(load(rest[law])).max())  # still settling

    q = rest["PD and gravity"]
    near(w**2 * names["M"] * (goal - q), "PD and gravity")
    q = rest["computed torque"]
    near(w**2 * empty.mass_matrix(q) @ (goal - q), "computed torque")
    sag = 1000 * 2.0 * 9.81 / names["soft"]["stiffness"]
    assert example.numbers("impedance *, load unknown *: .*, *# mm in")[0] == pytest.approx(sag, rel=0.03)
    assert_shows_something(example.pixels)


@pytest.mark.slow
def test_the_floor_carries_the_weight_until_its_centre_passes_the_feet(ran):
    example = ran(5)
    names, dog = example.names, tw.robots.quadruped()
    masses = [float(m.get("value")) for m in ET.parse(tw.robots.path_of("quadruped")).iter("mass")]
    weight = 9.81 * sum(masses)
    np.testing.assert_allclose(example.numbers("weight # N, on the feet # to # N"), weight, atol=0.006)
    places = np.array([dog.forward_kinematics(names["standing"](0.0), foot)[:3, 3] for foot in names["feet"]])
    for lean, found in zip(names["leans"], names["answers"], strict=True):
        q = names["standing"](lean)
        feet = np.array([dog.forward_kinematics(q, foot)[:3, 3] for foot in names["feet"]])
        np.testing.assert_allclose(feet[:, :2], places[:, :2], atol=1e-8)
        np.testing.assert_allclose(feet[:, 2], 0, atol=1e-8)
        centre = dog.center_of_mass(q)
        assert found.holds == bool(feet[:, 0].min() <= centre[0] <= feet[:, 0].max())
        if found.holds:
            assert found.share <= 1
            assert all(c.allows(f) for c, f in zip(names["contacts"], found.forces, strict=True))
            np.testing.assert_allclose(found.forces.sum(axis=0), [0, 0, weight], atol=1e-6)
            moment = np.cross(feet, found.forces).sum(axis=0)
            np.testing.assert_allclose(moment, np.cross(centre, [0, 0, weight]), atol=1e-6)
    assert not names["answers"][0].holds
    assert not names["answers"][-1].holds
    assert_shows_something(example.pixels)


def test_the_hands_of_the_rollouts_are_off_by_the_load_over_the_square_of_the_frequency(ran):
    """X = J M⁻¹ Δg / ω² to first order: for stiff gains to 10 %, which have settled and are bent little."""
    example = ran(6)
    names = example.names
    robot, goal = names["robot"], names["goal"]
    one = robot.with_payload(tw.SpatialInertia.from_com(1.0, (0, 0, 0)))
    e = np.linalg.solve(robot.mass_matrix(goal), one.gravity_forces(goal) - robot.gravity_forces(goal))
    tip = 1000 * np.linalg.norm((robot.jacobian(goal, kind="world_aligned") @ e)[3:])
    ratio = names["error"] / (tip * names["mass"] / names["omega"] ** 2)
    stiff = names["omega"] > 40
    assert stiff.sum() > 30
    np.testing.assert_allclose(ratio[stiff], 1, atol=0.1)
    assert np.median(ratio[stiff]) > 0.95
    assert not names["motions"].unstable.any()
    median, most = example.numbers("off by # mm in the median, # mm in")
    assert 0 < median < most
    assert example.numbers("#% ask for more")[0] == round(100 * np.mean(names["share"] > 1), 1)
    assert example.numbers("# steps a second")[0] > 0
    assert_shows_something(example.pixels)


@pytest.mark.slow
def test_the_nut_of_the_gripper_does_the_work_of_its_pads(ran):
    """F ds + Σ f dx = dV along the openings, by central differences good to 1e-3; and the nut is where the geometry has it."""
    example = ran(7)
    names = example.names
    q, width, robot = names["q"], names["width"], names["robot"]
    assert names["found"].converged.all() and np.abs(names["closed"].constraint_error(q)).max() <= 1e-12
    s = q[:, robot.coordinate_names.index("spindle")]
    work = names["push"] * np.gradient(s) + names["grip"] * np.gradient(width)
    stored = np.gradient(robot.potential_energy(q))
    np.testing.assert_allclose(work[1:-1], stored[1:-1], atol=1e-3 * names["grip"] * (width[1] - width[0]))
    angle = np.arcsin(0.5 * width / names["crank"])
    elbow = np.stack([names["inner"] + names["arm"] * np.cos(angle), -names["arm"] * np.sin(angle)])
    np.testing.assert_allclose(s, elbow[1] - np.sqrt(names["rod"] ** 2 - (elbow[0] - names["pin"]) ** 2), atol=1e-10)
    least, most, at = example.numbers("pushes # to # N, most at # mm")
    assert 0 < least < most and at == round(1000 * width[np.argmax(names["push"])])
    assert_shows_something(example.pixels)


@pytest.mark.slow
def test_the_legs_of_the_hexapod_carry_its_weight_by_virtual_work(ran):
    """Σ F dl = dV around the circle at rest, and the power of the legs that of the energy in motion; slopes by Fourier sums."""
    example = ran(8)
    names = example.names
    closed, robot, q = names["closed"], names["robot"], names["found"].q
    T = robot.forward_kinematics(q, "platform")
    np.testing.assert_allclose(T, names["poses"], atol=1e-9)
    ends = np.einsum("nij,kj->nki", T[:, :3, :3], names["sockets"]) + T[:, None, :3, 3]
    lengths = np.linalg.norm(ends - names["anchors"], axis=2)
    legs = [robot.coordinate_names.index(name) for name in names["motors"]]
    np.testing.assert_allclose(q[:, legs], lengths, atol=1e-10)

    def slope(x):
        """Of what is periodic, by all the harmonics there are."""
        sums = np.fft.rfft(x[:-1], axis=0)
        ways = 2j * np.pi * np.arange(len(sums)) / names["period"]
        return np.fft.irfft(sums * ways.reshape(-1, *[1] * (x.ndim - 1)), len(x) - 1, axis=0)

    needed = slope(robot.potential_energy(q))
    np.testing.assert_allclose(
        (names["at_rest"][:-1] * slope(lengths)).sum(axis=1), needed, atol=2e-3 * np.abs(needed).max()
    )
    energy = slope(robot.kinetic_energy(q, names["dq"])) + needed
    given = (names["force"][:-1] * slope(lengths)).sum(axis=1)
    np.testing.assert_allclose(given[3:-3], energy[3:-3], atol=0.05 * np.abs(energy).max())
    assert example.numbers("leg # carries most")[0] == names["worst"] and (names["force"] < 0).any()
    assert np.abs(closed.constraint_error(q)).max() <= 1e-12
    assert_shows_something(example.pixels)


def test_every_example_has_a_picture_and_a_text():
    """Every picture is there, none of them large; each script begins with a title, what is seen, and what to change."""
    pytest.importorskip("PIL")
    gallery = runpy.run_path(str(ROOT / "examples" / "__main__.py"))
    assert gallery["SCRIPTS"] == SCRIPTS
    for script in SCRIPTS:
        title, *said, to_change = ast.get_docstring(ast.parse(script.read_text("utf-8"))).split("\n\n")
        assert title == f"{gallery['title'](script)}." and said and to_change.startswith("To change: ")
        assert 10_000 < gallery["picture_of"](script).stat().st_size < 150_000
    assert len(list(gallery["PICTURES"].iterdir())) == len(SCRIPTS) == 8


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda s: s.name)
def test_examples_use_public_names_only(script):
    tree = ast.parse(script.read_text("utf-8"))
    used = [n.attr for n in ast.walk(tree) if isinstance(n, ast.Attribute)]
    used += [a.name for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) for a in n.names]
    assert not [name for name in used if name.startswith("_")]


def test_examples_say_what_they_do(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["02_tumbling_body.py", "--help"])
    with pytest.raises(SystemExit) as left:
        runpy.run_path(str(SCRIPTS[1]), run_name="__main__")
    assert left.value.code == 0
    assert "about the middle principal axis" in capsys.readouterr().out
