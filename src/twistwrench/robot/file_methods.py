"""Methods that write a robot to other formats and to functions of other packages."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, Literal, Unpack

from ..errors import MissingExtraError, ModelError, ModelWarning
from ..model.notes import frames_to_user, grouped

if TYPE_CHECKING:
    from .programs import KernelOptions


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


# ── Quantities as functions of other packages


class BridgeMethods:
    """The methods of a robot that hand its programs to JAX, PyTorch, CasADi and JavaScript."""

    def to_jax(
        self: Any, quantity: str, *, precision: Literal["double", "single"] = "double", **options: Unpack[KernelOptions]
    ) -> Callable[..., Any]:
        """Function of JAX arrays that computes one quantity: it jits, vmaps, and differentiates in both modes.

        Parameters
        ----------
        quantity : str, a quantity's name
        precision : "double" or "single"
            Double needs ``jax_enable_x64``; without, a warning says that float32 was computed.
        **options : as for :meth:`kernel`, but for ``by`` and what goes with it

        Returns
        -------
        function : callable, of the quantity's inputs with any leading batch shape

        Raises
        ------
        UnknownNameError
            There is no such quantity or frame.
        KernelError
            An option does not apply.
        MissingExtraError
            JAX is not installed.

        Notes
        -----
        First derivatives are the robot's analytic ones. Derivatives by q are by its entries; along a quaternion's own
        length they are zero.

        Examples
        --------
        >>> import jax, twistwrench as tw
        >>> jax.config.update("jax_enable_x64", True)
        >>> gravity_forces = tw.robots.pendulum().to_jax("gravity_forces")
        >>> float(jax.jacobian(gravity_forces)(jax.numpy.zeros(1))[0, 0]).__round__(2)
        9.81
        """
        from ..export.bridge import BridgedQuantity
        from ..export.jax import jax_function

        return jax_function(BridgedQuantity.of("to_jax", self, quantity, options, precision), precision)

    def to_torch(self: Any, quantity: str, **options: Unpack[KernelOptions]) -> Callable[..., Any]:
        """Function of PyTorch tensors that computes one quantity by compiled kernels, differentiable twice.

        Parameters
        ----------
        quantity : str, a quantity's name
        **options : as for :meth:`kernel`, but for ``by`` and what goes with it

        Returns
        -------
        function : callable, of the quantity's inputs with any leading batch shape
            Tensors on the processor share their memory with the kernel, those on a GPU stay there; float32 if all are.

        Raises
        ------
        UnknownNameError
            There is no such quantity or frame.
        KernelError
            An option does not apply.
        MissingExtraError
            PyTorch is not installed.

        Notes
        -----
        Works with ``torch.func`` (grad, jacrev, vmap). Derivatives by q are by its entries; along a quaternion's own
        length they are zero.

        Examples
        --------
        >>> import twistwrench as tw
        >>> import torch  # doctest: +SKIP
        >>> energy = tw.robots.pendulum().to_torch("potential_energy")  # doctest: +SKIP
        >>> q = torch.zeros(1, dtype=torch.float64, requires_grad=True)  # doctest: +SKIP
        >>> torch.autograd.grad(energy(q), q)  # doctest: +SKIP
        (tensor([0.], dtype=torch.float64),)
        """
        from ..export.bridge import BridgedQuantity
        from ..export.torch import torch_function

        return torch_function(BridgedQuantity.of("to_torch", self, quantity, options, "double"))

    def to_casadi(self: Any, quantity: str, **options: Unpack[KernelOptions]) -> Any:
        """CasADi function that computes one quantity, in SX symbols, for optimal control and code generation.

        Parameters
        ----------
        quantity : str, a quantity's name
        **options : as for :meth:`kernel`, but for ``by`` and what goes with it

        Returns
        -------
        function : casadi.Function, of columns; a result of more than two axes has the first as its rows

        Raises
        ------
        UnknownNameError
            There is no such quantity or frame.
        KernelError
            An option does not apply.
        MissingExtraError
            CasADi is not installed.

        Notes
        -----
        Derivatives are CasADi's, by the entries of q; those of a quaternion are not kept at length one.

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.pendulum().to_casadi("inverse_dynamics")
        Function(inverse_dynamics:(q,dq,ddq)->(tau) SXFunction)
        """
        from ..export.bridge import BridgedQuantity
        from ..export.javascript import casadi_function

        return casadi_function(BridgedQuantity.of("to_casadi", self, quantity, options, "double"))

    def to_javascript(self: Any, quantity: str, **options: Unpack[KernelOptions]) -> str:
        """JavaScript module with one function that computes one quantity, for browsers and Node.

        Parameters
        ----------
        quantity : str, a quantity's name
        **options : as for :meth:`kernel`

        Returns
        -------
        text : str, an ES module without imports
            Its function takes arrays of numbers, matrices flat in C order, and last an ``out`` to fill, a fresh
            ``Float64Array`` if left out; of several results an object of arrays.

        Raises
        ------
        UnknownNameError
            There is no such quantity or frame.
        KernelError
            An option does not apply.

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
        from ..export.bridge import BridgedQuantity
        from ..export.javascript import javascript_module

        return javascript_module(BridgedQuantity(self, quantity, options))
