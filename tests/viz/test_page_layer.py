"""Results drawn on a page: contact forces of a robot on its feet, errors of readings before and after a calibration."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure
from page_files import read_page
from standing_robots import dog

import twistwrench as tw
from twistwrench.statics.contacts import contact_maps
from twistwrench.viz import plots
from twistwrench.viz.colours import SEQUENTIAL

pytest_plugins = ("page_fixtures", "numpy_fixtures")
pytestmark = pytest.mark.usefixtures("on_numpy")


@pytest.fixture(scope="module")
def standing():
    return tw.check(*dog(3.0), feet="auto", contact_friction=0.6)


@pytest.fixture(scope="module")
def calibrated():
    return tw.calibration.calibrate("ur5", "demo")


@pytest.fixture
def opened(page, folder):
    def opened(answer):
        path = folder / f"{answer.call}_layer.html"
        path.write_text(answer.viewer().page, encoding="utf-8")
        page.complaints.clear()
        page.open(path.as_uri())
        assert page.wait("!!window.viewer")
        return page

    return opened


ARROWS = "(row) => viewer.layer.groups.map((group) => Array.from({ length: group.count }, (_, c) => viewer.layer.arrow(group, group.count * row + c)))"


def test_contact_forces_are_those_of_the_answer(opened, standing):
    """At the contacts, to 1e-6 of single precision, and in proportion; another load hides them."""
    page, found = opened(standing), standing.support
    _, points = contact_maps(found.robot, found.states.q, found.contacts)
    for row in (0, 20, 33):
        (seen,) = page.run(f"({ARROWS})({row})")
        np.testing.assert_allclose([p for p, _ in seen], points[row], atol=1e-6)
        drawn = np.array([along for _, along in seen])
        scale = np.linalg.norm(drawn) / np.linalg.norm(found.forces[row])
        np.testing.assert_allclose(drawn, scale * found.forces[row], atol=1e-6)
    count = "(() => { const items = []; viewer.layer.marks(items); return items.length; })()"
    page.run("viewer.seek(0.2)")
    assert page.run(count) == 4
    page.run("viewer.mechanics.mass = 2; viewer.loaded()")
    assert page.run(count) == 0
    assert page.complaints == []


def test_the_largest_contact_force_is_drawn_as_long_as_a_third_of_the_robot(opened, standing):
    page = opened(standing)
    longest = page.run(
        f"Math.max(...Array.from(viewer.motion.time, (_, row) => ({ARROWS})(row)).flat(2).map(([, along]) => norm(along)))"
    )
    assert longest == pytest.approx(0.35 * page.run("viewer.robot.size"), rel=1e-6)


def test_a_contact_near_the_edge_of_its_cone_is_amber_and_beyond_it_red(opened, standing):
    page = opened(standing)
    seen = page.run("[0.5, 0.9, 1.1].map((share) => viewer.layer.colour({ shares: [share], colour: 'own' }, 0))")
    shares = page.run("viewer.robot.colours.shares")
    assert seen == ["own", shares[2][1], shares[-1][1]]
    use = np.array(page.run("Array.from(viewer.layer.groups[0].shares)"))
    assert 0.29 / 0.6 < use.max() <= 1.0  # the command: needs 0.29, given 0.6; forces of least norm take what is given


def test_errors_of_a_calibration_are_those_of_the_readings(opened, calibrated):
    """A hundred times enlarged, at the measured points; their rms is that of the answer."""
    points, before, after = calibrated.error_vectors
    assert np.sqrt(np.mean((before**2).sum(axis=1))) == pytest.approx(calibrated.before, rel=1e-12)
    np.testing.assert_allclose(np.linalg.norm(after, axis=1), np.concatenate(calibrated.fit.errors), rtol=1e-12)
    page = opened(calibrated)
    for seen, vectors in zip(page.run(f"({ARROWS})(0)"), (before, after), strict=True):
        np.testing.assert_allclose([p for p, _ in seen], points, atol=1e-6)
        np.testing.assert_allclose([along for _, along in seen], 100 * vectors, atol=1e-6)
    told = page.run("document.querySelector('#layer span').textContent").replace("\u2212", "-")
    assert told.startswith(str(calibrated).split("\n")[0].split(";")[0])
    assert "100 times enlarged" in page.run("document.querySelector('#layer div').textContent")
    assert page.complaints == []


def test_the_workspace_has_the_predicted_errors_of_the_calibration(opened, calibrated):
    """Six equal steps from the least to the largest; places are those of the calibrated tip, and a switch hides them."""
    errors = 1e3 * calibrated.remaining_at(calibrated.reference)
    tips = calibrated.robot.forward_kinematics(calibrated.reference)[:, :3, 3]
    page = opened(calibrated)
    groups = page.run("viewer.layer.workspace.map((group) => group.places)")
    steps = np.minimum(np.floor(6 * (errors - errors.min()) / np.ptp(errors)), 5)
    assert sum(map(len, groups)) == len(errors) == 500
    for k, group in enumerate(groups):
        np.testing.assert_allclose(np.reshape(group, (-1, 3)), tips[steps == k], atol=1e-6)
    drawn = "(() => { const items = []; viewer.layer.marks(items); return items.length; })()"
    told = f"predicted error, {errors.min():.3f} to {errors.max():.3f} mm"
    assert told in page.run("document.querySelector('#layer .legend').innerText")
    before = page.run(drawn)
    page.run("viewer.panel.show('workspace', false)")
    assert page.run(drawn) == before - sum(map(bool, groups))
    assert page.run("viewer.layer.chip.hidden")
    assert page.complaints == []


def test_the_chart_of_a_report_has_the_colours_of_the_page(calibrated):
    """The same six steps of the same error."""
    axis = Figure().subplots()
    plots.calibration._draw_predicted_errors(axis, calibrated)
    errors = 1e3 * calibrated.remaining_at(calibrated.reference)
    steps = np.minimum(np.floor(6 * (errors - errors.min()) / np.ptp(errors)), 5).astype(int)
    drawn = axis.collections[0].to_rgba(errors)[:, :3]
    np.testing.assert_allclose(drawn, np.array(SEQUENTIAL)[steps], atol=1e-12)


def test_other_readings_have_no_layer(folder, standing):
    """A report without contacts: no layer is invented."""
    robot = tw.robots.ur5()
    log = tw.robots.path_of("ur5").with_name("ur5_demo.csv")
    path = folder / "plain.html"
    path.write_text(tw.check(robot, log).viewer().page, encoding="utf-8")
    assert read_page(path)[0]["layer"] is None
