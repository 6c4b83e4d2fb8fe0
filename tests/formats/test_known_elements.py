"""The table of what other programs' files may say, each name switched on alone in a small robot.

READ changes a number or the structure (or is an error), what is left out gives a remark that names it and changes nothing, what
has no mechanics gives nothing.
"""

from __future__ import annotations

import copy
import warnings
import xml.etree.ElementTree as ET

import pytest
from robot_files import BESIDE, FILES

import twistwrench as tw
from twistwrench.formats.known_elements import ALL_OTHERS, KNOWN, NO_MECHANICS, READ, LeftOut, Unread

URDF = """<robot name="r">
<link name="base"/>
<link name="l"><inertial><origin xyz="0.3 0.1 0" rpy="0.2 0.1 0"/><mass value="2"/>
<inertia ixx="0.1" iyy="0.2" izz="0.25" ixy="0.01" ixz="0.02" iyz="0.03"/></inertial></link>
<link name="m"><inertial><origin xyz="0.3 0.1 0" quat_xyzw="0 0.6 0 0.8"/><mass value="2"/>
<inertia ixx="0.1" iyy="0.2" izz="0.25" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="n"><inertial><mass value="2"/><inertia ixx="0.1" iyy="0.2" izz="0.25" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j" type="revolute"><origin xyz="0 0 1" rpy="0 0.2 0"/><parent link="base"/><child link="l"/><axis xyz="0.6 0.8 0"/>
<limit lower="-1" upper="1" effort="5" velocity="1" acceleration="8" deceleration="9" jerk="99"/>
<dynamics damping="0.5" friction="0.2"/><joint_properties damping="0"/></joint>
<joint name="k" type="revolute"><origin xyz="0 0.1 1"/><parent link="l"/><child link="m"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="5" velocity="1"/></joint>
<joint name="f" type="revolute"><origin xyz="0 0.1 1"/><parent link="m"/><child link="n"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="5" velocity="4"/><mimic joint="k" multiplier="1.5" offset="0.1"/></joint>
<constraint name="c" type="revolute"><parent link="l"/><child link="n"/><parent_axis xyz="0 0.6 0.8"/>
<parent_origin xyz="0 0.1 0" rpy="0.1 0 0"/><child_origin xyz="0 0.2 0" quat_xyzw="0 0.6 0 0.8"/></constraint>
<constraint name="d" type="link"><parent link="l"/><child link="n"/><parent_origin quat_xyzw="0 0.6 0 0.8"/>
<child_origin rpy="0.1 0 0"/></constraint>
<gazebo reference="l"/>
<transmission><actuator name="a"><drake:rotor_inertia value="0"/></actuator></transmission>
<mujoco><compiler/></mujoco>
</robot>"""

_INERTIAL = """<inertial auto="false"><mass>2</mass><pose rotation_format="euler_rpy">0.3 0.1 0 0.2 0.1 0</pose>
<inertia><ixx>0.1</ixx><iyy>0.2</iyy><izz>0.25</izz><ixy>0.01</ixy><ixz>0.02</ixz><iyz>0.03</iyz></inertia></inertial>"""
_AXIS = """<xyz>{xyz}</xyz><dynamics><damping>0.5</damping><friction>0.2</friction><spring_reference>0.1</spring_reference>
<spring_stiffness>3</spring_stiffness></dynamics><limit><lower>-1</lower><upper>1</upper><effort>5</effort><velocity>2</velocity></limit>"""
SDF = f"""<sdf version="1.9" xmlns:drake="drake"><world name="w"><gravity>0 0.1 -9</gravity>
<model name="r" canonical_link="a"><static>true</static><pose>0 0 0 0.1 0.2 0</pose>
<link name="base"/><link name="a">{_INERTIAL}</link><link name="b"><pose relative_to="a" degrees="true">0 0 1 10 20 0</pose>{_INERTIAL}</link>
<link name="c">{_INERTIAL}</link><link name="d">{_INERTIAL}</link><link name="e">{_INERTIAL}</link>
<model name="inner" canonical_link="x"><link name="y">{_INERTIAL}</link><link name="x"/>
<joint name="xy" type="revolute"><parent>x</parent><child>y</child><axis><xyz>0 1 0</xyz></axis></joint></model>
<frame name="f" attached_to="b"><pose relative_to="a">0 0.1 0.2 0 0 0</pose></frame>
<joint name="j" type="revolute"><pose>0.1 0.2 0 0.3 0 0</pose><parent>base</parent><child>a</child>
<axis>{_AXIS.format(xyz="0 1 0").replace("<xyz>", '<xyz expressed_in="b">')}</axis>
<drake:rotor_inertia>0.1</drake:rotor_inertia><drake:gear_ratio>2</drake:gear_ratio>
<physics><ode/><simbody/></physics></joint>
<joint name="k" type="universal"><pose>0 0 0 0.3 0 0</pose><parent>a</parent><child>b</child>
<axis>{_AXIS.format(xyz="0 1 0")}<use_parent_model_frame>true</use_parent_model_frame></axis>
<axis2>{_AXIS.format(xyz="1 0 0")}<use_parent_model_frame>true</use_parent_model_frame>
<mimic joint="j"><multiplier>1.5</multiplier><offset>0.1</offset><reference>0.2</reference></mimic></axis2></joint>
<joint name="s" type="screw"><parent>b</parent><child>c</child><axis><xyz>0 0 1</xyz>
<mimic joint="j"><multiplier>1.5</multiplier><offset>0.1</offset><reference>0.2</reference></mimic></axis>
<thread_pitch>3</thread_pitch></joint>
<joint name="t" type="screw"><parent>c</parent><child>d</child><axis><xyz>0 0 1</xyz></axis><screw_thread_pitch>3</screw_thread_pitch></joint>
<joint name="u" type="fixed"><parent>d</parent><child>inner</child></joint>
</model></world></sdf>"""

TEXTS = {"URDF": URDF, "SDF": SDF}
ROOTS = {"URDF": "robot", "SDF": "world"}


def plain(text: str) -> ET.Element:
    """Elements of a text; prefixes stay as they are written."""
    return ET.fromstring(
        text.replace("drake:", "drake-").replace("xmlns:drake-", "xmlns:drake:").replace('xmlns:drake="drake"', "")
    )


def text_of(root: ET.Element) -> str:
    return ET.tostring(root, encoding="unicode").replace("drake-", "drake:")


def loaded(text: str) -> tw.Robot:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        return tw.load(text)


def meaning(robot: tw.Robot) -> tuple[object, ...]:
    """Whatever of a robot a file can decide."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        written = robot.to_sdf()  # bodies, joints, limits, springs, friction, rotors, followers
    limits = {kind: values.tolist() for kind, values in vars(robot.limits).items()}
    return robot.name, tuple(robot.frame_names), robot.gravity.tolist(), limits, dict(robot.closures), written


def answer(text: str) -> tuple[object, object]:
    """What a file means, or the error; and its remarks without their lines."""
    try:
        robot = loaded(text)
    except tw.TwistWrenchError as error:
        return str(error), ()
    return meaning(robot), robot.defects


def rows_with(kind: object) -> list[object]:
    found = []
    for form, rows in KNOWN.items():
        for tag, row in rows.items() if form in TEXTS else ():
            found += [
                pytest.param(form, tag, name, entry, id=f"{form} {tag} {name}")
                for name, entry in row.items()
                if name != ALL_OTHERS
                and (tag, name) != ("world", "<model>")
                and (entry is kind if isinstance(kind, str) else isinstance(entry, LeftOut))
            ]
    return found


def elements(root: ET.Element, tag: str) -> list[ET.Element]:
    """Those of a row, ``parent/tag`` or ``tag``."""
    tag = tag.replace(":", "-")
    parent, _, own = tag.rpartition("/")
    return list(root.iter(own)) if not parent else [child for one in root.iter(parent) for child in one.findall(own)]


@pytest.fixture(scope="module")
def whole() -> dict[str, tuple[object, object]]:
    return {form: answer(text) for form, text in TEXTS.items()}


def test_the_files_here_are_read_without_a_remark_on_names(whole):
    for form, (said, defects) in whole.items():
        assert isinstance(said, tuple), said
        assert not [text for text in defects if "not read" in text or "is not an" in text], (form, defects)


@pytest.mark.parametrize(
    "name", ["loop_joint", "force_element", "cable", "drake:linear_spring_damper", "drake:tendon_constraint"]
)
def test_what_pulls_couples_or_closes_in_another_program_is_remarked(name, whole):
    """By mechanics, not by the table: without them the torques are those of another machine."""
    _, before = whole["URDF"]
    (said,) = set(loaded(URDF.replace("</robot>", f'<{name} name="x"/></robot>')).defects) - set(before)
    assert said.startswith(f"<{name} ")


@pytest.mark.parametrize(("form", "tag", "name", "entry"), rows_with(READ))
def test_what_is_read_counts(form, tag, name, entry, whole):
    root = plain(TEXTS[form])
    count, changed = len(elements(root, tag)), False
    assert count, f"no <{tag}> in the file of this test"
    for k in range(count):
        other = copy.deepcopy(root)
        at = elements(other, tag)[k]
        if name.startswith("<"):
            child = at.find(name[1:-1].replace(":", "-"))
            if not has_read(form, name[1:-1]):
                return  # entered only because mechanics may be in it
            if child is not None:
                at.remove(child)
            elif k == 0 and root.find(f".//{name[1:-1].replace(':', '-')}") is None:
                ET.SubElement(at, name[1:-1].replace(":", "-"))
        elif name in at.attrib:
            at.set(name, changed_text(at.get(name, "")))
        else:
            continue
        changed = changed or answer(text_of(other)) != whole[form]
    assert changed


def has_read(form: str, tag: str) -> bool:
    """True if something in an element counts by itself."""
    row = KNOWN[form].get(tag)
    read = [] if row is None else [name for name, entry in row.items() if entry is READ]
    return row is None or any(not name.startswith("<") or has_read(form, name[1:-1]) for name in read)


def changed_text(text: str) -> str:
    """Another value that can stand there."""
    flags = {"true": "false", "false": "true"}
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        return flags.get(text, text + "x")
    first = next((k for k, value in enumerate(values) if value), 0)  # whose sign keeps a quaternion's length
    return " ".join(repr(-value) if k == first else repr(value) for k, value in enumerate(values))


def switched_on(form: str, tag: str, name: str, value: str) -> str:
    root = plain(TEXTS[form])
    if name.startswith("<"):
        one = elements(root, tag)[0]
        old = one.find(name[1:-1].replace(":", "-"))
        if old is not None:
            one.remove(old)
        child = ET.SubElement(one, name[1:-1].replace(":", "-"))
        child.text = value
        if form == "URDF":  # where texts have a meaning in extensions only
            child.set("value", value)
    else:
        elements(root, tag)[0].set(name.replace(":", "-"), value)
    return text_of(root)


@pytest.mark.parametrize(("form", "tag", "name", "entry"), rows_with(NO_MECHANICS))
def test_what_has_no_mechanics_is_passed_over(form, tag, name, entry, whole):
    assert without_lines(answer(switched_on(form, tag, name, "3"))) == without_lines(whole[form])


@pytest.mark.parametrize(("form", "tag", "name", "entry"), rows_with(LeftOut("")))
def test_what_is_left_out_is_remarked_and_changes_nothing(form, tag, name, entry, whole):
    value = next(text for text in ("3", "0", "x") if entry.acts([text]))
    said, defects = answer(switched_on(form, tag, name, value))
    assert said == whole[form][0]
    (new,) = [text for text in defects if "not read" in text]
    assert entry.change in new
    assert name.strip("<>") in new
    for harmless in entry.unless or ("0", "false", "0 0.0"):
        assert not [text for text in answer(switched_on(form, tag, name, harmless))[1] if "not read" in text]


def without_lines(found):
    return found[0], len(found[1])


@pytest.mark.parametrize("form", TEXTS)
def test_names_in_no_row_are_remarked_wherever_something_is_read(form, whole):
    for tag, row in KNOWN[form].items():
        if ALL_OTHERS in row:
            continue
        for name in ("<qqqq>", "qqqq"):
            said, defects = answer(switched_on(form, tag, name, "3"))
            assert said == whole[form][0], (tag, name)
            (new,) = [text for text in defects if "is not an" in text]
            assert new.startswith("line ") and name in new, new
            foreign = name.replace("qqqq", "drake:qqqq")
            assert not [text for text in answer(switched_on(form, tag, foreign, "3"))[1] if "is not an" in text]


# ── MJCF: its table has what MuJoCo's own schema has, and every other name is remarked ──

MJCF = """<mujoco><compiler/><option><flag/></option><default><joint/><tendon/><equality/><motor/></default>
<asset><mesh name="m" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset>
<worldbody><body name="b"><inertial pos="1 0 0" mass="1" diaginertia="1 1 1"/><joint name="j" axis="0 1 0"/>
<frame><geom size="1"/><site name="s"/></frame></body></worldbody>
<equality><joint joint1="j"/></equality><tendon><fixed><joint joint="j" coef="1"/></fixed></tendon>
<actuator><motor joint="j"/></actuator></mujoco>"""


def _schema():
    """(parents and tag, attributes) of MuJoCo's own schema."""
    mujoco = pytest.importorskip("mujoco")
    path: list[str] = []
    found: dict[tuple[str, ...], set[str]] = {}
    for line in mujoco.mj_printSchema(False, False).splitlines():
        indent = len(line) - len(line.lstrip())
        words = line.split()
        if indent < 20 and words:
            path = [*path[: indent // 3], words[0].replace("(world)", "")]
            words = words[2:]
        found.setdefault(tuple(path), set()).update(words)
    return found


def test_the_table_of_mjcf_has_every_name_that_mujoco_reads():
    unread = Unread("MJCF")
    looked = 0
    for path, attributes in _schema().items():
        rows = [unread.row(tag, above) for above, tag in zip(("", *path), path, strict=False)]
        entered = all(unread.entry(row, f"<{tag}>") is READ for row, tag in zip(rows, path[1:], strict=False))
        if entered and path:
            row = rows[-1]
            looked += 1
            assert not [name for name in attributes if unread.entry(row, name) is None], path
    assert looked > 40


@pytest.mark.parametrize("tag", sorted({one.tag for one in ET.fromstring(MJCF).iter()}))
def test_names_of_mjcf_in_no_table_are_remarked(tag):
    before = loaded(MJCF).defects
    for name in ("<strnge>",) if ALL_OTHERS in KNOWN["MJCF"].get(tag, {}) else ("strnge", "<strnge>"):
        root = ET.fromstring(MJCF)
        one = next(root.iter(tag))
        if name == "strnge":
            one.set(name, "1")
        else:
            ET.SubElement(one, "strnge")
        new = [text for text in loaded(ET.tostring(root, encoding="unicode")).defects if text not in before]
        assert [text for text in new if "strnge" in text], (tag, name)


def test_the_pose_of_a_model_in_another_frame_is_remarked():
    text = """<sdf version="1.9"><world name="w"><frame name="f"><pose>1 0 0 0 0 0</pose></frame>
    <model name="r"><static>true</static><pose{}>0 0 1 0 0 0</pose><link name="l"/></model></world></sdf>"""
    before, after = (loaded(text.format(at)) for at in ("", ' relative_to="f"'))
    assert meaning(before) == meaning(after)
    (new,) = [one for one in after.defects if one not in before.defects]
    assert "relative to 'f', which is not read" in new


@pytest.mark.parametrize(
    "values", ['settotalmass="0"', 'settotalmass="-1"', 'inertiafromgeom="auto"', 'inertiafromgeom="false"']
)
def test_a_compiler_of_mujoco_that_changes_no_inertia_is_passed_over_in_urdf(values):
    assert answer(URDF.replace("<compiler/>", f"<compiler {values}/>")) == answer(URDF)


@pytest.mark.parametrize("values", ['settotalmass="3"', 'inertiafromgeom="true"'])
def test_a_compiler_of_mujoco_that_changes_inertia_is_remarked_in_urdf(values):
    before = loaded(URDF).defects
    (remark,) = (x for x in loaded(URDF.replace("<compiler/>", f"<compiler {values}/>")).defects if x not in before)
    assert values.partition("=")[0] in remark


BALL = """<mujoco><compiler COMPILER/><worldbody>
<body name="a"><joint name="j" type="hinge"/><inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/><geom size="0.1" density="1000"/></body>
<body name="b"><joint name="k" type="slide"/><geom size="0.1" density="1000"/></body></worldbody></mujoco>"""
_MASS = 1000 * 4 / 3 * 3.141592653589793 * 0.1**3


@pytest.mark.parametrize(
    ("compiler", "masses"),
    [
        ("", (2.0, _MASS)),
        ('inertiafromgeom="auto"', (2.0, _MASS)),
        ('inertiafromgeom="true"', (_MASS, _MASS)),
        ('settotalmass="0"', (2.0, _MASS)),
        ('settotalmass="-1"', (2.0, _MASS)),
        ('settotalmass="3"', (6.0 / (2.0 + _MASS), 3.0 * _MASS / (2.0 + _MASS))),
        ('inertiafromgeom="true" settotalmass="3"', (1.5, 1.5)),
    ],
)
def test_the_compiler_of_mjcf_says_where_masses_come_from(compiler, masses):
    robot = loaded(BALL.replace("COMPILER", compiler))
    assert [body.inertia.mass for body in robot.model.bodies] == pytest.approx(masses, rel=1e-12)
    assert any("settotalmass=3" in text for text in robot.defects) == ('"3"' in compiler)


# ── public files ──

MISPLACED = {
    "<origin> is not an element of <link> in URDF; it belongs into <inertial> or <joint>": {"so101"},
    "<inertial> is not an element of <robot> in URDF; it belongs into <link>": {"robotiq_tendons", "robotiq_3f"},
}
"""All remarks on unknown names in public files, and the files: each is an element at a place where no program reads it."""


@pytest.mark.slow
def test_of_the_names_in_public_files_those_alone_are_unknown_that_are_out_of_place():
    files = {*FILES.values(), *(file for kind in ("xml", "sdf") for file in BESIDE.rglob(f"*.{kind}"))}
    if not files:
        pytest.skip("neither example-robot-data nor ../shared/robots is there")
    found: dict[str, set[str]] = {}
    for file in sorted(files):
        try:
            defects = loaded_file(file).defects
        except tw.TwistWrenchError:
            continue  # of whose refusals other tests know
        for text in defects:
            if " is not an element of " in text or " is not an attribute of " in text:
                found.setdefault(text.partition(": ")[2], set()).add(file.stem)
    assert found.keys() <= MISPLACED.keys()
    assert all(names <= MISPLACED[text] for text, names in found.items()), found


def loaded_file(path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        return tw.load(path, inertia="accept", mimic="independent")
