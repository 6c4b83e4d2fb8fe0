"""The doctor on files without shapes: grams for kilograms and millimetres for metres are found; real files have no such warning."""

from __future__ import annotations

import re

import numpy as np
import pytest
from click.testing import CliRunner
from quiet_loading import load_quietly
from robot_files import FILES

import twistwrench as tw
from twistwrench import SpatialInertia
from twistwrench.cli.main import main
from twistwrench.diagnosis import Severity
from twistwrench.diagnosis.load_errors import load_errors
from twistwrench.formats.xml import parse

ARM = """<robot name="arm3"><link name="base"/>
<link name="l1"><inertial><origin xyz="0 0 0.1"/><mass value="{m1}"/><inertia ixx="0.02" iyy="0.02" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="l2"><inertial><origin xyz="{x} 0 0"/><mass value="{m2}"/><inertia ixx="0.004" iyy="0.035" izz="0.035" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="l3"><inertial><origin xyz="0.14 0 0"/><mass value="{m3}"/><inertia ixx="0.002" iyy="0.012" izz="0.012" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="flange"/>
<joint name="j1" type="revolute"><parent link="base"/><child link="l1"/><origin xyz="0 0 0.1"/><axis xyz="0 0 1"/><limit effort="40" velocity="3" lower="-3" upper="3"/><dynamics damping="0.5"/></joint>
<joint name="j2" type="revolute"><parent link="l1"/><child link="l2"/><origin xyz="0 0 0.2"/><axis xyz="0 1 0"/><limit effort="{effort}" velocity="3" lower="-2.5" upper="2.5"/><dynamics damping="0.5"/></joint>
<joint name="j3" type="revolute"><parent link="l2"/><child link="l3"/><origin xyz="0.4 0 0"/><axis xyz="0 1 0"/><limit effort="15" velocity="3" lower="-2.5" upper="2.5"/><dynamics damping="0.5"/></joint>
<joint name="jf" type="fixed"><parent link="l3"/><child link="flange"/><origin xyz="0.3 0 0"/></joint></robot>"""
RIGHT = {"m1": "4.0", "m2": "3.0", "m3": "1.5", "x": "0.18", "effort": "40"}


def arm(**changes: str) -> str:
    return ARM.format(**{**RIGHT, **changes})


def warnings_of(text: str) -> dict[tuple[str, str], tw.diagnosis.Finding]:
    findings = tw.doctor(text, only=["units", "effort"]).findings
    return {(f.check, f.where): f for f in findings if f.severity is Severity.WARNING}


def test_the_right_arm_has_no_finding_at_all():
    assert tw.doctor(arm()).findings == ()


@pytest.mark.parametrize(
    ("slip", "said"),
    [
        ({"x": "180"}, "180 m from the frame of the link"),
        ({"m2": "3000"}, "3000 kg, 750 times that of the next heaviest"),
    ],
)
def test_one_number_in_millimetres_or_grams_is_repaired_to_the_right_file(slip, said):
    report = tw.doctor(arm(**slip))
    found = warnings_of(arm(**slip))
    finding = found["units", "link 'l2'"]
    assert said in finding.sentence and finding.repair.kind == "slip" and finding.effect.reaches(100.0)
    assert "divide it by 1000" in finding.repair.sentence
    assert found["effort", "joint 'j2'"].sentence.startswith("the robot's own weight takes up to 13")
    assert report.exit_code() == tw.doctor(arm(effort="0")).exit_code() != tw.doctor(arm()).exit_code()
    wanted, got = load_quietly(arm()).model, report.repaired().model
    for name, inertia in wanted.link_inertias.items():
        assert got.link_inertias[name].parameters == pytest.approx(inertia.parameters, rel=1e-12), name


def test_a_whole_arm_in_grams_is_found_by_its_gyration_radii():
    """No mass stands out: √(0.035/3000) m is 1/220 of the span of 0.76 m, in real files at least 1/86. l1 turns about its own axis."""
    found = warnings_of(arm(m1="4000", m2="3000", m3="1500"))
    assert {where for check, where in found if check == "units"} == {"link 'l2'", "link 'l3'"}
    assert all("gyration radius" in f.sentence for (check, _), f in found.items() if check == "units")
    assert not any(f.repair.edits for (check, _), f in found.items() if check == "units")


def test_own_weight_warns_only_if_it_takes_a_multiple_of_the_effort():
    weight = abs(tw.load(arm()).gravity_forces([0.0, 0.0, 0.0])[1])  # stretched out, the worst pose
    for share, severity in ((0.5, Severity.NOTE), (0.05, Severity.WARNING)):
        (finding,) = tw.doctor(arm(effort=f"{share * weight:.6f}"), only="effort").findings
        assert finding.severity is severity and "own weight" in finding.sentence


def test_limits_from_a_table_replace_missing_ones(tmp_path):
    """Without efforts the doctor is UNSURE; a table clears that. Large efforts are a placeholder unless it has their unit."""
    text = re.sub(r' (effort|velocity)="[^"]*"', "", arm())
    (tmp_path / "arm.urdf").write_text(text)
    (tmp_path / "limits.csv").write_text("joint,effort [N m],velocity\nj1,9000,3\nj2,9000,3\nj3,9000,3\n")
    (tmp_path / "large.csv").write_text("joint,effort,velocity\nj1,9000,3\nj2,9000,3\nj3,9000,3\n")
    (tmp_path / "some.csv").write_text("joint,effort,velocity\nj1,40,3\nj2,40,3\n")
    bare, whole, some, large = (
        CliRunner().invoke(main, ["doctor", str(tmp_path / "arm.urdf"), *flags])
        for flags in (
            (),
            ("--limits", str(tmp_path / "limits.csv")),
            ("--limits", str(tmp_path / "some.csv")),
            ("--limits", str(tmp_path / "large.csv")),
        )
    )
    assert large.exit_code == 1 and "stand for no limit" in " ".join(large.output.split())
    assert (bare.exit_code, whole.exit_code, some.exit_code) == (1, 0, 1)
    assert bare.output.startswith("UNSURE") and whole.output.startswith("OK: arm3, 0 errors, 0 warnings, 0 notes.")
    assert "joint 'j3'" in some.output and "'j1'" not in some.output
    with pytest.raises(tw.ValueRangeError, match=r"no joint named .j9."):
        (tmp_path / "wrong.csv").write_text("joint,effort\nj9,40\n")
        tw.doctor(tmp_path / "arm.urdf", limits=tmp_path / "wrong.csv")


def test_a_milder_tensor_is_named_beside_a_slip():
    """izz is 0.06 for 0.035: 0.021 too large, 21 % away; ten times ixx, the only single slip, is a change of 52 %."""
    (finding,) = tw.doctor(
        arm().replace('iyy="0.035" izz="0.035"', 'iyy="0.035" izz="0.06"'), only="impossible"
    ).findings
    I = np.diag([0.004, 0.035, 0.06])
    assert finding.repair.kind == "slip"
    assert finding.repair.sentence.startswith(
        "one slip would explain it: ixx is 10 times too small; the nearest tensor"
    )
    J = SpatialInertia.from_com(3.0, moment_about_com=I).nearest_consistent().moment_about_com
    mild, slip = np.linalg.norm(J - I) / np.linalg.norm(I), 0.036 / np.linalg.norm(I)
    assert f"{100 * mild:.0f} % away, the slip's {100 * slip:.0f} %" in finding.repair.sentence


@pytest.mark.slow
def test_real_files_have_no_warning_of_grams_millimetres_or_weights():
    """123 files when this was written; gyration radii larger than the robot's span were found before, in minitaur."""
    looked_at = 0
    for name, path in FILES.items():
        try:
            report = tw.doctor(path, only=["units", "effort"], meshes=False)
        except tw.TwistWrenchError:
            continue
        looked_at += 1
        for finding in report.findings:
            new = "its mass is", "its centre of mass", "own weight takes up to"
            assert finding.severity is not Severity.WARNING or not any(x in finding.sentence for x in new), (
                name,
                str(finding),
            )
    if not looked_at:
        pytest.skip("neither example-robot-data nor ../shared/robots is there")


def test_a_helper_body_parked_far_away_changes_no_finding(tmp_path):
    """Simulators park bodies without use far above the scene; a span that counts them would make every link look too compact."""
    links = "".join(
        f'<body name="l{k}" pos="0 0 0.3"><joint name="j{k}" axis="0 1 0"/><inertial pos="0 0 0.15" mass="{4 - k}" '
        f'diaginertia="{0.02 / (k + 1)} {0.02 / (k + 1)} {0.002 / (k + 1)}"/>'
        for k in range(4)
    )
    arm = f"{links}{'</body>' * 4}"
    parked = '<body name="helper" pos="0 0 20"><joint name="h" axis="0 0 1"/><inertial pos="0 0 0" mass="0.01" diaginertia="1e-6 1e-6 1e-6"/></body>'

    def units(bodies: str) -> list[str]:
        path = tmp_path / "robot.xml"
        path.write_text(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
        return [finding.sentence for finding in tw.doctor(path, only="units").findings if "helper" not in finding.where]

    assert units(arm) == units(arm + parked) == []


def test_degrees_on_one_side_of_zero_alone_are_repaired_to_radians():
    """150° are 5 π / 6 rad on whichever side they stand; the end at zero keeps its number."""
    for text, lower, upper in (
        ('lower="-150" upper="0"', -5.0 * np.pi / 6.0, 0.0),
        ('lower="0" upper="150"', 0.0, 5.0 * np.pi / 6.0),
    ):
        report = tw.doctor(arm().replace('lower="-2.5" upper="2.5"', text, 1), only="degrees")
        assert [(f.check, f.where) for f in report.findings] == [("degrees", "joint 'j2'")]
        limits = report.repaired().limits
        assert limits.lower[1] == pytest.approx(lower, rel=1e-9) and limits.upper[1] == pytest.approx(upper, rel=1e-9)


def test_a_limit_at_zero_leaves_the_robot_its_zero():
    """Zero is inside of [0, 2], outside of [0.1, 2] and of [-2, -0.1]."""
    for text, is_outside in (
        ('lower="0" upper="2"', False),
        ('lower="-2" upper="0"', False),
        ('lower="0.1" upper="2"', True),
        ('lower="-2" upper="-0.1"', True),
    ):
        findings = tw.doctor(arm().replace('lower="-2.5" upper="2.5"', text, 1), only="limits").findings
        assert [f.where for f in findings] == (["joint 'j2'"] if is_outside else []), text


def test_an_axis_of_another_length_is_offered_with_length_one_and_its_direction():
    """(0, 3, 4) has the length 5: the unit vector along it is (0, 0.6, 0.8)."""
    (finding,) = tw.doctor(arm().replace('<axis xyz="0 1 0"/>', '<axis xyz="0 3 4"/>', 1), only="axis").findings
    assert finding.numbers["length"] == pytest.approx(5.0)
    (edit,) = finding.repair.edits
    np.testing.assert_allclose([float(x) for x in edit.text.split()], [0.0, 0.6, 0.8], atol=1e-12)


BOXED = """<robot name="two"><link name="a"/>
<link name="b"><inertial><origin xyz="{com}" rpy="{rpy}"/><mass value="{mass}"/>
<inertia ixx="{ixx}" iyy="{iyy}" izz="{izz}" ixy="{ixy}" ixz="{ixz}" iyz="{iyz}"/></inertial>
<visual><origin xyz="0.5 0 0"/><geometry><box size="1 0.2 0.1"/></geometry></visual></link>
<joint name="j" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0 0 1"/><axis xyz="0 1 0"/>
<limit effort="100" velocity="3" lower="-1" upper="1"/><dynamics damping="1"/></joint></robot>"""
"""A link whose shape is a box of 1 x 0.2 x 0.1 m about (0.5, 0, 0)."""


def boxed(com: object, tensor: np.ndarray, rpy: str = "0 0 0", mass: float = 2.0) -> str:
    names = {"ixx": (0, 0), "iyy": (1, 1), "izz": (2, 2), "ixy": (0, 1), "ixz": (0, 2), "iyz": (1, 2)}
    numbers = {name: repr(float(tensor[at])) for name, at in names.items()}
    return BOXED.format(com=" ".join(map(repr, map(float, com))), rpy=rpy, mass=mass, **numbers)


def test_a_centre_of_mass_in_the_frame_of_the_link_before_is_recognised():
    """(0.5, 0, 0) in the link's frame, which is 1 m above that of its parent, is (0.5, 0, 1) there."""
    (finding,) = tw.doctor(boxed((0.5, 0.0, 1.0), np.diag([0.01, 0.17, 0.17])), only="com-outside").findings
    assert "read in the frame of 'a' it would be inside" in finding.sentence
    (finding,) = tw.doctor(boxed((0.5, 0.0, 3.0), np.diag([0.01, 0.17, 0.17])), only="com-outside").findings
    assert "read in the frame" not in finding.sentence


def test_a_mass_at_one_end_of_a_link_may_have_the_moment_of_a_rod():
    """From x = 0.1 m the box reaches 0.9 m: 2 kg can have 1.6 kg m² about y, so 0.5 kg m² is no error; 20 kg m² is one."""
    com = (0.1, 0.0, 0.0)
    assert tw.doctor(boxed(com, np.diag([0.01, 0.5, 0.5])), only="too-large").findings == ()
    (finding,) = tw.doctor(boxed(com, np.diag([0.01, 20.0, 20.0])), only="too-large").findings
    assert finding.numbers["largest"] == pytest.approx(2.0 * (0.9**2 + 0.1**2), rel=0.05)


def test_a_tensor_about_the_origin_along_turned_axes_is_told_from_one_about_the_centre():
    """The box itself, drawn 3 m away: its moments about the origin, along axes that are turned by a quarter about x."""
    text = boxed((3.5, 0.0, 0.0), np.eye(3)).replace('<origin xyz="0.5 0 0"/>', '<origin xyz="3.5 0.4 0"/>')
    own = 2.0 / 12.0 * np.diag([0.2**2 + 0.1**2, 1.0 + 0.1**2, 1.0 + 0.2**2])
    c, R = np.array([3.5, 0.4, 0.0]), np.asarray(tw.so3.exp([np.pi / 2, 0.0, 0.0]))
    about_origin = own + 2.0 * (c @ c * np.eye(3) - np.outer(c, c))
    text = boxed(c, R.T @ about_origin @ R, rpy=f"{np.pi / 2!r} 0 0").replace(
        '<origin xyz="0.5 0 0"/>', '<origin xyz="3.5 0.4 0"/>'
    )
    (finding,) = tw.doctor(text, only="too-large").findings
    assert "about the link's origin" in finding.repair.sentence
    (repaired,) = finding.repair.inertias.values()
    np.testing.assert_allclose(repaired.moment_about_com, own, atol=1e-9)


def test_an_arm_is_light_by_its_mass_per_reach():
    """Less than 10 g for each metre, here 0.8 m: 8.2 g are no finding, 7.8 g are one."""

    def short(mass: float) -> str:
        each = repr(mass / 3.0)
        return arm(m1=each, m2=each, m3=each).replace('<origin xyz="0.4 0 0"/>', '<origin xyz="0.2 0 0"/>')

    (finding,) = tw.doctor(short(1e-6), only="light").findings
    assert finding.numbers["reach"] == pytest.approx(0.8)
    assert [len(tw.doctor(short(mass), only="light").findings) for mass in (8.2e-3, 7.8e-3)] == [0, 1]


def test_a_link_with_two_parents_is_named():
    links, joints = (
        "".join(f'<link name="{name}"/>' for name in "abc"),
        '<joint name="{0}" type="fixed"><parent link="{0}"/><child link="{1}"/></joint>',
    )
    root = parse(f'<robot name="r">{links}{joints.format("a", "c")}{joints.format("b", "c")}</robot>')
    (error,) = load_errors(root)
    assert error.where == "joint 'b'" and "gives link 'c' a second parent" in error.sentence


def test_findings_that_change_the_robot_most_come_first():
    """A centre of mass 180 m away changes gravity's torque by thousands of N m; that a weight exceeds an effort changes nothing."""
    findings = [f for f in tw.doctor(arm(x="180")).findings if f.severity is Severity.WARNING]
    sizes = [max(f.effect.inertia_percent, f.effect.effort_percent) for f in findings]
    assert len(sizes) > 1 and sizes == sorted(sizes, reverse=True) and sizes[0] > sizes[-1]
