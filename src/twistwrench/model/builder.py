"""The builder: where links and joints are named one by one, and a checked, frozen model comes out."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Mapping
from dataclasses import replace

from numpy.typing import ArrayLike

from ..bodies.inertia import SpatialInertia
from ..errors import ModelError, ModelWarning, ValueRangeError
from .assembly import ROOT_JOINT, assemble
from .description import (
    KINDS,
    JointEntry,
    LinkEntry,
    Mimic,
    axes_of,
    label,
    limits_of,
    link_entry,
    mimic_of,
    numbers,
    placement_of,
)
from .edit import gravity_vector, lock
from .joint import Joint
from .judgement import INERTIA_POLICIES, judge
from .massless import massless_links
from .mimic import MIMIC_POLICIES, find_drives
from .model import Model
from .remark import Remark, grouped
from .snap import DEFAULT_SNAP
from .tip import check_tip
from .tree import Tree, find_tree

__all__ = ["ModelBuilder"]


class ModelBuilder:
    """Collects links and joints, in any order, and builds a :class:`~twistwrench.model.model.Model` of them.

    ``where`` says where a link or joint was described ("line 12"), and appears in messages about it.

    >>> import numpy as np
    >>> builder = ModelBuilder("pendulum")
    >>> builder.add_link("base")
    >>> builder.add_link("rod", SpatialInertia.from_com(1.0, (0, 0, -0.5), 0.1 * np.eye(3)))
    >>> builder.add_joint("hinge", "revolute", "base", "rod", axis=(0, 1, 0))
    >>> builder.build().tip
    'rod'
    """

    def __init__(self, name: str, source: str = "") -> None:
        self.name, self.source = name, source
        self._links: dict[str, LinkEntry] = {}
        self._joints: dict[str, JointEntry] = {}
        self._remarks: list[str] = []

    def remark(self, text: str) -> None:
        """Note something doubtful: a :class:`~twistwrench.ModelWarning` on building, kept in the defects."""
        self._remarks.append(text)

    def add_link(
        self, name: str, inertia: SpatialInertia | None = None, where: str = "", *, shaped: bool = False
    ) -> None:
        """Add a link with its inertia about its own frame's origin; None is a link without mass.

        ``shaped`` says that the link has a shape in its file, so that it cannot be a mere frame.

        Raises :class:`~twistwrench.ModelError` for a name taken, :class:`~twistwrench.InertiaError` for numbers that
        are not finite and for a negative mass.
        """
        link = link_entry(name, inertia, where, shaped)
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
        damping: float = 0.0,
        friction: float = 0.0,
        mimic: Mimic | None = None,
        where: str = "",
    ) -> None:
        """Add a joint of one of the kinds revolute, continuous, prismatic, helical, planar, floating and fixed.

        ``placement`` (4, 4) is T_parent,child with the joint at zero (None: the identity). ``axis``, in the child's
        frame, is a direction (3,) or a screw axis (6,), angular part first; ``pitch`` [m/rad] goes with a direction and
        ``helical``. Axes are normalised unless ``normalise_axes=False``: then q counts in units of the axis's length.
        Limits in rad or m, rad/s or m/s, N m or N; None means not given. ``mimic`` is (leader, multiplier, offset).
        Raises :class:`~twistwrench.ModelError` for whatever cannot be meant.
        """
        who = label("joint", name, where)
        _check_new("joint", name, where, self._joints.get(name))
        if kind not in KINDS:
            raise ModelError(f"{who} has the unknown type {kind!r}. Allowed: {', '.join(KINDS)}.")
        joint = Joint(name, kind, axes_of(kind, axis, pitch, normalise_axes, who))
        limits, remarks = limits_of(joint, lower, upper, velocity, effort, who)
        loss = {"damping": damping, "friction": friction}
        for what, value in loss.items():
            loss[what] = float(numbers(value, (), f"the {what} of {who}"))
            if loss[what] < 0:
                remarks.append(Remark(who, f"has a negative {what}, {value:g}, so it feeds energy into the robot"))
        self._joints[name] = JointEntry(
            joint=joint,
            parent=parent,
            child=child,
            placement=placement_of(placement, who),
            limits=limits,
            damping=loss["damping"],
            friction=loss["friction"],
            mimic=mimic_of(mimic, who),
            where=where,
        )
        self._remarks.extend(remarks)

    def build(
        self,
        *,
        floating_base: bool = False,
        lock: Mapping[str, ArrayLike] | None = None,
        tip: str | None = None,
        mimic: str = "follow",
        inertia: str = "error",
        snap: float = DEFAULT_SNAP,
        gravity: ArrayLike = (0.0, 0.0, -9.81),
    ) -> Model:
        """The model of what was added, checked: one tree, possible bodies, mimic chains resolved, fixed links fused.

        ``floating_base`` lets the root link float; ``lock`` holds joints at positions; ``mimic`` is "follow" or
        "independent"; ``inertia`` is "error", "accept" or "repair"; entries of fixed rotations within ``snap`` of 0 or
        ±1 are set to it; ``gravity`` (3,) is in the base frame. Remarks are warned of and stay in ``model.defects``.

        Raises :class:`~twistwrench.ModelError`, :class:`~twistwrench.InertiaError` for a moving body that cannot exist,
        and :class:`~twistwrench.UnknownNameError` for a joint to lock or a tip that is not there.
        """
        _check_choice("mimic", mimic, MIMIC_POLICIES)
        _check_choice("inertia", inertia, INERTIA_POLICIES)
        if not 0 <= snap < 0.1:
            raise ValueRangeError(
                f"snap={snap!r} is not allowed: a small number such as {DEFAULT_SNAP:g}, or 0 for off."
            )
        tree = find_tree(self._links, list(self._joints.values()))
        remarks = [*self._remarks, *self._floating_remarks(tree, floating_base)]
        drives = find_drives(self._joints.values()) if mimic == "follow" else {}
        model = assemble(
            self.name,
            self._links,
            tree,
            drives,
            floating_base=floating_base,
            snap=snap,
            gravity=gravity_vector(gravity),
            source=self.source,
        )
        model = _locked(model, lock or {})
        model, found = judge(model, inertia, lambda link: str(self._links[link]))
        # Files that forget masses; a table of lengths alone, for kinematics, has none on purpose.
        described = [self._links[link] for link in massless_links(model) if self._links[link].where]
        found += _on_massless([str(link) for link in described])
        model = replace(model, tip=check_tip(model, tip), defects=(*remarks, *found))
        for text in grouped(model.defects):
            warnings.warn(f"robot {self.name!r}: {text}.", ModelWarning, stacklevel=_frames_to_user())
        return model

    def _floating_remarks(self, tree: Tree, floating_base: bool) -> list[str]:
        if not floating_base:
            return []
        if ROOT_JOINT in self._joints:
            raise ModelError(
                f"{self._joints[ROOT_JOINT]} has the name that floating_base=True gives to the joint it adds. "
                "Rename it, or leave out floating_base."
            )
        twice = [j for j in tree.joints if j.parent == tree.root and j.joint.kind == "floating"]
        return [f"{joint} floats already, and floating_base=True makes the root link float too" for joint in twice]


_locked = lock  # inside build, `lock` is the option


def _on_massless(links: list[str]) -> list[str]:
    """One remark on all moving links that ought to have a mass and have none."""
    if not links:
        return []
    listed = ", ".join(links[:12]) + (f" and {len(links) - 12} more" if len(links) > 12 else "")
    verb, whose = ("has", "its") if len(links) == 1 else ("have", "their")
    return [f"{listed} {verb} no mass: {whose} weight and inertia are missing from every torque"]


def _check_new(kind: str, name: str, where: str, old: LinkEntry | JointEntry | None) -> None:
    if not isinstance(name, str) or not name:
        raise ModelError(f"{label(kind, name, where)} needs a name: a text that is not empty.")
    if old is not None:
        places = f" ({where} and {old.where})" if where or old.where else ""
        raise ModelError(
            f"two {kind}s are called {name!r}{places}. Each needs a name of its own; rename or remove one."
        )


def _check_choice(option: str, value: str, choices: tuple[str, ...]) -> None:
    if value not in choices:
        raise ValueRangeError(f"{option}={value!r} is not allowed. Choose from: {', '.join(map(repr, choices))}.")


def _frames_to_user() -> int:
    """The stack level of the first caller outside this package, so that a warning points at the user's own line."""
    package = __name__.partition(".")[0]
    level, frame = 1, sys._getframe(1)
    while frame.f_back is not None and frame.f_globals.get("__name__", "").partition(".")[0] == package:
        level, frame = level + 1, frame.f_back
    return level
