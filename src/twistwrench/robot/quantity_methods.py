"""One method for each quantity.

Shapes in docstrings are those of one state; any leading batch shape is allowed, and batch shapes broadcast as in NumPy.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Generic

from numpy.typing import ArrayLike

from ..core.errors import UnknownNameError
from ..core.glossary import complete
from ..core.typing import Array
from .arguments import Kind, Wrenches, refuse_base, values_at
from .base import Motion, Slopes, Torques
from .derivatives import DerivativeMethods

if TYPE_CHECKING:
    from ..mechanics.lie.twist_wrench import Wrench


class QuantityMethods(DerivativeMethods[Slopes], Generic[Motion, Torques, Slopes]):
    """Methods for the quantities of a robot: kinematics, dynamics, statics, energies and their derivatives."""

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
        """Difference of configurations, q1 ⊖ q0: joint twists dv for which ``add(q0, dv)`` has the pose of q1.

        Parameters
        ----------
        q1, q0 : (nq,) array_like, configurations

        Returns
        -------
        dv : (nv,) array, joint twists times unit time [rad, m], along the shorter rotation
        """
        return self._call("subtract", q1, q0, out=out)

    # ── kinematics ──

    def forward_kinematics(self, q: ArrayLike, frame: str | None = None, *, out: Any = None) -> Array:
        """Forward kinematics: T_s,frame, the pose of a frame in the base frame {s}. MR section 4.1.

        Returns
        -------
        T : (4, 4) array, homogeneous transform [m]

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> np.round(arm.forward_kinematics([0, np.pi / 2])[:3, 3], 12).tolist()
        [1.0, 0.0, 1.0]
        """
        return self._call("forward_kinematics", q, frame=frame, out=out)

    def link_poses(self, q: ArrayLike, *, out: Any = None) -> Array:
        """Forward kinematics of all links: T_s,link, each in the base frame {s}.

        Returns
        -------
        T : (nlinks, 4, 4) array, homogeneous transforms [m], in the order of :attr:`link_names`
        """
        return self._call("link_poses", q, out=out)

    def jacobian(self, q: ArrayLike, frame: str | None = None, kind: Kind = "body", *, out: Any = None) -> Array:
        """Geometric Jacobian J of a frame, with twist V = J dq (omega, v). MR eq. 5.11 (space), 5.18 (body).

        Parameters
        ----------
        kind : "body", "space" or "world_aligned"
            ``"body"``: the twist in the frame itself; ``"space"``: at the base origin, with the base's axes;
            ``"world_aligned"``: at the frame's origin, with the base's axes.

        Returns
        -------
        J : (6, nv) array, angular rows first [rad, m per unit of q]

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
        """
        return self._call("jacobian_rate", q, dq, frame=frame, kind=kind, out=out)

    def frame_velocity(
        self, q: ArrayLike, dq: ArrayLike, frame: str | None = None, kind: Kind = "body", *, out: Any = None
    ) -> Array:
        """Velocity of a frame: its twist (omega, v) = J dq.

        Returns
        -------
        V : (6,) array, twist [rad/s, m/s], in the axes and about the point of ``kind``
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
        """Acceleration of a frame: time derivative dV/dt of its twist, without gravity.

        The six components of the twist are differentiated one by one. Except for ``kind="world_aligned"``, the acceleration
        of a body point has the additional term ω × v.

        Returns
        -------
        dV : (6,) array, d/dt of :meth:`frame_velocity` [rad/s², m/s²]
        """
        return self._call("frame_acceleration", q, dq, ddq, frame=frame, kind=kind, out=out)

    # ── dynamics ──

    def inverse_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        actuated: Iterable[str] | None = None,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        friction: bool = False,
        out: Any = None,
    ) -> Torques:
        """Inverse dynamics: joint torques τ = M q̈ + h + Σ J'F_by - Σ J'F_on of a motion.

        Newton-Euler recursion, MR eq. 8.54. With constraints, τ = M q̈ + h + A'λ + … of the ``actuated`` joints and λ, for
        a motion that satisfies them; with more motors than degrees of freedom, τ has minimal norm.

        Parameters
        ----------
        friction : bool, add the torque that overcomes the friction of all joints, driven or not
            With constraints, load-dependent friction is evaluated at the tree's torques.

        Returns
        -------
        tau : (nv,) array, joint torques [N m, sliding joints: N]
            With constraints ConstrainedTorques: ``tau``, zero at the other joints, and ``lam`` (k,) [N m, N].

        Raises
        ------
        ConstraintError
            q, dq or ddq violates the constraints, see :meth:`forward_dynamics`, or the motors cannot produce the
            motion.

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> robot = tw.robots.planar_2r()
        >>> np.round(robot.inverse_dynamics([0, 0], [0, 0], [0, 0]), 2).tolist()
        [29.43, 9.81]
        """
        options: dict[str, Any] = {"friction": True} if friction else {}
        if actuated is not None:
            options["actuated"] = self._motors(actuated)
        return self._with_wrenches("inverse_dynamics", (q, dq, ddq), wrench_by_robot, wrench_on_robot, out, **options)

    def forward_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        tau: ArrayLike,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        friction: bool = False,
        out: Any = None,
    ) -> Motion:
        """Forward dynamics: joint accelerations q̈ = M⁻¹ (τ - h - Σ J'F_by + Σ J'F_on) under torques. MR section 8.5.

        With constraints, q̈ and λ of τ = M q̈ + h + A'λ + Σ J'F_by - Σ J'F_on, A q̈ + (dA/dt) dq = 0:
        λ = (A M⁻¹ A')⁻¹ (A M⁻¹ (τ - h) + (dA/dt) dq), of minimal norm if A loses rank. MR section 8.7.

        Parameters
        ----------
        friction : bool, subtract the joints' friction from τ; a joint at rest is assumed to slide without friction

        Returns
        -------
        ddq : (nv,) array, joint accelerations [rad/s², m/s²]
            With constraints ConstrainedMotion: ``ddq`` and ``lam`` (k,) [N m, N], rows as in :attr:`row_names`.

        Raises
        ------
        SingularMassMatrixError
            A joint moves no inertia, so that M has no inverse.
        ConstraintError
            A gap of the loops at q exceeds 0.01 (rad, or times the joints' lever), or over a tenth of dq violates the
            constraints.

        Warns
        -----
        ConstraintWarning
            The configuration of the constraints is singular.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> arm.forward_dynamics([0, 0], [0, 0], [30.43, 9.81]).round(12).tolist()
        [1.0, -2.0]
        """
        options = {"friction": True} if friction else {}
        return self._with_wrenches("forward_dynamics", (q, dq, tau), wrench_by_robot, wrench_on_robot, out, **options)

    def mass_matrix(self, q: ArrayLike, *, out: Any = None) -> Array:
        """Mass matrix M (joint-space inertia), symmetric and full. MR eq. 8.57.

        Returns
        -------
        M : (nv, nv) array [kg m², sliding joints: kg]
        """
        return self._call("mass_matrix", q, out=out)

    def bias_forces(self, q: ArrayLike, dq: ArrayLike, *, out: Any = None) -> Array:
        """Bias forces h = c + g: joint torques τ at q̈ = 0. MR section 8.1.2.

        Returns
        -------
        h : (nv,) array [N m, sliding joints: N]
        """
        return self._call("bias_forces", q, dq, out=out)

    def coriolis_forces(self, q: ArrayLike, dq: ArrayLike, *, out: Any = None) -> Array:
        """Coriolis and centripetal torques c, the velocity-product terms. MR section 8.1.2.

        Returns
        -------
        c : (nv,) array [N m, sliding joints: N]
        """
        return self._call("coriolis_forces", q, dq, out=out)

    def coriolis_matrix(self, q: ArrayLike, dq: ArrayLike, *, out: Any = None) -> Array:
        """Coriolis matrix C, with C dq = c and dM/dt - 2C skew-symmetric.

        For joints with one degree of freedom, C follows from the Christoffel symbols. MR section 8.1.2.

        Returns
        -------
        C : (nv, nv) array [N m s, sliding joints: N s]
        """
        return self._call("coriolis_matrix", q, dq, out=out)

    def christoffel(self, q: ArrayLike, *, out: Any = None) -> Array:
        """Christoffel symbols of the first kind Γ_ijk of the mass matrix: c_i = Σ Γ_ijk dq_j dq_k. MR eq. 8.12.

        Returns
        -------
        gamma : (nv, nv, nv) array [kg m², sliding joints: kg; per rad or m]

        Raises
        ------
        ValueRangeError
            The robot has planar, ball or floating joints, whose rates are not derivatives of coordinates.
        """
        return self._call("christoffel", q, out=out)

    def gravity_forces(self, q: ArrayLike, *, out: Any = None) -> Array:
        """Gravity torques g that hold the robot at rest against gravity. MR section 8.1.2.

        Returns
        -------
        g : (nv,) array [N m, sliding joints: N]
        """
        return self._call("gravity_forces", q, out=out)

    def friction_forces(self, dq: ArrayLike, *, load: ArrayLike | None = None, out: Any = None) -> Array:
        """Joint friction: the torques that overcome it at the velocities dq.

        MR section 8.9.4. At rest, friction can take any value up to static friction; this method returns 0.

        Parameters
        ----------
        load : (nv,) array_like, optional, torques carried by the joints, for load-dependent friction

        Returns
        -------
        tau : (nv,) array, joint torques [N m, sliding joints: N]

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> rough = arm.with_actuators({"actuators": {"joint1": {"friction": {"viscous": "0.5 N m s/rad"}}}})
        >>> rough.friction_forces([2.0, 2.0]).tolist()
        [1.0, 0.0]
        """
        if load is None:
            return self._call("friction_forces", dq, out=out)
        return self._call("friction_under_load", dq, load, out=out)

    def regressor(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike, *, out: Any = None) -> Array:
        """Regressor Y of the inertial parameters: τ = Y π, π being :attr:`parameters`.

        The equation of motion is linear in π, MR section 8.2. Torques of springs and friction are not included.

        Returns
        -------
        Y : (nv, 10 nbodies) array, ten columns for each moving body
        """
        return self._call("regressor", q, dq, ddq, out=out)

    def drive_torques(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        out: Any = None,
    ) -> tuple[Array, Array]:
        """Torques in the drives, referred to the joints: the part through the gears, and the part that accelerates the rotors.

        Their sum is τ. Divided by the gear ratio G, they are the book's τ_gear / G and the rotor's part of τ_motor. MR
        section 8.9.3.

        Parameters
        ----------
        out : pair of arrays, optional, takes the results

        Returns
        -------
        gear : (nv,) array, torques through the gears [N m, sliding joints: N]
        rotor : (nv,) array, torques that turn the rotors [N m, sliding joints: N]

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> drives = {"actuators": {"joint1": {"ratio": 100, "rotor": {"inertia": "200 g cm^2", "extra": True}}}}
        >>> gear, rotor = arm.with_actuators(drives).drive_torques([0, 0], [0, 0], [1, 0])
        >>> rotor.round(9).tolist()
        [0.2, 0.0]
        """
        return self._with_wrenches("drive_torques", (q, dq, ddq), wrench_by_robot, wrench_on_robot, out)

    # ── statics ──

    def wrench_torques(
        self, q: ArrayLike, wrench_by_robot: ArrayLike | Wrench, frame: str | None = None, *, out: Any = None
    ) -> Array:
        """Joint torques of a single wrench, τ = J_b' F (Jacobian transpose). MR eq. 5.26.

        Parameters
        ----------
        wrench_by_robot : (6,) array_like or Wrench, (m, f) the robot applies at the frame, in its axes [N m, N]
            A labelled wrench acts at the frame of its label, on the link that carries it.

        Returns
        -------
        tau : (nv,) array, joint torques [N m, sliding joints: N]

        Raises
        ------
        FrameError
            No frame is given and the robot has no single tip; or the wrench is labelled with another frame, or with one of
            the base.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> arm.wrench_torques([0, 0], [0, 0, 0, 0, 10.0, 0]).round(12).tolist()
        [20.0, 10.0]
        """
        from ..mechanics.lie.twist_wrench import Wrench

        if isinstance(wrench_by_robot, Wrench):
            frame = wrench_by_robot.frame if frame is None else frame
            F: Any = values_at(wrench_by_robot, frame)
            refuse_base(self.model, frame)
        else:
            F = wrench_by_robot
        return self._call("wrench_torques", q, F, frame=frame, out=out)

    def holding_torques(
        self,
        q: ArrayLike,
        actuated: Iterable[str] | None = None,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        out: Any = None,
    ) -> Torques:
        """Holding torques of static equilibrium, g + Σ J'F_by - Σ J'F_on, including springs. MR section 5.2.

        With constraints, :meth:`inverse_dynamics` at rest.

        Returns
        -------
        tau : (nv,) array, joint torques [N m, sliding joints: N]
            With constraints ConstrainedTorques: ``tau``, zero at the other joints, and ``lam`` (k,) [N m, N].

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> arm.holding_torques([0, 0], wrench_on_robot={arm.tip: [0, 0, 0, 0, 0, 9.81]}).round(2).tolist()
        [29.43, 9.81]
        """
        options = {} if actuated is None else {"actuated": self._motors(actuated)}
        return self._with_wrenches("holding_torques", (q,), wrench_by_robot, wrench_on_robot, out, **options)

    def joint_wrenches(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        actuated: Iterable[str] | None = None,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        out: Any = None,
    ) -> Array:
        """Wrenches across the joints (bearing loads), received by each moving body across its joint.

        With constraints, they are the wrenches in the tree, with λ of :meth:`inverse_dynamics` on both links of each
        closure. The joint of the closure itself carries λ.

        Returns
        -------
        F : (nbodies, 6) array, (m, f) [N m, N], each in the frame of its body, in the order of :attr:`body_names`
        """
        options = {} if actuated is None else {"actuated": self._motors(actuated)}
        return self._with_wrenches("joint_wrenches", (q, dq, ddq), wrench_by_robot, wrench_on_robot, out, **options)

    # ── energies, momentum, centre of mass ──

    def kinetic_energy(self, q: ArrayLike, dq: ArrayLike, *, out: Any = None) -> Any:
        """Kinetic energy of the moving bodies, ½ dq' M dq. MR section 8.1.2.

        Returns
        -------
        K : () [J]
        """
        return self._call("kinetic_energy", q, dq, out=out)

    def potential_energy(self, q: ArrayLike, *, out: Any = None) -> Any:
        """Potential energy of the moving bodies under gravity; zero if their centre of mass is at the base origin.

        Returns
        -------
        P : () [J]
        """
        return self._call("potential_energy", q, out=out)

    def momentum(self, q: ArrayLike, dq: ArrayLike, frame: str = "base", *, out: Any = None) -> Array:
        """Spatial momentum (angular, linear) of the moving bodies, at the base origin or about the centre of mass.

        Parameters
        ----------
        frame : "base": at the base origin; "com": about the centre of mass (centroidal momentum), in base axes

        Returns
        -------
        P : (6,) array, in the axes of the base frame [N m s, N s]

        Raises
        ------
        ValueRangeError
            No moving body has mass, and ``frame`` is "com".
        """
        if frame not in ("base", "com"):
            raise UnknownNameError.from_choices("momentum frame", frame, ("base", "com"))
        quantity = "momentum" if frame == "base" else "momentum_about_com"
        return self._call(quantity, q, dq, out=out)

    def center_of_mass(self, q: ArrayLike, *, out: Any = None) -> Array:
        """Centre of mass of the moving bodies in the base frame.

        Returns
        -------
        com : (3,) array [m]

        Raises
        ------
        ValueRangeError
            No moving body has mass.
        """
        return self._call("center_of_mass", q, out=out)

    def com_jacobian(self, q: ArrayLike, *, out: Any = None) -> Array:
        """Jacobian of the centre of mass: d(center_of_mass)/dt = J dq.

        Returns
        -------
        J : (3, nv) array, in the axes of the base frame [m per unit of q]

        Raises
        ------
        ValueRangeError
            No moving body has mass.
        """
        return self._call("com_jacobian", q, out=out)


complete(globals())
