"""URDF, SDF and USD as other programs write them: what is read is right, what is left out is remarked, nothing is lost."""

from __future__ import annotations

import time
import warnings
import xml.etree.ElementTree as ET

import numpy as np
import pytest

import twistwrench as tw

TURN = 'rpy="1.5707963267948966 0 0"'
SAME_TURN = 'quat_xyzw="0.7071067811865476 0 0 0.7071067811865476"'


def one_joint(inertial: str = "", placement: str = "", joint: str = "", link: str = "", rest: str = "") -> str:
    """A URDF of one revolute joint, with what is given put into its elements."""
    return f"""<robot name="a" version="1.1">
<link name="base"/>
<link name="l"><inertial><origin xyz="0.3 0 0" {inertial}/><mass value="2"/>
<inertia ixx="0.1" iyy="0.2" izz="0.25" ixy="0" ixz="0" iyz="0"/></inertial>{link}</link>
<joint name="j" type="revolute"><parent link="base"/><child link="l"/><origin xyz="0 0 1" {placement}/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="5" velocity="1"/>{joint}</joint>{rest}</robot>"""


def quiet(text: str, **options: object) -> tw.Robot:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        return tw.load(text, **options)  # type: ignore[arg-type]


def numbers(robot: tw.Robot) -> np.ndarray:
    """Torque in a state where mass, gravity and Coriolis terms all act."""
    n = robot.nv
    return robot.inverse_dynamics(np.full(n, 0.4), np.full(n, 1.5), np.full(n, -0.7))


@pytest.mark.parametrize("where", ["inertial", "placement"])
def test_a_quaternion_of_urdf_1_1_is_the_equal_rpy(where):
    pinocchio = pytest.importorskip("pinocchio", exc_type=ImportError)
    asked, expected = (one_joint(**{where: turn}) for turn in (SAME_TURN, TURN))
    robot = quiet(asked)
    np.testing.assert_allclose(numbers(robot), numbers(quiet(expected)), rtol=1e-14)
    model = pinocchio.buildModelFromXML(asked)
    tau = pinocchio.rnea(model, model.createData(), np.array([0.4]), np.array([1.5]), np.array([-0.7]))
    np.testing.assert_allclose(numbers(robot), tau, rtol=1e-12)
    assert robot.defects == ()


def test_both_rotations_and_a_length_that_is_not_one_are_errors():
    with pytest.raises(tw.RobotFileError, match=r"<origin> of link 'l' \(line 3\) has both rpy and quat_xyzw"):
        tw.load(one_joint(inertial=f"{TURN} {SAME_TURN}"))
    with pytest.raises(tw.RobotFileError, match=r"length 1\.01"):
        tw.load(one_joint(placement='quat_xyzw="0 0 0 1.01"'))
    rounded = one_joint(inertial='quat_xyzw="0.7071 0 0 0.7071"')  # four decimals: the length is divided out
    np.testing.assert_allclose(numbers(quiet(rounded)), numbers(quiet(one_joint(inertial=TURN))), rtol=1e-14)


def remark(robot: tw.Robot, name: str) -> str:
    """The one remark that names something."""
    (found,) = [text for text in robot.defects if name in text]
    return found


def test_elements_and_attributes_of_urdf_that_are_not_read_are_named():
    rest = '<jiont name="x"/>\n<jiont/><transmision/><constraint type="ball"/><inertial/><controller:thing/>'
    robot = quiet(one_joint(rest=rest, placement='foo="1"', joint="<dynamics dampign='3'/>"))
    assert remark(robot, "jiont") == "line 6 and 1 more: <jiont> is not an element of URDF; did you mean <joint>?"
    assert "line 7: <transmision> is not an element of URDF; did you mean <transmission>?" in robot.defects
    assert remark(robot, "foo") == "line 5: foo is not an attribute of <origin> in URDF"
    assert remark(robot, "dampign").endswith("did you mean damping?")
    assert "its loop stays open: it needs a name, parent, child and a type of revolute" in remark(robot, "<constraint>")
    assert "it belongs into <link>" in remark(robot, "<inertial>")
    assert len(robot.defects) == 6
    np.testing.assert_array_equal(numbers(robot), numbers(quiet(one_joint())))


@pytest.mark.parametrize(
    ("said", "remarked"),
    [
        ("<turnGravityOff>true</turnGravityOff>", "gravity does not act"),
        ("<turnGravityOff>false</turnGravityOff>", ""),
        ("<gravity>0</gravity>", "gravity does not act"),
        ("<gravity>true</gravity>", ""),
        ('<springStiffness value="20"/><springReference value="0.1"/>', "torque of the spring"),
        ("<springStiffness>0.0</springStiffness><implicitSpringDamper>1</implicitSpringDamper>", ""),
        ("<velocity_decay><linear>0</linear><angular>0.1</angular></velocity_decay>", "drag"),
        ("<mu1>0.2</mu1><anything>3</anything><sensor name='s'><pose>0</pose></sensor>", ""),
    ],
)
def test_mechanics_in_extensions_of_gazebo_is_remarked_and_the_rest_is_not(said, remarked):
    defects = quiet(one_joint(rest=f'<gazebo reference="l">{said}</gazebo>')).defects
    assert len(defects) == bool(remarked)
    assert remarked in "".join(defects)


def sdf(link: str = "", inertial: str = "", rest: str = "") -> str:
    """An SDF of one joint, with what is given put into its elements."""
    return f"""<sdf version="1.9"><model name="a"><link name="base"/>
<link name="l"><inertial><pose>0.3 0 0 0 0 0</pose><mass>2</mass><inertia><ixx>0.1</ixx><iyy>0.2</iyy><izz>0.25</izz></inertia>
{inertial}</inertial>{link}</link>
<joint name="j" type="revolute"><parent>base</parent><child>l</child><axis><xyz>0 1 0</xyz></axis></joint>
<joint name="fix" type="fixed"><parent>world</parent><child>base</child></joint>{rest}</model></sdf>"""


@pytest.mark.parametrize(
    ("parts", "remarked"),
    [
        ({"inertial": "<fluid_added_mass><xx>3</xx></fluid_added_mass>"}, "<fluid_added_mass> of link 'l'"),
        ({"inertial": "<fluid_added_mass><xx>0</xx></fluid_added_mass>"}, ""),
        ({"link": "<velocity_decay><linear>0.1</linear></velocity_decay>"}, "<velocity_decay> of link 'l'"),
        ({"link": "<velocity_decay><linear>0</linear></velocity_decay>"}, ""),
        ({"link": "<kinematic>true</kinematic>"}, "<kinematic> of link 'l'"),
        ({"link": "<gravity>false</gravity>"}, "<gravity> of link 'l'"),
        ({"link": "<enable_wind>true</enable_wind>"}, "<enable_wind> of link 'l'"),
        ({"link": "<kinematik>true</kinematik>"}, "<kinematik> is not an element of SDF; did you mean <kinematic>?"),
        ({"rest": "<self_collide>true</self_collide><plugin name='p' filename='f'><a>1</a></plugin>"}, ""),
    ],
)
def test_elements_of_sdf_with_mechanics_are_remarked(parts, remarked):
    whole, robot = quiet(sdf()), quiet(sdf(**parts))
    new = [text for text in robot.defects if text not in whole.defects]
    assert len(new) == bool(remarked)
    assert remarked in "".join(new)
    np.testing.assert_array_equal(numbers(robot), numbers(whole))


INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'


def _urdf(n: int, parent: str = "l{k}", kind: str = "continuous", mimic: str = "") -> str:
    joints = (
        f'<link name="l{k + 1}">{INERTIAL}</link><joint name="j{k}" type="{kind}"><parent link="{parent.format(k=k)}"/>'
        f'<child link="l{k + 1}"/>{mimic.format(k=k - 1) if k else ""}</joint>'
        for k in range(n)
    )
    return f'<robot name="r"><link name="l0"/>{"".join(joints)}</robot>'


def _sdf(parts: str) -> str:
    return f'<sdf version="1.9"><model name="m"><link name="f"/>{parts}</model></sdf>'


def _mjcf(parts: str, rest: str = "") -> str:
    body = f'<body name="b"><joint name="j"/><geom size="1"/>{parts}</body>'
    return f"<mujoco><worldbody>{body}</worldbody>{rest}</mujoco>"


REPEATED = {
    "SDF frames attached to each other": lambda n: _sdf(
        '<frame name="f0" attached_to="f"/>' + "".join(f'<frame name="f{k + 1}" attached_to="f{k}"/>' for k in range(n))
    ),
    "URDF followers of followers": lambda n: _urdf(n, "l0", mimic='<mimic joint="j{k}"/>'),
    "SDF frames attached to later ones": lambda n: _sdf(
        "".join(f'<frame name="f{k}" attached_to="f{k + 1}"/>' for k in range(n))
        + f'<frame name="f{n}" attached_to="f"/>'
    ),
    "SDF frames relative to later ones": lambda n: _sdf(
        "".join(f'<frame name="f{k}"><pose relative_to="f{k + 1}">0 0 1 0 0 0</pose></frame>' for k in range(n))
        + f'<frame name="f{n}" attached_to="f"/>'
    ),
    "SDF models in models": lambda n: _sdf('<model name="a"><link name="b"/>' * n + "</model>" * n),
    "URDF followers of one joint": lambda n: _urdf(n, "l0", mimic='<mimic joint="j0"/>'),
    "URDF links in a chain": _urdf,
    "URDF links side by side": lambda n: _urdf(n, "l0"),
    "URDF fixed links": lambda n: _urdf(n, kind="fixed"),
    "URDF unknown elements of different names": lambda n: _urdf(1).replace(
        "</robot>", "".join(f"<a{k:05}/>" for k in range(n)) + "</robot>"
    ),
    "MJCF geoms": lambda n: _mjcf('<geom size="1"/>' * n),
    "MJCF sites": lambda n: _mjcf("".join(f'<site name="s{k}"/>' for k in range(n))),
    "MJCF frames in frames": lambda n: _mjcf('<frame pos="0 0 1">' * n + '<geom size="1"/>' + "</frame>" * n),
    "MJCF bodies in bodies": lambda n: _mjcf('<body><joint/><geom size="1"/>' * n + "</body>" * n),
    "MJCF bodies side by side": lambda n: _mjcf('<body><joint/><geom size="1"/></body>' * n),
    "MJCF joints of one body": lambda n: _mjcf("<joint/>" * n),
    "MJCF couplings": lambda n: _mjcf(
        "".join(f'<body><joint name="j{k}"/><geom size="1"/></body>' for k in range(n)),
        "<equality>" + "".join(f'<joint joint1="j{k + 1}" joint2="j{k}"/>' for k in range(n - 1)) + "</equality>",
    ),
}


def growth(text: str, twice_twice: str) -> float:
    """Processor time of loading the longer text per that of the shorter one, the least of a few."""
    took = []
    for one in (text, twice_twice):
        times = []
        for _ in range(3):
            before = time.process_time()
            quiet(one)
            times.append(time.process_time() - before)
        took.append(min(times))
    return took[1] / took[0]


@pytest.mark.parametrize(
    "kind", [*REPEATED][:2] + [pytest.param(kind, marks=pytest.mark.slow) for kind in [*REPEATED][2:]]
)
def test_loading_time_grows_with_the_size_of_the_file(kind):
    size = len(REPEATED[kind](200)) - len(REPEATED[kind](100))
    files = [REPEATED[kind](kilobytes * 100_000 // size) for kilobytes in (25, 100)]
    assert 95_000 < len(files[1]) < 105_000
    # Doubling it may take three times as long; with the square of the size it takes four times, from here on.
    assert any(growth(*files) < 3**2 for _ in range(3))


@pytest.mark.parametrize("tag", ["geom", "site", "frame"])
def test_the_limit_on_bodies_holds_for_their_parts(tag):
    with pytest.raises(tw.RobotFileError, match=f"more than 20,000 <{tag}> elements"):
        tw.load(_mjcf(f"<{tag}/>" * 20_001))
    assert quiet(_mjcf('<geom size="0.1"/>' * 30), max_bodies=3).nv == 1


def test_a_million_elements_are_refused_before_they_are_read():
    with pytest.raises(tw.RobotFileError, match=r"about 1,200,0.. elements; more than 1,000,000"):
        tw.load(_urdf(1).replace("</robot>", "<a/>" * 1_200_000 + "</robot>"))


MJCF = """<mujoco model="m"><compiler angle="radian"/><default><default class="c"><geom size="0.1"/></default></default>
<worldbody><body name="b" pos="0 0 1" childclass="c"><joint name="j" axis="0 1 0" range="-1 1" damping="0.1"/><geom type="sphere" size="0.1"/>
<site name="s" pos="0 0 1"/></body></worldbody><actuator><motor name="m" joint="j" gear="1"/></actuator>
<equality><joint joint1="j" polycoef="0 1 0 0 0"/></equality><keyframe><key name="k" qpos="0"/></keyframe></mujoco>"""
LONG = {"numbers": "1 " * 10_000, "one number": "1" * 20_000, "a word": "x" * 20_000, "quotes": "x'" * 10_000}


def every_text_replaced(text: str, by: str) -> list[str]:
    """The file with one attribute or text after the other replaced."""
    root = ET.fromstring(text)
    found = []
    for element in root.iter():
        for name, value in list(element.attrib.items()):
            element.set(name, by)
            found.append(ET.tostring(root, encoding="unicode"))
            element.set(name, value)
        if element.text and element.text.strip():
            element.text, value = by, element.text
            found.append(ET.tostring(root, encoding="unicode"))
            element.text = value
    return found


@pytest.mark.parametrize("by", LONG)
@pytest.mark.parametrize("text", [one_joint(), sdf(), MJCF], ids=["URDF", "SDF", "MJCF"])
def test_messages_quote_two_hundred_characters_at_most(text, by):
    errors = 0
    for changed in every_text_replaced(text, LONG[by]):
        try:
            said = quiet(changed).defects
        except tw.TwistWrenchError as error:
            said, errors = (str(error),), errors + 1
        for sentence in said:
            assert len(sentence) < 2000, sentence[:300]
    assert errors > 10


def test_elements_of_long_names_are_quoted_in_part():
    text = one_joint(rest=f"<{'x' * 100_000}/>", placement=f'{"y" * 100_000}="1"')
    assert [len(sentence) < 400 for sentence in quiet(text).defects] == [True, True]


TRIANGLES = "solid t\n" + "".join(
    f"facet normal 0 0 0\nouter loop\nvertex 0 0 {k}\nvertex 1 0 {k}\nvertex 0 1 {k}\nendloop\nendfacet\n"
    for k in (0, 1)
)


@pytest.mark.parametrize(
    ("uri", "shown"),
    [
        ("package://arm/meshes/part.stl", True),
        ("package://arm/urdf/../meshes/part.stl", True),
        ("file://{}/arm/meshes/part.stl", True),
        ("../meshes/part.stl", True),
        ("package://../secret.stl", False),
        ("package://arm/../secret.stl", False),
        ("package://arm/%2e%2e/secret.stl", False),
        ("package://arm//{}/secret.stl", False),
        ("package:///secret.stl", False),
        ("file://{}/secret.txt", False),
        ("package://arm/notes", False),
        ("{}/secret.txt", False),
    ],
)
def test_a_robot_file_names_meshes_within_packages_only(tmp_path, uri, shown):
    pytest.importorskip("trimesh")
    (tmp_path / "arm/meshes").mkdir(parents=True)
    (tmp_path / "arm/urdf").mkdir()
    for name in ("arm/meshes/part.stl", "secret.stl", "secret.txt", "arm/notes"):
        (tmp_path / name).write_text(TRIANGLES + "endsolid\n")
    robot_file = tmp_path / "arm/urdf/arm.urdf"
    mesh = f'<visual><geometry><mesh filename="{uri.format(tmp_path)}"/></geometry></visual>'
    robot_file.write_text(one_joint(link=mesh))
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        tw.viz.write_page(tw.load(robot_file), tmp_path / "page.html")
    assert any("meshes cannot be drawn" in str(one.message) for one in said) is not shown
