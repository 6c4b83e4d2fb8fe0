"""Methods for configurations and kinematics. Shapes are those of one state; any leading batch shape goes."""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike

from ..core.glossary import complete
from ..typing import Array
from .arguments import Kind
from .base import RobotBase


class KinematicsMethods(RobotBase):
    """Methods for configurations, poses, Jacobians, velocities and accelerations of frames."""

    # ── configurations ──

    def add(self, q: ArrayLike, dv: ArrayLike, *, out: Any = None) -> Array:
        """Configuration plus joint twists, q ⊕ dv: each joint moves along its constant twist for unit time.

        Parameters
        ----------
        dv : (nv,) array_like, joint twists times unit time [rad, m]
            Planar, ball and floating joints may turn by up to 32768 rad.

        Returns
        -------
        q : (nq,) array, configuration

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.floating_box().add([1, 0, 0, 0, 0, 0, 0], [0, 0, 0, 1, 2, 3]).tolist()
        [1.0, 0.0, 0.0, 0.0, 1.0, 2.0, 3.0]
        """
        return self._call("add", q, dv, out=out)

    def subtract(self, q1: ArrayLike, q0: ArrayLike, *, out: Any = None) -> Array:
        """Difference of configurations, q1 ⊖ q0: the dv with ``add(q0, dv)`` at the pose of q1.

        Parameters
        ----------
        q1, q0 : (nq,) array_like, configurations

        Returns
        -------
        dv : (nv,) array, joint twists times unit time [rad, m], turning the short way

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.floating_box().subtract([1, 0, 0, 0, 1, 2, 3], [1, 0, 0, 0, 0, 0, 0]).tolist()
        [0.0, 0.0, 0.0, 1.0, 2.0, 3.0]
        """
        return self._call("subtract", q1, q0, out=out)

    # ── kinematics ──

    def forward_kinematics(self, q: ArrayLike, frame: str | None = None, *, out: Any = None) -> Array:
        """Forward kinematics: T_s,frame, the pose of a frame in the base frame {s}.

        Returns
        -------
        T : (4, 4) array, homogeneous transform [m]

        Notes
        -----
        MR section 4.1.

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> np.round(arm.forward_kinematics([0, np.pi / 2])[:3, 3], 12).tolist()
        [1.0, 0.0, 1.0]
        """
        return self._call("forward_kinematics", q, frame=frame, out=out)

    def link_poses(self, q: ArrayLike, *, out: Any = None) -> Array:
        """Forward kinematics of all links at once: T_s,link, each in the base frame {s}.

        Returns
        -------
        T : (nlinks, 4, 4) array, homogeneous transforms [m], in the order of :attr:`link_names`

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> arm.link_poses([0, 0]).shape == (len(arm.link_names), 4, 4)
        True
        """
        return self._call("link_poses", q, out=out)

    def jacobian(self, q: ArrayLike, frame: str | None = None, kind: Kind = "body", *, out: Any = None) -> Array:
        """Geometric Jacobian J of a frame, with V = J dq its twist (omega, v).

        Parameters
        ----------
        kind : "body", "space" or "world_aligned"
            ``"body"``: the twist in the frame itself; ``"space"``: at the base origin, with the base's axes;
            ``"world_aligned"``: at the frame's origin, with the base's axes.

        Returns
        -------
        J : (6, nv) array, angular rows first [rad, m per unit of q]

        Notes
        -----
        MR eq. 5.11 (space), 5.18 (body).

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> arm.jacobian([0, 0]).round(12)[[2, 4]].tolist()
        [[1.0, 1.0], [2.0, 1.0]]
        """
        return self._call("jacobian", q, frame=frame, kind=kind, out=out)

    def jacobian_rate(
        self, q: ArrayLike, dq: ArrayLike, frame: str | None = None, kind: Kind = "body", *, out: Any = None
    ) -> Array:
        """Time derivative dJ/dt of the Jacobian, as in dV/dt = J ddq + (dJ/dt) dq.

        Returns
        -------
        dJ : (6, nv) array, d/dt of :meth:`jacobian`, angular rows first

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> arm.jacobian_rate([0, np.pi / 2], [0, 1]).round(12)[4].tolist()
        [-1.0, 0.0]
        """
        return self._call("jacobian_rate", q, dq, frame=frame, kind=kind, out=out)

    def frame_velocity(
        self, q: ArrayLike, dq: ArrayLike, frame: str | None = None, kind: Kind = "body", *, out: Any = None
    ) -> Array:
        """Velocity of a frame: its twist (omega, v) = J dq.

        Returns
        -------
        V : (6,) array, twist [rad/s, m/s], in the axes and about the point that ``kind`` says

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> arm.frame_velocity([0, 0], [0, 1], kind="world_aligned").round(12).tolist()
        [0.0, -1.0, 0.0, 0.0, 0.0, 1.0]
        """
        return self._call("frame_velocity", q, dq, frame=frame, kind=kind, out=out)

    def frame_acceleration(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        frame: str | None = None,
        kind: Kind = "body",
        *,
        out: Any = None,
    ) -> Array:
        """Acceleration of a frame: the rate dV/dt of its twist, gravity not included.

        Returns
        -------
        dV : (6,) array, d/dt of :meth:`frame_velocity` [rad/s², m/s²]

        Notes
        -----
        The rate of a twist's six numbers: the acceleration of a body's point has ω × v beside it, unless ``kind`` is
        ``"world_aligned"``.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> arm.frame_acceleration([0, 0], [1, 0], [0, 0], kind="world_aligned").round(12)[3].item()
        -2.0
        """
        return self._call("frame_acceleration", q, dq, ddq, frame=frame, kind=kind, out=out)


complete(globals())
