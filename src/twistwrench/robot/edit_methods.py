"""Edits of a robot: each returns another robot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..errors import ShapeError
from .task_space_methods import require_robot

if TYPE_CHECKING:
    from ..bodies.inertia import SpatialInertia
    from .robot import Robot


class EditMethods:
    """The methods of a robot that give another one."""

    def with_payload(self: Any, payload: SpatialInertia, frame: str | None = None) -> Robot:
        """The robot with a payload: a body fixed to one of its frames.

        Parameters
        ----------
        payload : SpatialInertia, in the axes of the frame and about its origin
        frame : str, optional, a link of the robot; its tip if None

        Returns
        -------
        robot : Robot

        Raises
        ------
        ShapeError
            ``payload`` is no SpatialInertia.
        InertiaError
            Such a body cannot exist.
        UnknownNameError
            The robot has no such frame.
        FrameError
            No frame is named, and the robot has no single tip.

        Examples
        --------
        >>> import twistwrench as tw
        >>> ur5 = tw.robots.ur5()
        >>> loaded = ur5.with_payload(tw.SpatialInertia.from_com(5.0, (0, 0, 0.1)), frame="tool0")
        >>> bool(abs(loaded.gravity_forces(ur5.neutral)[1]) > abs(ur5.gravity_forces(ur5.neutral)[1]))
        True
        """
        from ..bodies.inertia import SpatialInertia
        from ..model import edit

        if not isinstance(payload, SpatialInertia):
            raise ShapeError(
                f"a payload is a SpatialInertia, got {arguments.shown(payload)}: for a point mass, "
                "tw.SpatialInertia.from_com(mass, com)."
            )
        return self._of_model(edit.with_payload(self.model, payload, frame))

    def with_gravity(self: Any, gravity: ArrayLike) -> Robot:
        """The robot under another gravity.

        Parameters
        ----------
        gravity : (3,) array_like, in the base frame [m/s²]

        Returns
        -------
        robot : Robot

        Raises
        ------
        ShapeError, ValueRangeError
            ``gravity`` is no three finite numbers.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> arm.with_gravity([0, 0, -1.62]).gravity_forces([0, 0]).round(2).tolist()
        [4.86, 1.62]
        """
        from ..model import edit

        return self._of_model(edit.with_gravity(self.model, gravity))

    def with_actuators(self: Any, source: str | Path | Mapping[str, Any], *, stiff: bool = False) -> Robot:
        """The robot with motors, gears, rotors, elastic joints and friction laws.

        Parameters
        ----------
        source : str, Path or mapping, a YAML file, its text, or what it says; docs/actuation.md shows the file
        stiff : bool, take elastic gears to be rigid, so that no motor has a coordinate of its own, and warn of it

        Returns
        -------
        robot : Robot

        Raises
        ------
        NotFoundError, ModelError, UnknownNameError
            There is no such file, or an entry, which is named, is invalid.

        Warns
        -----
        ModelWarning
            Elastic gears are taken to be rigid.

        Examples
        --------
        >>> import twistwrench as tw
        >>> drives = {"actuators": {"joint1": {"ratio": 100, "rotor": {"inertia": "200 g cm^2", "extra": True}}}}
        >>> arm = tw.robots.planar_2r()
        >>> float((arm.with_actuators(drives).mass_matrix([0, 0]) - arm.mass_matrix([0, 0]))[0, 0].round(9))
        0.2
        """
        from ..formats.actuators import add_actuators

        return self._of_model(add_actuators(self.model, source, stiff=stiff))

    def with_armature(self: Any, joints: Mapping[str, ArrayLike]) -> Robot:
        """The robot with other armature (reflected inertia of the drives) at the joints named.

        Parameters
        ----------
        joints : {joint: armature} [kg m², sliding joints: kg]; joints with several velocities take one number, or one each

        Returns
        -------
        robot : Robot

        Raises
        ------
        UnknownNameError
            The robot has no such joint.
        ShapeError, ValueRangeError
            ``joints`` is no mapping, or a value is no inertia.

        Notes
        -----
        A rotor of inertia J behind a gear of ratio G has the armature G² J. It is part of every torque, energy and
        acceleration, and has no weight and no gyroscopic effect; a rotor described to :meth:`with_actuators` has those too.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r().with_armature({"joint2": 0.5})
        >>> arm.armature.tolist(), float(arm.mass_matrix([0, 0])[1, 1].round(9))
        ([0.0, 0.5], 1.5)
        """
        if not isinstance(joints, Mapping):
            raise ShapeError(f"with_armature takes a dict {{joint: kg m² or kg}}, got {joints!r}.")
        from ..model import edit

        return self._of_model(edit.with_armature(self.model, joints))

    def lock(self: Any, joints: Mapping[str, float | Sequence[float]]) -> Robot:
        """The robot with some joints fixed at given coordinates.

        Parameters
        ----------
        joints : {joint: position} [rad, m], as many numbers as the joint has coordinates

        Returns
        -------
        robot : Robot, without these joints

        Raises
        ------
        ShapeError
            ``joints`` is no mapping, or a joint has another number of coordinates.
        UnknownNameError
            The robot has no such joint.

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.planar_3r().lock({"joint2": 0.5}).joint_names
        ('joint1', 'joint3')
        """
        if not isinstance(joints, Mapping):
            raise ShapeError(f"lock takes a dict {{joint: position}}, got {joints!r}.")
        from ..model import edit

        return self._of_model(edit.lock(self.model, joints))

    def attach(
        self: Any, other: Robot, frame: str | None = None, pose: ArrayLike | None = None, *, prefix: str = ""
    ) -> Robot:
        """The robot with another one fixed to a frame of it, such as a gripper on an arm.

        Parameters
        ----------
        other : Robot, whose base is fixed; of a floating base the joint that lets it float goes
        frame : str, optional, where; the robot's tip if None
        pose : (4, 4) array_like, optional, of the other's base in that frame; None: the identity
        prefix : str, put before the names of the other's links, joints and sites

        Returns
        -------
        robot : Robot
            Its coordinates are depth first, as those of a file: the other's after what the frame's body carries already.

        Raises
        ------
        ModelError
            Both have a link or a joint of one name; a prefix keeps them apart.
        UnknownNameError
            The robot has no such frame.
        FrameError
            No frame is named, and the robot has no single tip.
        ShapeError, ValueRangeError
            ``pose`` is no pose.

        Notes
        -----
        Gravity is this robot's. Configurations of one name become one; where one robot has none of a name, it is neutral.
        The result is written to a file as any robot is.

        Examples
        --------
        >>> import twistwrench as tw
        >>> both = tw.robots.ur5().attach(tw.robots.planar_2r(), "tool0", prefix="hand_")
        >>> both.joint_names[-3:]
        ('wrist_3_joint', 'hand_joint1', 'hand_joint2')
        """
        from ..model import joining

        T = np.eye(4) if pose is None else arguments.pose(pose, "attach: pose")
        return self._of_model(joining.attach(self.model, require_robot(other, "attach").model, frame, T, prefix))

    def chain(self: Any, base: str | None = None, tip: str | None = None) -> Robot:
        """A part of the robot by itself: what a link carries, or the chain of joints between it and a tip.

        Parameters
        ----------
        base : str, optional, the link that stands still then, and whose frame is the base frame; None: the robot's own base
        tip : str, optional, frame; None: everything that the base carries

        Returns
        -------
        robot : Robot
            Of the links fixed to the base those that it carries belong to the part, and of those fixed to the chain all.

        Raises
        ------
        UnknownNameError
            The robot has no such link or frame.
        FrameError
            The base does not carry the tip.
        ModelError
            A joint of the part follows one outside, or a rotor of it is on a link outside.

        Notes
        -----
        Gravity is as the base feels it with every joint of the robot neutral. To keep what branches off, lock its joints
        first: :meth:`lock`.

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.ur5().chain("forearm_link").joint_names
        ('wrist_1_joint', 'wrist_2_joint', 'wrist_3_joint')
        >>> tw.robots.quadruped().chain("trunk", "FL_foot").nv
        3
        """
        from ..model import joining

        return self._of_model(joining.chain(self.model, base, tip))
