"""Loading of robots: files, screw lists, Denavit–Hartenberg tables, and models of other libraries."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from copy import deepcopy
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypedDict, Unpack

from numpy.typing import ArrayLike

from ..core.glossary import complete
from ..core.gravity import GRAVITY
from ..core.typing import Frame
from .kernels.disk_cache import CachedModel, keep_file, known_file
from .robot import Robot

if TYPE_CHECKING:
    from ..mechanics.model.model import Model

Mimic = Literal["follow", "independent"]
Inertia = Literal["error", "accept", "repair"]


class BuildOptions(TypedDict, total=False):
    """Options of :func:`load` that concern the robot rather than its file."""

    lock: Mapping[str, ArrayLike] | None
    tip: str | None
    mimic: Mimic
    inertia: Inertia
    snap: float
    gravity: ArrayLike | None


class LoadOptions(BuildOptions, total=False):
    """Options of :func:`load`, as a dictionary with the same names and meanings."""

    format: str | None
    floating_base: bool | None
    keep: str | None
    model: str | None
    include_paths: Sequence[str | Path]
    max_bodies: int
    xacro: Mapping[str, str | float | bool] | bool | None


_ROBOT_NAME = re.compile(r"\w[\w -]{0,79}")
"""Text that may be a robot's name: words without a dot or a slash, of at most 80 characters."""


def is_name(source: object) -> bool:
    """True for a text that may be a robot's name: without a suffix, a folder or markup."""
    return isinstance(source, str) and _ROBOT_NAME.fullmatch(source) is not None


def load(
    source: str | Path,
    *,
    format: str | None = None,  # noqa: A002  its usual name
    floating_base: bool | None = None,
    keep: str | None = None,
    model: str | None = None,
    include_paths: Sequence[str | Path] = (),
    max_bodies: int = 20_000,
    xacro: Mapping[str, str | float | bool] | bool | None = None,
    lock: Mapping[str, ArrayLike] | None = None,
    tip: Frame | None = None,
    mimic: Mimic = "follow",
    inertia: Inertia = "error",
    snap: float = 1e-9,  # equals model.assembly.DEFAULT_SNAP, not imported here
    gravity: ArrayLike | None = None,
) -> Robot:
    """Load a robot from a URDF, xacro, MJCF, SDF or USD file, or from XML text (first non-blank character ``<``).

    Parameters
    ----------
    source : str or Path, file, XML text, or a name that :func:`twistwrench.find` knows; a file of that name takes precedence
    format : "urdf", "mjcf", "sdf" or "usd", optional; None: from the root element or the suffix
    floating_base : bool, optional
        Let the base move freely; False fixes it in place, and states that something holds it, so that a robot with legs
        hangs on purpose. Default: as in the file (URDF and SDF models are fixed, free joints of MJCF and USD bodies without
        a joint float).
    keep : str, optional
        Keep only this body of an MJCF scene, with its descendants.
    model : str, optional
        Model to read from an SDF world, or articulation of a USD stage.
    include_paths : folders, optional
        Further folder from which files that the robot file names may be read.
    max_bodies : int, largest number of bodies accepted
    xacro : True or {argument: value}, optional
        Expand macros in a file that does not end in ``.xacro``; a mapping sets arguments of the macros.
    lock : {joint: position}, optional
        Lock joints at positions [rad, m], or all joints of a pattern, such as '*wheel*'.
    tip : str, optional
        Default frame for payloads, Jacobians and forces; default: the end effector.
    mimic : "follow" or "independent"
        Mimic joints follow their leader, or move independently.
    inertia : "error", "accept" or "repair"
        Physically impossible inertias: stop, keep them, or replace them by the nearest valid ones.
    snap : float, entries of fixed rotations within this distance of 0 or ±1 are set to it exactly; 0 disables
    gravity : (3,) array_like, optional, in the base frame [m/s²]; None: from the file, else (0, 0, -9.81)

    Raises
    ------
    NotFoundError
        The file does not exist.
    RobotFileError
        The file is not a robot file, or an entry of it cannot be read.
    ModelError
        The file's content does not describe a valid robot.
    InertiaError
        A moving body has a physically impossible inertia; link, condition and amount are named.
    MissingExtraError
        The file is USD or xacro, and the extra ``usd`` or ``xacro`` is not installed.

    Warns
    -----
    ModelWarning
        The file has doubtful entries, which are also listed in :attr:`Robot.defects`.

    Examples
    --------
    >>> import twistwrench as tw
    >>> robot = tw.load(tw.robots.path_of("ur5"))
    >>> robot.nv, robot.tip
    (6, 'tool0')
    """
    options = LoadOptions(
        format=format, floating_base=floating_base, keep=keep, model=model, include_paths=include_paths,
        max_bodies=max_bodies, xacro=xacro, lock=lock, tip=tip, mimic=mimic, inertia=inertia, snap=snap, gravity=gravity,
    )  # fmt: skip
    if is_name(source) and not Path(source).exists():
        from .doors import load_by_name

        return load_by_name(str(source), options)
    cache_entry = known_file(source, options)
    if cache_entry is None:  # not a file that the cache keeps
        return Robot(_read(source, None, options))
    was_loaded_before = cache_entry.remarks is not None
    if was_loaded_before:  # then the model is only read when it is needed
        if cache_entry.remarks:
            from ..mechanics.model.description import issue

            issue(cache_entry.remarks)
        own_options = deepcopy(options)  # copied: the caller may change them later
        return Robot(CachedModel(cache_entry.key, lambda: _read(source, cache_entry.data, own_options, quiet=True)))
    from ..mechanics.model.description import sentences

    new_model = _read(source, cache_entry.data, options)
    keep_file(cache_entry, sentences(new_model.name, new_model.defects))
    return Robot(CachedModel(cache_entry.key, lambda: new_model))


def _read(source: str | Path, data: bytes | None, options: LoadOptions, *, quiet: bool = False) -> Model:
    """Model of a file, or of its bytes ``data`` if they are already read; with ``quiet``, without warnings."""
    from ..formats import load_model

    return load_model(source, data=data, quiet=quiet, **options)


def from_screws(
    M: ArrayLike | None,
    Slist: ArrayLike,
    Mlist: Sequence[ArrayLike] | ArrayLike,
    Glist: Sequence[ArrayLike] | ArrayLike,
    *,
    joint_names: Sequence[str] | None = None,
    name: str = "screws",
    gravity: ArrayLike = GRAVITY,
    non_unit_screws: bool = False,
    inertia: Inertia = "error",
) -> Robot:
    """Robot from screw axes: the book's lists M, Slist, Mlist, Glist of a serial chain.

    MR section 8.3. A screw with an angular part (or, for pure translation, a linear part) that is not of unit length
    raises an error, because its joint coordinate is not an angle; the book's own three-link example has one.

    Parameters
    ----------
    M : (4, 4) array_like or None, home pose of the tip; checked against the product of ``Mlist``; None: that product
    Slist : (6, n) array_like, space screw axes as columns, at the home configuration
    Mlist : n + 1 poses (4, 4), each link frame in the previous one
    Glist : n spatial inertias (6, 6), each in its link frame
    name : str, the robot's name
    non_unit_screws : bool, accept screws that are not of unit length and keep their lengths

    Raises
    ------
    ValueRangeError
        A screw is not of unit length, or ``M`` is not the product of ``Mlist``.

    Examples
    --------
    >>> import numpy as np, twistwrench as tw
    >>> ur5 = tw.robots.ur5()
    >>> s = ur5.screws
    >>> back = tw.from_screws(s.M, s.Slist, s.Mlist, s.Glist)
    >>> q = ur5.random_configuration(1)
    >>> bool(np.allclose(back.gravity_forces(q), ur5.gravity_forces(q)))
    True
    """
    from ..formats import dh

    return Robot(dh.from_screws(
        M, Slist, Mlist, Glist, joint_names=joint_names, name=name, gravity=gravity, non_unit_screws=non_unit_screws,
        inertia=inertia,
    ))  # fmt: skip


def from_dh(
    table: Mapping[str, ArrayLike] | Sequence[Mapping[str, float]] | ArrayLike,
    *,
    convention: Literal["standard", "modified"] = "standard",
    columns: Sequence[str] | None = None,
    joint_types: str | Sequence[str] = "revolute",
    masses: ArrayLike | None = None,
    coms: ArrayLike | None = None,
    moments_about_com: ArrayLike | None = None,
    tool: ArrayLike | None = None,
    joint_names: Sequence[str] | None = None,
    name: str = "dh",
    gravity: ArrayLike = GRAVITY,
    inertia: Inertia = "error",
) -> Robot:
    """Robot from Denavit–Hartenberg parameters: a serial chain of n joints.

    Parameters
    ----------
    table : {column: (n,)}, n such rows, or (n, 4) array_like with ``columns`` [m, rad]
        ``{"theta": …, "d": …, "a": …, "alpha": …}``; omitted columns are zero.
    convention : "standard" or "modified", as in the notes
    columns : sequence of str, optional, order of the columns of an array, such as ``("theta", "d", "a", "alpha")``
        Required with an array, since books differ in the order.
    joint_types : str or n of them, ``"revolute"`` or ``"prismatic"``; one name applies to all joints
    masses : (n,) array_like, optional [kg]
    coms : (n, 3) array_like, optional, in link frame {i} [m]
    moments_about_com : (n, 3, 3) array_like, optional, about the centre of mass along the axes of {i} [kg m²]
    tool : (4, 4) array_like, optional, pose in {n}
    name : str, the robot's name

    Returns
    -------
    robot : Robot
        Frames are ``link0`` … ``linkn``, and ``tool`` if given; the last is the tip.

    Warns
    -----
    ModelWarning
        An angle exceeds 2π and is probably in degrees.

    Notes
    -----
    Row i is the pose of link frame {i} in {i-1}:

    - ``convention="standard"``: Rot_z(theta_i) Trans_z(d_i) Trans_x(a_i) Rot_x(alpha_i). Frame {i} is at the distal end
      of link i; joint i turns about z of {i-1}. (Corke, Siciliano, Spong.)
    - ``convention="modified"``: Rot_x(alpha) Trans_x(a) Rot_z(theta_i) Trans_z(d_i); row i holds alpha_{i-1} and
      a_{i-1}, of the link *before* the joint. Frame {i} is at joint i, which turns about z of {i}. (Craig; Modern
      Robotics, appendix C.)

    The joint coordinate q_i is added to theta_i (``"revolute"``) or d_i (``"prismatic"``); the table's entry is the
    offset. Omitted masses, centres of mass and moments are zero. In the standard convention the moving bodies are
    ``axis1`` … ``axisn``, with frames on the joint axes and z along them; links are fixed to them. Joint wrenches are
    in these frames.

    Examples
    --------
    >>> import numpy as np, twistwrench as tw
    >>> arm = tw.from_dh({"a": [1.0, 1.0]}, masses=[1, 1], gravity=(0, -9.81, 0))   # the planar 2R arm
    >>> np.round(arm.gravity_forces([0, 0]), 2).tolist()                         # gravity along z would give zeros
    [29.43, 9.81]
    >>> np.round(arm.forward_kinematics([0, np.pi / 2])[:3, 3], 12).tolist()
    [1.0, 1.0, 0.0]
    >>> scara = {"theta": [0, 0, 0, 0], "d": [0.4, 0, 0, 0], "a": [0, 0.3, 0.25, 0], "alpha": [0, 0, np.pi, 0]}
    >>> types = ["revolute", "revolute", "prismatic", "revolute"]
    >>> tw.from_dh(scara, convention="modified", joint_types=types).nv
    4
    """
    from ..formats import dh

    return Robot(dh.from_dh(
        table, convention=convention, columns=columns, joint_types=joint_types, masses=masses, coms=coms,
        moments_about_com=moments_about_com, tool=tool, joint_names=joint_names, name=name, gravity=gravity, inertia=inertia,
    ))  # fmt: skip


# ── Robots from models of other libraries, read by their attributes


def from_mujoco(model: Any, *, floating_base: bool | None = None, **options: Unpack[BuildOptions]) -> Robot:
    """Robot from a model compiled by MuJoCo.

    For MJCF features that :func:`load` does not support, such as ``replicate`` and ``attach``:
    ``tw.from_mujoco(mujoco.MjSpec.from_file(path).compile())``. Reads bodies, joints, sites, keyframes, effort limits
    of actuators, springs of fixed tendons, and the equality constraints that :func:`load` supports. Unnamed joints are
    named as by :func:`load`.

    Parameters
    ----------
    model : mujoco.MjModel; its attributes are read, nothing is imported
    floating_base : bool, optional, as for :func:`load`: True adds a free joint if there is none, False fixes floating bodies
        in place; None: as in the model
    **options : ``lock``, ``tip``, ``mimic``, ``inertia``, ``snap``, ``gravity``, as for :func:`load`

    Warns
    -----
    ModelWarning
        A tendon, an actuator or a constraint is ignored in part, or a loop is left open.

    Examples
    --------
    >>> import twistwrench as tw
    >>> tw.from_mujoco("scene.xml")
    Traceback (most recent call last):
    twistwrench.core.errors.ModelError: this is not a model of MuJoCo's: str lacks an attribute ...
    """
    from ..formats.mujoco_model import read_mujoco_model

    builder, floating = read_mujoco_model(model, floating_base)
    return Robot(builder.build(floating_base=floating, **options))


def from_pinocchio(model: Any, *, floating_base: bool | None = None, **options: Unpack[BuildOptions]) -> Robot:
    """Robot from a Pinocchio model.

    Reads joints, inertias, limits, friction, armature, gravity and reference configurations. Body frames become links;
    operational and sensor frames become sites. q is in the depth-first order of :func:`twistwrench.load`;
    :mod:`twistwrench.robot.convert` converts. A composite joint becomes one joint per part, ``NAME.0``, ``NAME.1``, …; mimic
    joints follow. Pinocchio's models lack the mass of links fixed to the base.

    Parameters
    ----------
    model : pinocchio.Model; its attributes are read, nothing is imported
    floating_base : bool, optional, as for :func:`load`: True adds a free joint if there is none, False fixes floating bodies
        in place; None: as in the model
    **options : ``lock``, ``tip``, ``mimic``, ``inertia``, ``snap``, ``gravity``, as for :func:`load`

    Examples
    --------
    >>> import twistwrench as tw
    >>> tw.from_pinocchio("arm.urdf")
    Traceback (most recent call last):
    twistwrench.core.errors.ModelError: this is not a model of Pinocchio's: str lacks an attribute ...
    """
    from ..formats.pinocchio_model import read_pinocchio_model

    builder, floating = read_pinocchio_model(model, floating_base)
    return Robot(builder.build(floating_base=floating, **options))


complete(globals())
