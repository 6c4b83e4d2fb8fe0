"""A robot as a file of another format."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from typing import Any

from ..errors import MissingExtraError, ModelError, ModelWarning
from ..model.remark import frames_to_user, grouped


class FileMethods:
    """The methods of a robot that write it."""

    def to_urdf(self: Any) -> str:
        """URDF text of the robot: every link with its own inertia, fixed joints too.

        Returns
        -------
        text : str

        Raises
        ------
        ModelError
            A screw axis is not of unit length, which no robot file can say.

        Warns
        -----
        ModelWarning
            The format cannot say something of the robot, such as armature and springs; :func:`twistwrench.save` lists it.

        Notes
        -----
        Looks and shapes are not kept by a robot, and are not written.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> tw.load(arm.to_urdf()).mass_matrix([0, 0]).tolist() == arm.mass_matrix([0, 0]).tolist()
        True
        """
        return _text(self, "urdf")

    def to_mjcf(self: Any) -> str:
        """MJCF text of the robot: each moving body with the inertia of all that is fixed to it, other links as empty bodies.

        Returns
        -------
        text : str

        Raises
        ------
        ModelError
            A screw axis is not of unit length, or a joint floats in the middle of the tree.

        Warns
        -----
        ModelWarning
            The format cannot say something of the robot, such as limits of velocity; :func:`twistwrench.save` lists it.

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> bool(np.allclose(tw.load(arm.to_mjcf()).mass_matrix([0, 0]), arm.mass_matrix([0, 0])))
        True
        """
        return _text(self, "mjcf")

    def to_sdf(self: Any) -> str:
        """SDF text of the robot: every link with its own inertia; fixed links without mass become frames.

        Returns
        -------
        text : str

        Raises
        ------
        ModelError
            A screw axis is not of unit length, or a joint floats in the middle of the tree.

        Warns
        -----
        ModelWarning
            The format cannot say something of the robot, such as keyframes; :func:`twistwrench.save` lists it.

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> bool(np.allclose(tw.load(arm.to_sdf()).mass_matrix([0, 0]), arm.mass_matrix([0, 0])))
        True
        """
        return _text(self, "sdf")

    def to_mujoco(self: Any) -> Any:
        """MuJoCo's model of the robot, compiled from :meth:`to_mjcf`.

        Returns
        -------
        model : mujoco.MjModel

        Raises
        ------
        MissingExtraError
            MuJoCo is not installed.
        ModelError
            The format has no words for how the robot moves, or MuJoCo refuses its bodies: those that cannot exist, and
            moving ones without mass.

        Warns
        -----
        ModelWarning
            The format cannot say something of the robot.

        Notes
        -----
        :func:`twistwrench.convert.to_mujoco` translates states.

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.planar_3r().to_mujoco().nv  # doctest: +SKIP
        3
        """
        try:
            import mujoco
        except ImportError:
            raise MissingExtraError.of("mujoco", "peers", "A model of MuJoCo's") from None
        text = _text(self, "mjcf")
        try:
            return mujoco.MjModel.from_xml_string(text)
        except ValueError as refusal:
            raise ModelError(f"MuJoCo refuses robot {self.name!r}: {' '.join(str(refusal).split())}.") from None

    def to_pinocchio(self: Any) -> Any:
        """Pinocchio's model of the robot, made joint by joint.

        Returns
        -------
        model : pinocchio.Model

        Raises
        ------
        MissingExtraError
            Pinocchio is not installed.
        ModelError
            A joint is none of Pinocchio's.

        Warns
        -----
        ModelWarning
            Such a model cannot say something of the robot, such as springs.

        Notes
        -----
        :func:`twistwrench.convert.to_pinocchio` translates states. Joints that follow others are joints of their own there.

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.ur5().to_pinocchio().nv  # doctest: +SKIP
        6
        """
        from ..formats.writers.pinocchio import pinocchio_of

        model, lost = pinocchio_of(self.model)
        _warn(self.name, "a model of Pinocchio's", lost)
        return model


def _text(robot: Any, form: str) -> str:
    from ..formats.writers import WRITERS

    written = WRITERS[form](robot.model)
    _warn(robot.name, form.upper(), written.lost)
    return written.text


def _warn(name: str, form: str, lost: Iterable[str]) -> None:
    for said in grouped(lost):
        warnings.warn(f"robot {name!r} as {form}: {said}.", ModelWarning, stacklevel=frames_to_user())
