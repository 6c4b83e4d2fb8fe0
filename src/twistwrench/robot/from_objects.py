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


def from_drake(plant: Any, **options: Unpack[BuildOptions]) -> Robot:
    """Robot from a plant of Drake's.

    Parameters
    ----------
    plant : pydrake MultibodyPlant, finalised; its attributes are read, and nothing is imported
    **options : ``lock``, ``tip``, ``mimic``, ``inertia``, ``snap``, ``gravity``, as for :func:`load`

    Returns
    -------
    robot : Robot

    Raises
    ------
    ModelError
        It is no such object, or a joint of it is none here.
    InertiaError
        A moving body cannot exist.
    UnknownNameError
        ``lock`` or ``tip`` names nothing of the robot.

    Warns
    -----
    ModelWarning
        Constraints, springs and other force elements are left out.

    Notes
    -----
    Bodies, joints, limits, damping, actuators with their reflected inertia, frames and gravity, of all models of the plant;
    a name that several models have is written ``model::name``. Universal joints are two, ``NAME.0`` and ``NAME.1``.
    :func:`twistwrench.convert.to_drake` translates states.

    Examples
    --------
    >>> import twistwrench as tw
    >>> tw.from_drake("arm.urdf")
    Traceback (most recent call last):
    twistwrench.errors.ModelError: this is no plant of Drake's: str has not what one has ...
    """
    from ..formats.drake_plant import read_drake_plant

    return Robot(read_drake_plant(plant).build(**options))


def from_rtb(robot: Any, **options: Unpack[BuildOptions]) -> Robot:
    """Robot from one of the Robotics Toolbox for Python.

    Parameters
    ----------
    robot : roboticstoolbox DHRobot or Robot; its attributes are read, and nothing is imported
    **options : ``lock``, ``tip``, ``mimic``, ``inertia``, ``snap``, ``gravity``, as for :func:`load`

    Returns
    -------
    robot : Robot

    Raises
    ------
    ModelError
        It is no such object, or a joint of it is none here.
    InertiaError
        A moving body cannot exist.
    UnknownNameError
        ``lock`` or ``tip`` names nothing of the robot.

    Warns
    -----
    ModelWarning
        Coulomb friction that differs either way is averaged.

    Notes
    -----
    Of a ``DHRobot`` frames are ``link0`` … ``linkn`` and ``tool``, joints ``joint1`` … ``jointn``, standard and modified
    conventions alike. Of a ``Robot`` joints are called as the links that they carry. Motor inertia becomes armature, Jm G², and
    motor friction B G² and Tc G. Gravity is taken as the vector of the toolbox, which points down.

    Examples
    --------
    >>> import twistwrench as tw
    >>> tw.from_rtb("arm.urdf")
    Traceback (most recent call last):
    twistwrench.errors.ModelError: this is no robot of the Robotics Toolbox: str has not what one has ...
    """
    from ..formats.rtb_robot import read_rtb_robot

    return Robot(read_rtb_robot(robot).build(**options))
