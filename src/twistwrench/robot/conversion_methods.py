"""Methods that turn a robot into another one, into text of robot files, and into functions of other libraries."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Unpack

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.glossary import complete
from ..errors import MissingExtraError, ModelError, ModelWarning, ShapeError
from .base import RobotBase
from .task_space_methods import require_robot

if TYPE_CHECKING:
    from ..bodies.inertia import SpatialInertia
    from .programs import KernelOptions
    from .robot import Robot


class EditMethods(RobotBase):
    """The methods of a robot that give another one."""

    def with_payload(self, payload: SpatialInertia, frame: str | None = None) -> Robot:
        """The robot with a payload: a body fixed to one of its frames.

        Parameters
        ----------
        payload : SpatialInertia, in the axes of the frame and about its origin

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

    def with_gravity(self, gravity: ArrayLike) -> Robot:
        """The robot under another gravity.

        Returns
        -------
        robot : Robot
        """
        from ..model import edit

        return self._of_model(edit.with_gravity(self.model, gravity))

    def with_actuators(self, source: str | Path | Mapping[str, Any], *, stiff: bool = False) -> Robot:
        """The robot with motors, gears, rotors, elastic joints and friction laws.

        Parameters
        ----------
        source : str, Path or mapping, a YAML file, its text, or what it says; docs/actuation.md shows the file
        stiff : bool, take elastic gears to be rigid, so that no motor has a coordinate of its own, and warn of it

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

    def with_armature(self, joints: Mapping[str, ArrayLike]) -> Robot:
        """The robot with other armature (reflected inertia of the drives) at the joints named.

        A rotor of inertia J behind a gear of ratio G has the armature G² J. It is part of every torque, energy and
        acceleration, and has no weight and no gyroscopic effect; a rotor described to :meth:`with_actuators` has those too.

        Parameters
        ----------
        joints : {joint: armature} [kg m², sliding joints: kg]; joints with several velocities take one number, or one each

        Returns
        -------
        robot : Robot
        """
        if not isinstance(joints, Mapping):
            raise ShapeError(f"with_armature takes a dict {{joint: kg m² or kg}}, got {joints!r}.")
        from ..model import edit

        return self._of_model(edit.with_armature(self.model, joints))

    def lock(self, joints: Mapping[str, float | Sequence[float]]) -> Robot:
        """The robot with some joints fixed at given coordinates.

        Parameters
        ----------
        joints : {joint: position} [rad, m], as many numbers as the joint has coordinates

        Returns
        -------
        robot : Robot, without these joints
        """
        if not isinstance(joints, Mapping):
            raise ShapeError(f"lock takes a dict {{joint: position}}, got {joints!r}.")
        from ..model import edit

        return self._of_model(edit.lock(self.model, joints))

    def attach(
        self, other: Robot, frame: str | None = None, pose: ArrayLike | None = None, *, prefix: str = ""
    ) -> Robot:
        """The robot with another one fixed to a frame of it, such as a gripper on an arm.

        Gravity is this robot's. Configurations of one name become one; where one robot has none of a name, it is neutral.
        The result is written to a file as any robot is.

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

    def chain(self, base: str | None = None, tip: str | None = None) -> Robot:
        """A part of the robot by itself: what a link carries, or the chain of joints between it and a tip.

        Gravity is as the base feels it with every joint of the robot neutral. To keep what branches off, lock its joints
        first: :meth:`lock`.

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
        FrameError
            The base does not carry the tip.
        ModelError
            A joint of the part follows one outside, or a rotor of it is on a link outside.

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


class FileMethods(RobotBase):
    """The robot as text of files and as models of other libraries.

    A ModelWarning lists what the format cannot say of the robot, such as springs; looks and shapes are not kept by a robot, and
    not written. ModelError is raised if it has no words for how the robot moves: a screw axis that is not of unit length, or,
    in MJCF and SDF, a joint that floats in the middle of the tree.
    """

    def to_urdf(self) -> str:
        """URDF text of the robot: every link with its own inertia, fixed joints too.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> tw.load(arm.to_urdf()).mass_matrix([0, 0]).tolist() == arm.mass_matrix([0, 0]).tolist()
        True
        """
        return _text(self, "urdf")

    def to_mjcf(self) -> str:
        """MJCF text of the robot: each moving body with the inertia of all that is fixed to it, other links as empty bodies.

        Returns
        -------
        text : str
        """
        return _text(self, "mjcf")

    def to_sdf(self) -> str:
        """SDF text of the robot: every link with its own inertia; fixed links without mass become frames.

        Returns
        -------
        text : str
        """
        return _text(self, "sdf")

    def to_mujoco(self) -> Any:
        """MuJoCo's model of the robot, compiled from :meth:`to_mjcf`; :func:`twistwrench.convert.to_mujoco` translates states.

        Returns
        -------
        model : mujoco.MjModel

        Raises
        ------
        ModelError
            MuJoCo refuses the robot's bodies: those that cannot exist, and moving ones without mass.

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.planar_3r().to_mujoco().nv  # doctest: +SKIP
        3
        """
        try:
            import mujoco
        except ImportError:
            raise MissingExtraError.from_extra("mujoco", "peers", "A model of MuJoCo's") from None
        text = _text(self, "mjcf")
        try:
            return mujoco.MjModel.from_xml_string(text)
        except ValueError as refusal:
            raise ModelError(f"MuJoCo refuses robot {self.name!r}: {' '.join(str(refusal).split())}.") from None

    def to_pinocchio(self) -> Any:
        """Pinocchio's model of the robot; :func:`twistwrench.convert.to_pinocchio` translates states.

        Joints that follow others are joints of their own there. A joint that is none of Pinocchio's is a ModelError.

        Returns
        -------
        model : pinocchio.Model

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.ur5().to_pinocchio().nv  # doctest: +SKIP
        6
        """
        from ..formats.pinocchio_model import pinocchio_of

        model, lost = pinocchio_of(self.model)
        _warn(self.name, "a model of Pinocchio's", lost)
        return model


def _text(robot: Any, form: str) -> str:
    from ..formats.writers import WRITERS

    written = WRITERS[form](robot.model)
    _warn(robot.name, form.upper(), written.lost)
    return written.text


def _warn(name: str, form: str, lost: Iterable[str]) -> None:
    from ..model.description import frames_to_user, grouped

    for sentence in grouped(lost):
        warnings.warn(f"robot {name!r} as {form}: {sentence}.", ModelWarning, stacklevel=frames_to_user())


# ── Quantities as functions of other packages


class BridgeMethods(RobotBase):
    """Quantities as functions of JAX, PyTorch, CasADi and JavaScript.

    MissingExtraError is raised if the library is not installed, KernelError if an option does not apply.
    """

    def to_jax(
        self, quantity: str, *, precision: Literal["double", "single"] = "double", **options: Unpack[KernelOptions]
    ) -> Callable[..., Any]:
        """Function of JAX arrays that computes one quantity: it jits, vmaps, and differentiates in both modes.

        First derivatives are the robot's analytic ones. Derivatives by q are by its entries; along a quaternion's own
        length they are zero.

        Parameters
        ----------
        precision : "double" or "single"
            Double needs ``jax_enable_x64``; without, a warning says that float32 was computed.
        **options : as for :meth:`kernel`, but for ``by`` and what goes with it

        Returns
        -------
        function : callable, of the quantity's inputs with any leading batch shape

        Examples
        --------
        >>> import jax, twistwrench as tw
        >>> jax.config.update("jax_enable_x64", True)
        >>> gravity_forces = tw.robots.pendulum().to_jax("gravity_forces")
        >>> float(jax.jacobian(gravity_forces)(jax.numpy.zeros(1))[0, 0]).__round__(2)
        9.81
        """
        from ..export.jax import jax_function
        from ..export.request import BridgedQuantity

        return jax_function(BridgedQuantity.from_robot("to_jax", self._open(), quantity, options, precision), precision)

    def to_torch(self, quantity: str, **options: Unpack[KernelOptions]) -> Callable[..., Any]:
        """Function of PyTorch tensors that computes one quantity by compiled kernels, differentiable twice.

        Works with ``torch.func`` (grad, jacrev, vmap). Derivatives by q are by its entries; along a quaternion's own
        length they are zero.

        Parameters
        ----------
        **options : as for :meth:`kernel`, but for ``by`` and what goes with it

        Returns
        -------
        function : callable, of the quantity's inputs with any leading batch shape
            Tensors on the processor share their memory with the kernel, those on a GPU stay there; float32 if all are.

        Examples
        --------
        >>> import twistwrench as tw
        >>> import torch  # doctest: +SKIP
        >>> energy = tw.robots.pendulum().to_torch("potential_energy")  # doctest: +SKIP
        >>> q = torch.zeros(1, dtype=torch.float64, requires_grad=True)  # doctest: +SKIP
        >>> torch.autograd.grad(energy(q), q)  # doctest: +SKIP
        (tensor([0.], dtype=torch.float64),)
        """
        from ..export.request import BridgedQuantity
        from ..export.torch import torch_function

        return torch_function(BridgedQuantity.from_robot("to_torch", self._open(), quantity, options, "double"))

    def to_casadi(self, quantity: str, **options: Unpack[KernelOptions]) -> Any:
        """CasADi function that computes one quantity, in SX symbols, for optimal control and code generation.

        Derivatives are CasADi's, by the entries of q; those of a quaternion are not kept at length one.

        Parameters
        ----------
        **options : as for :meth:`kernel`, but for ``by`` and what goes with it

        Returns
        -------
        function : casadi.Function, of columns; a result of more than two axes has the first as its rows

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.pendulum().to_casadi("inverse_dynamics")
        Function(inverse_dynamics:(q,dq,ddq)->(tau) SXFunction)
        """
        from ..export.javascript import casadi_function
        from ..export.request import BridgedQuantity

        return casadi_function(BridgedQuantity.from_robot("to_casadi", self._open(), quantity, options, "double"))

    def to_javascript(self, quantity: str, **options: Unpack[KernelOptions]) -> str:
        """JavaScript module with one function that computes one quantity, for browsers and Node.

        Parameters
        ----------
        **options : as for :meth:`kernel`

        Returns
        -------
        text : str, an ES module without imports
            Its function takes arrays of numbers, matrices flat in C order, and last an ``out`` to fill, a fresh
            ``Float64Array`` if left out; of several results an object of arrays.

        Examples
        --------
        >>> import twistwrench as tw
        >>> print(tw.robots.pendulum().to_javascript("gravity_forces"))
        // gravity_forces of pendulum: q [1] to g [1]; SI units.
        export function gravity_forces(q, out = new Float64Array(1)) {
          const q_0_ = q[0];
          const t1 = Math.sin(q_0_);
          const t2 = 9.81 * t1;
          out[0] = t2;
          return out;
        }
        <BLANKLINE>
        """
        from ..export.javascript import javascript_module
        from ..export.request import BridgedQuantity

        return javascript_module(BridgedQuantity(self._open(), quantity, options))


complete(globals())
