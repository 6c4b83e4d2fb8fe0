"""MJCF files and compiled models of MuJoCo: the numbers of MuJoCo, or a remark that names the feature."""

from __future__ import annotations

import importlib.util
import warnings
from pathlib import Path

import numpy as np
import pytest
from places import SHARED

import twistwrench as tw
from twistwrench.identification.parameters import UnknownParameters
from twistwrench.simulation import Event

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed", exc_type=ImportError)

Q, DQ, DDQ = 0.4, 1.5, -0.7


def hinge(body="", joint="", option="", inside="", rest="", kind="hinge"):
    """A 0.1 m sphere 0.3 m beside a joint, with what is given put into its elements."""
    return f"""<mujoco>{option}<worldbody><body name="b" {body}><joint name="j" type="{kind}" axis="0 1 0" {joint}/>
    <geom size=".1" pos=".3 0 0"/>{inside}</body></worldbody>{rest}</mujoco>"""


def quietly(make, *arguments, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        return make(*arguments, **options)


def doors(text):
    """(the robot of the text, the robot of the compiled model, the model)."""
    model = mujoco.MjModel.from_xml_string(text)
    return quietly(tw.load, text, snap=0), quietly(tw.from_mujoco, model, snap=0), model


def of_mujoco(robot, model, q, dq, ddq):
    """qfrc_inverse in the robot's velocities, without contacts and limits."""
    data = mujoco.MjData(model)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT) | int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
    data.qpos[:], data.qvel[:], data.qacc[:] = tw.convert.to_mujoco(robot, model, q, dq, ddq)
    mujoco.mj_inverse(model, data)
    return tw.convert.mujoco_rates(robot, model, q).T @ data.qfrc_inverse


def same_numbers(robot, model, seed=0):
    rng = np.random.default_rng(seed)
    q = np.full(1, Q) if robot.nq == 1 else robot.random_configuration(rng)
    dq, ddq = (np.full(1, DQ), np.full(1, DDQ)) if robot.nv == 1 else rng.uniform(-1, 1, (2, robot.nv))
    theirs = of_mujoco(robot, model, q, dq, ddq)
    ours = robot.inverse_dynamics(q, dq, ddq, friction=True)
    return bool(np.abs(ours - theirs).max(initial=0.0) <= 1e-8 * max(1.0, np.abs(theirs).max(initial=0.0)))


MOTOR = '<actuator><motor name="m" joint="j" {}/></actuator>'
TENDON = '<tendon><fixed {}><joint joint="j" coef="1"/></fixed></tendon>'
FIELD = '<asset><hfield name="h" nrow="2" ncol="2" size="1 .5 .5 .2" elevation="0 1 2 3"/></asset>'
FEATURES = {
    "plain": (hinge(), ""),
    "gravcomp": (hinge(body='gravcomp="1"'), "gravcomp"),
    "density": (hinge(option='<option density="1000"/>'), "fluid"),
    "viscosity": (hinge(option='<option viscosity="1" wind="1 2 3"/>'), "fluid"),
    "wind without a medium": (hinge(option='<option wind="1 2 3"/>'), ""),
    "damping": (hinge(joint='damping="3"'), ""),
    "damping polynomial": (hinge(joint='damping="3 .5 .2"'), "damping that is a polynomial"),
    "damping off": (hinge(joint='damping="3"', option='<option><flag damper="disable"/></option>'), ""),
    "stiffness": (hinge(joint='stiffness="3" springref="9"'), ""),
    "stiffness polynomial": (hinge(joint='stiffness="3 5 9"'), "stiffness that is a polynomial"),
    "spring off": (hinge(joint='stiffness="3"', option='<option><flag spring="disable"/></option>'), ""),
    "springdamper": (hinge(joint='springdamper="1 1"'), None),
    "frictionloss off": (hinge(joint='frictionloss="2"', option='<option><flag frictionloss="disable"/></option>'), ""),
    "constraints off": (hinge(joint='frictionloss="2"', option='<option><flag constraint="disable"/></option>'), ""),
    "gravity off": (hinge(option='<option><flag gravity="disable"/></option>'), ""),
    "armature": (hinge(joint='armature="2"'), ""),
    "motor damping": (hinge(rest=MOTOR.format('damping=".3" gear="2"')), ""),
    "motor damping polynomial": (hinge(rest=MOTOR.format('damping=".3 .2"')), "damping that is a polynomial"),
    "motor armature": (hinge(rest=MOTOR.format('armature=".3" gear="3"')), ""),
    "tendon stiffness": (hinge(rest=TENDON.format('stiffness="2" springlength=".3"')), ""),
    "tendon stiffness polynomial": (hinge(rest=TENDON.format('stiffness="2 3" springlength=".3"')), "polynomial"),
    "tendon damping": (hinge(rest=TENDON.format('damping="2"')), "damping"),
    "tendon damping polynomial": (hinge(rest=TENDON.format('damping="0 2"')), "damping"),
    "tendon armature": (hinge(rest=TENDON.format('armature="2"')), "armature"),
    "hfield": (hinge(option=FIELD, inside='<geom type="hfield" hfield="h" pos=".1 .2 .3" euler="10 20 30"/>'), ""),
    "hfield with mass": (hinge(option=FIELD, inside='<geom type="hfield" hfield="h" mass="3"/>'), ""),
    "ball stiffness": (hinge(joint='stiffness="2"', kind="ball"), "stiffness, which is left out"),
    "slide": (hinge(joint='stiffness="2" damping="1"', kind="slide"), ""),
    "slide polynomial": (hinge(joint='stiffness="2 1" damping="1 1"', kind="slide"), "stiffness that is a polynomial"),
    "free damping": (hinge(joint='damping="1"', kind="free"), ""),
    "springyield": (hinge(joint='stiffness="2" springyield=".1"'), None),
}  # fmt: skip
"""(text, remark): the same numbers where the remark is empty, the remark or the same numbers where it is None."""


@pytest.mark.parametrize("name", FEATURES)
def test_each_feature_alone_has_the_numbers_of_mujoco_or_a_remark(name):
    text, word = FEATURES[name]
    try:
        mujoco.MjModel.from_xml_string(text)
    except ValueError as error:
        pytest.skip(f"this version of MuJoCo does not read it: {error}")
    *robots, model = doors(text)
    remarks = [[one for one in robot.defects if "largest force is not given" not in one] for robot in robots]
    for robot, said in zip(robots, remarks, strict=True):
        if word == "":
            assert same_numbers(robot, model)
            assert said == []
        elif word is None:
            assert said or same_numbers(robot, model)
        else:
            assert not same_numbers(robot, model)
            assert any(word in one for one in said)
    if name != "springdamper":  # which the compiled model has as a stiffness and a damping
        assert len(remarks[0]) == len(remarks[1])
        np.testing.assert_allclose(*(r.reference("mass_matrix", r.random_configuration(0)) for r in robots), rtol=1e-8)


@pytest.mark.parametrize("base", ["", "<freejoint/>"])
@pytest.mark.parametrize("order", [("ball", "hinge", "slide"), ("hinge", "ball", "slide"), ("slide", "hinge", "ball")])
def test_each_joint_has_its_own_numbers_whatever_moves_before_it(base, order):
    """Joints, coordinates and velocities are counted apart: a free joint has 7 and 6 of these, a ball joint 4 and 3."""
    geom, ends, given = '<geom size=".1" pos=".3 0 0"/>', "", {name: [0.0] * 6 * bool(base) for name in ("c", "v", "a")}
    text = f"<body>{base}{geom}"
    for k, kind in enumerate((*order, *order), start=1):
        position_range = "0 1.5" if kind == "ball" else f"-{k} {k + 0.5}"
        text += f'<body><joint name="j{k}" type="{kind}" frictionloss="{k}" damping="{10 + k}" armature="{20 + k}" '
        text += f'limited="true" range="{position_range}"/>{geom}'
        ends += "</body>"
        for name, number in (("c", k), ("v", 10 + k), ("a", 20 + k)):
            given[name] += [number] * (3 if kind == "ball" else 1)
    *robots, _ = doors(f'<mujoco><compiler angle="radian"/><worldbody>{text}{ends}</body></worldbody></mujoco>')
    for robot in robots:
        np.testing.assert_array_equal(robot.model.friction.coulomb, given["c"])
        np.testing.assert_array_equal(robot.model.friction.viscous, given["v"])
        np.testing.assert_array_equal(robot.armature, given["a"])
        for k, kind in enumerate((*order, *order), start=1):
            if kind != "ball":
                (v,) = range(*robot.model.leaders_by_name[f"j{k}"].places[1].indices(robot.nv))
                assert (robot.limits.lower[v], robot.limits.upper[v]) == (-k, k + 0.5)


def test_flexible_bodies_and_plugins_of_a_compiled_model_are_remarked():
    cloth = """<mujoco><worldbody><flexcomp name="c" type="grid" count="3 3 3" spacing=".1 .1 .1" mass="1" dim="3">
    <elasticity young="1e4" poisson=".1"/></flexcomp></worldbody></mujoco>"""
    robot = quietly(tw.from_mujoco, mujoco.MjModel.from_xml_string(cloth))
    assert any("deformable body, whose elastic forces are left out" in one for one in robot.defects)
    cable = """<mujoco><extension><plugin plugin="mujoco.elasticity.cable"/></extension><worldbody>
    <composite type="cable" curve="s" count="5 1 1" size="1" initial="none"><plugin plugin="mujoco.elasticity.cable">
    <config key="twist" value="1e6"/><config key="bend" value="1e6"/></plugin><joint kind="main" damping=".1"/>
    <geom type="capsule" size=".01"/></composite></worldbody></mujoco>"""
    try:
        model = mujoco.MjModel.from_xml_string(cable)
    except ValueError:
        return  # older and newer versions write cables otherwise
    assert any("plugin, whose forces are left out" in one for one in quietly(tw.from_mujoco, model).defects)


def test_a_height_field_without_its_asset_is_refused():
    with pytest.raises(tw.RobotFileError, match=r"<geom> of body 'b' .* shows the height field 'k', which no <asset>"):
        tw.load(hinge(inside='<geom type="hfield" hfield="k"/>'))


DRIVES = {
    "motor": '<motor joint="j" gear="3" forcerange="-2 2"/>',
    "motor by control": '<motor joint="j" gear="3" ctrlrange="-2 2"/>',
    "orientation elsewhere": '<orientation joint="k" kp="1"/><motor joint="j" ctrlrange="-4 4"/>',
    "dcmotor": '<dcmotor joint="j" gear="50" motorconst="0.05" resistance="0.5" saturation="1.2 0 0"/>',
    "dcmotor by current": '<dcmotor joint="j" gear="-2" nominal="24 1.5 300" saturation="0 10 0"/>',
    "dcmotor by two constants": '<dcmotor joint="j" motorconst="0.05 0.08" resistance="2" saturation="0 10 0"/>',
    "dcmotor by both": '<dcmotor joint="j" nominal="24 1.5 300" motorconst="0.05" saturation="0 10 0"/>',
    "dcmotor by all": '<dcmotor joint="j" nominal="24 1.5 300" motorconst="0.05 .07" saturation="0 10 0"/>',
    "dcmotor without limit": '<dcmotor joint="j" motorconst="0.05" resistance="0.5" saturation="0 0 0"/>',
    "dcmotor with a controller": '<dcmotor joint="j" input="pos vel" controller="10 0 5" motorconst="0.05" resistance="0.5" '
    'saturation="1 0 0"/><motor joint="j" ctrlrange="-4 4"/>',
    "dcmotor without input": '<dcmotor joint="j" input="none" gear="3" resistance="1" lugre="100 1 .1 .2 .05" '
    'saturation="2 0 0"/>',
    "pid": '<pid joint="j" kp="2" kv="1" gear="2" forcerange="-3 3"/>',
    "pid without limit": '<pid joint="j" kp="2" kv="1"/>',
}  # fmt: skip


@pytest.mark.parametrize("name", DRIVES)
def test_findings_39_and_40_efforts_are_those_of_the_compiled_model(name):
    ball = '<body><joint name="k" type="ball"/><geom size=".1"/></body>'
    text = hinge(inside=ball, rest=f"<actuator>{DRIVES[name]}</actuator>")
    try:
        mujoco.MjModel.from_xml_string(text)
    except ValueError as error:
        pytest.skip(f"this version of MuJoCo does not read it: {error}")
    filed, compiled, model = doors(text)
    total = np.zeros(2)
    for k in range(len(model.actuator_trntype)):
        if model.actuator_trnid[k, 0] == 0:
            c, o = (int(getattr(model, f"actuator_{x}adr", range(99))[k]) for x in ("ctrl", "out"))
            ends = np.array([-np.inf, np.inf])
            if model.actuator_forcelimited[k]:
                ends = model.actuator_forcerange[k]
            elif model.actuator_ctrllimited[c]:
                ends = model.actuator_ctrlrange[c]
            total = total + np.sort(model.actuator_gear[o, 0] * ends)
    for robot in (filed, compiled):
        np.testing.assert_allclose(robot.limits.effort[0], total[1], rtol=1e-12)
        assert any("largest force is not given" in one for one in robot.defects) == np.isinf(total[1])
        assert any("drives no hinge or slide" in one for one in robot.defects) == ("orientation" in name)


MOTORS = {
    "two constants": 'motorconst="0.05 0.08" resistance="2" saturation="0 10 0"',
    "nominal": 'nominal="24 1.5 300" saturation="1.2 10 0"',
    "nominal and resistance": 'nominal="24 1.5 300" resistance="3"',
    "nominal and constant": 'nominal="24 1.5 300" motorconst="0 0.05" saturation="3 0 0"',
    "time constant": 'nominal="24 1.5 300" inductance="0 0.002"',
    "inductance and time constant": 'nominal="24 1.5 300" inductance="0.01 0.002"',
    "controller": 'motorconst="0.05" resistance="2" input="pos" controller="1 0 0 0 0 12"',
    "friction": 'motorconst="0.05" resistance="2" lugre="100 1 0.1 0.2 0.05"',
    "friction without Stribeck": 'motorconst="0.05" resistance="2" lugre="100 1 0.1 0.1 0"',
    "heat and cogging": 'motorconst="0.05" resistance="2" thermal="2 30 0 .0039 25 25" cogging=".01 6 0"',
}


@pytest.mark.parametrize("gear", [1.0, -50.0])
@pytest.mark.parametrize("name", MOTORS)
def test_dc_motors_have_the_data_that_mujoco_compiles(name, gear):
    text = hinge(
        joint='frictionloss="0.3"', rest=f'<actuator><dcmotor joint="j" gear="{gear}" {MOTORS[name]}/></actuator>'
    )
    try:
        mujoco.MjModel.from_xml_string(text)
    except ValueError as error:
        pytest.skip(f"this version of MuJoCo does not read it: {error}")
    filed, compiled, model = doors(text)
    R, K, *_ = gain = model.actuator_gainprm[0]
    coulomb, static, stribeck = model.actuator_biasprm[0][3:6]
    for robot in (filed, compiled):
        (actuator,) = robot.actuators.values()
        motor, law = actuator.motor, robot.model.friction
        assert actuator.ratio == gear
        found = (motor.torque_constant, motor.resistance, motor.inductance)
        np.testing.assert_allclose(found, [K, R, R * model.actuator_dynprm[0][0]], rtol=1e-12)
        np.testing.assert_allclose(motor.current_peak * K * abs(gear), robot.limits.effort[0], rtol=1e-12)
        assert law.coulomb[0] == pytest.approx(0.3 + abs(gear) * coulomb)  # that of the joint, and the motor's
        assert law.static[0] == pytest.approx(0.3 + abs(gear) * static)
        assert law.stribeck[0] == pytest.approx(stribeck / abs(gear) if static > coulomb else 1.0)
        for words, there in (("bristles", coulomb), ("thermal model", "heat" in name), ("cogging", "heat" in name)):
            assert any(words in one for one in robot.defects) == bool(there), robot.defects
    voltage = 24.0 if "nominal" in MOTORS[name] else gain[7] or np.inf
    assert filed.actuators["j"].motor.voltage == voltage


def test_described_motors_give_way_to_an_actuator_file_and_to_identification():
    text = hinge(rest=f'<actuator><dcmotor joint="j" gear="50" {MOTORS["nominal"]}/></actuator>')
    robot = quietly(tw.load, text)
    assert robot.with_actuators({"actuators": {"j": {"ratio": 100}}}).actuators["j"].motor is None
    assert not robot.lock({"j": 0.2}).actuators and not quietly(tw.load, text, lock={"j": 0.2}).actuators
    assert robot.motor_loads([0.3], [2.0], [0.0]).speed == pytest.approx(100.0)
    assert not UnknownParameters(robot).robot.actuators


def test_a_motor_that_cannot_be_is_refused_by_element_and_line():
    for bad, words in (('resistance="-1"', "resistance -1"), ('inductance="-1 0"', "inductance -1")):
        text = hinge(rest=f'<actuator>\n<dcmotor joint="j" motorconst="0.1" {bad}/></actuator>')
        with pytest.raises(tw.RobotFileError, match=rf"<dcmotor> \(line 3\) cannot be a motor: .*{words}"):
            tw.load(text)


def test_an_unknown_actuator_leaves_the_effort_unknown_and_the_file_read():
    robot = quietly(tw.load, hinge(rest='<actuator><motor joint="j" ctrlrange="-1 1"/><engine joint="j"/></actuator>'))
    assert np.isinf(robot.limits.effort[0])
    assert any("<engine>" in one and "is not an actuator known here" in one for one in robot.defects)


def written(text, **options):
    """(the robot of a URDF, its MJCF, MuJoCo's model of that, what writing warned of)."""
    robot = quietly(tw.load, text, inertia="accept", **options)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = robot.to_mjcf()
    return robot, found, [str(one.message) for one in caught]


MASS = """<inertial><origin xyz="0 .1 .4"/><mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial>"""


def links(**inertials):
    return "".join(f'<link name="{name}">{inertial}</link>' for name, inertial in inertials.items())


def joint(name, parent, child, axis, kind="continuous"):
    return f"""<joint name="{name}" type="{kind}"><origin xyz=".1 .2 .3" rpy=".3 .2 .1"/><parent link="{parent}"/>
    <child link="{child}"/><axis xyz="{axis}"/></joint>"""


def test_joints_about_a_massless_link_are_joints_of_one_body():
    chain = joint("i", "a", "b", "0 1 0") + joint("f", "b", "c", "0 0 1", "fixed") + joint("j", "c", "d", "1 0 0")
    end = joint("k", "d", "e", "0 0 1")
    text = f'<robot name="r">{links(a=MASS, b="", c="", d=MASS, e=MASS)}{chain}{end}</robot>'
    robot, file, said = written(text)
    model = mujoco.MjModel.from_xml_string(file)
    assert (model.nv, model.nbody) == (3, 4)
    assert same_numbers(robot, model)
    again = quietly(tw.load, file)
    q = robot.random_configuration(0)
    np.testing.assert_allclose(again.mass_matrix(q), robot.mass_matrix(q), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(
        again.forward_kinematics(q, frame="e"), robot.forward_kinematics(q, frame="e"), atol=1e-12
    )
    assert any("link 'b' has no mass" in one and "frame is lost" in one for one in said)


BASES = {
    "indefinite": MASS.replace('ixx=".1"', 'ixx="-.1"'),
    "no moments": MASS.replace('".1"', '"0"'),
    "no body has": MASS.replace('ixx=".1"', 'ixx=".9"'),
    "right": MASS,
}


@pytest.mark.parametrize("name", BASES)
def test_a_base_that_stands_still_never_stops_mujoco(name):
    text = f'<robot name="r">{links(a=BASES[name], b=MASS)}{joint("j", "a", "b", "0 1 0")}</robot>'
    robot, file, said = written(text)
    assert same_numbers(robot, mujoco.MjModel.from_xml_string(file))
    assert any("link 'a' stands still" in one for one in said) == (name != "right")


REFUSED = {
    "has no mass": links(a="", b=""),
    "has a mass without inertia": links(a="", b=BASES["no moments"]),
    "physically impossible moments of inertia": links(a="", b=BASES["no body has"]),
}


@pytest.mark.parametrize("said", REFUSED)
def test_what_mujoco_does_not_compile_is_warned_of_by_the_links_name(said):
    _, file, warned = written(f'<robot name="r">{REFUSED[said]}{joint("j", "a", "b", "0 1 0")}</robot>')
    assert any("link 'b' moves and" in one and said in one and "MuJoCo does not compile" in one for one in warned)
    with pytest.raises(ValueError, match=r"mjMINVAL|eigenvalues|A \+ B"):
        mujoco.MjModel.from_xml_string(file)


def test_flat_bodies_compile_in_every_orientation():
    """A thin plate: two principal moments add up to the third, up to the last digit."""
    rng = np.random.default_rng(0)
    for _ in range(40):
        R, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        moments = rng.uniform(0.001, 1.0, 3)
        moments[2] = moments[0] + moments[1]
        I = R @ np.diag(moments) @ R.T
        entries = " ".join(f'i{"xyz"[i]}{"xyz"[k]}="{float(I[i, k])!r}"' for i in range(3) for k in range(i, 3))
        body = f'<inertial><origin xyz="0 .1 .2"/><mass value="1"/><inertia {entries}/></inertial>'
        _, file, _ = written(f'<robot name="r">{links(a="", b=body)}{joint("j", "a", "b", "0 1 0")}</robot>')
        model = mujoco.MjModel.from_xml_string(file)
        np.testing.assert_allclose(np.sort(model.body_inertia[-1]), np.sort(moments), rtol=1e-12)


def test_events_that_may_pass_zero_more_than_once_in_a_step_are_remarked():
    pendulum = tw.robots.pendulum()
    seen = [Event(lambda t, q, dq: np.sin(200 * t), "fast")]
    for options in ({"method": "rk4"}, {}):
        found = pendulum.simulate([1.0], [0.0], duration=1.0, dt=0.1, events=seen, **options)
        assert len(found.events) < 63
        assert any("event 'fast' may pass zero more often than was seen" in one for one in found.remarks)


QUIET = {
    "angle": lambda t, q, dq: q[0] - 0.5,
    "rate": lambda t, q, dq: dq[0],
    "time": lambda t, q, dq: t - 2.345,
    "jump at a step": lambda t, q, dq: 1.0 if t < 2 else -1.0,
    "jump": lambda t, q, dq: 1.0 if t < 2.001 else -1.0,
    "slow enough": lambda t, q, dq: np.sin(20 * t),
    "never": lambda t, q, dq: 2.0 + np.sin(20 * t),
}  # fmt: skip


@pytest.mark.parametrize("name", QUIET)
def test_events_that_are_seen_have_no_remark(name):
    event = Event(QUIET[name], "event")
    for method in ("rk4", "midpoint"):
        found = tw.robots.pendulum().simulate([1.0], [0.0], duration=3.0, dt=0.02, method=method, events=[event])
        assert not any("more often" in one for one in found.remarks)


@pytest.mark.parametrize("rows", [None, "vx vy vz", "wx wy wz vx vy vz"])
def test_the_distance_left_is_that_between_the_origins(rows):
    panda = tw.robots.panda()
    rng = np.random.default_rng(0)
    for _ in range(4):
        T = tw.se3.exp(rng.uniform(-3, 3, 6))
        found = panda.inverse_kinematics(T, rows=rows, restarts=1)
        apart = np.linalg.norm(panda.forward_kinematics(found.q)[:3, 3] - T[:3, 3])
        np.testing.assert_allclose(found.distance, apart, rtol=1e-9, atol=1e-12)
    near = panda.forward_kinematics(panda.random_configuration(0)) @ tw.se3.exp([0, 0, 0, 0.03, 0, 0])
    turned = near @ tw.se3.exp([0.9, 0.4, 0, 0, 0, 0])
    loose = panda.inverse_kinematics(turned, angle=3.0, distance=0.05, restarts=20)
    assert loose.converged
    assert loose.distance < 0.1  # the tolerance times the arm's size


def test_two_frames_each_have_their_own_distance():
    quadruped = tw.robots.quadruped()
    feet = ("FL_foot", "FR_foot")
    T = quadruped.forward_kinematics(quadruped.neutral, frame=feet[0]), tw.se3.exp([0.3, 1.2, 0.1, 4.0, 1.0, 2.0])
    found = quadruped.inverse_kinematics(np.array(T), feet, rows={feet[0]: "vx vy vz"}, restarts=0)
    apart = [quadruped.forward_kinematics(found.q, frame=f)[:3, 3] - t[:3, 3] for f, t in zip(feet, T, strict=True)]
    np.testing.assert_allclose(found.distance, np.linalg.norm(apart), rtol=1e-9, atol=1e-12)


def test_between_samples_a_motion_keeps_to_its_rates():
    """sin 4t at 50 Hz: the linear rates were 3.2e-3 rad/s off, and the slope of q up to 0.158 rad/s off dq."""
    t, robot = np.arange(0, 2, 0.02), tw.robots.pendulum()
    x = 4 * t[:, None]
    motion = tw.Motion(t, np.sin(x), 4 * np.cos(x), -16 * np.sin(x), robot=robot)
    between = np.linspace(0, t[-1], 777)
    for found, true in zip(
        motion.at(between), (np.sin, lambda y: 4 * np.cos(y), lambda y: -16 * np.sin(y)), strict=True
    ):
        assert np.abs(found[:, 0] - true(4 * between)).max() < 2e-5
    assert np.abs(motion.at(between)[0][:, 0] - np.sin(4 * between)).max() < 1e-10
    for found, given in zip(motion.at(t), (motion.q, motion.dq, motion.ddq), strict=True):
        np.testing.assert_allclose(found, given, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("kind", ["ball", "floating", "planar"])
def test_joints_of_several_degrees_too(kind):
    """A curve whose rates are known: q0 exp(c1 t + c2 t^2), sampled, with rates by central differences of fourth order."""
    from twistwrench.testing import random_robot

    robot = random_robot(3, 2, (kind,))
    rng = np.random.default_rng(1)
    q0, (c1, c2) = robot.random_configuration(0), rng.normal(size=(2, robot.nv))

    def q(t):
        t = np.asarray(t, float)[..., None]
        return robot.add(q0, c1 * t + c2 * t**2)

    def rates(t, h=1e-3):
        steps = [robot.subtract(q(t + k * h), q(t)) for k in (-2, -1, 1, 2)]
        first = (steps[0] - 8 * steps[1] + 8 * steps[2] - steps[3]) / (12 * h)
        return first, (-steps[0] + 16 * steps[1] + 16 * steps[2] - steps[3]) / (12 * h * h)

    t = np.linspace(0, 1, 21)
    motion = tw.Motion(t, q(t), *rates(t), robot=robot)
    between = np.linspace(0.01, 0.99, 57)
    found = motion.at(between)
    dq, ddq = rates(between)
    assert np.abs(robot.subtract(found[0], q(between))).max() < 1e-8
    assert np.abs(found[1] - dq).max() < 1e-6
    assert np.abs(found[2] - ddq).max() < 1e-3


def _model_files():
    """MJCF files of MuJoCo's wheel, of gymnasium and beside the checkout."""
    folders = [SHARED / "robots" / "mjcf", Path(mujoco.__file__).parent]
    found = importlib.util.find_spec("gymnasium")
    folders += (
        [Path(p) / "envs" / "mujoco" / "assets" for p in (found.submodule_search_locations or ())] if found else []
    )
    return sorted(path for folder in folders if folder.is_dir() for path in folder.rglob("*.xml"))


@pytest.mark.slow
@pytest.mark.parametrize("path", _model_files(), ids=lambda path: path.name)
def test_every_model_of_mujoco_has_its_numbers_or_a_remark(path):
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError:
        pytest.skip("MuJoCo does not compile it alone")
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)  # constraints are the robot's closures
    robot = quietly(tw.from_mujoco, model, snap=0, inertia="accept", mimic="independent")
    if robot.nv == 0:
        pytest.skip("nothing of it moves")
    acting = ("left out", "alone is kept", "read as elastic", "is not kept")
    said = [one for one in robot.defects if any(word in one for word in acting)]
    assert said or same_numbers(robot, model)
