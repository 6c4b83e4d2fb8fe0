"""Bundled robots: small files without meshes, each with the source of its parameters.

>>> from twistwrench import robots
>>> robots.names()[:3]
('cart_pole', 'floating_box', 'panda')
"""

from __future__ import annotations

import warnings
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from ..core.errors import ModelWarning, UnknownNameError
from ..core.glossary import complete

if TYPE_CHECKING:
    from ..robot import Robot
    from ..robot.load import LoadOptions
    from .known_robots import KnownRobots

__all__ = [
    "cart_pole",
    "floating_box",
    "known",
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
"""Folder of the bundled robots."""


def names() -> tuple[str, ...]:
    """List the names of the bundled robots, sorted.

    Returns
    -------
    names : tuple of str

    Examples
    --------
    >>> len(names())
    8
    """
    return tuple(sorted(path.stem for path in _FOLDER.glob("*.urdf")))


def known(word: str = "") -> KnownRobots:
    """Robots known by name: bundled, or from installed packages.

    Parameters
    ----------
    word : str, optional, selects by name, and bundled robots also by description

    Returns
    -------
    known : KnownRobots

    Raises
    ------
    UnknownNameError
        No robot has the word in its name.

    Examples
    --------
    >>> known("quadruped").bundled
    ('quadruped',)
    """
    from .known_robots import KnownRobots

    return KnownRobots.from_word(word)


def path_of(name: str) -> Path:
    """File of a bundled robot.

    Parameters
    ----------
    name : str

    Returns
    -------
    path : Path of a URDF file

    Examples
    --------
    >>> path_of("ur5").name
    'ur5.urdf'
    """
    if name not in names():
        raise UnknownNameError.from_choices("bundled robot", name, names())
    return _FOLDER / f"{name}.urdf"


def _load(name: str, **options: Unpack[LoadOptions]) -> Robot:
    """Load a bundled robot."""
    # Imported here, as importing the list of robots must not load the computing modules.
    from ..robot import load

    with warnings.catch_warnings():
        # Point masses of the books are intended and documented in the files; other warnings are shown.
        warnings.filterwarnings("ignore", message=".*as a point mass has", category=ModelWarning)
        return load(path_of(name), **options)


def ur5(**options: Unpack[LoadOptions]) -> Robot:
    """Universal Robots UR5, six revolute joints, tip ``tool0``.

    Parameters
    ----------
    **options : as for :func:`twistwrench.load`

    Notes
    -----
    Source: ROS-Industrial package ur_description; velocities from the data sheet.

    Examples
    --------
    >>> ur5().nv
    6
    """
    return _load("ur5", **options)


def panda(**options: Unpack[LoadOptions]) -> Robot:
    """Franka Emika Panda, seven revolute joints, with hand, fingers closed, tip ``panda_hand_tcp``.

    Parameters
    ----------
    **options : as for :func:`twistwrench.load`

    Notes
    -----
    Source: ROS package franka_description; inertias identified by Gaz et al., IEEE RA-L 4(4), 2019.

    Examples
    --------
    >>> panda().tip
    'panda_hand_tcp'
    """
    return _load("panda", **options)


def planar_2r(**options: Unpack[LoadOptions]) -> Robot:
    """2R arm of the book in a vertical plane: point masses of 1 kg at the ends of links of 1 m.

    Parameters
    ----------
    **options : as for :func:`twistwrench.load`

    Notes
    -----
    Source: Modern Robotics, section 8.1.1, with the book's angles. Gravity acts along -z of the base frame, which is -y
    of the book's drawing.

    Examples
    --------
    >>> planar_2r().joint_names
    ('joint1', 'joint2')
    """
    return _load("planar_2r", **options)


def planar_3r(**options: Unpack[LoadOptions]) -> Robot:
    """3R arm in a vertical plane: three uniform cylinders, 1 kg, 1 m long, 20 mm in radius.

    Parameters
    ----------
    **options : as for :func:`twistwrench.load`

    Examples
    --------
    >>> planar_3r().nv
    3
    """
    return _load("planar_3r", **options)


def pendulum(**options: Unpack[LoadOptions]) -> Robot:
    """Mathematical pendulum, 1 kg at 1 m, hanging down at zero: τ = q̈ + 9.81 sin q.

    Parameters
    ----------
    **options : as for :func:`twistwrench.load`

    Examples
    --------
    >>> pendulum().gravity_forces([0.0]).tolist()
    [0.0]
    """
    return _load("pendulum", **options)


def cart_pole(**options: Unpack[LoadOptions]) -> Robot:
    """Cart and pole, upright at zero: cart 1 kg, uniform pole 0.1 kg and 1 m long.

    Parameters
    ----------
    **options : as for :func:`twistwrench.load`

    Notes
    -----
    Source: Barto, Sutton and Anderson, IEEE Trans. Systems, Man, and Cybernetics 13(5), 1983.

    Examples
    --------
    >>> cart_pole().nv
    2
    """
    return _load("cart_pole", **options)


def floating_box(**options: Unpack[LoadOptions]) -> Robot:
    """Uniform free box of 6 kg, 0.3 m × 0.2 m × 0.1 m, on a floating base.

    Parameters
    ----------
    **options : as for :func:`twistwrench.load`

    Examples
    --------
    >>> box = floating_box()
    >>> box.nq, box.nv
    (7, 6)
    """
    options.setdefault("floating_base", True)
    return _load("floating_box", **options)


def quadruped(**options: Unpack[LoadOptions]) -> Robot:
    """Quadruped of 15 kg with twelve revolute joints on a floating base.

    Parameters
    ----------
    **options : as for :func:`twistwrench.load`

    Notes
    -----
    Source: the Unitree Go2 of the ROS package go2_description, without the rotors of its motors.

    Examples
    --------
    >>> quadruped().nv
    18
    """
    options.setdefault("floating_base", True)
    return _load("quadruped", **options)


def __getattr__(name: str) -> Any:
    """Bundled robot by a name in another case, such as ``UR5``; for other names, an error that lists the robots."""
    if name.startswith("_"):
        raise AttributeError(name)
    if name.lower() in names():
        return globals()[name.lower()]
    similar_names = get_close_matches(name, names(), n=1, cutoff=0.6)
    hint = f" Did you mean {similar_names[0]}?" if similar_names else ""
    raise AttributeError(
        f"no bundled robot {name!r}.{hint} There are {', '.join(names())}; tw.find({name!r}) looks in other packages, and "
        "tw.load takes a file."
    )


def __dir__() -> list[str]:
    return [*__all__]


complete(globals())
