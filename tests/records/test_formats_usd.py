"""USD: complete answers on record."""

from __future__ import annotations

import pytest
from recorded_models import ShortRecords, described, pose

from twistwrench.core.errors import TwistWrenchError
from twistwrench.formats import load_model

pytest.importorskip("pxr", reason="usd-core is not installed")
records = ShortRecords(__file__)


def prim(kind, name, inside="", apis=()):
    schemas = f" (prepend apiSchemas = [{', '.join(f'{chr(34)}{api}{chr(34)}' for api in apis)}])" if apis else ""
    return f'def {kind} "{name}"{schemas}\n{{\n{inside}\n}}\n'


def placed(position="(0.3, -0.2, 0.5)", turn="(0.8, 0.2, -0.4, 0.4)", scale=""):
    order = ["xformOp:translate", "xformOp:orient", *(["xformOp:scale"] if scale else [])]
    text = f"double3 xformOp:translate = {position}\nquatd xformOp:orient = {turn}\n"
    if scale:
        text += f"double3 xformOp:scale = {scale}\n"
    return text + f"uniform token[] xformOpOrder = [{', '.join(chr(34) + op + chr(34) for op in order)}]\n"


BODY = ("PhysicsRigidBodyAPI", "PhysicsMassAPI")
MASS = """float physics:mass = {}
point3f physics:centerOfMass = (0.1, -0.2, 0.3)
float3 physics:diagonalInertia = (0.5, 0.4, 0.3)
quatf physics:principalAxes = (0.9, 0.1, -0.3, 0.3)
"""


def body(name, mass=2.5, place=None, more="", apis=BODY):
    return prim("Xform", name, (placed() if place is None else place) + MASS.format(mass) + more, apis)


def joint(kind, name, near, far, more="", apis=()):
    ends = ""
    for k, end in enumerate((near, far)):
        if end:
            ends += f"rel physics:body{k} = <{end}>\n"
        ends += f"point3f physics:localPos{k} = ({0.1 + k}, {0.2 - k}, 0.25)\nquatf physics:localRot{k} = (0.6, {0.2 * k}, 0.8, {-0.4 * k})\n"
    return prim(f"Physics{kind}Joint", name, ends + more, apis)


HEAD = """#usda 1.0
(
 defaultPrim = "rover"
 metersPerUnit = {metre}
 kilogramsPerUnit = {kilogram}
 upAxis = "{up}"
)
"""
REVOLUTE = """uniform token physics:axis = "Z"
float physics:lowerLimit = -40
float physics:upperLimit = 75
float drive:angular:physics:maxForce = 300
float physxJoint:maxJointVelocity = 90
float physxJoint:armature = 7
float newton:damping = 3
float newton:friction = 20
"""
PRISMATIC = """uniform token physics:axis = "Y"
float physics:lowerLimit = -2
float physics:upperLimit = 5
float drive:linear:physics:maxForce = 60
float physxJoint:maxJointVelocity = 11
float newton:armature = 2
float physxJoint:armature = 7
float newton:damping = 4
float newton:friction = 0.5
float physxJoint:jointFriction = 0.3
float mjc:frictionloss = 3
float mjc:armature = 0
"""
ROVER = prim(
    "Xform",
    "rover",
    placed("(1, 2, 3)", "(1, 0, 0, 0)", "(2, 2, 2)")
    + body("hull", 30, more=prim("Cube", "panel") + prim("Xform", "bolt", placed("(0.5, 0, 0)", "(0.6, 0, 0, 0.8)")))
    + body("arm", 4, placed("(1, 1, 1)", "(0.6, 0, 0.8, 0)"))
    + body("slider", 2, placed("(2, 1, 1)"), "float physxRigidBody:linearDamping = 0.5\nbool physxRigidBody:disableGravity = 1\nint author = 3\nfloat physics:mess = 1\n")
    + body("probe", 1, placed("(2, 2, 1)"))
    + body("tip", 0.5, placed("(2, 2, 2)"))
    + body("wheel", 3, placed("(0, 1, 0)", scale="(0.5, 0.5, 0.5)"))
    + body("stone", 3, more="bool physics:rigidBodyEnabled = 0\n")
    + body("puppet", 3, more="bool physics:kinematicEnabled = 1\n")
    + body("moon", 7)
    + body("sun", 8)
    + joint("Revolute", "elbow", "/rover/hull", "/rover/arm", REVOLUTE, ("PhysicsDriveAPI:angular", "NewtonMimicAPI:rotX"))
    + joint("Prismatic", "slide", "/rover/slider", "/rover/arm", PRISMATIC)
    + joint("Spherical", "ball", "/rover/slider", "/rover/probe", "float physics:coneAngle0Limit = 30\n")
    + joint("Fixed", "weld", "/rover/probe", "/rover/tip")
    + joint("Revolute", "axle", "/rover/hull/bolt", "/rover/wheel", 'uniform token physics:axis = "Y"\nfloat physics:upperLimit = 3.4e38\nfloat drive:angular:physics:maxForce = 1e30\n')
    + joint("Revolute", "off", "/rover/moon", "/rover/tip", "bool physics:jointEnabled = 0\n")
    + joint("Revolute", "loop", "/rover/tip", "/rover/hull", 'uniform token physics:axis = "Y"\nbool physics:excludeFromArticulation = 1\n')
    + joint("Prismatic", "rail", "/rover/tip", "", "bool physics:excludeFromArticulation = 1\n")
    + joint("Spherical", "pin", "/rover/wheel", "/rover/tip", "bool physics:excludeFromArticulation = 1\n")
    + joint("Fixed", "clamp", "/rover/wheel", "/rover/arm", "bool physics:excludeFromArticulation = 1\n")
    + joint("", "six", "/rover/wheel", "/rover/arm", "bool physics:excludeFromArticulation = 1\n")
    + joint("Fixed", "far", "/rover/moon", "/rover/arm", "bool physics:excludeFromArticulation = 1\n"),
    ("PhysicsArticulationRootAPI",),
)  # fmt: skip
SCENE = prim(
    "PhysicsScene", "scene", "vector3f physics:gravityDirection = (1, 2, -2)\nfloat physics:gravityMagnitude = 500\n"
)


class Stages:
    """Loads texts of stages from a folder, in this process."""

    def __init__(self, folder):
        self.folder = folder
        self.count = 0

    def __call__(self, text, shown=described, metre=0.01, kilogram=0.5, up="Z", **options):
        self.count += 1
        path = self.folder / f"stage{self.count}.usda"
        path.write_text(HEAD.format(metre=metre, kilogram=kilogram, up=up) + text)
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("TWISTWRENCH_SANDBOX", "0")
            try:
                return shown(load_model(path, quiet=True, **{"inertia": "accept", **options}))
            except TwistWrenchError as error:
                return f"{type(error).__name__}: {error}".replace(path.name, "STAGE")


@records.of
def a_rover_of_all_joints(folder):
    return Stages(folder)(ROVER + SCENE)


def short(model):
    answer = described(model)
    keys = ("name", "joints", "mounted", "mounts", "gravity", "base", "notes")
    return {key: answer.get(key) for key in keys} | {"placements": [pose(b.placement) for b in model.bodies]}


@records.of
def the_rover_by_option(folder):
    load = Stages(folder)
    return {
        "held": load(ROVER + SCENE, short, floating_base=False),
        "floating": load(ROVER, short, floating_base=True, up="Y", metre=1, kilogram=1),
        "few bodies": load(ROVER, short, max_bodies=7),
        "enough bodies": load(ROVER, lambda model: len(model.frames), max_bodies=8),
        "model": load(ROVER, short, model="crawler"),
        "format": load(ROVER, short, format="urdf"),
        "keep": load(ROVER, short, keep="arm"),
    }


def pair(
    more="",
    kind="Revolute",
    inside='uniform token physics:axis = "Z"\n',
    near="/rover/a",
    far="/rover/b",
    apis=(),
    root=True,
):
    own = body("a", 4) + body("b", 3, placed("(1, 2, 0.5)"))
    return prim(
        "Xform",
        "rover",
        own + joint(kind, "j", near, far, inside, apis) + more,
        ("PhysicsArticulationRootAPI",) if root else (),
    )


@records.of
def gravity_of_scenes(folder):
    load = Stages(folder)

    def gravity(model):
        return model.gravity

    scene = 'def PhysicsScene "{}" {{\n{}\n}}\n'
    cases = {
        "none": "", "empty": scene.format("s", ""), "direction": scene.format("s", "vector3f physics:gravityDirection = (0, 3, 4)"), "magnitude": scene.format("s", "float physics:gravityMagnitude = 200"),
        "zero": scene.format("s", "float physics:gravityMagnitude = 0"), "negative": scene.format("s", "float physics:gravityMagnitude = -1"), "two": scene.format("s", "float physics:gravityMagnitude = 3") + scene.format("t", "float physics:gravityMagnitude = 7"),
    }  # fmt: skip
    return {f"{name} {up}": load(pair() + text, gravity, up=up) for name, text in cases.items() for up in ("Y", "Z")}


@records.of
def roots_of_articulations(folder):
    load = Stages(folder)
    other = prim(
        "Xform",
        "crane",
        body("a", 9) + body("c", 2) + joint("Revolute", "k", "/crane/a", "/crane/c"),
        ("PhysicsArticulationRootAPI",),
    )
    base = joint("Fixed", "base", "", "/rover/a")
    back = joint("Revolute", "base", "/rover/a", "")
    cases = {
        "joined": (pair(base), {}), "joined backward": (pair(back), {}), "free": (pair(), {}), "no root": (pair(root=False), {}), "two": (pair() + other, {}), "first": (pair() + other, {"model": "rover"}), "second": (pair() + other, {"model": "/crane"}),
        "swapped": (pair(near="/rover/b", far="/rover/a"), {}), "root body": (prim("Xform", "rover", body("a", 4) + body("b", 3, apis=(*BODY, "PhysicsArticulationRootAPI")) + joint("Revolute", "j", "/rover/a", "/rover/b")), {}),
        "joint outside": (pair() + joint("Revolute", "k", "/rover/b", "/crane/a") + prim("Xform", "crane", body("a", 9)), {}), "single": (prim("Xform", "rover", body("a", 4)), {}), "held": (pair(base), {"floating_base": True}), "held false": (pair(base), {"floating_base": False}),
        "root without body": (prim("Xform", "rover", "", ("PhysicsArticulationRootAPI",)) + prim("Xform", "x", body("a")), {}), "unjoined": (prim("Xform", "rover", body("a", 4) + body("b", 3) + body("c", 5) + joint("Revolute", "j", "/rover/b", "/rover/c")), {}),
        "backward without root": (pair(near="/rover/b", far="/rover/a", root=False), {}), "names": (pair(prim("Xform", "sub", body("b", 2)) + joint("Fixed", "k", "/rover/sub/b", "/rover/b") + prim("Xform", "more", joint("Fixed", "j", "/rover/sub/b", "/rover/world")) + body("world")), {}),
    }  # fmt: skip
    return {name: load(text, short, **options) for name, (text, options) in cases.items()}


@records.of
def ends_axes_and_units(folder):
    load = Stages(folder)

    def joints(model):
        return [[b.joint.kind, b.joint.axes, pose(b.placement)] for b in model.bodies] + [
            described(model).get("limits"),
            described(model).get("friction"),
            model.armature[-1:],
        ]

    answers = {}
    for metre, kilogram in ((0.01, 0.5), (1.0, 1.0)):
        for near, far in (("/rover/a", "/rover/b"), ("/rover/b", "/rover/a")):
            for kind, inside in (("Revolute", REVOLUTE), ("Prismatic", PRISMATIC)):
                answers[f"{metre} {near} {kind}"] = load(
                    pair(kind=kind, inside=inside, near=near, far=far, apis=("PhysicsDriveAPI:angular",)),
                    joints,
                    metre=metre,
                    kilogram=kilogram,
                )
    numbers = ["3.4028235e38", "-3.4028235e38", "1e30", "9e29", "inf", "0.1", "123456.789"]
    limits = (
        'uniform token physics:axis = "{}"\nfloat physics:upperLimit = {}\nfloat physxJoint:maxJointVelocity = {}\n'
    )
    for number in numbers:
        answers[number] = load(
            pair(kind="Prismatic", inside=limits.format("X", number, number)),
            lambda model: described(model).get("limits"),
            metre=1,
        )
    for axis in "XYZ":
        answers[axis] = load(
            pair(kind="Prismatic", inside=limits.format(axis, 1, 1)), lambda model: model.bodies[-1].joint.axes
        )
    return answers


SHAPES = {
    "none": "", "cube": prim("Cube", "s", placed("(1, 2, 3)", scale="(1, 2, 3)"), ("PhysicsCollisionAPI",)), "cube of size": prim("Cube", "s", "double size = 3\n", ("PhysicsCollisionAPI",)),
    "sphere": prim("Sphere", "s", "double radius = 1.5\n" + placed("(1, 0, 0)"), ("PhysicsCollisionAPI",)), "egg": prim("Sphere", "s", placed(scale="(1, 2, 3)"), ("PhysicsCollisionAPI",)),
    **{f"cylinder {axis}": prim("Cylinder", "s", f'uniform token axis = "{axis}"\ndouble radius = 0.5\ndouble height = 3\n' + placed(scale="(2, 2, 2)"), ("PhysicsCollisionAPI",)) for axis in "XYZ"},
    "default cylinder": prim("Cylinder", "s", "", ("PhysicsCollisionAPI",)), "default capsule": prim("Capsule", "s", "", ("PhysicsCollisionAPI",)), "default sphere": prim("Sphere", "s", "", ("PhysicsCollisionAPI",)), "default cube": prim("Cube", "s", "", ("PhysicsCollisionAPI",)),
    **{f"capsule {axis}": prim("Capsule", "s", f'uniform token axis = "{axis}"\ndouble radius = 0.5\ndouble height = 3\n', ("PhysicsCollisionAPI",)) for axis in "XY"},
    "long cylinder": prim("Cylinder", "s", placed(scale="(2, 2, 3)"), ("PhysicsCollisionAPI",)), "oval cylinder": prim("Cylinder", "s", placed(scale="(2, 3, 2)"), ("PhysicsCollisionAPI",)), "long capsule": prim("Capsule", "s", placed(scale="(2, 2, 3)"), ("PhysicsCollisionAPI",)),
    "cone": prim("Cone", "s", "", ("PhysicsCollisionAPI",)), "mesh": prim("Mesh", "s", "", ("PhysicsCollisionAPI",)), "no collider": prim("Cube", "s"), "mass": prim("Cube", "s", "float physics:mass = 6\nfloat physics:density = 9\n", ("PhysicsCollisionAPI", "PhysicsMassAPI")),
    "density": prim("Cube", "s", "float physics:density = 0.004\n", ("PhysicsCollisionAPI", "PhysicsMassAPI")), "two": prim("Cube", "s", placed(), ("PhysicsCollisionAPI",)) + prim("Sphere", "t", placed("(2, 0, 1)"), ("PhysicsCollisionAPI",)),
    "in a body": body("inner", 4, more=prim("Cube", "s", "", ("PhysicsCollisionAPI",))) + prim("Sphere", "t", "", ("PhysicsCollisionAPI",)),
}  # fmt: skip
GIVEN = {
    "nothing": "", "mass": "float physics:mass = 5\n", "com": "point3f physics:centerOfMass = (1, 2, 3)\n", "moments": "float3 physics:diagonalInertia = (7, 6, 5)\n",
    "mass and com": "float physics:mass = 5\npoint3f physics:centerOfMass = (1, 2, 3)\n", "mass and moments": "float physics:mass = 5\nfloat3 physics:diagonalInertia = (7, 6, 5)\nquatf physics:principalAxes = (0.5, 0.5, 0.5, -0.5)\n",
    "density": "float physics:density = 0.002\n", "all": MASS.format(5), "zero moments": "float physics:mass = 5\npoint3f physics:centerOfMass = (1, 2, 3)\nfloat3 physics:diagonalInertia = (0, 0, 0)\n",
    "scaled": "float physics:mass = 5\npoint3f physics:centerOfMass = (1, 2, 3)\nfloat3 physics:diagonalInertia = (7, 6, 5)\n" + placed(scale="(2, 3, 4)"),
}  # fmt: skip


@records.of
def inertia_of_bodies(folder):
    load = Stages(folder)

    def inertia(model):
        return model.bodies[0].inertia.parameters

    answers = {}
    for shape in SHAPES:
        answers[shape] = load(prim("Xform", "rover", SHAPES[shape], BODY), inertia)
    for given in GIVEN:
        for shape in ("none", "cube", "two"):
            answers[f"{given} {shape}"] = load(prim("Xform", "rover", GIVEN[given] + SHAPES[shape], BODY), inertia)
    material = 'def Material "m" (prepend apiSchemas = ["PhysicsMaterialAPI"])\n{\nfloat physics:density = 0.003\n}\n'
    bound = prim(
        "Cube", "s", "rel material:binding:physics = </rover/m>\n", ("PhysicsCollisionAPI", "MaterialBindingAPI")
    )
    answers["material"] = load(prim("Xform", "rover", material + bound, BODY), inertia)
    answers["units"] = load(prim("Xform", "rover", SHAPES["density"], BODY), inertia, metre=0.1, kilogram=2)
    return answers


@records.of
def refused_stages(folder):
    load = Stages(folder)
    inner = pair()
    cases = {
        "nothing": "", "no bodies": prim("Xform", "rover"), "type": pair(kind=""), "distance": pair(kind="Distance"), "both ends": pair(near="/rover/a", far="/rover/a"), "missing body": pair(far="/rover/z"), "two targets": pair(inside="rel physics:body0 = [</rover/a>, </rover/b>]\n", near=""),
        "axis": pair(inside='uniform token physics:axis = "W"\n'), "loop": pair(joint("Revolute", "k", "/rover/b", "/rover/a")), "long loop": pair(body("c", 2) + joint("Revolute", "k", "/rover/b", "/rover/c") + joint("Revolute", "l", "/rover/c", "/rover/a")), "sheared": pair().replace("double3 xformOp:translate = (1, 2, 0.5)", "matrix4d xformOp:transform = ((1,0.5,0,0),(0,1,0,0),(0,0,1,0),(0,0,0,1))").replace('["xformOp:translate", "xformOp:orient"]', '["xformOp:transform"]'),
        "mirrored": pair().replace("quatd xformOp:orient", "double3 xformOp:scale = (1, 1, -1)\nquatd xformOp:orient").replace('"xformOp:orient"]', '"xformOp:orient", "xformOp:scale"]'), "nothing left": pair().replace("quatd xformOp:orient", "double3 xformOp:scale = (1, 1, 0)\nquatd xformOp:orient").replace('"xformOp:orient"]', '"xformOp:orient", "xformOp:scale"]'),
        "nan": pair().replace("physics:mass = 4", "physics:mass = nan"), "text": pair().replace("float physics:mass = 4", 'string physics:mass = "4"'), "array": pair().replace("float physics:mass = 4", "float[] physics:mass = [4]"), "vector": pair().replace("point3f physics:centerOfMass = (0.1, -0.2, 0.3)", "float2 physics:centerOfMass = (1, 2)"),
        "quaternion": pair().replace("quatf physics:principalAxes = (0.9, 0.1, -0.3, 0.3)", "float physics:principalAxes = 3"), "infinite quaternion": pair().replace("(0.9, 0.1, -0.3, 0.3)", "(inf, 0, 0, 0)"), "zero quaternion": pair().replace("(0.9, 0.1, -0.3, 0.3)", "(0, 0, 0, 0)"), "no mass": prim("Xform", "rover", "", BODY), "broken": inner[:-9],
    }  # fmt: skip
    answers = {name: load(text, lambda model: model.bodies[0].inertia.parameters) for name, text in cases.items()}
    del answers["broken"]  # the library's own words
    answers["metre"] = load(pair(), len, metre=0)
    answers["kilogram"] = load(pair(), len, kilogram=-2)
    return answers


@records.of
def layers_of_a_stage(folder):
    (folder / "home").mkdir()
    (folder / "far").mkdir()
    load = Stages(folder / "home")
    part = HEAD.format(metre=0.01, kilogram=0.5, up="Z") + pair()
    (folder / "far" / "part.usda").write_text(part)
    (folder / "home" / "part.usda").write_text(part)
    outside = 'def "rover" (references = @../far/part.usda@) {}\n'
    inside = 'def "rover" (references = @part.usda@) {}\n'

    def names(model):
        return model.joint_names

    return {
        "outside": load(outside, names),
        "allowed": load(outside, names, include_paths=[folder / "far"]),
        "inside": load(inside, names),
        "folder": load('def "rover" (references = @../home@) {}\n', names),
    }


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
