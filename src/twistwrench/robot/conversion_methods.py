"""Methods that convert a robot to another robot, to text of robot files, and to functions of other libraries."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, Unpack, cast

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import MissingExtraError, ModelError, ModelWarning, ShapeError
from ..core.glossary import complete
from .base import RobotBase, require_robot
from .constraint_methods import ConstraintMethods

if TYPE_CHECKING:
    from ..mechanics.bodies.inertia import SpatialInertia
    from ..mechanics.model.model import Model
    from .export.request import Quantities
    from .export.written import Written
    from .kernels.options import KernelOptions
    from .robot import Robot

Precision: TypeAlias = Literal["double", "float"]
BlockStyle: TypeAlias = Literal["function_block", "codesys"]
TorqueSide: TypeAlias = Literal["joint", "motor"]


def _robot_of(robot: RobotBase, model: Model) -> Robot:
    """Robot with another model, the result of an edit."""
    return cast("Robot", type(robot)(model))


class EditMethods(RobotBase):
    """Methods of a robot that return an edited one."""

    @arguments.hint_if_misused(
        "Robot.with_payload() takes a SpatialInertia: robot.with_payload(tw.SpatialInertia.from_com(5)), mass in kg"
    )
    def with_payload(self, payload: SpatialInertia, frame: str | None = None) -> Robot:
        """Robot with a payload: a body fixed to one of its frames.

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
        from ..mechanics.bodies.inertia import SpatialInertia
        from ..mechanics.model import edit

        if not isinstance(payload, SpatialInertia):
            raise ShapeError(
                f"a payload is a SpatialInertia, got {arguments.value_text(payload)}: for a point mass, "
                "tw.SpatialInertia.from_com(mass, com)."
            )
        model = require_robot(self, "with_payload").model
        return _robot_of(self, edit.with_payload(model, payload, frame))

    def with_gravity(self, gravity: ArrayLike) -> Robot:
        """Robot with another gravity.

        Returns
        -------
        robot : Robot
        """
        from ..mechanics.model import edit

        model = require_robot(self, "with_gravity").model
        return _robot_of(self, edit.with_gravity(model, gravity))

    def with_actuators(self, source: str | Path | Mapping[str, Any], *, stiff: bool = False) -> Robot:
        """Robot with motors, gears, rotors, elastic joints and friction laws.

        Parameters
        ----------
        source : str, Path or mapping, a YAML file, its text or its content; docs/actuation.md describes the format
        stiff : bool, treat elastic gears as rigid, without a coordinate for the motor, and issue a warning

        Examples
        --------
        >>> import twistwrench as tw
        >>> drives = {"actuators": {"joint1": {"ratio": 100, "rotor": {"inertia": "200 g cm^2", "extra": True}}}}
        >>> arm = tw.robots.planar_2r()
        >>> float((arm.with_actuators(drives).mass_matrix([0, 0]) - arm.mass_matrix([0, 0]))[0, 0].round(9))
        0.2
        """
        from ..formats.actuators import add_actuators

        model = require_robot(self, "with_actuators").model
        return _robot_of(self, add_actuators(model, source, stiff=stiff))

    def with_armature(self, joints: Mapping[str, ArrayLike]) -> Robot:
        """Robot with other armature (reflected inertia of the drives) at the named joints.

        A rotor of inertia J behind a gear of ratio G has the armature G² J. Armature affects torques, energy and
        accelerations. Weight and gyroscopic effects require a rotor in :meth:`with_actuators`.

        Parameters
        ----------
        joints : {joint: armature} [kg m², sliding joints: kg]; one number, or one for each velocity of the joint

        Returns
        -------
        robot : Robot
        """
        if not isinstance(joints, Mapping):
            raise ShapeError(f"with_armature takes a dict {{joint: kg m² or kg}}, got {joints!r}.")
        from ..mechanics.model import edit

        model = require_robot(self, "with_armature").model
        return _robot_of(self, edit.with_armature(model, joints))

    def lock(self, joints: Mapping[str, float | Sequence[float]]) -> Robot:
        """Robot with some joints fixed at given coordinates.

        Parameters
        ----------
        joints : {joint: position} [rad, m], as many numbers as the joint has coordinates

        Returns
        -------
        robot : Robot, without these joints
        """
        if not isinstance(joints, Mapping):
            raise ShapeError(f"lock takes a dict {{joint: position}}, got {joints!r}.")
        from ..mechanics.model import edit

        model = require_robot(self, "lock").model
        return _robot_of(self, edit.lock(model, joints))

    def attach(
        self, other: Robot, frame: str | None = None, pose: ArrayLike | None = None, *, prefix: str = "", name: str = ""
    ) -> Robot:
        """Robot with another robot fixed to one of its frames, such as a gripper on an arm.

        Gravity is that of this robot. Named configurations with equal names are merged. If only one robot has a
        configuration of a name, the other robot is neutral there. The result can be saved like any robot.

        Parameters
        ----------
        other : Robot, with a fixed base; the joint of a floating base is removed
        frame : str, optional, where to attach; None: the robot's tip
        pose : (4, 4) array_like, optional, pose of the other robot's base in that frame; None: the identity
        prefix : str, prepended to the names of the other robot's links, joints and sites
        name : str, name of the result; default: both names, joined

        Returns
        -------
        robot : Robot
            Coordinates are in depth-first order: the other robot's follow those of the frame's existing subtree.

        Raises
        ------
        ModelError
            Both robots have a link or joint of the same name; give a prefix.

        Examples
        --------
        >>> import twistwrench as tw
        >>> both = tw.robots.ur5().attach(tw.robots.planar_2r(), "tool0", prefix="hand_")
        >>> both.name, both.joint_names[-3:]
        ('ur5_planar_2r', ('wrist_3_joint', 'hand_joint1', 'hand_joint2'))
        """
        from ..mechanics.model import joining

        T = np.eye(4) if pose is None else arguments.pose(pose, "attach: pose")
        model = require_robot(self, "attach").model
        other_model = require_robot(other, "attach").model
        joined_name = name or f"{model.name}_{other_model.name}"
        return _robot_of(self, joining.attach(model, other_model, frame, T, prefix, joined_name))

    def chain(self, base: str | None = None, tip: str | None = None) -> Robot:
        """Part of the robot: the subtree of a link, or the chain of joints from a link to a tip.

        Gravity is that in the base link's frame with all joints neutral. To keep side branches, :meth:`lock` their
        joints first.

        Parameters
        ----------
        base : str, optional, link that becomes the fixed base and base frame; None: the robot's base
        tip : str, optional, frame; None: the whole subtree of the base

        Returns
        -------
        robot : Robot
            Links fixed to the base are kept if the base carries them; all links fixed to the chain are kept.

        Raises
        ------
        FrameError
            The base does not carry the tip.
        ModelError
            A mimic joint follows a joint outside the part, or a rotor of the part is mounted on a link outside.

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.ur5().chain("forearm_link").joint_names
        ('wrist_1_joint', 'wrist_2_joint', 'wrist_3_joint')
        >>> tw.robots.quadruped().chain("trunk", "FL_foot").nv
        3
        """
        from ..mechanics.model import joining

        model = require_robot(self, "chain").model
        return _robot_of(self, joining.chain(model, base, tip))


class FileMethods(RobotBase):
    """Robot as text of robot files and as models of other libraries.

    A ModelWarning lists properties that the format cannot represent, such as springs. Visuals and collision shapes are
    not part of a robot and are not written. ModelError is raised if the format cannot represent the motion: screw axes
    not of unit length, or, in MJCF and SDF, a floating joint inside the tree.
    """

    def to_urdf(self) -> str:
        """URDF text of the robot: every link with its own inertia, also those behind fixed joints.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> tw.load(arm.to_urdf()).mass_matrix([0, 0]).tolist() == arm.mass_matrix([0, 0]).tolist()
        True
        """
        return _text(self, "urdf")

    def to_mjcf(self) -> str:
        """MJCF text of the robot: each moving body with the inertia of its fixed links, which become empty bodies.

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
        """MuJoCo model of the robot, compiled from :meth:`to_mjcf`; :mod:`twistwrench.robot.convert` converts states.

        Returns
        -------
        model : mujoco.MjModel

        Raises
        ------
        ModelError
            MuJoCo rejects the robot's bodies: physically impossible inertias, and moving bodies without mass.

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
        except ValueError as error:
            reason = " ".join(str(error).split())  # on one line
            raise ModelError(f"MuJoCo refuses robot {self.name!r}: {reason}.") from None

    def to_pinocchio(self) -> Any:
        """Pinocchio model of the robot; :func:`twistwrench.robot.convert.to_pinocchio` converts states.

        Mimic joints become independent joints. ModelError is raised if Pinocchio lacks a joint type.

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

        model, losses = pinocchio_of(require_robot(self, "to_pinocchio").model)
        _warn_of_losses(self.name, "a model of Pinocchio's", losses)
        return model


def _text(robot: Any, file_format: str) -> str:
    """Text of a robot in a format; warns of what the format cannot represent."""
    from ..formats.writers import WRITERS

    document = WRITERS[file_format](require_robot(robot, f"to_{file_format}").model)
    _warn_of_losses(robot.name, file_format.upper(), document.lost)
    return document.text


def _warn_of_losses(name: str, target: str, losses: Iterable[str]) -> None:
    """Warn of properties of a robot that a ``target``, a format or a model, cannot represent."""
    from ..mechanics.model.description import frames_to_user, grouped

    for sentence in grouped(losses):
        warnings.warn(f"robot {name!r} as {target}: {sentence}.", ModelWarning, stacklevel=frames_to_user())


class BridgeMethods(RobotBase):
    """Quantities as functions of JAX, PyTorch, CasADi and JavaScript.

    MissingExtraError is raised if the library is not installed, KernelError if an option does not apply.
    """

    def to_jax(
        self, quantity: str, *, precision: Literal["double", "single"] = "double", **options: Unpack[KernelOptions]
    ) -> Callable[..., Any]:
        """JAX function that computes one quantity; supports jit, vmap, and both modes of differentiation.

        First derivatives are the robot's analytic ones. Derivatives by q are with respect to its entries; along the
        norm of a quaternion they are zero.

        Parameters
        ----------
        precision : "double" or "single"
            Double precision requires ``jax_enable_x64``; without it, a warning reports that float32 is used.
        **options : as for :meth:`kernel`, except ``by`` and its options

        Returns
        -------
        function : callable, takes the quantity's inputs with any leading batch shape

        Examples
        --------
        >>> import jax, twistwrench as tw
        >>> jax.config.update("jax_enable_x64", True)
        >>> gravity_forces = tw.robots.pendulum().to_jax("gravity_forces")
        >>> float(jax.jacobian(gravity_forces)(jax.numpy.zeros(1))[0, 0]).__round__(2)
        9.81
        """
        from .export.jax import jax_function
        from .export.request import BridgedQuantity

        bridged = BridgedQuantity.from_robot("to_jax", cast("Robot", self), quantity, options, precision)
        return jax_function(bridged, precision)

    def to_torch(self, quantity: str, **options: Unpack[KernelOptions]) -> Callable[..., Any]:
        """PyTorch function that computes one quantity by compiled kernels, twice differentiable.

        Works with ``torch.func`` (grad, jacrev, vmap). Derivatives by q are with respect to its entries; along the norm
        of a quaternion they are zero.

        Parameters
        ----------
        **options : as for :meth:`kernel`, except ``by`` and its options

        Returns
        -------
        function : callable, takes the quantity's inputs with any leading batch shape
            CPU tensors share memory with the kernel; GPU tensors stay on the GPU; float32 if all inputs are.

        Examples
        --------
        >>> import twistwrench as tw
        >>> import torch  # doctest: +SKIP
        >>> energy = tw.robots.pendulum().to_torch("potential_energy")  # doctest: +SKIP
        >>> q = torch.zeros(1, dtype=torch.float64, requires_grad=True)  # doctest: +SKIP
        >>> torch.autograd.grad(energy(q), q)  # doctest: +SKIP
        (tensor([0.], dtype=torch.float64),)
        """
        from .export.request import BridgedQuantity
        from .export.torch import torch_function

        bridged = BridgedQuantity.from_robot("to_torch", cast("Robot", self), quantity, options, "double")
        return torch_function(bridged)

    def to_casadi(self, quantity: str, **options: Unpack[KernelOptions]) -> Any:
        """CasADi function that computes one quantity with SX symbols, for optimal control and code generation.

        Derivatives are CasADi's, with respect to the entries of q; unit length of quaternions is not enforced.

        Parameters
        ----------
        **options : as for :meth:`kernel`, except ``by`` and its options

        Returns
        -------
        function : casadi.Function of column vectors; results with more than two axes are flattened to rows by the first
            axis

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.pendulum().to_casadi("inverse_dynamics")
        Function(inverse_dynamics:(q,dq,ddq)->(tau) SXFunction)
        """
        from .export.casadi_function import casadi_function
        from .export.request import BridgedQuantity

        bridged = BridgedQuantity.from_robot("to_casadi", cast("Robot", self), quantity, options, "double")
        return casadi_function(bridged)

    def to_javascript(self, quantity: str, **options: Unpack[KernelOptions]) -> str:
        """JavaScript module with one function that computes one quantity, for browsers and Node.

        Parameters
        ----------
        **options : as for :meth:`kernel`

        Returns
        -------
        text : str, an ES module without imports
            The function takes arrays of numbers, with matrices flat in C order. Its last argument ``out`` is filled; if
            omitted, a new ``Float64Array`` is returned. Several results are an object of arrays.

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
        from .export.javascript import javascript_module
        from .export.request import BridgedQuantity

        return javascript_module(BridgedQuantity(cast("Robot", self), quantity, options))


class ExportMethods(ConstraintMethods):
    """Quantities as source code: C, Structured Text, CUDA, and a package of ROS 2."""

    def export_c(
        self,
        quantities: Quantities,
        path: str | Path,
        *,
        precision: Precision = "double",
        prefix: str | None = None,
        test: bool = True,
    ) -> Written:
        """C code export: quantities as C99 functions that need only ``math.h`` and no heap memory.

        docs/export.md shows the files. A closed robot also exports quantities with its constraints.

        Parameters
        ----------
        path : str or Path, a folder, or the .c file; the header is written beside it
        precision : "double" or "float"
            Use single precision; default: double.
        prefix : str, optional
            Prefix of function names; default: the robot's name.
        test : bool, write a test program, which compares the functions with the kernels

        Returns
        -------
        files : Written, a tuple of Path: header, source, and test program

        Raises
        ------
        KernelError
            An option does not apply, or no program without branches computes the quantity.
        ValueRangeError
            ``path`` cannot be written.

        Examples
        --------
        >>> import tempfile, twistwrench as tw
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     files = tw.robots.ur5().export_c(["mass_matrix", ("jacobian", {"kind": "space"})], folder)
        ...     print("void ur5_mass_matrix(const double q[6], double M[36]);" in files[0].read_text())
        True
        """
        from .export import export_c

        pairs = self._with_constraints(quantities)
        return export_c(self.open(), pairs, path, precision=precision, prefix=prefix, test=test)

    def export_st(
        self,
        quantities: Quantities,
        path: str | Path,
        *,
        precision: Precision = "double",
        prefix: str | None = None,
        test: bool = True,
        style: BlockStyle = "function_block",
        torque: TorqueSide = "joint",
    ) -> Written:
        """Structured Text export: quantities as function blocks (IEC 61131-3) for PLCs. Not yet run on a PLC.

        docs/export.md shows the file. The tests execute it with an interpreter based on an independent parser.

        Parameters
        ----------
        path : str or Path, a folder, or a file with suffix .st, .scl, .exp or .txt
        precision : "double" or "float", numbers of type LREAL or REAL
        test : bool, also write a program that compares the blocks with stored results
        style : "function_block" or "codesys"
            Structured Text only; 'codesys' adds a block for the interface ISMDynamics, to be completed by hand; it exports
            only ``inverse_dynamics``, with gravity as an input.
        torque : "joint" or "motor"
            Structured Text only: torques of ``inverse_dynamics`` at the joints, or at the motor shafts, as
            :meth:`motor_loads` computes them.

        Returns
        -------
        files : Written, a tuple with the Path

        Raises
        ------
        KernelError
            An option does not apply, or no program without branches computes the quantity.
        ModelError
            Motor torques are requested, but a joint has no actuator.
        ValueRangeError
            ``path`` cannot be written.

        Examples
        --------
        >>> import tempfile, twistwrench as tw
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     (file,) = tw.robots.ur5().export_st(["inverse_dynamics", "gravity_forces"], folder)
        ...     print("FUNCTION_BLOCK ur5_inverse_dynamics" in file.read_text())
        True
        """
        from .export.structured_text import export_st

        pairs: Any = self._with_constraints(quantities)
        return export_st(
            self.open(), pairs, path, precision=precision, prefix=prefix, test=test, style=style, torque=torque
        )

    def export_ros2(self, path: str | Path, *, license: str = "Apache-2.0") -> Written:  # noqa: A002
        """ROS 2 package export: a plug-in of ``inverse_dynamics_solver`` with a test. Not yet built with colcon.

        docs/export.md shows the files. The plug-in compares joints and masses with ``robot_description``.

        Parameters
        ----------
        path : str or Path, the folder to create; its last part is the name of the package
        license : str
            License in package.xml.

        Returns
        -------
        files : Written, a tuple of Path

        Raises
        ------
        KernelError
            A joint has several coordinates, or no joint moves.
        ValueRangeError
            The folder exists, its name is not a valid package name, or the license is not a valid name.

        Examples
        --------
        >>> import tempfile, twistwrench as tw
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     files = tw.robots.panda().export_ros2(f"{folder}/panda_dynamics")
        ...     print("getInertiaMatrix" in files[4].read_text())
        True
        """
        from .export.ros2 import export_ros2

        return export_ros2(self.open(), path, license=license)

    def export_cuda(
        self,
        quantities: Quantities,
        path: str | Path,
        *,
        precision: Precision = "double",
        prefix: str | None = None,
    ) -> tuple[Path, ...]:
        """CUDA source export: quantities as CUDA C++ kernels with one thread per sample.

        docs/export.md describes the launch. The tests compile it with nvcc and NVRTC; its kernels are not timed on a GPU.

        Parameters
        ----------
        path : str or Path, a folder with a file for each kernel; or the .cu file of one kernel

        Raises
        ------
        KernelError
            An option does not apply, no program without branches computes the quantity, or the program is too long.
        ValueRangeError
            ``path`` cannot be written.

        Examples
        --------
        >>> import tempfile, twistwrench as tw
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     (file,) = tw.robots.panda().export_cuda("inverse_dynamics", folder, precision="float")
        ...     print("void __launch_bounds__(THREADS) panda_inverse_dynamics" in file.read_text())
        True
        """
        from .export import export_cuda

        return export_cuda(self.open(), self._with_constraints(quantities), path, precision=precision, prefix=prefix)

    def _with_constraints(self, quantities: Quantities) -> list[tuple[str, dict[str, Any]]]:
        """Names of quantities with their options, including the robot's constraints."""
        from .export.request import name_option_pairs
        from .kernels.options import options_of

        pairs = []
        for name, given_options in name_option_pairs(quantities):
            options = dict(given_options)
            if self.constraints and "constraints" in options_of(name):
                options.setdefault("constraints", self._independent_constraints)
            pairs.append((name, options))
        return pairs


complete(globals())
