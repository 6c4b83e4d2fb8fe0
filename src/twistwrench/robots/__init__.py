"""Bundled robots: small files without meshes, each with the source of its figures.

>>> from twistwrench import robots
>>> robots.names()[:3]
('cart_pole', 'floating_box', 'panda')
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import ModelWarning, UnknownNameError

if TYPE_CHECKING:
    from ..robot import Robot

__all__ = [
    "cart_pole",
    "floating_box",
    "names",
    "panda",
    "path_of",
    "pendulum",
    "planar_2r",
    "planar_3r",
    "quadruped",
    "ur5",
]

_FOLDER = Path(__file__).parent


def names() -> tuple[str, ...]:
    """The names of the bundled robots, sorted."""
    return tuple(sorted(path.stem for path in _FOLDER.glob("*.urdf")))


def path_of(name: str) -> Path:
    """The file of a bundled robot; raises :class:`~twistwrench.UnknownNameError` listing the names."""
    if name not in names():
        raise UnknownNameError.of("bundled robot", name, names())
    return _FOLDER / f"{name}.urdf"


def _load(name: str, **options: Any) -> Robot:
    # Importing a list of robots loads none of what computes with them.
    from ..robot import load

    with warnings.catch_warnings():
        # The books' point masses are meant as such, and said to be in the files; other remarks come through.
        warnings.filterwarnings("ignore", message=".*as a point mass has", category=ModelWarning)
        return load(path_of(name), **options)


def ur5(**options: Any) -> Robot:
    """Universal Robots UR5, six revolute joints, tip ``tool0``; options as for :func:`twistwrench.load`.

    Source: ROS-Industrial package ur_description; velocities from the data sheet.
    """
    return _load("ur5", **options)


def panda(**options: Any) -> Robot:
    """Franka Emika Panda, seven revolute joints, hand on, fingers closed, tip ``panda_hand_tcp``; options as for load.

    Source: ROS package franka_description; inertias identified by Gaz et al., IEEE RA-L 4(4), 2019.
    """
    return _load("panda", **options)


def planar_2r(**options: Any) -> Robot:
    """The book's 2R arm in a vertical plane: point masses of 1 kg at the ends of links of 1 m; options as for load.

    Source: Modern Robotics, section 8.1.1; the angles are the book's, and gravity acts along -z of the base frame,
    which is -y of the book's drawing.
    """
    return _load("planar_2r", **options)


def planar_3r(**options: Any) -> Robot:
    """A 3R arm in a vertical plane: three uniform cylinders, 1 kg, 1 m long, 20 mm in radius; options as for load."""
    return _load("planar_3r", **options)


def pendulum(**options: Any) -> Robot:
    """The mathematical pendulum, 1 kg at 1 m, hanging down at zero: τ = q̈ + 9.81 sin q; options as for load."""
    return _load("pendulum", **options)


def cart_pole(**options: Any) -> Robot:
    """The cart and pole, upright at zero: cart 1 kg, uniform pole 0.1 kg and 1 m long; options as for load.

    Source: Barto, Sutton and Anderson, IEEE Trans. Systems, Man, and Cybernetics 13(5), 1983.
    """
    return _load("cart_pole", **options)


def floating_box(**options: Any) -> Robot:
    """A uniform free box of 6 kg, 0.3 m × 0.2 m × 0.1 m, on a floating base; options as for load."""
    return _load("floating_box", **{"floating_base": True, **options})


def quadruped(**options: Any) -> Robot:
    """A quadruped of 15 kg with twelve revolute joints on a floating base; options as for load.

    Source: the Unitree Go2 of the ROS package go2_description, its motors' rotors left out.
    """
    return _load("quadruped", **{"floating_base": True, **options})
