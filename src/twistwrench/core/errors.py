"""All errors and warnings of the library.

::

    TwistWrenchError
    ├── ModelError (ValueError)             an invalid robot description
    │   ├── RobotFileError                  not readable as a robot file
    │   └── InertiaError                    a physically impossible inertia
    ├── ShapeError (ValueError)             an argument of the wrong shape
    ├── ValueRangeError (ValueError)        an argument outside the allowed range
    ├── UnknownNameError (KeyError)         an unknown joint, link, frame or quantity
    ├── FrameError (ValueError)             frames that do not match, or a missing frame
    ├── ConstraintError (ValueError)        constraints that are dependent, cannot be met, or are not met
    ├── PathError (ValueError)              a path that the robot cannot follow; has the feasible part
    ├── SingularMassMatrixError (ValueError)    forward dynamics of a robot whose mass matrix has no inverse
    ├── TrajectoryError (ValueError)        a motion file that cannot be used
    ├── SimulationError (RuntimeError)      a simulation that stopped; ``.result`` has the computed part
    ├── NotFoundError (FileNotFoundError)   a missing file
    ├── KernelError (RuntimeError)          compiled code could not be made or used
    └── MissingExtraError (ImportError)     an optional package is not installed

    CacheWarning (UserWarning)              compiled code cannot be cached
    ConstraintWarning (UserWarning)         a singular configuration of constraints, a closed one far from the start,
                                            or a path beyond position limits
    ModelWarning (UserWarning)              a doubtful entry in a robot file; the robot still loads
    ShapeWarning (UserWarning)              an array whose shape has two meanings

Each message names the cause, the allowed values, and a remedy.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, NoReturn

from .glossary import complete
from .text import Argument, bounded_message, listed, shorten, visible, with_arguments
from .version import ON_INDEX

__all__ = [
    "CacheWarning",
    "ConstraintError",
    "ConstraintWarning",
    "FrameError",
    "InertiaError",
    "KernelError",
    "MissingExtraError",
    "ModelError",
    "ModelWarning",
    "NotFoundError",
    "PathError",
    "RobotFileError",
    "ShapeError",
    "ShapeWarning",
    "SimulationError",
    "SingularMassMatrixError",
    "TrajectoryError",
    "TwistWrenchError",
    "UnknownNameError",
    "ValueRangeError",
]


_MAX_LISTED_CHOICES = 40
"""Largest number of known names in a message."""


class HintedClass(type):
    """Metaclass of public classes. The error for a missing attribute (``Robot.from_urdf``) names the call to use instead."""

    if not TYPE_CHECKING:  # so that type checkers reject these names too

        def __getattr__(cls, name: str) -> NoReturn:
            """Raise AttributeError with the call from the table of first calls."""
            is_field = name in cls.__annotations__  # the dataclass decorator looks for its default
            if name.startswith("_") or is_field:
                raise AttributeError(f"type object {cls.__name__!r} has no attribute {name!r}", name=name, obj=cls)
            from .first_calls import missing_class_attribute

            raise missing_class_attribute(cls, name)


class TwistWrenchError(Exception):
    """Base class of all errors raised by the library.

    Arguments after the text replace its placeholders ``{0}``, ``{1}`` …. ``str(error)`` spells them as in Python, and
    ``in_shell`` as options of a command.
    """

    def __str__(self) -> str:
        return self._message()

    def in_shell(self) -> str:
        """Message with the options of a command in place of Python's arguments.

        Returns
        -------
        text : str

        Examples
        --------
        >>> from twistwrench.core.text import Argument
        >>> error = TwistWrenchError("several episodes: 0 to 1. Choose one: {0}.", Argument("episode", 0))
        >>> print(error, error.in_shell()[-16:])
        several episodes: 0 to 1. Choose one: episode=0. ne: --episode 0.
        """
        return self._message(shell=True)

    def _message(self, *, shell: bool | None = None) -> str:
        """Message with its arguments spelled for the shell or for Python; with None, for the one that runs the program."""
        # bounded and visible: names from a file may have thousands of characters, some of which control a terminal
        text, *arguments = self.args or ("",)
        if not all(isinstance(argument, Argument) for argument in arguments):
            return bounded_message(visible(super().__str__()))
        # not super().__str__(), which for a KeyError is the repr of its text, with quotes and escapes
        message = with_arguments(str(text), arguments, shell=shell)
        return bounded_message(visible(message))


class ModelError(TwistWrenchError, ValueError):
    """Invalid robot description: no root, a cycle, a zero axis, or reversed limits."""


class RobotFileError(ModelError):
    """Text that cannot be read as a robot file."""


class InertiaError(ModelError):
    """Physically impossible inertia of a moving body."""


class ShapeError(TwistWrenchError, ValueError):
    """Array argument of the wrong shape."""


class ValueRangeError(TwistWrenchError, ValueError):
    """Argument outside the allowed range."""


class UnknownNameError(TwistWrenchError, KeyError):
    """Name that the robot does not have."""

    @classmethod
    def from_choices(cls, kind: str, name: object, choices: Iterable[str], similarity: float = 0.5) -> UnknownNameError:
        """Error for an unknown name, with a list of choices, nearest spelling first.

        Parameters
        ----------
        kind : str, kind of the name
        name : the unknown name
        choices : iterable of str
        similarity : float, least similarity of a suggested name, 0 to 1

        Examples
        --------
        >>> print(UnknownNameError.from_choices("joint", "elbo", ["elbow", "wrist"]))
        no joint named 'elbo'. Did you mean 'elbow'? Known: elbow, wrist.
        """
        import difflib

        known_names = list(dict.fromkeys(choices))
        if isinstance(name, str):  # without the repr of a subclass
            name = str(name)
        similar_names = difflib.get_close_matches(shorten(str(name)), known_names, n=3, cutoff=similarity)
        hint = ""
        if similar_names:
            suggestions = " or ".join(repr(shorten(similar_name)) for similar_name in similar_names)
            hint = f" Did you mean {suggestions}?"
        choices_text = listed(known_names, _MAX_LISTED_CHOICES) or "(none)"
        return cls(f"no {kind} named {shorten(repr(name))}.{hint} Known: {choices_text}.")


class FrameError(TwistWrenchError, ValueError):
    """Frames that do not match, or a required frame that is not named."""


class ConstraintError(TwistWrenchError, ValueError):
    """Constraints that are dependent, that no configuration meets, or that a given state does not meet."""


class PathError(TwistWrenchError, ValueError):
    """Path that the robot cannot follow, with its feasible part.

    Parameters
    ----------
    message : str
    reached : float, optional, feasible path parameter
    partial : optional, feasible part of the path
    """

    def __init__(self, message: str, *, reached: float | None = None, partial: object = None) -> None:
        super().__init__(message)
        self.reached = reached
        """Path parameter, from 0 to 1, up to which the robot can follow."""
        self.partial = partial
        """Part computed so far, a :class:`~twistwrench.trajectories.JointPath`; None if there is none."""


class SingularMassMatrixError(TwistWrenchError, ValueError):
    """Mass matrix without an inverse, so that torques do not determine accelerations."""


class TrajectoryError(TwistWrenchError, ValueError):
    """Motion file that cannot be used."""


class SimulationError(TwistWrenchError, RuntimeError):
    """Simulation that stopped, such as at an unstable step or a failed controller; ``result`` has the computed part."""

    result: object = None
    """The :class:`~twistwrench.simulation.SimulationResult` up to the time of the error."""


class NotFoundError(TwistWrenchError, FileNotFoundError):
    """File that does not exist."""


class KernelError(TwistWrenchError, RuntimeError):
    """Machine code that could not be made, or a kernel that does not support the request."""


class MissingExtraError(TwistWrenchError, ImportError):
    """Missing optional package; the message names the extra."""

    @classmethod
    def from_extra(cls, package: str, extra: str, purpose: str) -> MissingExtraError:
        """Error for a package installed by an extra.

        Parameters
        ----------
        package : str
        extra : str, extra that installs the package
        purpose : str, what the package is needed for

        Examples
        --------
        >>> str(MissingExtraError.from_extra("matplotlib", "plot", "Drawing")).startswith("Drawing")
        True
        """
        return cls(f"{purpose} needs {package!r}, which is not installed: {cls.advice(extra)}.")

    @staticmethod
    def advice(extra: str) -> str:
        """Command that installs an extra in a checkout, and from a package index if this version is on one.

        Parameters
        ----------
        extra : str

        Examples
        --------
        >>> MissingExtraError.advice("plot")
        "pip install -e '.[plot]' in a checkout of twistwrench"
        """
        checkout = f"pip install -e '.[{extra}]' in a checkout of twistwrench"
        if ON_INDEX:
            return f"{checkout}, or pip install 'twistwrench[{extra}]'"
        return checkout


class CacheWarning(UserWarning):
    """Compiled code that cannot be cached, for a reason that the user can remove."""


class ConstraintWarning(UserWarning):
    """Doubtful constraints: a singular configuration, or loops closed or paths far from where they should be.

    At a singular configuration the constraint forces are not unique. Loops may close only far from the start, or a path
    may exceed the position limits of joints.
    """


class ModelWarning(UserWarning):
    """Doubtful entry in a robot file; the robot loads, and ``robot.defects`` keeps the remark."""


class ShapeWarning(UserWarning):
    """Array whose shape has two meanings: six vectors in rows, or a matrix (6, 6)."""


complete(globals())
