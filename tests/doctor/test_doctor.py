"""The doctor: planted slips are found, explained and undone, healthy robots are left alone, and only the numbers concerned change."""

from __future__ import annotations

import json
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner
from quiet_loading import load_quietly

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.diagnosis import CHECKS, Severity
from twistwrench.diagnosis.symmetry_checks import _evidence
from twistwrench.robots import path_of

NUMBERS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
AT = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}


class Arm:
    """An arm of links that are two boxes each, with the inertia that these have; every number can be written otherwise."""

    def __init__(self, seed: int, links: int = 4) -> None:
        rng = np.random.default_rng(seed)
        self.shapes, self.inertias = [], []
        for _ in range(links):
            boxes = [(rng.uniform(0.05, 0.3, 3), rng.uniform(-0.1, 0.1, 3)) for _ in range(2)]
            parts = []
            for size, place in boxes:
                T = np.eye(4)
                T[:3, 3] = place
                parts.append(tw.SpatialInertia.box(size, density=300.0).in_frame(T))
            self.shapes.append(boxes)
            self.inertias.append(parts[0] + parts[1])
        self.axes = rng.integers(0, 3, links)

    def tensor(self, link: int) -> np.ndarray:
        return self.inertias[link].moment_about_com

    def text(self, tensors: dict[int, np.ndarray] | None = None, coms: dict[int, np.ndarray] | None = None) -> str:
        out = ['<?xml version="1.0"?>\n<!-- an arm -->\n<robot name="arm">\n  <link name="base"/>']
        for k, G in enumerate(self.inertias):
            I = (tensors or {}).get(k, G.moment_about_com)
            com = (coms or {}).get(k, G.com)
            numbers = " ".join(f'{n}="{float(I[AT[n]])!r}"' for n in NUMBERS)
            bound = 9.81 * sum(
                b.mass * (0.4 * i + 0.2) for i, b in enumerate(self.inertias[k:])
            )  # of the weight's torque
            out.append(f'  <link name="link{k}">\n    <inertial>')
            out.append(f'      <origin xyz="{" ".join(map(repr, com.tolist()))}"/>\n      <mass value="{G.mass!r}"/>')
            out.append(f"      <inertia {numbers} />\n    </inertial>")
            for size, place in self.shapes[k]:
                out.append(
                    f'    <visual><origin xyz="{" ".join(map(repr, place.tolist()))}"/><geometry>'
                    f'<box size="{" ".join(map(repr, size.tolist()))}"/></geometry></visual>'
                )
            axis = " ".join("1" if i == self.axes[k] else "0" for i in range(3))
            parent = "base" if k == 0 else f"link{k - 1}"
            out.append(
                f'  </link>\n  <joint name="joint{k}" type="revolute"><parent link="{parent}"/><child link="link{k}"/>'
                f'<origin xyz="0 0 0.4"/><axis xyz="{axis}"/>'
                f'<limit lower="-2" upper="2" effort="{1.5 * bound:.3f}" velocity="3"/><dynamics damping="0.1"/></joint>'
            )
        return "\n".join(out) + "\n</robot>\n"


def impossible(I: np.ndarray) -> bool:
    A, B, C = np.linalg.eigvalsh(I)
    return A < -1e-5 * (A + B + C) or A + B < C - 1e-5 * (A + B + C)


def changed(I: np.ndarray, entry: str, value: float) -> np.ndarray:
    J = I.copy()
    J[AT[entry]] = J[AT[entry][::-1]] = value
    return J


@pytest.mark.parametrize("seed", range(8))
def test_a_robot_of_uniform_solids_has_nothing_wrong(seed):
    assert tw.doctor(Arm(seed).text()).findings == ()


@pytest.mark.parametrize("name", ["ur5", "panda", "quadruped", "floating_box"])
def test_the_bundled_robots_have_no_warning(name):
    assert all(f.severity is Severity.NOTE for f in tw.doctor(path_of(name)).findings)


def planted(kind: str, seed: int) -> tuple[Arm, int, np.ndarray] | None:
    """An arm with one slip of a kind in one link, that makes a tensor nobody has or that fits nowhere."""
    arm, rng = Arm(seed), np.random.default_rng(seed)
    k = int(rng.integers(0, 4))
    I, G = arm.tensor(k), arm.inertias[k]
    if kind == "power of a moment":
        J = changed(I, (entry := ("ixx", "iyy", "izz")[seed % 3]), I[AT[entry]] * 10.0)
    elif kind == "small moment":
        J = changed(I, (entry := ("ixx", "iyy", "izz")[seed % 3]), I[AT[entry]] / 10.0)
    elif kind == "power of a product":
        J = changed(I, (entry := ("ixy", "ixz", "iyz")[seed % 3]), I[AT[entry]] * 100.0)
    elif kind == "unit":
        J = I * 1e6
    else:
        raise AssertionError(kind)
    del G
    return (arm, k, J) if kind == "unit" or impossible(J) else None


@pytest.mark.parametrize("kind", ["power of a moment", "small moment", "power of a product", "unit"])
def test_a_planted_slip_is_found_and_undone(kind):
    """Where it is explained at all, it is as that slip, and the original numbers come back."""
    explained = tried = 0
    for seed in range(12):
        if (made := planted(kind, seed)) is None:
            continue
        arm, k, J = made
        tried += 1
        report = tw.doctor(arm.text({k: J}))
        (finding,) = [f for f in report.findings if f.check in ("impossible", "too-large")]
        assert finding.where == f"link 'link{k}'" and finding.severity is not Severity.NOTE
        if finding.repair.kind != "slip":
            continue
        explained += 1
        (G,) = finding.repair.inertias.values()
        assert np.allclose(G.moment_about_com, arm.tensor(k), rtol=1e-9, atol=1e-12), finding.repair.sentence
    assert tried >= 4 and explained >= 0.7 * tried, (tried, explained)


def test_the_sign_of_the_products_is_told_from_the_shapes():
    found = 0
    for seed in range(200):
        arm = Arm(seed, links=1)
        I = arm.tensor(0)
        J = 2 * np.diag(np.diag(I)) - I
        if impossible(J):
            (finding,) = tw.doctor(arm.text({0: J}), only="impossible").findings
            (G,) = finding.repair.inertias.values()
            found += finding.repair.kind == "slip"
            if finding.repair.kind == "slip":
                assert np.allclose(G.moment_about_com, I, rtol=1e-9, atol=1e-12)
    # Two boxes of such sizes seldom have products so large; an L of rods does.
    rods = Rods()
    J = 2 * np.diag(np.diag(rods.tensor(0))) - rods.tensor(0)
    assert impossible(J)
    (finding,) = tw.doctor(rods.text({0: J}), only="impossible").findings
    assert finding.repair.kind == "slip" and "sign" in finding.repair.sentence
    (G,) = finding.repair.inertias.values()
    assert np.allclose(G.moment_about_com, rods.tensor(0), rtol=1e-9, atol=1e-12)


class Rods(Arm):
    """One thin rod, slanted, made of little boxes: its products are as large as its moments."""

    def __init__(self) -> None:
        super().__init__(0, links=1)
        steps = np.linspace(-1.0, 1.0, 9)
        self.shapes = [[(np.full(3, 0.02), np.array([0.3, 0.25, 0.28]) * s) for s in steps]]
        parts = []
        for size, place in self.shapes[0]:
            T = np.eye(4)
            T[:3, 3] = place
            parts.append(tw.SpatialInertia.box(size, density=2000.0).in_frame(T))
        self.inertias = [sum(parts[1:], parts[0])]


def test_a_tensor_about_the_origin_is_told_from_one_about_the_com():
    arm = Arm(3)
    G = arm.inertias[1]
    far = np.array([0.6, 0.5, -0.4])
    # The same body drawn far from its frame: only then is the difference too large for its shapes.
    arm.shapes[1] = [(size, place + far) for size, place in arm.shapes[1]]
    T = np.eye(4)
    T[:3, 3] = far
    arm.inertias[1] = G.in_frame(T)
    (finding,) = tw.doctor(arm.text({1: arm.inertias[1].moment_about_origin})).findings
    assert finding.check == "too-large" and "about the link's origin" in finding.repair.sentence
    (H,) = finding.repair.inertias.values()
    assert np.allclose(H.parameters, arm.inertias[1].parameters, rtol=1e-9)


CYLINDER = """<robot name="spool"><link name="base"/>
<link name="spool"><inertial><mass value="1.219"/><inertia ixx="{0:.12g}" ixy="0" ixz="0" iyy="{0:.12g}" iyz="0" izz="{1:.12g}"/></inertial>
<visual><geometry><cylinder radius="0.06" length="0.12"/></geometry></visual></link>
<joint name="hinge" type="continuous"><parent link="base"/><child link="spool"/><axis xyz="0 0 1"/></joint></robot>"""


def test_a_radius_ten_times_too_large_is_told_from_its_digits():
    m, h = 1.219, 0.12
    wrong, right = ((m * (3 * r * r + h * h) / 12, m * r * r / 2) for r in (0.6, 0.06))
    (finding,) = tw.doctor(CYLINDER.format(*wrong), only="too-large").findings
    assert "radius is 10 times too large: 0.6 m for 0.06 m" in finding.repair.sentence
    (G,) = finding.repair.inertias.values()
    assert np.allclose(np.diag(G.moment_about_com), [right[0], right[0], right[1]], rtol=1e-9)
    assert finding.effect.inertia_percent == pytest.approx(9900.0)  # M is izz here, a hundred times too large


@pytest.mark.parametrize("seed", [1, 4, 6])
def test_the_effect_is_what_the_two_loaded_robots_differ_by(seed):
    arm = Arm(seed)
    text = arm.text({2: arm.tensor(2) * 1e3}, {1: arm.inertias[1].com + np.array([0.5, 0.0, 0.0])})
    report = tw.doctor(text)
    effects = report.contents.robot.effects
    for finding in report.findings:
        if not finding.repair.edits:
            continue
        before = load_quietly(text, inertia="accept")
        after = load_quietly(tw.doctor(text, only=finding.check).repaired_text(), inertia="accept")
        q = effects.q
        M, N = (np.diagonal(r.mass_matrix(q), axis1=-2, axis2=-1) for r in (before, after))
        assert finding.effect.inertia_percent == pytest.approx(100 * (np.abs(M - N) / N).max(), rel=1e-6)
        g, f = before.gravity_forces(q), after.gravity_forces(q)
        assert finding.effect.torque == pytest.approx(np.abs(g - f).max(), rel=1e-6, abs=1e-9)
    M = np.diagonal(before.mass_matrix(effects.q), axis1=-2, axis2=-1)
    assert np.allclose(effects.diagonal, M, rtol=1e-10)
    assert np.allclose(effects.gravity_torques, before.gravity_forces(effects.q), atol=1e-9)


def turned(text: str, arm: Arm, link: int, tensor: np.ndarray, rpy: tuple[float, float, float]) -> str:
    """The same with one link's tensor written along axes of its own."""
    from twistwrench.formats.urdf import rotation_of_rpy

    R = rotation_of_rpy(np.array(rpy))
    del arm
    before, _, after = text.partition(f'<link name="link{link}">')
    numbers = " ".join(f'{n}="{float((R.T @ tensor @ R)[AT[n]])!r}"' for n in NUMBERS)
    after = re.sub(r"<inertia [^>]*/>", f"<inertia note='a > b' {numbers}/>", after, count=1)
    after = after.replace("<origin ", f'<origin rpy="{" ".join(map(repr, rpy))}" ', 1)
    return f'{before}<link name="link{link}">{after}'


@pytest.mark.parametrize("fixed", [False, True], ids=["moving", "fused"])
def test_axes_of_its_own_and_fixed_joints_are_reckoned_with(fixed):
    """The slip is one along the written axes; the effect that of the body the link is part of."""
    arm = Arm(4)
    rpy = (0.3, -0.7, 1.1)
    text = turned(arm.text(), arm, 2, arm.tensor(2) * 1e4, rpy)
    if fixed:
        place = '<joint name="joint2" type="{}"><parent link="link1"/><child link="link2"/><origin {}xyz'
        text = text.replace(place.format("revolute", ""), place.format("fixed", 'rpy="0.5 0.2 -0.4" '))
        assert 'type="fixed"' in text
    report = tw.doctor(text, only=["impossible", "too-large"])
    (finding,) = report.findings
    assert "1e4 times too large, as kg cm²" in finding.repair.sentence
    (G,) = finding.repair.inertias.values()
    assert np.allclose(G.parameters, arm.inertias[2].parameters, rtol=1e-8, atol=1e-12)
    before, after = load_quietly(text), report.repaired()
    assert "note='a > b'" in report.repaired_text()
    assert np.allclose(after.model.link_inertias["link2"].parameters, arm.inertias[2].parameters, rtol=1e-8, atol=1e-9)
    q = report.contents.robot.effects.q
    M, N = (np.diagonal(r.mass_matrix(q), axis1=-2, axis2=-1) for r in (before, after))
    assert finding.effect.inertia_percent == pytest.approx(100 * (np.abs(M - N) / N).max(), rel=1e-6)


def test_the_tensor_of_the_shapes_is_along_the_written_axes():
    from twistwrench.diagnosis.tensor_checks import reference_of

    arm = Arm(4)
    link = tw.doctor(turned(arm.text(), arm, 2, arm.tensor(2), (0.3, -0.7, 1.1))).contents.robot.links["link2"]
    assert np.allclose(reference_of(link), link.written.tensor, rtol=1e-9, atol=1e-12)


def test_one_entry_along_axes_of_its_own_is_told_from_the_shapes():
    """Two entries could be at fault; the tensor of the shapes, along the same axes, tells which."""
    from twistwrench.formats.urdf import rotation_of_rpy

    arm, rpy = Arm(4), (0.3, -0.7, 1.1)
    R = rotation_of_rpy(np.array(rpy))
    wrong = R.T @ arm.tensor(2) @ R
    wrong[1, 1] *= 10.0
    text = turned(arm.text(), arm, 2, R @ wrong @ R.T, rpy)
    (finding,) = tw.doctor(text, only="impossible").findings
    assert finding.repair.sentence.endswith("iyy is 10 times too large")
    assert [edit.place.attribute for edit in finding.repair.edits] == ["iyy"]


@pytest.mark.parametrize("name", ["quadruped", "floating_box", "panda"])
def test_effects_know_all_kinds_of_joints(name):
    robot = getattr(tw.robots, name)()
    from twistwrench.diagnosis.findings import Effects

    effects = Effects(robot.model)
    assert np.allclose(effects.diagonal, np.diagonal(robot.mass_matrix(effects.q), axis1=-2, axis2=-1), rtol=1e-9)
    assert np.allclose(effects.gravity_torques, robot.gravity_forces(effects.q), atol=1e-9)


def test_effects_follow_mimic_joints():
    text = (
        Arm(2)
        .text()
        .replace(
            '<dynamics damping="0.1"/></joint>\n  <link name="link3">',
            '<mimic joint="joint0" multiplier="-2" offset="0.3"/></joint>\n  <link name="link3">',
        )
    )
    robot = load_quietly(text)
    assert robot.nv == 3
    effects = tw.doctor(text).contents.robot.effects
    assert np.allclose(effects.diagonal, np.diagonal(robot.mass_matrix(effects.q), axis1=-2, axis2=-1), rtol=1e-9)
    assert np.allclose(effects.gravity_torques, robot.gravity_forces(effects.q), atol=1e-9)


@pytest.mark.parametrize("metric", ["frobenius", "entropic"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
def test_only_the_numbers_concerned_change(metric, encoding, tmp_path):
    arm = Arm(5)
    text = arm.text({1: changed(arm.tensor(1), "ixy", 0.9 * np.trace(arm.tensor(1)))})
    text = text.replace("an arm", "ein Arm, dünn > dick \"'").replace("\n", "\r\n")
    if encoding != "utf-8-sig":
        text = text.replace('version="1.0"', f'version="1.0" encoding="{encoding}"')
    data = text.encode(encoding)
    source = tmp_path / "arm.urdf"
    source.write_bytes(data)
    report = tw.doctor(source, metric=metric)
    assert [f.check for f in report.findings] == ["impossible"]
    (repaired,) = report.write(tmp_path / "fixed.urdf")
    new = (tmp_path / "fixed.urdf").read_bytes()
    assert new != data and source.read_bytes() == data
    undone = re.sub(r"[ ]*<!-- twistwrench doctor: .*? -->\r\n", "", new.decode(encoding))
    was = dict(re.findall(r"(i[xyz]{2}) was ([^,: ]+)", new.decode(encoding)))
    assert set(was) == {edit.place.attribute for edit in repaired.repair.edits}
    for name, value in was.items():
        now = re.search(rf'{name}="([^"]*)"', undone[undone.index("link1") :])
        at = undone.index("link1") + now.start(1)
        undone = undone[:at] + value + undone[undone.index('"', at) :]
    assert undone.encode(encoding) == data
    assert load_quietly(tmp_path / "fixed.urdf", inertia="error").nv == 4
    assert tw.doctor(tmp_path / "fixed.urdf", only="impossible").findings == ()


@pytest.mark.parametrize("quoted", ["'a > b'", '"a > b"', "'a \"> b'"])
def test_a_tag_ends_behind_its_quoted_text(quoted, tmp_path):
    arm = Arm(5)
    text = arm.text({1: changed(arm.tensor(1), "ixy", 0.9 * np.trace(arm.tensor(1)))})
    source = tmp_path / "arm.urdf"
    source.write_text(text.replace("<inertia ", f"<inertia note={quoted} "))
    assert [f.check for f in tw.doctor(source).findings] == ["impossible"]
    tw.doctor(source).write(tmp_path / "fixed.urdf")
    assert load_quietly(tmp_path / "fixed.urdf", inertia="error").nv == 4
    assert (tmp_path / "fixed.urdf").read_text().count(f"note={quoted}") == text.count("<inertia ")


def test_entropic_repairs_have_volume_and_keep_what_is_possible():
    from twistwrench.shapes.solids import nearest

    rng = np.random.default_rng(0)
    for _ in range(20):
        A = rng.normal(size=(3, 3))
        reference = tw.SpatialInertia.box(rng.uniform(0.1, 1, 3), mass=2.0).moment_about_com
        bad = A + A.T
        for metric in ("frobenius", "entropic"):
            I = nearest(bad, metric, reference)
            A_, B, C = np.linalg.eigvalsh(I)
            assert A_ + B > C > 0 < A_
        assert np.allclose(nearest(reference, "frobenius"), reference)
        assert np.allclose(nearest(reference, "entropic", reference), reference, rtol=1e-9)


def test_a_robot_that_came_from_no_file_is_looked_at_and_not_written(tmp_path):
    G = tw.SpatialInertia.from_com(2.0, (0, 0, 0.1), np.diag([1.0, 0.1, 0.1]))
    robot = tw.from_dh({"a": [1.0]}, masses=[2], moments_about_com=[G.moment_about_com], inertia="accept")
    report = tw.doctor(robot)
    assert [f.check for f in report.findings if f.severity is Severity.ERROR] == ["impossible"]
    with pytest.raises(tw.ValueRangeError, match="not read from a file"):
        report.write(tmp_path / "x.urdf")


def test_what_the_checks_are_called_is_checked():
    with pytest.raises(tw.ValueRangeError, match="too-large"):
        tw.doctor(path_of("ur5"), only="to-large")
    with pytest.raises(tw.ValueRangeError, match="entropic"):
        tw.doctor(path_of("ur5"), metric="euclid")
    assert tw.doctor(path_of("planar_2r"), only=["friction", "axis"]).checks == ("friction", "axis")


# ── the command ──


def run(*arguments):
    return CliRunner().invoke(main, ["doctor", *map(str, arguments)])


def test_the_command_says_what_it_found_and_ends_with_its_code(tmp_path):
    arm = Arm(5)
    path, out = tmp_path / "arm.urdf", tmp_path / "fixed.urdf"
    path.write_text(arm.text({1: changed(arm.tensor(1), "izz", 10 * arm.tensor(1)[2, 2])}))
    result = run(path, "--out", out)
    assert result.exit_code == 1, result.output
    assert "impossible" in result.output and f"wrote {out}, with 1 repair" in result.output
    assert run(out).exit_code == 0
    before = out.read_bytes()
    refused = run(path, "--out", out)
    assert refused.exit_code == 2 and "there already" in refused.output and "--overwrite" in refused.output
    assert out.read_bytes() == before
    assert run(path, "--out", out, "--overwrite").exit_code == 1
    data = json.loads(run(path, "--json", "-").output)
    assert data["findings"][0]["check"] == "impossible" and data["findings"][0]["line"] > 0
    assert run(path, "--only", "axis").exit_code == 0
    assert run("pendulum").exit_code == 0 and run("pendulum", "--strict").exit_code == 1


@pytest.mark.parametrize(
    "arguments",
    [
        ("nothing.urdf",),
        ("ur5", "--only", "nothing"),
        ("ur5", "--meshes", "/nowhere/at/all"),
        ("ur5", "--metric", "other"),
        ("ur5", "--out", "/nowhere/at/all.urdf"),
    ],
)
def test_bad_options_are_bad_input(arguments):
    result = run(*arguments)
    assert result.exit_code == 2 and "Traceback" not in result.output


def test_the_robot_itself_is_not_overwritten(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(Arm(0).text())
    assert run(path, "--out", path).exit_code == 2


# ── hostile files ──

JUNK = {
    "empty": "",
    "truncated": Arm(0).text()[:700],
    "no robot": "<html/>",
    "bomb": '<!DOCTYPE r [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><robot name="r"><link name="&b;"/></robot>',
    "not a number": Arm(0).text().replace('mass value="', 'mass value="nan', 1),
    "infinite": Arm(0).text().replace('ixx="', 'ixx="1e999', 1),
    "negative mass": Arm(0).text().replace('mass value="', 'mass value="-', 1),
    "two of a name": Arm(0).text().replace('"link2"', '"link1"'),
    "a loop": Arm(0).text().replace('<parent link="base"/>', '<parent link="link3"/>'),
}


@pytest.mark.parametrize("name", JUNK)
def test_junk_ends_in_our_errors(name, tmp_path):
    path = tmp_path / "junk.urdf"
    path.write_text(JUNK[name])
    with pytest.raises(tw.TwistWrenchError):
        tw.doctor(path)
    assert run(path).exit_code == 2


@pytest.mark.parametrize(
    "geometry",
    [
        '<mesh filename="file:///etc/passwd"/>',
        '<mesh filename="../../../../etc/passwd.stl"/>',
        '<mesh filename="http://example.org/x.stl"/>',
        '<mesh filename="junk.stl"/>',
        '<box size="0 0 0"/>',
        '<box size="1 1"/>',
        '<sphere radius="-1"/>',
        '<cylinder radius="nan" length="1"/>',
        '<cylinder radius="1e59" length="1e59"/>',
        "<teapot/>",
        "",
    ],
)
def test_shapes_that_cannot_be_read_are_no_reason_to_stop(geometry, tmp_path):
    """No judgement is made of what was not read."""
    arm = Arm(1)
    text = re.sub(r"<geometry>.*?</geometry>", f"<geometry>{geometry}</geometry>", arm.text())
    path = tmp_path / "arm.urdf"
    path.write_text(text)
    (tmp_path / "junk.stl").write_bytes(b"solid nothing \x00\xff" * 10)
    assert not [f for f in tw.doctor(path).findings if f.severity is not Severity.NOTE]


def test_every_check_has_a_name_and_says_what_it_looks_for():
    for name, check in CHECKS.items():
        assert re.fullmatch(r"[a-z-]+", name) and check.__doc__


def test_files_given_as_text_are_repaired_as_text():
    arm = Arm(5)
    text = arm.text({1: changed(arm.tensor(1), "izz", 10 * arm.tensor(1)[2, 2])})
    report = tw.doctor(text)
    assert report.source == "the text given"
    assert np.allclose(report.repaired().model.bodies[1].inertia.parameters, arm.inertias[1].parameters, rtol=1e-8)
    assert Path("fixed.urdf").exists() is False


def harmful(name: str) -> tuple[str, str]:
    """A file made to do harm, and the suffix it has."""
    link = '<link name="l{0}"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>'
    if name == "bodies":
        return f'<robot name="r">{"".join(link.format(k) for k in range(100_000))}</robot>', ".urdf"
    if name == "frames":
        return "<mujoco><worldbody>" + "<frame>" * 1_000_000 + "</frame>" * 1_000_000 + "</worldbody></mujoco>", ".xml"
    if name == "outside":
        return '<mujoco><worldbody><include file="../../etc/passwd"/></worldbody></mujoco>', ".xml"
    if name == "cycle":
        return '<mujoco><worldbody><include file="harm.xml"/></worldbody></mujoco>', ".xml"
    bomb = "".join(f'<!ENTITY e{k} "{f"&e{k - 1};" * 10}">' for k in range(1, 12))
    return f'<!DOCTYPE sdf [<!ENTITY e0 "lol">{bomb}]><sdf version="1.7"><model name="&e11;"/></sdf>', ".sdf"


@pytest.mark.parametrize("name", ["bodies", "frames", "outside", "cycle", "bomb"])
def test_files_made_to_do_harm_are_refused(name, tmp_path):
    text, suffix = harmful(name)
    path = tmp_path / f"harm{suffix}"
    path.write_text(text)
    with pytest.raises(tw.RobotFileError, match="harm"):
        tw.doctor(path)
    assert run(path, "--json", "-").exit_code == 2


@pytest.mark.parametrize("name", ["spool.stl", "spool.STL"])
def test_meshes_are_found_in_the_folders_that_are_named(tmp_path, name):
    trimesh = pytest.importorskip("trimesh")
    folder = tmp_path / "elsewhere" / "meshes"
    folder.mkdir(parents=True)
    trimesh.creation.box((0.12, 0.12, 0.12)).export(folder / name, file_type="stl")
    moments = [1.219 * (3 * 0.36 + 0.0144) / 12, 1.219 * 0.36 / 2]
    text = CYLINDER.format(*moments).replace(
        '<cylinder radius="0.06" length="0.12"/>', f'<mesh filename="package://spools/meshes/{name}"/>'
    )
    path = tmp_path / "spool.urdf"
    path.write_text(text)
    assert run(path, "--only", "too-large").exit_code == 0  # nothing to hold the tensor against
    found = run(path, "--only", "too-large", "--meshes", tmp_path / "elsewhere")
    assert found.exit_code == 1 and "radius is 10 times" in " ".join(found.output.split())
    assert run(path, "--only", "too-large", "--meshes", folder).exit_code == 1
    assert not tw.doctor(path, only="too-large", meshes=False).findings


def test_meshes_are_scaled(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.box((120.0, 120.0, 120.0)).export(tmp_path / "spool.stl")
    mesh = '<mesh filename="spool.stl" scale="0.001 0.001 0.001"/>'
    right = [1.219 * (3 * 0.0036 + 0.0144) / 12, 1.219 * 0.0036 / 2]
    path = tmp_path / "spool.urdf"
    path.write_text(CYLINDER.format(*right).replace('<cylinder radius="0.06" length="0.12"/>', mesh))
    assert tw.doctor(path).contents.robot.links["spool"].shapes.diagonal == pytest.approx(0.12 * 3**0.5)
    assert [f.check for f in tw.doctor(path).findings if f.check in ("too-large", "too-small", "units")] == []


@pytest.mark.parametrize(
    ("check", "old", "new", "where"),
    [
        ("degrees", 'lower="-2" upper="2"', 'lower="-90" upper="90"', "joint 'joint0'"),
        ("axis", "<axis xyz=", "<axis xyz=", "joint"),
        ("limits", 'lower="-2"', 'lower="0.5"', "joint 'joint0'"),
        ("effort", 'effort="[0-9.]+"', 'effort="0"', "joint 'joint0'"),
        ("friction", '<dynamics damping="0.1"/>', "", "robot 'arm'"),
        ("placeholder", None, np.eye(3) * 1e-3, "link 'link1'"),
        ("no-inertia", None, np.zeros((3, 3)), "link 'link1'"),
        ("too-small", None, 1e-9, "link 'link1'"),
    ],
)
def test_each_check_finds_what_it_is_for(check, old, new, where):
    arm = Arm(2)
    if check == "axis":
        text = re.sub(r'<axis xyz="([^"]*)"', lambda m: f'<axis xyz="{m[1].replace("1", "2")}"', arm.text())
    elif old is None:
        text = arm.text({1: new if isinstance(new, np.ndarray) else arm.tensor(1) * new})
    else:
        text = re.sub(old, new, arm.text(), count=1 if new else 0)
    found = [f for f in tw.doctor(text).findings if f.check == check]
    assert found and found[0].where.startswith(where), [str(f) for f in found]
    if found[0].repair is not None and found[0].repair.edits:
        repaired = tw.doctor(text, only=check)
        if repaired.repairs:
            assert not tw.doctor(repaired.repaired_text(), only=check).findings


def test_a_unit_is_told_from_shapes_when_a_tensor_is_too_small():
    arm = Arm(2)
    (finding,) = [f for f in tw.doctor(arm.text({1: arm.tensor(1) * 1e-6})).findings if f.check == "too-small"]
    (G,) = finding.repair.inertias.values()
    assert finding.repair.kind == "slip" and np.allclose(G.moment_about_com, arm.tensor(1), rtol=1e-9)


def test_a_link_without_mass_at_the_end_is_named_with_its_joint():
    text = Arm(2).text()
    text = re.sub(r'(<link name="link3">\s*)<inertial>.*?</inertial>', r"\1", text, flags=re.DOTALL)
    (finding,) = [f for f in tw.doctor(text).findings if f.check == "massless"]
    assert finding.severity is Severity.WARNING and "'joint3'" in finding.sentence
    with pytest.raises(tw.SingularMassMatrixError):
        load_quietly(text).forward_dynamics(np.zeros(4), np.zeros(4), np.zeros(4))


@pytest.mark.parametrize(
    ("bare", "moves_nothing"),
    [((0, 1, 2, 3), (0, 1, 2, 3)), ((1, 2), ()), ((0, 3), (3,))],
)
def test_joints_that_move_no_mass_make_the_mass_matrix_singular_and_are_named(bare, moves_nothing):
    """Those that nothing with a mass comes after, also where nothing has a mass at all."""
    text = Arm(2).text()
    for k in bare:
        text = re.sub(rf'(<link name="link{k}">\s*)<inertial>.*?</inertial>', r"\1", text, flags=re.DOTALL)
    found = tw.doctor(text, only="massless").findings
    named = [re.findall(r"'(joint\d)'", f.sentence) for f in found if "M is singular" in f.sentence]
    assert named == ([[f"joint{k}" for k in moves_nothing]] if moves_nothing else [])
    assert sum(f.numbers["links"] for f in found) == len(bare)
    assert all((f.severity is Severity.WARNING) == ("M is singular" in f.sentence) for f in found)


def test_inertia_without_mass_and_a_distant_com_are_found():
    arm = Arm(2)
    text = arm.text().replace(f'mass value="{arm.inertias[1].mass!r}"', 'mass value="0"')
    assert [f.where for f in tw.doctor(text, only="no-mass").findings] == ["link 'link1'"]
    (finding,) = tw.doctor(
        arm.text(coms={2: arm.inertias[2].com + np.array([0.0, 0.0, 2.0])}), only="com-outside"
    ).findings
    assert finding.severity is Severity.WARNING and finding.numbers["distance"] > 1.5


def test_leaders_that_are_not_there_are_gathered():
    text = Arm(2).text().replace('<dynamics damping="0.1"/>', '<mimic joint="nobody"/>')
    report = tw.doctor(text)
    assert len([f for f in report.findings if f.check == "mimic" and f.severity is Severity.ERROR]) == 4
    with pytest.raises(tw.ModelError, match="nobody"):
        tw.load(text)


@pytest.mark.parametrize("also", ['<dynamics damping="0.1"/>', '<mimic joint="nobody"/>'])
def test_all_that_the_loader_refuses_is_said_at_once(also):
    """Whether or not a joint follows one that is not there, too, without which the file could be examined."""
    text = Arm(2).text().replace('<dynamics damping="0.1"/>', also, 1)
    text = text.replace('mass value="', 'mass value="-').replace('<parent link="base"/>', '<parent link="bass"/>')
    with pytest.raises(tw.ModelError) as caught:
        tw.doctor(text)
    assert all(name in str(caught.value) for name in ("link0", "link1", "link2", "link3", "bass")), caught.value


def test_all_that_the_loader_refuses_is_said_of_a_large_file_too():
    """A file of more bodies than usual, which the call allows."""
    more = "".join(f'<link name="more{k}"/>' for k in range(2001))
    text = (
        Arm(2).text().replace('<parent link="base"/>', '<parent link="bass"/>').replace("</robot>", f"{more}</robot>")
    )
    text = text.replace('mass value="', 'mass value="-')
    with pytest.raises(tw.ModelError) as caught:
        tw.doctor(text, max_bodies=3000)
    assert all(name in str(caught.value) for name in ("link1", "bass")), caught.value


@pytest.mark.parametrize(
    ("left", "right", "side"),
    [
        (1.0, 10.0, "left"),
        (10.0, 1.0, "right"),
        (4.9, 10.0, "left"),
        (5.1, 10.0, ""),  # more than half as far
        (0.5, 2.6, "left"),
        (0.5, 2.4, ""),  # nearer by less than 2 mm
        (None, 10.0, ""),
        (1.0, None, ""),
    ],
)
def test_shapes_speak_for_the_side_whose_centre_of_mass_is_half_as_far_and_2_mm_nearer(left, right, side):
    """Distances from the centre of the shapes [mm]; None: there are no shapes on that side."""

    def link(distance):
        shapes = SimpleNamespace(complete=distance is not None, uniform=SimpleNamespace(com=np.zeros(3)))
        com = np.array([0.0, 1e-3 * (distance or 0.0), 0.0])
        return SimpleNamespace(written=SimpleNamespace(com=com), shapes=shapes)

    found = _evidence(SimpleNamespace(left=link(left), right=link(right)))
    if side:
        near, far = sorted((left, right))
        assert found.startswith(f"the shapes speak for the {side} one")
        assert f"{near:.2g} mm from theirs, not {far:.2g}" in found
    else:
        assert found == "the file does not determine which is meant"


def test_an_element_of_another_format_in_a_urdf_is_no_second_robot(tmp_path):
    """A robot whose file has a model without a name beside its links, which URDF passes over, is judged."""
    text = (
        '<robot name="r"><model/><link name="base"/><link name="arm"><inertial><mass value="1"/>'
        '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="j" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint></robot>'
    )
    file = tmp_path / "r.urdf"
    file.write_text(text)
    assert tw.doctor(load_quietly(file)).verdict.word in ("OK", "UNSURE")
