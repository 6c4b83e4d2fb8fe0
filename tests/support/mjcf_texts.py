"""Small MJCF models, one for each thing that the format can say, for comparison with MuJoCo."""

from __future__ import annotations

ARM = """
<mujoco model="two links">
  {head}
  <worldbody>
    {world}
    <body name="upper" pos="0.1 0.2 0.3" {upper}>
      {joint1}
      {inertial1}
      <body name="lower" pos="0 0.1 0.4" {lower}>
        {joint2}
        {inertial2}
      </body>
    </body>
  </worldbody>
  {tail}
</mujoco>
"""
_MASS1 = '<inertial mass="2" pos="0.01 0.02 0.2" diaginertia="0.03 0.02 0.01"/>'
_MASS2 = '<inertial mass="1" pos="0.03 -0.01 0.1" quat="0.9 0.1 -0.2 0.3" diaginertia="0.02 0.015 0.01"/>'


def arm(head="", world="", upper="", lower="", tail="", **more):
    """The two links with some parts as given."""
    parts = {
        "joint1": '<joint name="a" axis="0 1 0"/>',
        "joint2": '<joint name="b" axis="1 0.2 0"/>',
        "inertial1": _MASS1,
        "inertial2": _MASS2,
    } | more
    return ARM.format(head=head, world=world, upper=upper, lower=lower, tail=tail, **parts)


def geoms(*lines, head=""):
    """The two links, the second of which weighs what its geoms weigh."""
    return arm(head=head, inertial2="\n".join(lines))


_DEFAULTS = """
<default>
  <joint damping="0.1" armature="0.01"/>
  <geom density="500"/>
  <default class="outer">
    <joint axis="0 0 1" damping="0.2"/>
    <geom type="box" size="0.1 0.05 0.02"/>
    <default class="inner"><joint armature="0.3" pos="0 0.1 0"/></default>
  </default>
  <default class="other"><joint axis="1 0 0" frictionloss="0.4"/><geom type="sphere" size="0.07"/></default>
</default>
"""

TEXTS = {
    "inertial and hinge": arm(),
    "fullinertia": arm(inertial2='<inertial mass="1" pos="0 0 0.1" fullinertia="0.03 0.025 0.02 0.001 -0.002 0.003"/>'),
    "mass without moments": arm(tail="", inertial2='<inertial mass="1" pos="0 0 0.1" diaginertia="1e-4 1e-4 1e-4"/>'),
    "joint beside the origin": arm(joint2='<joint name="b" pos="0.1 0.05 -0.2" axis="1 2 3"/>'),
    "slide": arm(joint2='<joint name="b" type="slide" axis="1 2 3" range="-1 2"/>'),
    "ref of a hinge": arm(joint2='<joint name="b" pos="0.1 0 0.2" ref="40"/>'),
    "ref of a slide": arm(joint2='<joint name="b" type="slide" axis="0 1 1" ref="0.3"/>'),
    "radians": arm(head='<compiler angle="radian"/>', joint2='<joint name="b" ref="0.5" range="-1 2"/>'),
    "several joints in a body": arm(
        joint2='<joint name="b" type="slide" axis="1 0 0"/><joint name="c" axis="0 1 0" pos="0 0 0.3" ref="20"/>'
        '<joint name="d" axis="0 0 1" pos="0.1 0 0"/>'
    ),
    "ball between joints": arm(joint2='<joint name="b" axis="0 0 1"/><joint name="c" type="ball" pos="0.1 0.2 0"/>'),
    "ball": arm(joint2='<joint name="b" type="ball"/>'),
    "ball beside the origin, then a slide": arm(
        joint2='<joint name="b" type="ball" pos="0 0.2 0.1"/><joint name="c" type="slide" axis="1 0 0"/>'
    ),
    "free body": arm(joint1='<freejoint name="a"/>', upper='euler="10 20 30"'),
    "free joint by its long name": arm(joint1='<joint name="a" type="free" damping="0.2"/>', upper='quat="1 2 3 4"'),
    "defaults of joints do not reach a freejoint": arm(
        head='<default><joint armature="0.2" damping="1"/></default>', joint1='<freejoint name="a"/>'
    ),
    "static body": arm(world='<body pos="1 2 3"><geom size="0.1"/></body>', joint1="", upper='zaxis="1 1 0"'),
    "orientations": arm(upper='axisangle="1 2 3 40"', lower='xyaxes="1 0.2 0 0.3 1 0.1"'),
    "zaxis": arm(upper='zaxis="0.1 -1 0.3"', lower='zaxis="0 0 -1"'),
    "euler": arm(upper='euler="10 20 30"', lower='euler="-40 50 -60"'),
    "eulerseq": arm(head='<compiler eulerseq="ZYx"/>', upper='euler="10 20 30"'),
    "eulerseq, axes at rest": arm(head='<compiler eulerseq="XZY" angle="radian"/>', upper='euler="0.1 0.2 0.3"'),
    "frames": arm(
        world='<frame pos="0 1 0" euler="0 90 0"><body name="more" pos="1 0 0"><joint name="m"/><geom size="0.1"/></body></frame>',
        joint2='<frame pos="0.1 0.2 0.3" quat="1 1 0 0"><joint name="b" axis="0 1 0" pos="0 0 0.1"/>'
        '<geom type="box" size="0.1 0.2 0.3"/><site name="s" pos="1 0 0"/></frame>',
        inertial2="",
    ),
    "sphere": geoms('<geom size="0.1" pos="0.1 0.2 0.3"/>'),
    "capsule": geoms('<geom type="capsule" size="0.05 0.2" pos="0.1 0 0" euler="30 40 50"/>'),
    "cylinder, ellipsoid, box": geoms(
        '<geom type="cylinder" size="0.05 0.2"/>',
        '<geom type="ellipsoid" size="0.1 0.2 0.3" pos="0 0 0.4"/>',
        '<geom type="box" size="0.1 0.2 0.3" pos="0 0.4 0" quat="1 2 3 4"/>',
    ),
    "fromto": geoms(
        *(
            f'<geom type="{kind}" size="0.05" fromto="0.1 0 {k} 0.3 0.2 {k + 1}"/>'
            for k, kind in enumerate(("capsule", "cylinder", "ellipsoid", "box"))
        )
    ),
    "mass before density": geoms(
        '<geom type="box" size="0.1 0.2 0.3" mass="2" density="7"/>', '<geom size="0.1" density="300"/>'
    ),
    "geoms without mass": geoms('<geom size="0.1"/>', '<geom size="0.4" mass="0"/>', '<geom size="0.3" density="0"/>'),
    "groups": geoms('<geom size="0.1"/>', '<geom size="0.3" group="4"/>', head='<compiler inertiagrouprange="0 3"/>'),
    "last group": geoms(
        '<geom size="0.1"/>', '<geom size="0.3" group="3"/>', head='<compiler inertiagrouprange="0 3"/>'
    ),
    "inertial before geoms": arm(inertial2=_MASS2 + '<geom size="0.3"/>'),
    "geoms before inertial": arm(head='<compiler inertiafromgeom="true"/>', inertial2=_MASS2 + '<geom size="0.3"/>'),
    "geoms before inertial, where there are any": arm(head='<compiler inertiafromgeom="true"/>', inertial2=_MASS2),
    "settotalmass": arm(head='<compiler settotalmass="9"/>'),
    "boundmass, boundinertia": arm(head='<compiler boundmass="1.5" boundinertia="0.018"/>'),
    "balanceinertia": arm(
        head='<compiler balanceinertia="true"/>',
        inertial2='<inertial mass="1" pos="0 0 0" diaginertia="0.05 0.01 0.01"/>',
    ),
    "defaults": arm(
        head=_DEFAULTS,
        upper='childclass="outer"',
        joint1='<joint name="a"/>',
        joint2='<joint name="b" class="inner"/><joint name="c" class="other"/>',
        inertial2='<geom/><geom class="other" pos="0 0 0.2"/>',
    ),
    "defaults of the class around": arm(
        head=_DEFAULTS,
        upper='childclass="other"',
        lower='childclass="inner"',
        joint1='<joint name="a"/>',
        joint2='<joint name="b"/>',
        inertial2="<geom/>",
    ),
    "an orientation over another": geoms(
        '<geom class="turned" type="box" size="0.1 0.2 0.3" zaxis="0 1 0"/>',
        '<geom class="tilted" type="box" size="0.1 0.2 0.3" quat="1 2 3 4"/>',
        head='<default><default class="turned"><geom quat="1 2 3 4"/></default>'
        '<default class="tilted"><geom zaxis="1 1 0"/></default></default>',
    ),
    "limits by themselves": arm(
        joint1='<joint name="a" range="-10 20"/>', joint2='<joint name="b" limited="false" range="-1 2"/>'
    ),
    "no autolimits": arm(
        head='<compiler autolimits="false"/>',
        joint1='<joint name="a"/>',
        joint2='<joint name="b" limited="true" range="-50 60"/>',
    ),
    "spring, damper, drive": arm(
        joint1='<joint name="a" stiffness="3" springref="30" damping="0.4" armature="0.2" frictionloss="0.5"/>',
        joint2='<joint name="b" type="slide" stiffness="5" springref="0.2" ref="0.1"/>',
    ),
    "springs behind a free body": """<mujoco><worldbody><body><freejoint/><geom size="0.1"/><body pos="0 0 0.3">
    <joint name="a" axis="0 1 0" stiffness="3" springref="30"/><geom size="0.1" pos="0.1 0 0"/><body pos="0 0 0.3">
    <joint name="b" axis="1 0 0" stiffness="5" springref="-20"/><geom size="0.1" pos="0 0.1 0"/></body></body></body></worldbody></mujoco>""",
    "tendon as a spring": arm(
        tail='<tendon><fixed stiffness="7" springlength="0.2"><joint joint="a" coef="2"/><joint joint="b" coef="-1"/></fixed>'
        '<fixed stiffness="4"><joint joint="b" coef="3"/></fixed></tendon>',
        joint2='<joint name="b" springref="25"/>',
    ),
    "tendon's default": arm(
        head='<default><tendon stiffness="6"/></default>',
        tail='<tendon><fixed><joint joint="a" coef="2"/></fixed></tendon>',
    ),
    "actuators with inertia and damping": arm(
        joint2='<joint name="b" damping="0.2"/>',
        tail='<actuator><motor joint="b" gear="3" armature="0.1" damping="0.4"/><general joint="b" gear="-2" armature="0.2"/>'
        "</actuator>",
    ),
    "springs and dampers off": arm(
        head='<option><flag spring="disable"/></option>', joint2='<joint name="b" stiffness="3" springref="20"/>'
    ),
    "inertial in a frame": arm(
        inertial2='<frame pos="0.1 0.2 0.3" euler="10 20 30">' + _MASS2 + "</frame>",
    ),
    "gravity": arm(head='<option gravity="1 2 3"/>'),
    "gravity off": arm(head='<option gravity="1 2 3"><flag gravity="disable"/></option>'),
    "keyframes": arm(
        joint2='<joint name="b" type="ball"/>',
        joint1='<freejoint name="a"/>',
        tail='<keyframe><key name="home" qpos="1 2 3 0.5 0.5 0.5 0.5 1 0 0 0"/></keyframe>',
    ),
    "sites": arm(
        world='<site name="here" pos="1 2 3"/>',
        joint2='<joint name="b"/><site name="lower" pos="0.1 0 0" euler="10 20 30"/>'
        '<site name="rod" type="capsule" size="0.01" fromto="0 0 0 0.1 0.2 0.3"/>',
    ),
    "nameless": """<mujoco><worldbody><body><joint/><geom size="0.1"/><body pos="0 0 1"><joint type="slide"/><joint/>
        <geom size="0.2"/></body></body><body name="body1_"><freejoint/><geom size="0.1"/></body></worldbody></mujoco>""",
    "several sections": """<mujoco><compiler angle="radian"/><compiler eulerseq="zyx"/><default><geom density="100"/></default>
        <default><joint damping="2"/></default><worldbody><body euler="0.1 0.2 0.3"><joint ref="0.2"/><geom size="0.1"/></body>
        </worldbody><worldbody><body><joint/><geom size="0.2"/></body></worldbody></mujoco>""",
    "mirrored mesh": """<mujoco><asset><mesh name="m" inertia="exact" scale="-1 2 3" vertex="0 0 0 1 0 0 0 1 0 0 0 1"
        face="0 2 1 0 1 3 0 3 2 1 2 3"/></asset><worldbody><body><joint/><geom type="mesh" mesh="m"/></body></worldbody>
        </mujoco>""",
    "hull of a mesh's corners": """<mujoco><asset><mesh name="wedge" scale="0.1 0.2 0.3"
        vertex="0 0 0 1 0 0 0 1 0 0 0 1 1 1 0" inertia="convex"/></asset><worldbody><body><joint/>
        <geom type="mesh" mesh="wedge" pos="0.5 0 0" euler="90 0 0"/></body></worldbody></mujoco>""",
    "mesh with hollows, as it was weighed": """<mujoco><asset><mesh name="bracket" vertex="{v}" face="{f}"/></asset>
        <worldbody><body><joint pos="0.1 0 0"/><geom type="mesh" mesh="bracket"/></body></worldbody></mujoco>""",
    "mesh with hollows, weighed exactly": """<mujoco><asset><mesh name="bracket" inertia="exact" vertex="{v}" face="{f}"
        refpos="0.1 0.2 0.3" refquat="1 2 3 4"/></asset>
        <worldbody><body><joint pos="0.1 0 0"/><geom type="mesh" mesh="bracket" mass="3"/></body></worldbody></mujoco>""",
}
"""By what they are about; the angles are in degrees unless they say otherwise."""


def _bracket():
    """An L with arms three units long and one thick: what its surface goes round is not where its centre is."""
    outline = [(0, 0), (3, 0), (3, 1), (1, 1), (1, 3), (0, 3)]
    vertices = [(x, y, z) for z in (0, 1) for x, y in outline]
    top = [(6, 7, 8), (6, 8, 9), (6, 9, 11), (9, 10, 11)]
    bottom = [(c - 6, b - 6, a - 6) for a, b, c in top]
    walls = [f for i in range(6) for j in [(i + 1) % 6] for f in ((i, j, j + 6), (i, j + 6, i + 6))]
    flat = [" ".join(str(x) for row in rows for x in row) for rows in (vertices, top + bottom + walls)]
    return flat[0], flat[1]


_V, _F = _bracket()
TEXTS = {name: text.replace("{v}", _V).replace("{f}", _F) for name, text in TEXTS.items()}

MESHES = {name for name in TEXTS if "mesh" in name}
"""Those with meshes, whose principal moments MuJoCo keeps to fewer digits."""
