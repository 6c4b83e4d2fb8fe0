"""Base of a robot's methods: model, engine, names and limits, configurations, kernels."""

from __future__ import annotations

import operator
from collections.abc import Iterable, Mapping
from functools import cached_property
from os import PathLike
from typing import TYPE_CHECKING, Any, NoReturn, Unpack, cast
from weakref import WeakMethod

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import ValueRangeError
from ..core.glossary import complete
from ..core.text import shorten
from ..core.typing import Array
from .engine import Engine
from .kernels.disk_cache import CachedModel

if TYPE_CHECKING:
    from ..compiler.ir.program import Program
    from ..compiler.runtime.dispatch import CallSignature
    from ..mechanics.algorithms.constraints import Constraint
    from ..mechanics.model.actuators import Actuator
    from ..mechanics.model.limits import Limits
    from ..mechanics.model.model import Model, OfferedClosure
    from .arguments import Wrenches
    from .kernels.options import KernelOptions
    from .robot import Robot

if TYPE_CHECKING:  # results without constraints are the defaults, so that a bare ``Robot`` is an open one
    from typing_extensions import TypeVar

    Motion = TypeVar("Motion", default=Array)
    Torques = TypeVar("Torques", default=Array)
    Slopes = TypeVar("Slopes", default=tuple[Array, Array])
else:
    from typing import TypeVar

    Motion, Torques, Slopes = map(TypeVar, ("Motion", "Torques", "Slopes"))


class RobotBase:
    """Model and engine of a robot, with its properties, configurations and kernels."""

    constraints: tuple[Constraint, ...] = ()
    """Closures and velocity constraints, in the order of their creation; () for a robot without constraints."""
    _tree: Robot | None = None
    """For a robot with constraints, the robot with its loops open; otherwise None."""

    def __init__(self, model: Model | CachedModel) -> None:
        if isinstance(model, str | PathLike):
            raise TypeError(f'Robot takes a Model; to read a file: tw.load("{shorten(str(model))}")')
        # The reference is weak, so that a robot is freed at once when it is not used any more.
        self.engine = Engine(model, WeakMethod(self._install_direct_call))
        # Calls of the engine without the methods below, which would add a stack frame to each call.
        vars(self).update(_call=self.engine.call, _with_wrenches=self.engine.call_with_wrenches)

    @cached_property
    def model(self) -> Model:
        """The robot as data: its bodies, joints, frames and limits."""
        return self.engine.model

    def __repr__(self) -> str:
        tip = "no single tip" if self.tip is None else f"tip {self.tip!r}"
        return f"<Robot {self.name!r}: {len(self.model.bodies)} moving bodies, nq = {self.nq}, nv = {self.nv}, {tip}>"

    if not TYPE_CHECKING:  # so that type checkers reject these names too

        def __getattr__(self, name: str) -> NoReturn:
            """Raise AttributeError with the method or the kernel that has another name here."""
            raise _missing(self, name)

    def __getstate__(self) -> Any:
        return self.model

    def __setstate__(self, state: Any) -> None:
        type(self).__init__(self, state)

    def open(self) -> Robot:
        """The same robot with its loops open, without constraints.

        Returns
        -------
        robot : Robot
        """
        return cast("Robot", self if self._tree is None else self._tree)

    def _install_direct_call(self, name: str, kernel: Any, signature: CallSignature, call_count: int) -> bool:
        """Register a kernel for direct calls; see :class:`.robot.Robot`."""
        raise NotImplementedError

    # ── calls of quantities; robots without constraints replace these two by the engine's methods in ``__init__`` ──

    def _call(self, name: str, *arrays: Any, out: Any = None, **options: Any) -> Any:
        """Quantity that does not depend on wrenches."""
        return self.engine.call(name, *arrays, out=out, **options)

    def _with_wrenches(
        self,
        name: str,
        arrays: tuple[Any, ...],
        by_robot: Wrenches | None,
        on_robot: Wrenches | None,
        out: Any = None,
        **options: Any,
    ) -> Any:
        """Quantity with wrenches: with constraint forces if its row in QUANTITIES is ``projected``, otherwise by the engine."""
        from .quantities import QUANTITIES

        needs_constraint_forces = QUANTITIES[name].constrained == "projected"
        if not needs_constraint_forces or "by" in options:
            return self.engine.call_with_wrenches(name, arrays, by_robot, on_robot, out, **options)
        if out is not None:
            raise ValueRangeError(f"{name}: out= is for a robot without constraints. Leave it out.")
        from .constraints import projections

        projected_quantity = getattr(projections, name)
        return projected_quantity(self, *arrays, wrench_by_robot=by_robot, wrench_on_robot=on_robot, **options)

    def _motors(self, actuated: Iterable[str]) -> Iterable[str]:
        """Return the joints with a motor; raises ValueRangeError for a robot without constraints."""
        if not self.constraints:
            raise ValueRangeError(
                "actuated= is for a robot with constraints: an open tree needs the torque of every joint."
            )
        return actuated

    # ── properties ──

    @property
    def name(self) -> str:
        """The robot's name in its file."""
        return self.model.name

    @property
    def nq(self) -> int:
        """Number of coordinates nq, the entries of a configuration q."""
        return self.model.nq

    @property
    def nv(self) -> int:
        """Number of velocities nv, the entries of dq: degrees of freedom of the open tree."""
        return self.model.nv

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Joints with coordinates, in the order of q."""
        return self.model.joint_names

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """A name for each entry of q: the joint's name, with a suffix if the joint has several coordinates."""
        return self.model.coordinate_names

    @property
    def velocity_names(self) -> tuple[str, ...]:
        """A name for each entry of dq, ddq and tau: the joint's name, with a suffix if the joint has several velocities."""
        return self.model.velocity_names

    @property
    def body_names(self) -> tuple[str, ...]:
        """Moving bodies, named by the link their joint carries, in the order of :meth:`joint_wrenches`."""
        return tuple(body.link for body in self.model.bodies)

    @property
    def link_names(self) -> tuple[str, ...]:
        """Links of the file, in document order."""
        return tuple(self.model.frames)

    @property
    def frame_names(self) -> tuple[str, ...]:
        """Names of all frames: links, then sites of the file."""
        return tuple(self.model.all_frames)

    @property
    def tip(self) -> str | None:
        """Default frame; None if the robot has no single tip."""
        return self.model.tip

    @property
    def defects(self) -> tuple[str, ...]:
        """Doubtful entries of the robot's file, one sentence each."""
        return self.model.defects

    @property
    def limits(self) -> Limits:
        """Joint limits, (nv,) each; inf if the file gives none."""
        return self.model.limits

    @property
    def gravity(self) -> Array:
        """Gravity in the base frame, (3,) m/s²."""
        return self.model.gravity

    if not TYPE_CHECKING:  # type checkers reject it

        @gravity.setter
        def gravity(self, _: ArrayLike) -> None:
            """Raise AttributeError: robots are immutable."""
            raise AttributeError("robot.gravity cannot be set: robot.with_gravity(g) gives a new robot", name=None)

    @property
    def actuators(self) -> Mapping[str, Actuator]:
        """Actuators by joint; see :meth:`with_actuators`."""
        return self.model.actuators

    @property
    def armature(self) -> Array:
        """Reflected inertia of the drives, (nv,) kg m² or kg, added to the diagonal of M."""
        return self.model.armature

    @property
    def configurations(self) -> Mapping[str, Array]:
        """Named configurations of the file, such as MJCF keyframes; (nq,) each."""
        return self.model.configurations

    @property
    def closures(self) -> Mapping[str, OfferedClosure]:
        """Loops that the file describes, by name. The robot itself is the open tree; :meth:`close` closes a loop."""
        return self.model.closures

    @property
    def parameters(self) -> Array:
        """Inertial parameters π, ten for each moving body with its fixed links; (10 nbodies,) [kg, kg m, kg m²]. MR 8.2."""
        parameters_by_body = [body.inertia.parameters for body in self.model.bodies]
        return np.concatenate([np.zeros(0), *parameters_by_body])  # zeros(0): a robot may have no bodies

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """A name for each of :attr:`parameters`: ``<body>.m``, ``<body>.mcx`` … ``<body>.Izz``."""
        from ..mechanics.algorithms.inverse_dynamics import PARAMETER_NAMES

        return tuple(f"{body.link}.{parameter}" for body in self.model.bodies for parameter in PARAMETER_NAMES)

    @property
    def neutral(self) -> Array:
        """Neutral configuration: every joint at zero, even outside its limits; (nq,), rad or m."""
        return self.model.neutral

    @property
    def screws(self) -> Any:
        """The book's M, Slist, Blist, Mlist and Glist, with link frames as in the file; serial chains only."""
        from ..formats.dh import screw_lists

        return screw_lists(self.model)

    def screws_at_com(self) -> Any:
        """The book's lists with link frames at the centres of mass, along principal axes, so that G is diagonal.

        Returns
        -------
        lists : named tuple of M, Slist, Blist, Mlist, Glist, as :attr:`screws`

        Raises
        ------
        ModelError
            The robot is not a serial chain of joints with one degree of freedom.
        """
        from ..formats.dh import screw_lists

        return screw_lists(self.model, at_com=True)

    # ── configurations ──

    def coordinates(self, **joints: ArrayLike) -> Array:
        """Configuration from joint names; joints not named are neutral.

        Parameters
        ----------
        **joints : joint=position [rad, m], as many numbers as the joint has coordinates

        Returns
        -------
        q : (nq,) array
        """
        from ..mechanics.model import configurations

        return configurations.from_names(self.model, joints)

    def random_configuration(
        self, rng: np.random.Generator | int | None = None, size: int | tuple[int, ...] = ()
    ) -> Array:
        """Random configuration inside the joint limits; unbounded joints within ±π or ±1 m.

        Parameters
        ----------
        rng : numpy Generator or seed, optional

        Returns
        -------
        q : (*size, nq) array
        """
        from ..mechanics.model import configurations

        try:
            lengths = size if isinstance(size, tuple | list) else (size,)
            shape = tuple(operator.index(length) for length in lengths)  # refuses numbers that are not whole
            generator = np.random.default_rng(rng)
        except (TypeError, ValueError):
            raise ValueRangeError(
                f"rng={arguments.value_text(rng)}, size={arguments.value_text(size)}: give a seed or a numpy "
                "Generator, and whole numbers of samples."
            ) from None
        if any(length < 0 for length in shape):
            raise ValueRangeError(f"size={arguments.value_text(size)} has a negative number of samples.")
        return configurations.random_configuration(self.model, generator, shape)

    # ── kernels ──

    def kernel(self, *names: str, **options: Unpack[KernelOptions]) -> np.ufunc:
        """Compiled kernel of one or several quantities: a ``numpy.ufunc`` with the robot's sizes.

        Quantities share inputs of the same name and common intermediate results.

        Parameters
        ----------
        *names : str, quantities
        **options : each option applies to the quantities that accept it
            ``frame=``, ``kind=``, ``rows=``: as for the methods.
            ``wrenches=(frame, …)``: one further input per frame, a wrench applied by the robot, or by the world if the
            frame is in ``on_robot=(frame, …)``.
            ``friction=True``: for inverse and forward dynamics.
            ``gravity="input"``: a further input, (3,) m/s² in the base frame, replaces the robot's gravity.
            ``parameters=(pattern, …)``: a last input with one number for each of ``robot.varying(*patterns)``. Masses,
            inertias, lengths, friction, armatures and stiffnesses may then differ in each sample.
            ``constraints=``: the constraints of a closed robot, which its own kernels have already.
            ``by="q"``: derivative of a quantity with respect to one or several inputs, along :meth:`add` for q;
            ``form``, ``mode`` and ``values`` as for :func:`twistwrench.differentiate`.

        Returns
        -------
        kernel : ufunc, with a signature such as ``(7),(7)->(7,7)``

        Raises
        ------
        KernelError
            An option does not apply, or constraints change the quantity.
        SingularMassMatrixError
            A joint moves no inertia, so that M has no inverse.

        Notes
        -----
        A robot with constraints has the kernels of kinematics, masses and gravity of its open tree,
        ``"constrained_dynamics"``, ``"constraint_jacobian"``, ``"constraint_bias"`` and ``"closure_poses"``, and beside
        these any quantity of the open tree. Dependent rows are left out. Kernels do not check states: constrained
        dynamics also returns the pivots of A M⁻¹ A', of which one near zero marks a singular configuration.

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.ur5().kernel("inverse_dynamics").signature
        '(6),(6),(6)->(6)'
        >>> tw.robots.ur5().kernel("mass_matrix", "bias_forces").signature
        '(6),(6)->(6,6),(6)'
        """
        return self.engine.kernel(names, options)

    def varying(self, *patterns: str) -> dict[str, float]:
        """Parameters that can be inputs of a kernel (masses, lengths, friction, drives, springs), with the values of the robot.

        Names: ``<link>.mass``, ``.com_x`` …, ``.Ixx`` … (about the centre of mass), ``<joint>.x`` … (position in the
        parent body), ``<joint>.viscous`` and the other friction parameters, ``<joint>.armature``,
        ``<joint>.rotor_inertia`` (about the rotor's axis), ``<joint>.stiffness`` (of its spring or elastic gear); coupled
        motors have their own. The mass of a massless link is a payload.

        Parameters
        ----------
        *patterns : str, names with wildcards such as ``"*.mass"``; none given: all parameters

        Returns
        -------
        parameters : {name: float}, in the order of the kernel's input [SI units]

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> ur5 = tw.robots.ur5()
        >>> ur5.varying("*.viscous", "tool0.mass")["tool0.mass"]
        0.0
        >>> holding = ur5.kernel("gravity_forces", parameters=("tool0.mass",))
        >>> payloads = np.array([[0.0], [5.0]])
        >>> holding([0, -1, 1, 0, 0, 0], payloads)[:, 1].round(2).tolist()
        [-39.18, -69.68]
        """
        from ..mechanics.model.parameters import matching, nominal

        values = nominal(self.model)
        names = matching(self.model, patterns or ("*",))
        return {name: values[name] for name in names}

    def program(self, *names: str, **options: Unpack[KernelOptions]) -> Program:
        """Straight-line program behind a kernel, for example to count its operations.

        Parameters
        ----------
        *names : str, quantities
        **options : as for :meth:`kernel`

        Returns
        -------
        program : Program
        """
        return self.engine.program(names, options)

    def reference(self, name: str, *arrays: ArrayLike, **options: Unpack[KernelOptions]) -> Any:
        """Reference value of a quantity: the algorithm evaluated on floats, one state at a time, without compilation.

        Parameters
        ----------
        name : str, a quantity
        *arrays : inputs of the quantity, one state
        **options : as for :meth:`kernel`

        Returns
        -------
        result : array, or tuple of arrays if the quantity has several outputs; symbols if the inputs are symbols of a
            trace
        """
        return self.engine.reference(name, arrays, options)


def _missing(robot: RobotBase, name: str) -> AttributeError:
    """Error for an attribute that a robot does not have, with the call to use if it is known."""
    subject = f"{type(robot).__name__!r} object"
    if name.startswith("_"):
        return AttributeError(f"{subject} has no attribute {name!r}", name=name, obj=robot)  # Python suggests names
    from ..core.first_calls import missing_attribute
    from .quantities import QUANTITIES

    if name in QUANTITIES:
        call = f"kernel({name!r})"
        if name == "momentum_about_com":
            call = "momentum(q, dq, frame='com')"
        return AttributeError(f"{subject} has no attribute {name!r}: use robot.{call}", name=None)
    return missing_attribute(subject, name, "robot", dir(type(robot)))


def require_robot(robot: object, what: str) -> Robot:
    """Return ``robot`` if it is a Robot without constraints; raises ValueRangeError otherwise. ``what``: the caller."""
    if not isinstance(robot, RobotBase):
        raise ValueRangeError(
            f"{what}: the robot is {arguments.value_text(robot)}: give a tw.Robot, as tw.load(path) makes one."
        )
    if robot.constraints:
        raise ValueRangeError(
            f"{what}: not available for a robot with constraints, {robot!r}. For the robot with its loops open: robot.open()."
        )
    return cast("Robot", robot)


complete(globals())
