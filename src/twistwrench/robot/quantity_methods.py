"""One method for each quantity.

Shapes in docstrings are those of one state; any leading batch shape goes, and batch shapes broadcast as NumPy's do.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from ..core.glossary import complete
from ..errors import UnknownNameError
from ..typing import Array
from .arguments import Wrenches
from .derivatives import DerivativeMethods
from .kinematics_methods import KinematicsMethods

if TYPE_CHECKING:
    from ..lie.twist_wrench import Wrench


class QuantityMethods(KinematicsMethods, DerivativeMethods):
    """Methods for the quantities of a robot: kinematics, dynamics, statics, energies and their derivatives.

    Shapes are those of one state; any leading batch shape goes, and batch shapes broadcast as NumPy's do.
    """

    # ── dynamics ──

    def inverse_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        friction: bool = False,
        out: Any = None,
    ) -> Array:
        """Inverse dynamics: joint torques τ = M q̈ + h + Σ J'F_by - Σ J'F_on of a motion.

        Parameters
        ----------
        friction : bool, add the torque that overcomes the joints' friction

        Returns
        -------
        tau : (nv,) array, joint torques [N m, sliding joints: N]

        Notes
        -----
        Newton-Euler recursion, MR eq. 8.54.

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> robot = tw.robots.planar_2r()
        >>> np.round(robot.inverse_dynamics([0, 0], [0, 0], [0, 0]), 2).tolist()
        [29.43, 9.81]
        """
        how = {"friction": True} if friction else {}
        given = q, dq, ddq
        return self._with_wrenches("inverse_dynamics", given, wrench_by_robot, wrench_on_robot, out, **how)

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
    ) -> Array:
        """Forward dynamics: joint accelerations q̈ = M⁻¹ (τ - h - Σ J'F_by + Σ J'F_on) under torques.

        Parameters
        ----------
        friction : bool, take what the joints' friction costs off τ first; a joint at rest is taken to slide freely

        Returns
        -------
        ddq : (nv,) array, joint accelerations [rad/s², m/s²]

        Raises
        ------
        SingularMassMatrixError
            A joint moves nothing with inertia, so that M has no inverse.

        Notes
        -----
        MR section 8.5.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> arm.forward_dynamics([0, 0], [0, 0], [30.43, 9.81]).round(12).tolist()
        [1.0, -2.0]
        """
        how = {"friction": True} if friction else {}
        given = q, dq, tau
        return self._with_wrenches("forward_dynamics", given, wrench_by_robot, wrench_on_robot, out, **how)

    def mass_matrix(self, q: ArrayLike, *, out: Any = None) -> Array:
        """Mass matrix M (joint-space inertia), symmetric and full.

        Returns
        -------
        M : (nv, nv) array [kg m², sliding joints: kg]

        Notes
        -----
        MR eq. 8.57.

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> arm.mass_matrix([0, np.pi / 2]).round(12).tolist()
        [[3.0, 1.0], [1.0, 1.0]]
        """
        return self._call("mass_matrix", q, out=out)

    def bias_forces(self, q: ArrayLike, dq: ArrayLike, *, out: Any = None) -> Array:
        """Bias forces h = c + g: what remains of the joint torques τ at q̈ = 0.

        Returns
        -------
        h : (nv,) array [N m, sliding joints: N]

        Notes
        -----
        MR section 8.1.2.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> arm.bias_forces([0, 0], [0, 0]).round(2).tolist()
        [29.43, 9.81]
        """
        return self._call("bias_forces", q, dq, out=out)

    def coriolis_forces(self, q: ArrayLike, dq: ArrayLike, *, out: Any = None) -> Array:
        """Coriolis and centripetal torques c, the velocity-product terms.

        Returns
        -------
        c : (nv,) array [N m, sliding joints: N]

        Notes
        -----
        MR section 8.1.2.

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> arm.coriolis_forces([0, np.pi / 2], [0, 1]).round(12).tolist()
        [-1.0, 0.0]
        """
        return self._call("coriolis_forces", q, dq, out=out)

    def coriolis_matrix(self, q: ArrayLike, dq: ArrayLike, *, out: Any = None) -> Array:
        """Coriolis matrix C, with C dq = c and dM/dt - 2C skew-symmetric.

        Returns
        -------
        C : (nv, nv) array [N m s, sliding joints: N s]

        Notes
        -----
        On one-degree joints it is the one of the Christoffel symbols. MR section 8.1.2.

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> arm.coriolis_matrix([0, np.pi / 2], [0, 1]).round(12).tolist()
        [[-1.0, -1.0], [0.0, 0.0]]
        """
        return self._call("coriolis_matrix", q, dq, out=out)

    def christoffel(self, q: ArrayLike, *, out: Any = None) -> Array:
        """Christoffel symbols of the first kind Γ_ijk of the mass matrix: c_i = Σ Γ_ijk dq_j dq_k.

        Returns
        -------
        gamma : (nv, nv, nv) array [kg m², sliding joints: kg; per rad or m]

        Raises
        ------
        ValueRangeError
            The robot has planar, ball or floating joints, whose rates are not derivatives of coordinates.

        Notes
        -----
        MR eq. 8.12.

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> arm.christoffel([0, np.pi / 2])[0].round(12).tolist()
        [[0.0, -1.0], [-1.0, -1.0]]
        """
        return self._call("christoffel", q, out=out)

    def gravity_forces(self, q: ArrayLike, *, out: Any = None) -> Array:
        """Gravity torques g, which hold the robot at rest against gravity.

        Returns
        -------
        g : (nv,) array [N m, sliding joints: N]

        Notes
        -----
        MR section 8.1.2.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> arm.gravity_forces([0, 0]).round(2).tolist()
        [29.43, 9.81]
        """
        return self._call("gravity_forces", q, out=out)

    def friction_forces(self, dq: ArrayLike, *, load: ArrayLike | None = None, out: Any = None) -> Array:
        """Joint friction: the torques that overcome it at the velocities dq.

        Parameters
        ----------
        load : (nv,) array_like, optional, torques the joints carry, for friction that grows with them

        Returns
        -------
        tau : (nv,) array, joint torques [N m, sliding joints: N]

        Notes
        -----
        MR section 8.9.4. At rest friction may be anything up to the static one, and the law gives 0.

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

        Returns
        -------
        Y : (nv, 10 nbodies) array, ten columns for each moving body

        Notes
        -----
        The equation of motion is linear in π, MR section 8.2. Springs and friction are apart.

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> Y = arm.regressor([0, 0], [0, 0], [0, 0])
        >>> np.round(Y @ arm.parameters, 2).tolist()
        [29.43, 9.81]
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
        """Torques in the drives, referred to the joints: the part through the gears, and the part of the rotors before them.

        Parameters
        ----------
        out : pair of arrays, optional, takes the results

        Returns
        -------
        gear : (nv,) array, torques through the gears [N m, sliding joints: N]
        rotor : (nv,) array, torques that turn the rotors [N m, sliding joints: N]

        Notes
        -----
        They add up to τ. Divided by the ratio they are the book's τ_gear / G and the rotor's own part of τ_motor. MR
        section 8.9.3.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> drives = {"actuators": {"joint1": {"ratio": 100, "rotor": {"inertia": "200 g cm^2", "extra": True}}}}
        >>> gear, rotor = arm.with_actuators(drives).drive_torques([0, 0], [0, 0], [1, 0])
        >>> rotor.round(9).tolist()
        [0.2, 0.0]
        """
        carried, rotor = self._with_wrenches("drive_torques", (q, dq, ddq), wrench_by_robot, wrench_on_robot, out)
        return carried, rotor

    # ── statics ──

    def wrench_torques(
        self, q: ArrayLike, wrench_by_robot: ArrayLike | Wrench, frame: str | None = None, *, out: Any = None
    ) -> Array:
        """Joint torques of one wrench alone, τ = J_b' F (Jacobian transpose).

        Parameters
        ----------
        wrench_by_robot : (6,) array_like or Wrench, (m, f) the robot applies at the frame, in its axes [N m, N]
            A labelled wrench brings its own frame.

        Returns
        -------
        tau : (nv,) array, joint torques [N m, sliding joints: N]

        Raises
        ------
        FrameError
            No frame is named, and the robot has no single tip; or the label of the wrench says another frame.

        Notes
        -----
        MR eq. 5.26.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> arm.wrench_torques([0, 0], [0, 0, 0, 0, 0, 10.0]).round(12).tolist()
        [0.0, 0.0]
        """
        from ..lie.twist_wrench import Wrench
        from .arguments import unlabelled

        if isinstance(wrench_by_robot, Wrench):
            frame = wrench_by_robot.frame if frame is None else frame
            F: Any = unlabelled(wrench_by_robot, frame)
        else:
            F = wrench_by_robot
        return self._call("wrench_torques", q, F, frame=frame, out=out)

    def holding_torques(
        self,
        q: ArrayLike,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        out: Any = None,
    ) -> Array:
        """Holding torques of static equilibrium, g + Σ J'F_by - Σ J'F_on, with the torques of springs.

        Returns
        -------
        tau : (nv,) array, joint torques [N m, sliding joints: N]

        Notes
        -----
        MR section 5.2.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> arm.holding_torques([0, 0], wrench_on_robot={arm.tip: [0, 0, 0, 0, 0, 9.81]}).round(2).tolist()
        [29.43, 9.81]
        """
        return self._with_wrenches("holding_torques", (q,), wrench_by_robot, wrench_on_robot, out)

    def joint_wrenches(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        out: Any = None,
    ) -> Array:
        """Wrenches across the joints (bearing loads): what each moving body receives across its joint.

        Returns
        -------
        F : (nbodies, 6) array, (m, f) [N m, N], each in the frame of its body, in the order of :attr:`body_names`

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> arm.joint_wrenches([0, 0], [0, 0], [0, 0]).shape
        (2, 6)
        """
        return self._with_wrenches("joint_wrenches", (q, dq, ddq), wrench_by_robot, wrench_on_robot, out)

    # ── energies, momentum, centre of mass ──

    def kinetic_energy(self, q: ArrayLike, dq: ArrayLike, *, out: Any = None) -> Any:
        """Kinetic energy of the moving bodies, ½ dq' M dq.

        Returns
        -------
        K : () [J]

        Notes
        -----
        MR section 8.1.2.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> round(float(arm.kinetic_energy([0, 0], [0, 1])), 12)
        0.5
        """
        return self._call("kinetic_energy", q, dq, out=out)

    def potential_energy(self, q: ArrayLike, *, out: Any = None) -> Any:
        """Potential energy of the moving bodies under gravity, zero with their centre of mass at the base origin.

        Returns
        -------
        P : () [J]

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> round(float(arm.potential_energy([-np.pi / 2, 0])), 12)
        -29.43
        """
        return self._call("potential_energy", q, out=out)

    def momentum(self, q: ArrayLike, dq: ArrayLike, frame: str = "base", *, out: Any = None) -> Array:
        """Spatial momentum (angular, linear) of the moving bodies, at the base origin or centroidal.

        Parameters
        ----------
        frame : "base", at the base origin; or "com", about the centre of mass, axes of the base (centroidal momentum)

        Returns
        -------
        P : (6,) array, in the axes of the base frame [N m s, N s]

        Raises
        ------
        ValueRangeError
            No moving body has mass, and ``frame`` is "com".

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> arm.momentum([0, 0], [1, 0]).round(12).tolist()
        [0.0, -5.0, 0.0, 0.0, 0.0, 3.0]
        """
        if frame not in ("base", "com"):
            raise UnknownNameError.from_choices("momentum frame", frame, ("base", "com"))
        return self._call("momentum" if frame == "base" else "momentum_about_com", q, dq, out=out)

    def center_of_mass(self, q: ArrayLike, *, out: Any = None) -> Array:
        """Centre of mass of the moving bodies in the base frame.

        Returns
        -------
        com : (3,) array [m]

        Raises
        ------
        ValueRangeError
            No moving body has mass.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> arm.center_of_mass([0, 0]).round(12).tolist()
        [1.5, 0.0, 0.0]
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

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> arm.com_jacobian([0, 0]).round(12)[2].tolist()
        [1.5, 0.5]
        """
        return self._call("com_jacobian", q, out=out)


METHODS = {
    name: method
    for part in (KinematicsMethods, QuantityMethods, DerivativeMethods)
    for name, method in vars(part).items()
    if not name.startswith("_")
}
"""All of them by name."""


complete(globals())
