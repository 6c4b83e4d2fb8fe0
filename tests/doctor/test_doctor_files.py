"""The doctor on real files: what is known to be wrong is found, healthy robots have no warning, repaired files load everywhere."""

from __future__ import annotations

import re
import warnings
from functools import cache

import numpy as np
import pytest
from robot_files import BESIDE, FILES

import twistwrench as tw
from twistwrench.diagnosis import Severity

UR5 = "ur_description/ur5_robot"


def file(name):
    path = FILES.get(name) or next((p for p in (BESIDE / name,) if p.is_file()), None)
    if path is None:
        pytest.skip(f"{name} is not there")
    return path


@cache
def found(name):
    return tw.doctor(file(name))


def warned(name, check):
    return {f.where: f for f in found(name).findings if f.check == check and f.severity is not Severity.NOTE}


def test_the_wrists_of_the_ur5_that_everybody_copies():
    wrists = warned(UR5, "too-large")
    assert set(wrists) == {"link 'wrist_1_link'", "link 'wrist_2_link'"}
    for finding in wrists.values():
        assert finding.repair.kind == "slip" and "radius is 10 times too large" in finding.repair.sentence
        (G,) = finding.repair.inertias.values()
        # The solid cylinder of radius 0.06 m and length 0.12 m, as Universal Robots' own files have it since.
        assert np.allclose(np.diag(G.moment_about_com), [0.0025599, 0.0025599, 0.0021942], atol=1e-9)
    assert found(UR5).effect.inertia_percent > 1000.0


def test_the_identified_set_of_the_panda_is_only_noted():
    findings = found("panda_description/panda").findings
    assert all(f.severity is Severity.NOTE for f in findings)
    assert any("as identified sets have" in f.sentence for f in findings)


def slow(*values):
    """Of a file that takes most of a second; what is wrong in it is noticed in a smaller file or by a test of its check."""
    return pytest.param(*values, marks=pytest.mark.slow)


KNOWN = [
    slow("talos_data/talos_reduced", "mirror", "arm_left_4_link", "centres of mass 42.1 mm"),
    ("icub_description/icub", "no-inertia", "r_upper_leg", "no rotational inertia"),
    ("icub_description/icub", "no-inertia", "r_lower_leg", "no rotational inertia"),
    ("beside/unitree_b2", "mirror", "FL_hip", "centres of mass 5.59 mm"),
    ("beside/unitree_b2", "mirror", "RL_hip", "centres of mass 5.59 mm"),
    ("beside/unitree_h1_2", "mirror", "left_wrist_roll_link", "centres of mass"),
    slow("alex_description/alex_psyonic_hands", "mirror", "Left_thumb_base", "masses 0.4 and 0.2 kg"),
    slow("alex_description/alex_psyonic_hands", "mimic", "Left_index_q2", "not there"),
    ("romeo_description/romeo", "mirror", "LElbowYawLink", "tensors 34 %"),
    ("romeo_description/romeo_small", "impossible", "RElbowYawLink", "triangle inequality"),
    ("romeo_description/romeo_laas_small", "impossible", "RHipPitch_link", "negative principal moment"),
    ("ur_description/ur3_robot", "com-outside", "wrist_2_link", "outside its shapes"),
]


@pytest.mark.parametrize(("name", "check", "where", "said"), KNOWN)
def test_what_is_known_to_be_wrong_is_found(name, check, where, said):
    assert any(f"'{where}'" in at and said in f.sentence for at, f in warned(name, check).items())


def test_the_other_arm_of_romeo_has_the_moment_that_the_slip_explains():
    """izz of the right elbow is a tenth of the left one's: the repair comes to the left one's, digit for digit or nearly."""
    report = found("romeo_description/romeo_small")
    for part in ("ElbowYawLink", "ShoulderYawLink"):
        (finding,) = [f for f in report.findings if f.check == "impossible" and part in f.where]
        (G,) = finding.repair.inertias.values()
        left = report.contents.robot.links[f"L{part}"].written.tensor
        assert finding.repair.sentence.endswith("izz is 10 times too small")
        assert G.moment_about_com[2, 2] == pytest.approx(left[2, 2], rel=0.01)


# Named before the doctor ran on them: the first nine by those who asked for it, then four more.
HEALTHY = [
    "go1_description/go1", "g1_description/g1_29dof_rev_1_0", "beside/kinova_gen3_lite", "beside/shadow_hand_left",
    "mjcf/menagerie/robotis_op3__op3_nomesh.xml", "mjcf/menagerie/unitree_go1__go1_nomesh.xml", "mjcf/unitree/g1_29dof_nomesh.xml",
    "mjcf/menagerie/shadow_hand__right_hand_nomesh.xml", "mjcf/menagerie/franka_emika_panda__panda_nomesh.xml",
    "xarm_description/xarm7",
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", HEALTHY)
def test_healthy_robots_have_no_warning(name):
    assert [str(f) for f in found(name).findings if f.severity is not Severity.NOTE] == []


@pytest.mark.slow
@pytest.mark.parametrize("name", ["solo_description/solo12", "bolt_description/bolt", "so_arm_description/so101"])
def test_of_robots_that_are_healthy_otherwise_placeholder_efforts_are_found(name):
    """1000 N m and more in robots of about a kilogram; 10 N m where the servos stall at about 3 N m."""
    assert [f.check for f in found(name).findings if f.severity is not Severity.NOTE] == ["placeholder-limits"]


BROKEN = [
    "romeo_description/romeo_small", "romeo_description/romeo_laas_small", "beside/ufactory_xarm6", "beside/two_joint_fixed",
    UR5,
]  # fmt: skip
MORE_BROKEN = [
    "beside/atlas_drc_sdformat", "beside/kuka_iiwa7_allegro", "beside/robotiq_3f", "pr2_description/pr2",
    "allegro_hand_description/allegro_left_hand", "anymal_c_simple_description/anymal", "icub_description/icub",
    "defects/franka_panda_curobo_nonpsd.urdf", "hyq_description/hyq_no_sensors", "b1_description/b1-z1",
]  # fmt: skip


@pytest.mark.parametrize("name", [*BROKEN, *(pytest.param(n, marks=pytest.mark.slow) for n in MORE_BROKEN)])
def test_repaired_files_load_and_differ_in_the_named_numbers_only(name, tmp_path):
    source, out = file(name), tmp_path / "fixed.urdf"
    repaired = found(name).write(out)
    assert repaired
    old, new = source.read_bytes().decode(), out.read_bytes().decode()
    undone = re.sub(r"<!-- twistwrench doctor: .*? -->\s*", "", new)
    numbers = re.compile(r"""\b(ixx|ixy|ixz|iyy|iyz|izz|xyz|lower|upper)\s*=\s*["'][^"']*["']""")
    same = numbers.sub("#", undone), numbers.sub("#", old)
    assert same[0] == same[1]
    count = sum(a != b for a, b in zip(numbers.finditer(undone), numbers.finditer(old), strict=True) if a[0] != b[0])
    assert count <= sum(len(f.repair.edits) for f in repaired)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        robot = tw.load(out, inertia="error")
    assert not [f for f in tw.doctor(out, only="impossible").findings if f.severity is not Severity.NOTE]
    pin = pytest.importorskip("pinocchio", exc_type=ImportError)
    model = pin.buildModelFromXML(new)
    assert sum(i.mass for i in model.inertias) == pytest.approx(
        sum(G.mass for G in robot.model.link_inertias.values()), rel=1e-9
    )
    mujoco = pytest.importorskip("mujoco")
    bare = re.sub(r"<(visual|collision)\b.*?</\1>", "", new, flags=re.DOTALL)
    if name not in MASSLESS:
        mujoco.MjModel.from_xml_string(bare)


MASSLESS = {
    "romeo_description/romeo_laas_small",
    "icub_description/icub",
    "defects/franka_panda_curobo_nonpsd.urdf",
}
"""Files with moving bodies without mass or with points as masses, which MuJoCo refuses whatever their tensors are."""


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(FILES))
def test_every_file_is_looked_at_or_refused_with_a_reason(name):
    try:
        report = tw.doctor(FILES[name], meshes=False)
    except tw.TwistWrenchError as error:
        assert FILES[name].name in str(error)
        return
    report.to_json()
    for finding in report.repairs:
        assert finding.repair.edits
    report.repaired_text()
