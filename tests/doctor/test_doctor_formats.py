"""The doctor on MJCF and SDF: what is written is judged, and changed where it stands."""

from __future__ import annotations

import re

import numpy as np
import pytest
from click.testing import CliRunner
from robot_files import BESIDE

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.diagnosis import Severity
from twistwrench.formats.urdf import rotation_of_rpy

MJCF = """<mujoco model="arm"><!-- kept: 0.2 0.2 -->
  <worldbody>
    <body name="upper"><joint name="shoulder" axis="0 1 0" damping="1"/>
      <inertial pos="0 0 0.2" mass="2" {upper}/>
      <geom type="box" size="0.05 0.05 0.2" pos="0 0 0.2"/>
      <body name="lower" pos="0 0 0.4"><joint name="elbow" axis="0 1 0"/>
        <geom type="capsule" size="0.03 0.1" pos="0 0 0.1"/></body>
    </body>
  </worldbody>
</mujoco>
"""
GOOD = (0.028, 0.029, 0.0033)


def bad(report):
    return [f for f in report.findings if f.severity is not Severity.NOTE]


def test_inertia_of_geoms_is_right_by_itself():
    assert not bad(tw.doctor(MJCF.format(upper='diaginertia="0.028 0.029 0.0033"')))


@pytest.mark.parametrize(
    "written", ['diaginertia="0.028 {} 0.0033"', 'fullinertia="0.028\t{} 0.0033 0 0 0"'], ids=["diagonal", "full"]
)
def test_one_number_of_several_is_changed(written, tmp_path):
    text = MJCF.format(upper=written.format("0.29"))
    path, out = tmp_path / "arm.xml", tmp_path / "fixed.xml"
    path.write_text(text)
    report = tw.doctor(path)
    (finding,) = bad(report)
    assert finding.check == "impossible" and "iyy is 10 times too large" in finding.repair.sentence
    assert finding.line == 4 and report.write(out)
    new = re.sub(r"<!-- twistwrench doctor: .*? -->\s*", "", out.read_text())
    assert new == MJCF.format(upper=written.format("0.029"))
    assert np.allclose(tw.load(out).model.bodies[0].inertia.moment_about_com, np.diag(GOOD), rtol=1e-9)
    mujoco = pytest.importorskip("mujoco")
    with pytest.raises(ValueError, match="inertia"):
        mujoco.MjModel.from_xml_path(str(path))
    mujoco.MjModel.from_xml_path(str(out))


def test_what_another_file_says_is_found_there_and_not_changed(tmp_path):
    body = '<body name="a"><joint name="j"/><inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 1"/></body>'
    (tmp_path / "part.xml").write_text(f"<mujocoinclude>\n\n{body}</mujocoinclude>")
    path = tmp_path / "arm.xml"
    path.write_text('<mujoco><worldbody><include file="part.xml"/></worldbody></mujoco>')
    report = tw.doctor(path)
    (finding,) = bad(report)
    assert (finding.file, finding.line) == ("part.xml", 3) and "part.xml, line 3" in str(finding)
    assert report.repairs == () and report.repaired_text() == path.read_text()


def test_shapes_of_geoms_have_their_sizes():
    robot = tw.doctor(MJCF.format(upper='diaginertia="0.028 0.029 0.0033"')).contents.robot
    for link, low, high in (
        ("upper", (-0.05, -0.05, 0.0), (0.05, 0.05, 0.4)),
        ("lower", (-0.03, -0.03, -0.03), (0.03, 0.03, 0.23)),
    ):
        points = robot.links[link].shapes.points
        assert np.allclose([points.min(axis=0), points.max(axis=0)], [low, high])
        uniform = robot.links[link].shapes.uniform
        if link == "lower":  # MuJoCo's own, of a thousand times the density
            assert np.allclose(1000.0 * uniform.parameters, robot.model.link_inertias[link].parameters)


def test_effects_count_armature():
    from twistwrench.diagnosis.findings import Effects

    robot = tw.load(MJCF.format(upper='diaginertia="0.028 0.029 0.0033"').replace('damping="1"', 'armature="0.7"'))
    effects = Effects(robot.model)
    assert np.allclose(effects.diagonal, np.diagonal(robot.mass_matrix(effects.q), axis1=-2, axis2=-1))


def test_settings_that_change_inertias_are_named():
    text = MJCF.format(upper='diaginertia="0.028 0.29 0.0033"')
    balanced = text.replace("<worldbody>", '<compiler balanceinertia="true"/><worldbody>')
    (finding,) = [f for f in bad(tw.doctor(balanced)) if f.check == "assumed"]
    assert "balanceinertia" in finding.sentence


SDF = """<sdf version="1.8"><model name="pendulum">
  <link name="rod"><inertial><pose>0 0 -0.5 0 0 0</pose><mass>2</mass>
    <inertia><ixx>0.2</ixx><ixy>0</ixy><ixz>0</ixz><iyy> {0} </iyy><iyz>0</iyz><izz>0.01</izz></inertia></inertial>
    <visual name="v"><pose>0 0 -0.5 0 0 0</pose><geometry><box><size>0.1 0.1 1.09</size></box></geometry></visual></link>
  <joint name="hinge" type="revolute"><parent>world</parent><child>rod</child><axis><xyz>0 1 0</xyz></axis></joint>
</model></sdf>
"""


def test_the_text_of_an_element_is_changed(tmp_path):
    out = tmp_path / "fixed.sdf"
    report = tw.doctor(SDF.format("2.0"))
    (finding,) = bad(report)
    assert "iyy is 10 times too large" in finding.repair.sentence
    report.write(out)
    assert re.sub(r"<!-- twistwrench doctor: .*? -->\s*", "", out.read_text()) == SDF.format("0.2")
    assert np.allclose(tw.load(out).mass_matrix([0.3]), 0.7)
    assert not bad(tw.doctor(SDF.format("0.2")))


def test_what_sdf_takes_for_granted_is_a_warning():
    text = re.sub(r"<inertial>.*?</inertial>", "", SDF.format("0.2"), flags=re.DOTALL)
    (finding,) = [f for f in bad(tw.doctor(text)) if f.check == "assumed"]
    assert "1 kg" in finding.sentence


def test_one_model_of_a_world_is_looked_at():
    two = SDF.format("0.2").replace("</model>", '</model><model name="other"><link name="x"/></model>')
    world = two.replace('<sdf version="1.8">', '<sdf version="1.8"><world name="w">').replace(
        "</sdf>", "</world></sdf>"
    )
    with pytest.raises(tw.RobotFileError, match="model"):
        tw.doctor(world)
    assert tw.doctor(world, model="pendulum").robot == "pendulum"


@pytest.mark.parametrize(
    "name", sorted(p.relative_to(BESIDE).as_posix() for s in ("mjcf/*.xml", "sdf/*.sdf") for p in BESIDE.glob(s))
)
def test_every_file_is_looked_at_or_refused(name):
    try:
        tw.doctor(BESIDE / name).to_json()
    except tw.TwistWrenchError as error:
        assert name.rpartition("/")[2] in str(error)


# ── left against right ──

SIDES = """<robot name="sides"><link name="base"/>
{left}{right}
</robot>"""
SIDE = """<link name="{side}_arm"><inertial><origin xyz="{com}"/><mass value="2"/>
<inertia ixx="0.02" ixy="{ixy}" ixz="0.001" iyy="0.03" iyz="{iyz}" izz="0.025"/></inertial>
<visual><geometry><mesh filename="{mesh}"/></geometry></visual></link>
<joint name="{side}_shoulder" type="revolute"><parent link="base"/><child link="{side}_arm"/><origin xyz="0 {y} 0"/>
<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="20" velocity="1"/><dynamics damping="1"/></joint>
"""


def sides(com_right: str, mesh_right: str = "right.stl", sign: float = -1.0) -> str:
    left = SIDE.format(side="left", com="0.1 0.02 0.2", ixy=0.002, iyz=0.003, y=0.3, mesh="left.stl")
    right = SIDE.format(side="right", com=com_right, ixy=sign * 0.002, iyz=sign * 0.003, y=-0.3, mesh=mesh_right)
    return SIDES.format(left=left, right=right)


def test_mirrored_sides_are_alike():
    assert not tw.doctor(sides("0.1 -0.02 0.2"), only="mirror").findings


def test_a_centre_of_mass_that_is_not_mirrored_is_found_with_its_torque():
    report = tw.doctor(sides("0.1 -0.02 0.1"), only="mirror")
    (finding,) = report.findings
    assert finding.severity is Severity.WARNING and "100 mm apart" in finding.sentence
    robot = tw.load(sides("0.1 -0.02 0.1"))
    q = report.contents.robot.effects.q
    mirrored = np.abs(np.diff(robot.gravity_forces(np.stack([q[:, 0], q[:, 0]], axis=1)), axis=1)).max()
    assert finding.effect.torque <= 2 * 9.81 * 0.1 + 1e-9 and finding.effect.torque >= 0.5 * mirrored
    assert finding.effect.effort_percent == pytest.approx(100 * finding.effect.torque / 20)


@pytest.mark.parametrize("side", ["left", "right"])
def test_shapes_speak_for_the_side_whose_centre_of_mass_lies_in_their_middle(side):
    """Both arms are boxes about (0.1, ±0.02, 0.2); the centre of mass of the other side lies 100 mm below the middle of its box."""
    text = sides("0.1 -0.02 0.2" if side == "right" else "0.1 -0.02 0.1")
    if side == "right":
        text = text.replace('<origin xyz="0.1 0.02 0.2"/>', '<origin xyz="0.1 0.02 0.1"/>')
    for name, y in (("left", 0.02), ("right", -0.02)):
        mesh = f'<visual><geometry><mesh filename="{name}.stl"/>'
        text = text.replace(mesh, f'<visual><origin xyz="0.1 {y} 0.2"/><geometry><box size="0.2 0.1 0.6"/>')
    (finding,) = tw.doctor(text, only="mirror").findings
    assert f"the shapes speak for the {side} one" in finding.repair.sentence
    assert "0 mm from theirs, not 100" in finding.repair.sentence


def test_products_that_keep_their_signs_on_the_other_side_are_found():
    (finding,) = tw.doctor(sides("0.1 -0.02 0.2", sign=1.0), only="mirror").findings
    assert "tensors" in finding.sentence


@pytest.mark.parametrize("wrong", [False, True])
def test_the_frames_of_the_two_sides_may_be_turned_against_each_other(wrong):
    """A quarter turn of the right one's frame about y, so that what mirrors is not a symmetric matrix; its tensor has axes too."""
    R_b = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # of the right frame in the base
    A = rotation_of_rpy(np.array([0.2, -0.5, 0.9]))  # of its tensor's axes in the right frame
    I = np.array(
        [[0.02, -0.002, 0.001], [-0.002, 0.03, -0.003], [0.001, -0.003, 0.025]]
    )  # mirrored, along the base's axes
    J = A.T @ (R_b.T @ I @ R_b if not wrong else I) @ A
    names = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    com = " ".join(f"{x:.12g}" for x in R_b.T @ [0.1, -0.02, 0.2])
    head, mark, tail = sides(com).partition('<link name="right_arm"')
    tail = re.sub(
        r"<inertia [^>]*/>", "<inertia " + " ".join(f'{n}="{J[at]!r}"' for n, at in names.items()) + "/>", tail
    )
    tail = (
        tail.replace("np.float64(", "").replace(')"', '"').replace("<origin xyz", '<origin rpy="0.2 -0.5 0.9" xyz', 1)
    )
    tail = tail.replace('<origin xyz="0 -0.3 0"/>', f'<origin xyz="0 -0.3 0" rpy="0 {np.pi / 2!r} 0"/>')
    text = head + mark + tail
    findings = tw.doctor(text, only="mirror").findings
    assert bool(findings) == wrong
    for side in ("left", "right") if wrong else ():
        report = tw.doctor(text, only="mirror", mirror_from=side)
        assert len(report.repairs) == 1
        assert not tw.doctor(report.repaired_text(), only="mirror").findings


def test_one_mesh_on_both_sides_is_no_reason_to_warn():
    findings = tw.doctor(sides("0.1 0.02 0.2", mesh_right="left.stl"), only="mirror").findings
    assert all(f.severity is Severity.NOTE for f in findings)


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_side_that_is_chosen_is_copied(side, tmp_path):
    path, out = tmp_path / "sides.urdf", tmp_path / "fixed.urdf"
    path.write_text(sides("0.1 -0.02 0.1", sign=1.0).replace('<mass value="2"/>', '<mass value="2.5"/>', 1))
    result = CliRunner().invoke(main, ["doctor", str(path), "--mirror-from", side, "--out", str(out)])
    assert result.exit_code == 1 and "with 1 repair" in result.output
    assert not tw.doctor(out, only="mirror").findings
    mass = {"left": 2.5, "right": 2.0}[side]
    assert [link.mass for link in tw.load(out).model.link_inertias.values()] == [0.0, mass, mass]
    assert tw.doctor(path, mirror_from=side).repaired().mass_matrix([0.3, 0.3])[0, 0] > 0
    with pytest.raises(tw.ValueRangeError, match="left"):
        tw.doctor(path, mirror_from="both")


# ── pictures ──


def test_the_picture_shows_what_the_repair_changes(tmp_path):
    path = tmp_path / "pendulum.sdf"
    path.write_text(SDF.format("2.0"))
    result = CliRunner().invoke(main, ["doctor", str(path), "--plot", str(tmp_path / "p.png")])
    assert result.exit_code == 1 and (tmp_path / "p.png").stat().st_size > 5000, result.output
    result = CliRunner().invoke(main, ["doctor", "ur5", "--plot", str(tmp_path / "q.png")])
    assert result.exit_code == 0 and not (tmp_path / "q.png").exists() and "nothing to draw" in result.output


def test_the_page_shows_the_findings_on_the_links(tmp_path):
    from twistwrench.core.colours import COLOURS, Style
    from twistwrench.viz.findings_scene import findings_scene

    path = tmp_path / "sides.urdf"
    path.write_text(sides("0.1 -0.02 0.1"))
    result = CliRunner().invoke(main, ["doctor", str(path), "--report", str(tmp_path / "p.html")])
    assert result.exit_code == 1 and (tmp_path / "p.html").is_file(), result.output
    scene = findings_scene(tw.doctor(path))
    assert "they mirror each other" in scene.notes[0]
    assert {s.layer for s in scene.shapes} == {"looks", "inertia"}
    amber = {s.body for s in scene.shapes if s.layer == "looks" and s.colour == COLOURS[Style.NEAR].scene}
    assert amber == {0, 1}


def test_the_length_of_a_capsule_of_urdf_is_that_of_its_cylinder(tmp_path):
    """As of coal, which Pinocchio reads URDF 1.1 with: the caps come on top."""
    r, length, density = 0.1, 0.5, 10.0
    solid = tw.SpatialInertia.capsule(r, length, density=density)
    text = f"""<robot name="r" version="1.1"><link name="base"/><link name="l"><inertial><mass value="{solid.mass}"/>
    <inertia ixx="{solid.moment_about_com[0, 0]}" iyy="{solid.moment_about_com[1, 1]}" izz="{solid.moment_about_com[2, 2]}"
    ixy="0" ixz="0" iyz="0"/></inertial><collision><geometry><capsule radius="{r}" length="{length}"/></geometry></collision>
    </link><joint name="j" type="continuous"><parent link="base"/><child link="l"/></joint></robot>"""
    (tmp_path / "pill.urdf").write_text(text)
    (found,) = (f for f in tw.doctor(tmp_path / "pill.urdf", only="density").findings if f.check == "density")
    assert found.numbers["density"] == pytest.approx(density, rel=0.03)  # of a surface with corners
    pinocchio = pytest.importorskip("pinocchio")
    model = pinocchio.buildModelFromXML(text)
    shapes = pinocchio.buildGeomFromUrdfString(model, text, pinocchio.GeometryType.COLLISION)
    assert 2 * shapes.geometryObjects[0].geometry.halfLength == pytest.approx(length)
