"""Builder: validates named links and joints and returns a frozen model."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

from numpy.typing import ArrayLike

from ...core.errors import ModelError, ValueRangeError
from ...core.glossary import complete
from ...core.gravity import GRAVITY, gravity_vector
from ...core.numbers import printed
from ...core.text import argument, listed
from ..bodies.inertia import SpatialInertia
from ..joints import Floating
from ..joints.screw_joint import number, numbers
from .actuation import with_actuators, with_link_friction
from .actuators import Actuator
from .assembly import ROOT_JOINT, Additions, assemble, check_tip
from .description import (
    TYPES,
    JointEntry,
    LinkEntry,
    Mimic,
    ModelNote,
    SiteEntry,
    armature_of,
    issue,
    label,
    limits_of,
    link_entry,
    mimic_of,
    placement_of,
    sentences,
)
from .inertia_checks import INERTIA_POLICIES, judge, massless_links
from .mimic import MIMIC_POLICIES, find_drives
from .model import Model, OfferedClosure, Spring
from .snapping import DEFAULT_SNAP
from .tree import Tree, find_tree


class ModelBuilder:
    """Model builder: collects links and joints, in any order, and builds a model from them.

    The result is a :class:`~twistwrench.mechanics.model.model.Model`. In all methods, ``where`` is the place of a description
    in its file ("line 12"), for messages.

    Parameters
    ----------
    name : str, the robot's name
    source : str, file or origin of the description

    Examples
    --------
    >>> import numpy as np
    >>> builder = ModelBuilder("pendulum")
    >>> builder.add_link("base")
    >>> builder.add_link("rod", SpatialInertia.from_com(1.0, (0, 0, -0.5), 0.1 * np.eye(3)))
    >>> builder.add_joint("hinge", "revolute", "base", "rod", axis=(0, 1, 0))
    >>> builder.add_configuration("up", {"hinge": [np.pi]})
    >>> builder.add_closure("weld", OfferedClosure("base", "rod"))
    >>> builder.remark("the rod is an example")
    >>> builder.note("joint 'hinge'", "is one too")
    >>> model = builder.build(quiet=True)
    >>> model.tip, model.configurations["up"].round(2).tolist(), model.closures["weld"].frame_b
    ('rod', [3.14], 'rod')
    >>> model.defects
    ('the rod is an example', "joint 'hinge' is one too")
    """

    def __init__(self, name: str, source: str = "") -> None:
        self.name, self.source = name, source
        self._links: dict[str, LinkEntry] = {}
        self._joints: dict[str, JointEntry] = {}
        self._remarks: list[str] = []
        self._additions = Additions()
        self._actuators: dict[str, tuple[Actuator, Mapping[str, float]]] = {}
        """Actuator of each joint, with the friction of the drive."""
        self.gravity: ArrayLike = GRAVITY
        """Gravity of the file, (3,) m/s² in the base frame."""

    @property
    def link_names(self) -> tuple[str, ...]:
        """Names of the links added so far."""
        return tuple(self._links)

    @property
    def site_names(self) -> tuple[str, ...]:
        """Names of the sites added so far."""
        return tuple(self._additions.sites)

    def remark(self, *texts: str) -> None:
        """Add a remark on a doubtful entry: a :class:`~twistwrench.ModelWarning` on building, and one of the model's defects.

        Parameters
        ----------
        *texts : str, sentences
        """
        self._remarks.extend(texts)

    def note(self, subject: object, text: str) -> None:
        """Add a note on a doubtful link, joint or element of the file; equal notes are joined in warnings.

        Parameters
        ----------
        subject : object, its text is the subject of the sentence
        text : str, the rest of the sentence
        """
        self._remarks.append(ModelNote(str(subject), text))

    def add_link(
        self,
        name: str,
        inertia: SpatialInertia | None = None,
        where: str = "",
        *,
        shaped: bool = False,
        hidden: bool = False,
    ) -> None:
        """Add a link with its inertia about the origin of its frame.

        Parameters
        ----------
        name : str
        inertia : SpatialInertia, optional; None: a link without mass
        shaped : bool, the link has a shape in its file and is more than a frame
        hidden : bool, the link only connects two joints of one body and is not offered as a frame

        Examples
        --------
        >>> builder = ModelBuilder("point")
        >>> builder.add_link("base")
        >>> builder.build().nv
        0
        """
        link = link_entry(name, inertia, where, shaped, hidden)
        _check_new("link", name, where, self._links.get(name))
        self._links[name] = link

    def add_joint(
        self,
        name: str,
        kind: str,
        parent: str,
        child: str,
        *,
        placement: ArrayLike | None = None,
        axis: ArrayLike = (1.0, 0.0, 0.0),
        pitch: float = 0.0,
        normalise_axes: bool = True,
        lower: float | None = None,
        upper: float | None = None,
        velocity: float | None = None,
        effort: float | None = None,
        acceleration: float | None = None,
        deceleration: float | None = None,
        jerk: float | None = None,
        damping: float = 0.0,
        friction: float = 0.0,
        armature: float = 0.0,
        mimic: Mimic | None = None,
        where: str = "",
    ) -> None:
        """Add a joint: revolute, continuous, prismatic, helical, planar, floating, ball or fixed.

        Parameters
        ----------
        name : str
        kind : str, one of these types
        parent, child : str, links
        placement : (4, 4) array_like, optional, T_parent,child with the joint at zero; None: the identity
        axis : (3,) or (6,) array_like, direction or screw axis (angular part first) in the child's frame
        pitch : float, of a ``helical`` joint with a direction as axis [m/rad]
        normalise_axes : bool, scale axes to unit length; otherwise q is in units of the axis's length
        lower, upper : float, optional, position limits [rad or m]; None: not given
        velocity : float, optional, limit [rad/s or m/s]
        effort : float, optional, limit [N m or N]
        acceleration, deceleration : float, optional, limits of a joint that speeds up or slows down [rad/s² or m/s²];
            if only one is given, it holds for both
        jerk : float, optional, limit [rad/s³ or m/s³]
        damping : float, viscous friction [N m s/rad or N s/m]
        friction : float, Coulomb friction [N m or N]
        armature : float, reflected inertia of the drive for each velocity of the joint [kg m² or kg]
        mimic : (leader, multiplier, offset), optional

        Examples
        --------
        >>> builder = ModelBuilder("slider")
        >>> builder.add_link("rail")
        >>> builder.add_link("cart", SpatialInertia.from_com(1.0))
        >>> builder.add_joint("slide", "prismatic", "rail", "cart", lower=0.0, upper=2.0)
        >>> builder.build().limits.upper.tolist()
        [2.0]
        """
        who = label("joint", name, where)
        _check_new("joint", name, where, self._joints.get(name))
        if kind not in TYPES:
            raise ModelError(f"{who} has the unknown type {kind!r}. Allowed: {', '.join(TYPES)}.")
        joint_type = TYPES[kind]
        joint = joint_type(name, joint_type.axes_from(axis, pitch, normalise_axes, who))
        magnitude_limits = {
            "velocity": velocity, "effort": effort,
            "acceleration": acceleration, "deceleration": deceleration, "jerk": jerk,
        }  # fmt: skip
        limits, remarks = limits_of(joint, lower, upper, magnitude_limits, who)
        self._joints[name] = JointEntry(
            joint,
            parent,
            child,
            placement_of(placement, who),
            limits,
            number(damping, f"the damping of {who}"),
            number(friction, f"the friction of {who}"),
            mimic_of(mimic, who),
            where,
            armature_of(armature, who),
        )
        self._remarks.extend(remarks)
        for quantity, value in (("damping", damping), ("friction", friction)):
            if value < 0:
                self.note(who, f"has a negative {quantity}, {printed(value)}, so it feeds energy into the robot")

    def add_site(self, name: str, link: str, pose: ArrayLike | None = None, where: str = "") -> str:
        """Add a site: a named frame fixed to a link.

        Parameters
        ----------
        name : str
        link : str
        pose : (4, 4) array_like, optional, of the site in the link's frame; None: the identity

        Returns
        -------
        name : str, name of the site: ``site:NAME`` if a link already has the name

        Examples
        --------
        >>> builder = ModelBuilder("point")
        >>> builder.add_link("base")
        >>> builder.add_site("camera", "base"), builder.add_site("base", "base")
        ('camera', 'site:base')
        """
        if link not in self._links:
            raise ModelError(f"{label('site', name, where)} is on link {link!r}, which is not there.")
        if name in self._links:
            name = f"site:{name}"
        # Sites do not keep their place in the file, so the message names the place of the link.
        namesake = self._links[link] if name in self._additions.sites else None
        _check_new("site", name, where, namesake)
        self._additions.sites[name] = SiteEntry(name, link, placement_of(pose, label("site", name, where)))
        return name

    def add_spring(self, terms: Mapping[str, float], stiffness: float, rest: float = 0.0, where: str = "") -> None:
        """Add a spring that stores ``½ stiffness (Σ weight · coordinate - rest)²``.

        Parameters
        ----------
        terms : {joint: weight}
        stiffness : float [N m/rad or N/m]
        rest : float, value of the sum at which the spring is unloaded [rad or m]

        Examples
        --------
        >>> builder = ModelBuilder("slider")
        >>> builder.add_link("rail")
        >>> builder.add_link("cart", SpatialInertia.from_com(1.0))
        >>> builder.add_joint("slide", "prismatic", "rail", "cart")
        >>> builder.add_spring({"slide": 1.0}, stiffness=200.0, rest=0.1)
        >>> builder.build().springs[0].stiffness
        200.0
        """
        for name in terms:
            if name not in self._joints or self._joints[name].joint.nq != 1:
                where_text = f" ({where})" if where else ""
                raise ModelError(
                    f"a spring{where_text} acts on {name!r}, which is not a joint of one degree of freedom."
                )
        given_values = [stiffness, rest, *terms.values()]
        values = numbers(given_values, (len(given_values),), f"the numbers of a spring ({where})")
        checked_stiffness, checked_rest, *weights = values.tolist()
        checked_terms = tuple(zip(terms, weights, strict=True))
        self._additions.springs.append(Spring(checked_terms, checked_stiffness, checked_rest))

    def add_actuator(self, actuator: Actuator, friction: Mapping[str, float] | None = None) -> None:
        """Add the motor and gear of a joint that the robot's own file describes.

        Parameters
        ----------
        actuator : Actuator
        friction : {law: value}, optional, friction of the drive referred to the joint, in addition to the joint's
            friction

        Examples
        --------
        >>> from twistwrench.mechanics.model.actuators import Actuator, Motor
        >>> builder = ModelBuilder("slider")
        >>> builder.add_link("rail")
        >>> builder.add_link("cart", SpatialInertia.from_com(1.0))
        >>> builder.add_joint("slide", "prismatic", "rail", "cart")
        >>> builder.add_actuator(Actuator("slide", ratio=200.0, motor=Motor(0.05)))
        >>> builder.build().actuators["slide"].ratio
        200.0
        """
        self._actuators[actuator.joint] = actuator, friction or {}

    def add_configuration(self, name: str, positions: Mapping[str, ArrayLike]) -> None:
        """Add a named configuration, such as a keyframe.

        Parameters
        ----------
        name : str
        positions : {joint: coordinates} [rad, m]; omitted joints are neutral
        """
        self._additions.configurations[name] = dict(positions)

    def add_closure(self, name: str, closure: OfferedClosure) -> None:
        """Add a loop closure between two frames, which the user may apply.

        Parameters
        ----------
        name : str
        closure : OfferedClosure
        """
        self._additions.closures[name] = closure

    def add_motors(self, joints: Iterable[str]) -> None:
        """Add joints that the file's actuators drive; joints without a motor are then passive.

        Parameters
        ----------
        joints : iterable of str

        Examples
        --------
        >>> builder = ModelBuilder("slider")
        >>> builder.add_link("rail")
        >>> builder.add_link("cart", SpatialInertia.from_com(1.0))
        >>> builder.add_joint("slide", "prismatic", "rail", "cart")
        >>> builder.add_motors(["slide"])
        >>> sorted(builder.build().motor_joints)
        ['slide']
        """
        self._additions.motor_joints |= set(joints)

    def mount(self) -> None:
        """State that the description fixes the root, so that a robot with legs hangs or is bolted to the world.

        Examples
        --------
        >>> builder = ModelBuilder("point")
        >>> builder.add_link("base")
        >>> builder.mount()
        >>> builder.build().mounted
        True
        """
        self._additions.mounted = True

    def build(
        self,
        *,
        floating_base: bool = False,
        lock: Mapping[str, ArrayLike] | None = None,
        tip: str | None = None,
        mimic: str = "follow",
        inertia: str = "error",
        snap: float = DEFAULT_SNAP,
        gravity: ArrayLike | None = None,
        quiet: bool = False,
    ) -> Model:
        """Build and validate the model: one tree, consistent inertias, mimic chains resolved, fixed links merged.

        Parameters
        ----------
        floating_base : bool, let the root link float
        mimic : "follow" or "independent"
        snap : float, entries of fixed rotations within this distance of 0 or ±1 are set to 0 or ±1
        gravity : (3,) array_like, optional, in the base frame [m/s²]; None: from the description
        quiet : bool, issue no warnings; remarks are still stored in ``model.defects``

        Examples
        --------
        >>> builder = ModelBuilder("point")
        >>> builder.add_link("base")
        >>> builder.build().name
        'point'
        """
        _check_choice("mimic", mimic, MIMIC_POLICIES)
        _check_choice("inertia", inertia, INERTIA_POLICIES)
        if not 0 <= snap < 0.1:
            raise ValueRangeError(
                f"snap={snap!r} is not allowed: a small number such as {printed(DEFAULT_SNAP)}, or 0 for off."
            )
        tree = find_tree(self._links, list(self._joints.values()))
        remarks = [*self._remarks, *self._floating_remarks(tree, floating_base)]
        drives = find_drives(self._joints.values()) if mimic == "follow" else {}
        model = assemble(
            self.name, self._links, tree, drives, floating_base=floating_base, snap=snap,
            gravity=gravity_vector(self.gravity if gravity is None else gravity), source=self.source,
            additions=self._additions,
        )  # fmt: skip
        remarks += model.defects
        if lock:
            from . import edit

            model = edit.lock(model, lock)
        model = self._with_actuators(model)
        model, inertia_remarks = judge(model, inertia, lambda link: str(self._links[link]))
        # Only links of files are named: a purely kinematic table has no masses by intention.
        massless = [str(self._links[link]) for link in massless_links(model) if self._links[link].where]
        if massless:
            have_no_mass = "has no mass: its" if len(massless) == 1 else "have no mass: their"
            inertia_remarks.append(
                f"{listed(massless)} {have_no_mass} weight and inertia are missing from every torque"
            )
        model = replace(model, tip=check_tip(model, tip), defects=(*remarks, *inertia_remarks))
        if not quiet:
            issue(sentences(self.name, model.defects))
        return model

    def _with_actuators(self, model: Model) -> Model:
        """Model with the described actuators of the joints that are not locked, and with the friction of their drives."""
        descriptions = {name: self._actuators[name] for name in model.joint_names if name in self._actuators}
        actuators = [actuator for actuator, _ in descriptions.values() if actuator.motor is not None]
        friction_laws = {name: law for name, (_, law) in descriptions.items() if law}
        driven_model = with_actuators(model, actuators)
        return with_link_friction(driven_model, friction_laws)

    def _floating_remarks(self, tree: Tree, floating_base: bool) -> list[str]:
        """Remarks on a root link that would float twice; raises ModelError if a joint has the name of the added joint."""
        if not floating_base:
            return []
        if ROOT_JOINT in self._joints:
            raise ModelError(
                f"{self._joints[ROOT_JOINT]} has the name that {argument('floating_base', True)} gives to the joint it adds. "
                "Rename it, or leave out floating_base."
            )
        root_joints = [entry for entry in tree.joints if entry.parent == tree.root]
        floating_joints = [entry for entry in root_joints if isinstance(entry.joint, Floating)]
        return [
            f"{entry} floats already, and a floating base makes the root link float too" for entry in floating_joints
        ]


def _check_new(kind: str, name: str, where: str, namesake: LinkEntry | JointEntry | None) -> None:
    """Raise ModelError for an empty name, and for a name that another entry of this kind has."""
    if not isinstance(name, str) or not name:
        raise ModelError(f"{label(kind, name, where)} needs a name: a text that is not empty.")
    if namesake is not None:
        places = " and ".join(filter(None, [where, namesake.where]))
        where_text = f" ({places})" if places else ""
        raise ModelError(
            f"two {kind}s are called {name!r}{where_text}. Each needs a name of its own; rename or remove one."
        )


def _check_choice(option: str, value: str, choices: tuple[str, ...]) -> None:
    """Raise ValueRangeError unless the value of an option is one of the choices."""
    if value not in choices:
        raise ValueRangeError(
            f"{argument(option, value)} is not allowed. Choose from: {', '.join(map(repr, choices))}."
        )


complete(globals())
