"""Every error and warning of the library, in one tree.

::

    TwistWrenchError
    ├── ModelError (ValueError)             an invalid robot description
    │   ├── RobotFileError                  not readable as a robot file
    │   └── InertiaError                    a body that cannot exist
    ├── ShapeError (ValueError)             an argument of the wrong shape
    ├── ValueRangeError (ValueError)        an argument outside what is allowed
    ├── UnknownNameError (KeyError)         a joint, link, frame or quantity that is not there
    ├── FrameError (ValueError)             frames that do not match, or none where one is needed
    ├── ConstraintError (ValueError)        constraints that depend on each other, cannot be met, or are not met
    ├── PathError (ValueError)              a path that the robot cannot follow, with how far it could
    ├── SingularMassMatrixError (ValueError)    forward dynamics of a robot whose mass matrix has no inverse
    ├── TrajectoryError (ValueError)        a motion file that cannot be used
    ├── SimulationError (RuntimeError)      a simulation that could not go on; ``.result`` has all that was computed
    ├── NotFoundError (FileNotFoundError)   a file that is not there
    ├── KernelError (RuntimeError)          compiled code could not be made or used
    └── MissingExtraError (ImportError)     an optional package is not installed

    CacheWarning (UserWarning)              compiled code cannot be kept for the next time
    ConstraintWarning (UserWarning)         a singular configuration of constraints, a closed one far from the start, or a path
                                            beyond the positions of joints
    ModelWarning (UserWarning)              a robot file has a doubtful entry; the robot still loads

Each message names the offender, what is allowed, and what to try.
"""

from __future__ import annotations

from collections.abc import Iterable

from .core.glossary import complete
from .core.text import clipped, listed

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
    "SimulationError",
    "SingularMassMatrixError",
    "TrajectoryError",
    "TwistWrenchError",
    "UnknownNameError",
    "ValueRangeError",
]


class TwistWrenchError(Exception):
    """Root of every error the library raises on purpose."""

    def __str__(self) -> str:
        # KeyError would print the repr of its argument, quotes and escapes included.
        return str(self.args[0]) if len(self.args) == 1 else super().__str__()


class ModelError(TwistWrenchError, ValueError):
    """An invalid robot description: no root, a cycle, a zero axis, reversed limits."""


class RobotFileError(ModelError):
    """Text that cannot be read as a robot file at all."""


class InertiaError(ModelError):
    """The inertia of a moving body is one that no real body has."""


class ShapeError(TwistWrenchError, ValueError):
    """An array argument has the wrong shape."""


class ValueRangeError(TwistWrenchError, ValueError):
    """An argument has a value outside the allowed range."""


class UnknownNameError(TwistWrenchError, KeyError):
    """A name that the robot does not have."""

    @classmethod
    def from_choices(cls, kind: str, name: object, choices: Iterable[str]) -> UnknownNameError:
        """Error for an unknown name, listing the choices, nearest spelling first.

        Parameters
        ----------
        kind : str, what the name is of
        name : what was given
        choices : iterable of str

        Examples
        --------
        >>> print(UnknownNameError.from_choices("joint", "elbo", ["elbow", "wrist"]))
        no joint named 'elbo'. Did you mean 'elbow'? Known: elbow, wrist.
        """
        import difflib

        known, text = list(choices), repr(str(name) if isinstance(name, str) else name)
        text = clipped(text)
        near = difflib.get_close_matches(clipped(str(name)), known, n=3, cutoff=0.5)
        hint = f" Did you mean {' or '.join(repr(clipped(n)) for n in near)}?" if near else ""
        return cls(f"no {kind} named {text}.{hint} Known: {listed(known, 40) or '(none)'}.")


class FrameError(TwistWrenchError, ValueError):
    """Frames that do not match, or a frame that must be named and is not."""


class ConstraintError(TwistWrenchError, ValueError):
    """Constraints that depend on each other, that no configuration meets, or that a given state does not meet."""


class PathError(TwistWrenchError, ValueError):
    """A path that the robot cannot follow; it has the part up to there.

    Parameters
    ----------
    message : str
    reached : float, optional, how far along the path
    partial : optional, what was found until there
    """

    def __init__(self, message: str, *, reached: float | None = None, partial: object = None) -> None:
        super().__init__(message)
        self.reached = reached
        """The path's parameter, from 0 to 1, up to which it can be followed."""
        self.partial = partial
        """Part computed so far, a :class:`~twistwrench.trajectories.JointPath`; None if there is none."""


class SingularMassMatrixError(TwistWrenchError, ValueError):
    """The mass matrix has no inverse, so accelerations do not follow from torques."""


class TrajectoryError(TwistWrenchError, ValueError):
    """A motion file that cannot be used as it is."""


class SimulationError(TwistWrenchError, RuntimeError):
    """A simulation that stopped: an unstable step, a controller that failed. ``result`` has everything up to there."""

    result: object = None
    """The :class:`~twistwrench.simulation.SimulationResult` up to the time of the error."""


class NotFoundError(TwistWrenchError, FileNotFoundError):
    """A file does not exist."""


class KernelError(TwistWrenchError, RuntimeError):
    """Machine code could not be made, or a kernel does not support the request."""


class MissingExtraError(TwistWrenchError, ImportError):
    """An optional package is needed and not installed; the message names the extra."""

    @classmethod
    def from_extra(cls, package: str, extra: str, purpose: str) -> MissingExtraError:
        """Error for a package that an extra brings.

        Parameters
        ----------
        package : str
        extra : str, which brings it
        purpose : str, what it is needed for

        Examples
        --------
        >>> str(MissingExtraError.from_extra("matplotlib", "plot", "Drawing")).startswith("Drawing")
        True
        """
        return cls(f"{purpose} needs {package!r}, which is not installed: {cls.advice(extra)}.")

    @staticmethod
    def advice(extra: str) -> str:
        """Command that installs an extra, from an index and from a checkout.

        Parameters
        ----------
        extra : str

        Examples
        --------
        >>> MissingExtraError.advice("plot")
        "pip install 'twistwrench[plot]', or in a checkout pip install -e '.[plot]'"
        """
        return f"pip install 'twistwrench[{extra}]', or in a checkout pip install -e '.[{extra}]'"


class CacheWarning(UserWarning):
    """Compiled code cannot be cached, for a reason that can be removed."""


class ConstraintWarning(UserWarning):
    """Constraints met in a doubtful way: a singular configuration, or loops or paths far from where they should be.

    Forces are then one choice of many; loops closed only far from the start; or a path leads beyond the positions that
    joints can take.
    """


class ModelWarning(UserWarning):
    """A robot file has a doubtful entry; the robot loads, and ``robot.defects`` keeps the remark."""


complete(globals())
