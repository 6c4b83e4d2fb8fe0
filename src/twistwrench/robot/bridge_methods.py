"""The quantities of a robot as functions of other packages."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Literal, Unpack

if TYPE_CHECKING:
    from .quantity_options import KernelOptions


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
        from ..bridges.jax import jax_function
        from ..bridges.quantity import BridgedQuantity

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
        from ..bridges.quantity import BridgedQuantity
        from ..bridges.torch import torch_function

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
        from ..bridges.casadi import casadi_function
        from ..bridges.quantity import BridgedQuantity

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
        from ..bridges.javascript import javascript_module
        from ..bridges.quantity import BridgedQuantity

        return javascript_module(BridgedQuantity(self, quantity, options))
