"""The book's description of a serial chain, screws and link frames, to and from a model. Modern Robotics chapters 4 and 8."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..bodies.inertia import SpatialInertia
from ..core.printed_numbers import printed
from ..errors import InertiaError, ModelError, ShapeError
from ..lie import se3
from ..lie.adjoint import Ad
from ..model.builder import ModelBuilder
from ..model.model import Model
from ..typing import Array


@dataclass(frozen=True, eq=False)
class ScrewLists:
    """A serial chain of n one-degree joints at its zero configuration, as the book's functions take it."""

    M: Array
    """(4, 4) pose of the end-effector frame."""
    Slist: Array
    """(6, n) screw axes in the space frame, a column each."""
    Blist: Array
    """(6, n) screw axes in the end-effector frame."""
    Mlist: Array
    """(n + 1, 4, 4) pose of link frame i in link frame i - 1; the last is the end-effector in link n."""
    Glist: Array
    """(n, 6, 6) spatial inertia of each link in its own frame."""


def screw_lists(model: Model, *, at_com: bool = False) -> ScrewLists:
    """Screws of a serial chain; with ``at_com`` the link frames are moved to the centres of mass, along principal axes.

    Raises ModelError where the robot is no serial chain of one-degree joints with a tip.
    """
    if not all(body.joint.moves_body for body in model.bodies):
        raise ModelError(
            f"robot {model.name!r} has rotors, which no Slist holds. Take the screws of the robot before with_actuators."
        )
    for i, body in enumerate(model.bodies):
        if body.parent != i - 1 or body.joint.nv != 1 or body.follows:
            raise ModelError(
                f"robot {model.name!r} is no serial chain of one-degree joints (see joint {body.joint.name!r}), so it has "
                "no Slist. Lock joints (robot.lock) until one chain is left."
            )
    end = model.frame(None)
    if end.body != len(model.bodies) - 1:
        raise ModelError(f"tip {model.tip!r} of robot {model.name!r} does not ride on the last link. Load with tip=….")
    home, frames, screws, inertias = np.eye(4), [], [], []
    for body in model.bodies:
        home = home @ body.placement
        screws.append(Ad(home) @ body.joint.axes[0])
        moved = _principal_frame(body.inertia) if at_com else np.eye(4)
        frames.append(home @ moved)
        inertias.append(body.inertia.in_frame(se3.inverse(moved)).matrix)
    M = home @ end.pose
    chain = [np.eye(4), *frames, M]
    steps = [se3.inverse(a) @ b for a, b in itertools.pairwise(chain)]
    Slist = np.array(screws).T
    return ScrewLists(M, Slist, (Ad(se3.inverse(M)) @ Slist.T).T, np.array(steps), np.array(inertias))


def _principal_frame(G: SpatialInertia) -> Array:
    return se3.pose(G.principal()[1], G.com)


def from_screws(
    M: ArrayLike | None,
    Slist: ArrayLike,
    Mlist: Sequence[ArrayLike] | ArrayLike,
    Glist: Sequence[ArrayLike] | ArrayLike,
    *,
    joint_names: Sequence[str] | None,
    name: str,
    gravity: ArrayLike,
    non_unit_screws: bool,
    inertia: str,
) -> Model:
    """The model of the book's lists, by the arguments of :func:`twistwrench.from_screws`."""
    S, steps = np.asarray(Slist, float), np.asarray(Mlist, float)
    G = np.asarray(Glist, float)
    n = S.shape[-1] if S.ndim == 2 else 0
    if S.shape != (6, n) or n == 0 or steps.shape != (n + 1, 4, 4) or G.shape != (n, 6, 6):
        raise ShapeError(
            f"Slist {S.shape}, Mlist {steps.shape}, Glist {G.shape}: expected (6, n), (n + 1, 4, 4), (n, 6, 6). Screws are "
            "the columns of Slist; Mlist ends with the end-effector's pose in the last link."
        )
    names = list(joint_names) if joint_names is not None else [f"joint{i + 1}" for i in range(n)]
    if len(names) != n:
        raise ShapeError(f"{len(names)} joint names for {n} screws.")
    builder = ModelBuilder(name)
    builder.add_link("base")
    home, parent = np.eye(4), "base"
    for i in range(n):
        home = home @ steps[i]
        A = Ad(se3.inverse(home)) @ S[:, i]  # the screw in its own link's frame, MR section 8.3.1
        if not non_unit_screws:
            _check_unit(S[:, i], i, names[i])
        link = f"link{i + 1}"
        builder.add_link(link, _link_inertia(G[i], link))
        kind = "prismatic" if not np.any(A[:3]) else "helical"
        builder.add_joint(names[i], kind, parent, link, placement=steps[i], axis=A, normalise_axes=False)
        parent = link
    builder.add_link("end_effector")
    builder.add_joint("end_effector_fixed", "fixed", parent, "end_effector", placement=steps[n])
    if M is not None:
        _check_home(np.asarray(M, float), home @ steps[n])
    return builder.build(tip="end_effector", gravity=gravity, inertia=inertia, snap=0.0)


def _link_inertia(G: Array, link: str) -> SpatialInertia:
    """The inertia of a link's 6×6 matrix; errors name the link."""
    try:
        return SpatialInertia.from_matrix(G)
    except InertiaError as problem:
        raise InertiaError(f"{link}: {problem}") from None


def _check_unit(S: Array, i: int, joint: str) -> None:
    w, v = float(np.linalg.norm(S[:3])), float(np.linalg.norm(S[3:]))
    length, part = (w, "turning part") if w > 0 else (v, "sliding part")
    if abs(length - 1.0) > 1e-6:
        raise ModelError(
            f"screw {i + 1} (joint {joint!r}), {S.tolist()}: its {part} has length {printed(length)}, not 1. Divide it by "
            "that, or pass non_unit_screws=True to keep it, knowing that its coordinate is then no angle in radians."
        )


def _check_home(given: Array, product: Array) -> None:
    if given.shape != (4, 4):
        raise ShapeError(f"M has shape {given.shape}, expected (4, 4).")
    gap = float(np.abs(given - product).max())
    if not gap <= 1e-6:
        raise ModelError(
            f"M and the product of Mlist differ by up to {printed(gap, 3)}: they must describe the same end-effector frame "
            "at zero. Pass M=None to take the product."
        )
