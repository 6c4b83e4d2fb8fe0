"""The doctor on files without shapes: grams for kilograms and millimetres for metres are found; real files have no such warning."""

from __future__ import annotations

import pytest
from quiet_loading import load_quietly
from robot_files import FILES

import twistwrench as tw
from twistwrench.diagnosis import Severity

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
