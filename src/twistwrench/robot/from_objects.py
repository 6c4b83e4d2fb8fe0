"""Robots from models that other libraries hold, by their attributes: none of them is imported."""

from __future__ import annotations

from typing import Any, Unpack

from .load import BuildOptions
from .robot import Robot


def from_mujoco(model: Any, **options: Unpack[BuildOptions]) -> Robot:
    """Robot from a model that MuJoCo has compiled.

    Parameters
    ----------
    model : mujoco.MjModel; its attributes are read, and nothing is imported
    **options : ``lock``, ``tip``, ``mimic``, ``inertia``, ``snap``, ``gravity``, as for :func:`load`

    Returns
    -------
    robot : Robot

    Raises
    ------
    ModelError
        It is no such model.
    InertiaError
        A moving body cannot exist.
    UnknownNameError
        ``lock`` or ``tip`` names nothing of the robot.

    Warns
    -----
    ModelWarning
        A tendon, an actuator or a constraint says something that is left out, or a loop is left open.

    Notes
    -----
    For what :func:`load` does not read of MJCF files, such as ``replicate`` and ``attach``:
    ``tw.from_mujoco(mujoco.MjSpec.from_file(path).compile())``. Bodies, joints, sites and keyframes are those of the
    model, and so are the effort limits of actuators, the springs of fixed tendons, and equality constraints as :func:`load`
    has them. Joints without a name are called as :func:`load` calls them.

    Examples
    --------
    >>> import twistwrench as tw
    >>> tw.from_mujoco("scene.xml")
    Traceback (most recent call last):
    twistwrench.errors.ModelError: this is no model of MuJoCo's: str has not what one has ...
    """
    from ..formats.mujoco_model import read_mujoco_model

    return Robot(read_mujoco_model(model).build(**options))


def from_pinocchio(model: Any, **options: Unpack[BuildOptions]) -> Robot:
    """Robot from a model of Pinocchio's.

    Parameters
    ----------
    model : pinocchio.Model; its attributes are read, and nothing is imported
    **options : ``lock``, ``tip``, ``mimic``, ``inertia``, ``snap``, ``gravity``, as for :func:`load`

    Returns
    -------
    robot : Robot

    Raises
    ------
    ModelError
        It is no such model.
    InertiaError
        A moving body cannot exist.
    UnknownNameError
        ``lock`` or ``tip`` names nothing of the robot.

    Notes
    -----
    Joints, inertias, limits, friction, armature, gravity, reference configurations; bodies' frames are links, operational and
    sensor frames are sites. q is in the order of :func:`twistwrench.load`, depth first, and
    :mod:`twistwrench.convert` translates. A composite joint is one joint for each of its parts, ``NAME.0``, ``NAME.1``, …;
    mimic joints follow. Pinocchio gives its files' mass of fixed links to no joint.

    Examples
    --------
    >>> import twistwrench as tw
    >>> tw.from_pinocchio("arm.urdf")
    Traceback (most recent call last):
    twistwrench.errors.ModelError: this is no model of Pinocchio's: str has not what one has ...
    """
    from ..formats.pinocchio_model import read_pinocchio_model

    return Robot(read_pinocchio_model(model).build(**options))
