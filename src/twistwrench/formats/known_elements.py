"""Known elements, attributes and model fields of other programs' formats, read or left out with a note.

``KNOWN[format][tag][name]`` is one of these; ``name`` is an attribute, or ``<child>`` for an element. An element that is READ
is entered, and its row is called ``parent/tag`` where the tag means two things, else by its tag; without a row it holds text
alone. What has NO_MECHANICS (looks, contacts, sensors, controllers) is passed over whole. :class:`LeftOut` is mechanics
that is not read. ``*`` stands for all names that a row does not list. Names with another program's prefix that no row lists are
passed over; every other name is remarked.
"""

from __future__ import annotations

import difflib
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from ..core.text import clipped
from .xml import Element

READ = "read"
NO_MECHANICS = "no mechanics"


@dataclass(frozen=True)
class LeftOut:
    """Mechanics that is not read, and its effect."""

    change: str
    """Sentence: which numbers it would change."""
    unless: tuple[str, ...] = ()
    """Values without an effect; none: zeros and ``false``."""

    def acts(self, texts: Iterable[str]) -> bool:
        """True if one of the words in the texts has an effect, or if there are none."""
        words = [word for text in texts for word in text.lower().split()]
        return not words or any(word not in self.unless if self.unless else not _is_zero(word) for word in words)


Entry = str | LeftOut
Rows = Mapping[str, Mapping[str, Entry]]

OTHERS = "*"
_ACCELERATION = LeftOut("fastest motions do not keep to it")
_WEIGHTLESS = LeftOut("gravity does not act on the link in the file, and does here", ("true", "1"))
_KINEMATIC = LeftOut("forces do not move the link in the file, and do here")
_DRAG = LeftOut("the drag on the velocity of the link is missing")
_WIND = LeftOut("the force of the wind is missing")
_FORCE = LeftOut("its force is missing from the torques")
_SPRING = LeftOut("the torque of the spring is missing")
_ROTOR = LeftOut("the inertia of the rotor is missing from the mass matrix")
_FREE = LeftOut("the joint follows another one in the file, and moves freely here")
_LOOP = LeftOut("a loop stays open")


def _is_zero(word: str) -> bool:
    try:
        return word == "false" or float(word) == 0.0
    except ValueError:
        return False


def _all(kind: Entry, names: str) -> dict[str, Entry]:
    """One entry for many names, separated by blanks."""
    return dict.fromkeys(names.split(), kind)


_DRAKE = {
    **_all(_FORCE, "<drake:linear_spring_damper> <drake:linear_bushing_rpy> <drake:prismatic_spring>"),
    **_all(_LOOP, "<drake:ball_constraint> <drake:distance_constraint>"),
    "<drake:tendon_constraint>": LeftOut("the coupling of joints is missing"),
}
"""Elements of Drake in URDF and in SDF."""

_URDF: Rows = {
    "robot": {
        **_all(READ, "name <link> <joint> <gazebo> <transmission> <mujoco>"),
        **_all(NO_MECHANICS, "version <material> <ros2_control> <sensor> <group> <frame>"),
        # IHMC's, a simulator of drones', Drake's tests
        **_all(NO_MECHANICS, "<schedule_topic_creator_file> <properties> <parameter> <velocity>"),
        **_all(_LOOP, "<loop_joint> <constraint>"),
        **_all(_FORCE, "<force_element> <cable>"),
        "<drake:joint>": LeftOut("the two links are not joined"),
        **_DRAKE,
    },
    "link": {
        **_all(READ, "name <inertial>"),
        **_all(NO_MECHANICS, "type drake_ignore <visual> <collision> <contact> <surface> <self_collide>"),
        **_all(NO_MECHANICS, "<collision_checking> <self_collision_checking> <self_filter> <audio_source> <sensor>"),
        "<gravity>": _WEIGHTLESS,
        "<kinematic>": _KINEMATIC,
    },
    "inertial": _all(READ, "<origin> <mass> <inertia>"),
    "origin": _all(READ, "xyz rpy quat_xyzw"),
    "mass": _all(READ, "value"),
    "inertia": _all(READ, "ixx ixy ixz iyy iyz izz"),
    "joint": {
        **_all(READ, "name type <origin> <parent> <child> <axis> <limit> <dynamics> <mimic>"),
        **_all(
            NO_MECHANICS,
            "dont_collapse <calibration> <safety_controller> <controller_gains> <hardwareInterface> <sensor>",
        ),
        "<joint_properties>": READ,
        "<drake:mimic>": _FREE,
    },
    "parent": _all(READ, "link"),
    "child": _all(READ, "link"),
    "axis": {"xyz": READ, "rpy": LeftOut("URDF gives an axis by xyz alone")},
    "limit": {
        **_all(READ, "lower upper velocity effort"),
        **_all(_ACCELERATION, "acceleration deceleration jerk drake:acceleration"),
        **_all(NO_MECHANICS, "command_effort current gear_velocity twist k_velocity"),  # ANYbotics', misplaced gains
    },
    "dynamics": {
        **_all(READ, "damping friction"),
        **_all(NO_MECHANICS, "D K mu_coulomb mu_viscous"),  # copied from the Panda's; no program is known to read them
        "armature": _ROTOR,
        "spring_stiffness": _SPRING,
        "spring_reference": NO_MECHANICS,
    },
    "joint_properties": _all(LeftOut("the friction of old URDFs, before <dynamics>"), "damping friction"),
    "mimic": _all(READ, "joint multiplier offset"),
    "gazebo": {
        OTHERS: NO_MECHANICS,
        "<gravity>": _WEIGHTLESS,
        "<turnGravityOff>": LeftOut(_WEIGHTLESS.change),
        "<springStiffness>": _SPRING,
        **_all(_DRAG, "<dampingFactor> <velocity_decay>"),
        "<kinematic>": _KINEMATIC,
        "<static>": LeftOut("nothing of it moves in Gazebo"),
        "<enable_wind>": _WIND,
        "<joint>": LeftOut("a joint that only Gazebo has; a loop stays open"),
        "<link>": LeftOut("a link that only Gazebo has"),
    },
    "transmission": {OTHERS: NO_MECHANICS, "<actuator>": READ},
    "actuator": {OTHERS: NO_MECHANICS, "<drake:rotor_inertia>": READ},
    "drake:rotor_inertia": {"value": _ROTOR},
    "mujoco": {OTHERS: NO_MECHANICS, "<compiler>": READ},
    "compiler": {
        OTHERS: NO_MECHANICS,
        **_all(
            LeftOut("MuJoCo changes the inertia of links by it"),
            "inertiafromgeom settotalmass balanceinertia boundmass boundinertia",
        ),
        "settotalmass": LeftOut("MuJoCo scales all masses by it", ("-1", "0")),
        "inertiafromgeom": LeftOut("MuJoCo computes inertia from shapes", ("auto", "false")),
    },
}

_SDF_AXIS: Mapping[str, Entry] = {
    **_all(READ, "<xyz> <dynamics> <limit> <mimic> <use_parent_model_frame>"),
    "<initial_position>": NO_MECHANICS,
}
_SDF: Rows = {
    "world": {
        "<gravity>": READ,
        **_all(NO_MECHANICS, "name"),
        **_all(NO_MECHANICS, "<model> <light> <actor> <plugin> <physics> <scene> <gui> <audio> <atmosphere> <road>"),
        **_all(NO_MECHANICS, "<magnetic_field> <spherical_coordinates> <state> <population> <frame> <include>"),
        "<wind>": _WIND,
        "<joint>": LeftOut("a joint between models; each is read alone"),
    },
    "model": {
        **_all(READ, "name canonical_link <link> <joint> <frame> <model> <pose> <static> <drake:joint>"),
        **_all(NO_MECHANICS, "namespace <self_collide> <allow_auto_disable> <plugin> <gripper>"),
        "placement_frame": LeftOut("the pose is taken as that of the model's own frame"),
        "<enable_wind>": _WIND,
        **_DRAKE,
    },
    "pose": {
        **_all(READ, "relative_to rotation_format degrees"),
        "frame": LeftOut("the pose is taken as relative to the default frame"),  # of versions 1.5 and 1.6
    },
    "frame": _all(READ, "name attached_to <pose>"),
    "link": {
        **_all(READ, "name <pose> <inertial>"),
        **_all(NO_MECHANICS, "<visual> <collision> <sensor> <projector> <audio_sink> <audio_source> <battery> <light>"),
        **_all(NO_MECHANICS, "<particle_emitter> <self_collide> <plugin>"),
        "<gravity>": _WEIGHTLESS,
        "<enable_wind>": _WIND,
        "<kinematic>": _KINEMATIC,
        "<must_be_base_link>": LeftOut("the link floats in the file"),
        **_all(_DRAG, "<velocity_decay> <damping>"),
    },
    "inertial": {
        **_all(READ, "auto <mass> <pose> <inertia>"),
        **_all(NO_MECHANICS, "<density> <auto_inertia_params>"),  # of auto, which is refused
        "<fluid_added_mass>": LeftOut("the inertia of the fluid is missing from the mass matrix"),
    },
    "inertia": _all(READ, "<ixx> <ixy> <ixz> <iyy> <iyz> <izz>"),
    "joint": {
        **_all(READ, "name type <parent> <child> <pose> <axis> <axis2> <thread_pitch> <screw_thread_pitch>"),
        **_all(READ, "<physics> <drake:rotor_inertia> <drake:gear_ratio>"),
        **_all(NO_MECHANICS, "<gearbox_ratio> <gearbox_reference_body> <sensor>"),  # a gearbox is refused
        "<drake:mimic>": _FREE,
    },
    "axis": _SDF_AXIS,
    "axis2": _SDF_AXIS,
    "xyz": _all(READ, "expressed_in"),
    "dynamics": _all(READ, "<damping> <friction> <spring_reference> <spring_stiffness>"),
    "limit": {
        **_all(READ, "<lower> <upper> <effort> <velocity>"),
        **_all(NO_MECHANICS, "<stiffness> <dissipation>"),  # of the stops
        "<drake:acceleration>": _ACCELERATION,
    },
    "mimic": {
        **_all(READ, "joint <multiplier> <offset> <reference>"),
        "axis": LeftOut("the leader is taken to be the other joint's only axis", ("axis",)),
    },
    "physics": {OTHERS: NO_MECHANICS, "<ode>": READ, "<simbody>": READ},
    "ode": {OTHERS: NO_MECHANICS, "<max_force>": LeftOut("the motor that holds a velocity is missing")},
    "simbody": {OTHERS: NO_MECHANICS, "<must_be_loop_joint>": LeftOut("the joint is part of the tree here")},
}

_CONE = LeftOut("the limit of the cone is not kept", ("-1.0", "inf"))
_FRICTION = LeftOut("the friction of the joint is missing")
_USD: Rows = {  # rows of kinds of prims; schemas that are applied to them stand as elements
    "body": {
        **_all(READ, "physics:mass physics:density physics:centerOfMass physics:diagonalInertia physics:principalAxes"),
        **_all(READ, "physics:rigidBodyEnabled physics:kinematicEnabled"),
        **_all(NO_MECHANICS, "physics:velocity physics:angularVelocity physics:startsAsleep physics:collisionEnabled"),
        **_all(NO_MECHANICS, "physics:approximation physics:simulationOwner"),
        "physxRigidBody:disableGravity": LeftOut("gravity does not act on this body in the file, and does here"),
        **_all(_DRAG, "physxRigidBody:linearDamping physxRigidBody:angularDamping"),
        "mjc:gravcomp": LeftOut("the force that holds the body against gravity is missing"),
    },
    "joint": {
        **_all(READ, "physics:axis physics:lowerLimit physics:upperLimit physics:jointEnabled"),
        **_all(
            READ,
            "physics:excludeFromArticulation physics:localPos0 physics:localPos1 physics:localRot0 physics:localRot1",
        ),
        **_all(READ, "drive:angular:physics:maxForce drive:linear:physics:maxForce"),
        **_all(READ, "physxJoint:maxJointVelocity physxJoint:armature newton:armature newton:damping newton:friction"),
        **_all(NO_MECHANICS, "physics:collisionEnabled physics:breakForce physics:breakTorque"),
        **_all(_CONE, "physics:coneAngle0Limit physics:coneAngle1Limit"),
        **_all(_FRICTION, "physxJoint:jointFriction mjc:frictionloss mjc:damping"),
        "mjc:armature": _ROTOR,
        "mjc:stiffness": _SPRING,
        **_all(_FREE, "<NewtonMimicAPI> <PhysxMimicJointAPI> <MjcEqualityJointAPI>"),
        "<PhysxTendonAxisRootAPI>": LeftOut("the coupling of joints is missing"),
    },
    "scene": _all(READ, "physics:gravityDirection physics:gravityMagnitude"),
}

ACTUATORS = (
    "general", "motor", "position", "velocity", "intvelocity", "damper", "cylinder", "muscle", "adhesion", "dcmotor", "pid",
    "orientation", "plugin",
)  # fmt: skip
"""The elements of ``<actuator>`` in MJCF; they share their defaults."""
_TURNS = "quat axisangle xyaxes zaxis euler"
_MJCF_BODY: Mapping[str, Entry] = {
    **_all(READ, f"name pos {_TURNS} childclass gravcomp"),
    **_all(READ, "<body> <frame> <inertial> <joint> <freejoint> <geom> <site>"),
    **_all(NO_MECHANICS, "fuse simple sleep mocap user <camera> <light> <plugin>"),  # the reader remarks plugins
}
_MJCF_TENDON: Mapping[str, Entry] = {
    **_all(READ, "name class stiffness springlength springyield damping frictionloss armature <joint>"),
    **_all(NO_MECHANICS, "limited range margin group material rgba width user actuatorfrclimited actuatorfrcrange"),
    **_all(NO_MECHANICS, "solimpfriction solimplimit solreffriction solreflimit"),
}
_MJCF_ACTUATOR: Mapping[str, Entry] = {
    **_all(READ, "name class joint jointinparent gear armature damping forcelimited forcerange ctrllimited ctrlrange"),
    **_all(READ, "gaintype gainprm biastype dyntype saturation motorconst nominal"),
    **_all(NO_MECHANICS, "biasprm dynprm body site tendon refsite slidersite cranksite cranklength lengthrange"),
    **_all(NO_MECHANICS, "actdim actearly actlimited actrange area bias cogging controller dampratio delay diameter"),
    **_all(NO_MECHANICS, "ffrange force fpmax fvmax gain group imax inductance inheritrange input instance interp"),
    **_all(NO_MECHANICS, "ki kp kv lmax lmin lugre nsample plugin posrange range resistance scale slewmax tausmooth"),
    **_all(NO_MECHANICS, "thermal timeconst user velrange vmax <config>"),
}
_MJCF_EQUALITY: Mapping[str, Entry] = {
    **_all(READ, "name class active anchor relpose body1 body2 site1 site2 joint1 joint2 polycoef"),
    **_all(NO_MECHANICS, "solimp solref torquescale"),
}
_MJCF: Rows = {  # what depends on several attributes is READ here, and remarked by the reader
    "mujoco": {
        **_all(READ, "model <compiler> <option> <default> <asset> <worldbody> <equality> <tendon> <actuator>"),
        **_all(NO_MECHANICS, "<size> <visual> <statistic> <extension> <custom> <contact> <sensor>"),
        **_all(NO_MECHANICS, "<keyframe> <deformable>"),
    },
    "compiler": {
        **_all(READ, "angle eulerseq coordinate autolimits alignfree meshdir assetdir strippath settotalmass"),
        **_all(READ, "inertiafromgeom inertiagrouprange boundmass boundinertia balanceinertia"),
        **_all(NO_MECHANICS, "conflict convexhull discardvisual fitaabb fusestatic passthrough texturedir usethread"),
        **_all(NO_MECHANICS, "savecanonical savecompiled saveinertial <lengthrange>"),
        "exactmeshinertia": LeftOut("meshes are weighed as by the attribute inertia of <mesh>"),
    },
    "option": {
        **_all(READ, "gravity density viscosity wind <flag>"),
        **_all(NO_MECHANICS, "actuatorgroupdisable apirate ccd_iterations ccd_tolerance collision cone impratio"),
        **_all(NO_MECHANICS, "integrator iterations jacobian ls_iterations ls_tolerance magnetic mpr_iterations"),
        **_all(NO_MECHANICS, "mpr_tolerance noslip_iterations noslip_tolerance o_friction o_margin o_solimp o_solref"),
        **_all(NO_MECHANICS, "sdf_initpoints sdf_iterations sleep_tolerance solver timestep tolerance"),
    },
    "flag": {
        **_all(READ, "gravity spring damper passive equality frictionloss constraint"),
        **_all(NO_MECHANICS, "actuation autoreset clampctrl contact diagexact energy eulerdamp filterparent fwdinv"),
        **_all(NO_MECHANICS, "invdiscrete ipc island limit midphase multiccd nativeccd override refsafe sensor"),
        **_all(NO_MECHANICS, "sensornoise sleep speculative warmstart"),
    },
    "default": {
        **_all(READ, "class <default> <joint> <geom> <site> <mesh> <equality> <tendon>"),
        **_all(READ, " ".join(f"<{tag}>" for tag in ACTUATORS)),
        **_all(NO_MECHANICS, "<camera> <light> <pair> <texture> <material> <skin>"),
    },
    "asset": {**_all(READ, "<mesh> <hfield>"), **_all(NO_MECHANICS, "<skin> <texture> <material> <model>")},
    "mesh": {
        **_all(READ, "name class file vertex face inertia refpos refquat scale"),
        **_all(NO_MECHANICS, "builtin params content_type material maxhullvert normal smoothnormal texcoord <plugin>"),
    },
    "hfield": {**_all(READ, "name file size"), **_all(NO_MECHANICS, "content_type elevation ncol nrow")},
    "worldbody": _MJCF_BODY,
    "body": _MJCF_BODY,
    "frame": _MJCF_BODY,
    "inertial": _all(READ, f"pos {_TURNS} mass diaginertia fullinertia"),
    "joint": {
        **_all(READ, "name class type pos axis ref range limited stiffness springref springdamper springyield damping"),
        **_all(READ, "frictionloss armature actuatorfrcrange actuatorfrclimited"),
        **_all(NO_MECHANICS, "group margin user actuatorgravcomp"),
        **_all(NO_MECHANICS, "solimpfriction solimplimit solreffriction solreflimit"),
    },
    "freejoint": {**_all(READ, "name align"), **_all(NO_MECHANICS, "class group user")},
    "geom": {
        **_all(READ, f"name class type pos {_TURNS} size fromto mass density mesh hfield group shellinertia fitscale"),
        **_all(NO_MECHANICS, "adhesion castshadow conaffinity condim contype fluidcoef fluidshape friction gap margin"),
        **_all(NO_MECHANICS, "material priority rgba solimp solmix solref surfacevel user <plugin>"),
    },
    "site": {
        **_all(READ, f"name class type pos {_TURNS} size fromto"),
        **_all(NO_MECHANICS, "group material mesh rgba user"),
    },
    "equality": {  # others than these three are remarked by the reader
        **_all(READ, "<connect> <weld> <joint>"),
        OTHERS: NO_MECHANICS,
    },
    **dict.fromkeys(("default/equality", "connect", "weld", "equality/joint"), _MJCF_EQUALITY),
    "tendon": {"<fixed>": READ, "<spatial>": NO_MECHANICS},  # the reader remarks spatial tendons with forces
    "default/tendon": _MJCF_TENDON,
    "fixed": _MJCF_TENDON,
    "fixed/joint": _all(READ, "joint coef"),
    "actuator": {**_all(READ, " ".join(f"<{tag}>" for tag in ACTUATORS)), OTHERS: NO_MECHANICS},
    **{f"{parent}/{tag}": _MJCF_ACTUATOR for parent in ("actuator", "default") for tag in ACTUATORS},
}

KNOWN: Mapping[str, Rows] = {"URDF": _URDF, "SDF": _SDF, "USD": _USD, "MJCF": _MJCF}

LEFT_OUT: Mapping[str, str] = {
    "option/density": "fills the world with a fluid, whose forces are left out",
    "body/gravcomp": "is held against gravity (gravcomp), which is left out",
    "body/plugin": "is a plugin, whose forces are left out",
    "joint/damping": "has a damping that is a polynomial, of which the linear term alone is kept",
    "joint/stiffness": "has a stiffness that is a polynomial, of which the linear term alone is kept",
    "joint/springyield": "has a spring that yields (springyield), which is read as elastic",
    "ball/stiffness": "is a ball or free joint with a stiffness, which is left out",
    "ball/range": "is a ball joint with a limit, which is not kept",
    "actuator/unknown": "is not an actuator known here, and what it does is left out",
    "actuator/joint": "drives no hinge or slide, and what it does is left out",
    "actuator/damping": "has a damping that is a polynomial, of which the linear term alone is kept",
    "tendon/stiffness": "has a stiffness that is a polynomial, and its spring is left out",
    "tendon/springyield": "has a spring that yields (springyield), which is read as elastic",
    "deformable/flex": "is a deformable body, whose elastic forces are left out",
}
"""Notes on mechanics of MJCF and of compiled MuJoCo models that is left out, by element and attribute.

Most depends on several attributes, so the readers decide if it acts.
"""

_MOST = 100
"""Largest number of names that are noted one by one."""


class Unread:
    """Notes on elements and attributes that are not read, once per name with a count.

    Parameters
    ----------
    format_name : str, one of KNOWN
    """

    def __init__(self, format_name: str) -> None:
        self.format, self.rows = format_name, KNOWN[format_name]
        self._found: dict[tuple[str, str], tuple[str, str]] = {}
        self._count: Counter[tuple[str, str]] = Counter()

    def row(self, tag: str, parent: str = "") -> Mapping[str, Entry]:
        """Names that a tag may hold inside of another one."""
        return self.rows.get(f"{parent}/{tag}") or self.rows.get(tag) or {}

    @staticmethod
    def entry(row: Mapping[str, Entry], name: str) -> Entry | None:
        """Entry of a name in a row; None for a name that is not known."""
        found = row.get(name) or row.get(OTHERS)
        foreign = found is None and ":" in name and not name.startswith("physics:")  # which USD itself begins with
        return NO_MECHANICS if foreign else found

    def left_out(self, tag: str, name: str, entry: LeftOut, who: str) -> None:
        """Note mechanics that is not read."""
        self._note(tag, name, who, lambda: f"not read; {entry.change}")

    def unknown(self, tag: str, name: str, place: str) -> None:
        """Note a name that stands in a tag and in no row."""
        self._note(tag, name, place, lambda: self._meant(tag, name))

    def walk(self, element: Element) -> None:
        """Note all in an element that is not read."""
        stack = [(element, "")]
        while stack:
            at, parent = stack.pop()
            row = self.row(at.tag, parent)
            for name, text in at.attributes.items():
                entry = self.entry(row, name)
                if entry is None:
                    self.unknown(at.tag, name, at.place)
                elif isinstance(entry, LeftOut) and entry.acts([text]):
                    self.left_out(at.tag, name, entry, f'{name}="{clipped(text)}" of {at}')
            read = []
            for child in at.children:
                name = f"<{child.tag}>"
                entry = self.entry(row, name)
                if entry is READ:
                    read.append((child, at.tag))
                elif entry is None:
                    self.unknown(at.tag, name, child.place)
                elif isinstance(entry, LeftOut) and entry.acts(_texts(child)):
                    self.left_out(at.tag, name, entry, str(child))
            stack.extend(reversed(read))

    @property
    def remarks(self) -> list[str]:
        """Sentences, in the order in which names were met first."""
        more = {key: f" and {count - 1} more" if count > 1 else "" for key, count in self._count.items()}
        found = [f"{who}{more[key]}: {said}" for key, (who, said) in self._found.items()]
        rest = len(more) - len(found)
        return [*found, f"{rest} more names are not read"] if rest else found

    def _note(self, tag: str, name: str, who: str, said: Callable[[], str]) -> None:
        key = tag, name
        self._count[key] += 1
        if self._count[key] == 1 and len(self._found) < _MOST:
            self._found[key] = who, said()

    def _meant(self, tag: str, name: str) -> str:
        """Sentence about a name that is not known, and the known one that may be meant."""
        if not name.startswith("<"):
            said, choices = f"{clipped(name)} is not an attribute of <{tag}> in {self.format}", self.row(tag)
        else:
            homes = [f"<{home.rpartition('/')[2]}>" for home, names in self.rows.items() if name in names]
            if homes:
                return f"{name} is not an element of <{tag}> in {self.format}; it belongs into {' or '.join(homes[:3])}"
            said, choices = f"{clipped(name)} is not an element of {self.format}", self.row(tag)
        near = difflib.get_close_matches(
            name[:_MOST], [one for one in choices if one.startswith("<") == name.startswith("<")], n=1
        )
        return f"{said}; did you mean {near[0]}?" if near else said


def unread(format_name: str, *elements: Element) -> list[str]:
    """Notes on all in the elements that is not read."""
    found = Unread(format_name)
    for element in elements:
        found.walk(element)
    return found.remarks


def _texts(element: Element) -> list[str]:
    """Texts and ``value`` attributes in an element."""
    inside = [text for one in element.walk() for text in (one.content, one.attributes.get("value", ""))]
    return [text for text in inside if text.strip()]
