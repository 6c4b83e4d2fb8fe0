"""The robot's quantities on a GPU, a thread for each sample: ``robot.cuda``."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from . import quantities
from .errors import ShapeError, UnknownNameError, ValueRangeError
from .kernels.cuda_kernel import CudaKernel
from .kernels.device_array import DeviceArray, to_device
from .program.program import Instruction, Program
from .targets.c import PRECISIONS

if TYPE_CHECKING:
    from .robot import Robot

Device = Any
"""An array in a GPU's memory: PyTorch's, CuPy's, whatever has ``__cuda_array_interface__`` or DLPack."""

Wrenches = Mapping[str, Device]

__all__ = ["CudaRobot", "DeviceArray", "to_device"]


class CudaRobot:
    """A robot's quantities for arrays in a GPU's memory, with the names and arguments of :class:`~twistwrench.Robot`.

    Arrays are (..., n), all float32 or all float64; nothing is copied. An input without batch axes serves all samples. What
    comes out is of the first input's library, or in ``out=``; a kernel is compiled at its first call. Calls do not wait for
    the GPU. They raise ShapeError, ValueRangeError, KernelError where there is no GPU, MissingExtraError without NVRTC.

    >>> import twistwrench as tw
    >>> tw.robots.panda().cuda.kernel("inverse_dynamics")
    <CudaKernel inverse_dynamics: (7),(7),(7)->(7)>
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._kernels: dict[Any, CudaKernel] = {}

    def __repr__(self) -> str:
        return f"<CudaRobot {self._robot.name!r}>"

    def kernel(self, name: str, **options: Any) -> CudaKernel:
        """The kernel of any quantity, with the options of :meth:`twistwrench.Robot.kernel`; wrenches are by the robot.

        Raises as :meth:`twistwrench.Robot.export_c` does for what has no program, and KernelError for what is too long.
        """
        return self._kernel(name, (), options)

    def source(self, name: str, precision: str = "double", **options: Any) -> str:
        """The kernel's CUDA C++; needs no GPU. ``precision``: ``"double"`` or ``"float"``. docs/cuda.md says how to compile it.

        >>> import twistwrench as tw
        >>> text = tw.robots.panda().cuda.source("inverse_dynamics", precision="float")
        >>> "void __launch_bounds__(THREADS) panda_inverse_dynamics" in text
        True
        """
        from .export.document import comment

        if precision not in PRECISIONS:
            raise UnknownNameError.of("precision", precision, PRECISIONS)
        function = self.kernel(name, **options).function(precision)
        about = [
            f"{name} of the robot {self._robot.name} as a CUDA kernel, numbers of type {precision}. By twistwrench "
            f"{version('twistwrench')}.",
            "A thread computes a sample, a block THREADS of them; blocks: (samples + THREADS - 1) / THREADS.",
            "An input has a pointer and how many elements lie from one sample to the next, 0 if one serves all.",
            "Compile with -std=c++17 -fmad=false: products that are fused are fused here. As C++ (-ffp-contract=off) the",
            "function of the same name runs all blocks on the processor.",
        ]
        return f"{comment(about)}\n{function.source}"

    def _kernel(self, name: str, on_robot: tuple[str, ...], options: Mapping[str, Any]) -> CudaKernel:
        asked = (name, on_robot, *options.items())
        try:
            return self._kernels[asked]
        except (KeyError, TypeError):  # not yet asked for like this, or by a list
            pass
        full = quantities.checked_options(self._robot.model, name, options)
        key = (name, on_robot, *full.items())
        if key not in self._kernels:
            from .export.request import prefix_of, requests

            robot = self._robot
            (request,) = requests(robot, [(name, options)], "double", prefix_of(robot, None))
            function, turned = request.function, {f"wrench at {frame}" for frame in on_robot}
            ending = "_on_robot" if turned else ""
            program = _with_opposite(function.program, turned) if turned else function.program
            self._kernels[key] = CudaKernel(function.name + ending, program, name)
        with contextlib.suppress(TypeError):
            self._kernels[asked] = self._kernels[key]
        return self._kernels[key]

    def _call(self, name: str, *arrays: Device, out: Any = None, stream: Any = None, **options: Any) -> Any:
        return self._kernel(name, (), options)(*arrays, out=out, stream=stream)

    def _with_wrenches(
        self,
        name: str,
        arrays: tuple[Device, ...],
        by_robot: Wrenches | None,
        on_robot: Wrenches | None,
        out: Any,
        stream: Any,
    ) -> Any:
        """Call a kernel that takes wrenches as further inputs; the sign of those on the robot is the kernel's affair."""
        for given in (by_robot, on_robot):
            if given is not None and not isinstance(given, Mapping):
                raise ShapeError("wrenches are a dict {frame: (m, f)}, for the frame is part of what a wrench says.")
        by, on = dict(by_robot or {}), dict(on_robot or {})
        if both := by.keys() & on.keys():
            raise ValueRangeError(
                f"{name}: wrenches by and on the robot are given at {min(both)!r}. Give one, their difference."
            )
        frames, total = tuple(sorted({**by, **on})), {**by, **on}
        kernel = self._kernel(name, tuple(sorted(on)), {"wrenches": frames} if frames else {})
        return kernel(*arrays, *(total[frame] for frame in frames), out=out, stream=stream)

    # ── kinematics ──

    def forward_kinematics(self, q: Device, frame: str | None = None, *, out: Any = None, stream: Any = None) -> Any:
        """T_s,frame; (nq) → (4, 4)."""
        return self._call("forward_kinematics", q, frame=frame, out=out, stream=stream)

    def link_poses(self, q: Device, *, out: Any = None, stream: Any = None) -> Any:
        """T_s,link of all links; (nq) → (nlinks, 4, 4)."""
        return self._call("link_poses", q, out=out, stream=stream)

    def jacobian(
        self, q: Device, frame: str | None = None, kind: str = "body", *, out: Any = None, stream: Any = None
    ) -> Any:
        """J with V = J dq; (nq) → (6, nv), angular rows first."""
        return self._call("jacobian", q, frame=frame, kind=kind, out=out, stream=stream)

    def jacobian_rate(
        self,
        q: Device,
        dq: Device,
        frame: str | None = None,
        kind: str = "body",
        *,
        out: Any = None,
        stream: Any = None,
    ) -> Any:
        """d/dt of the Jacobian; (nq), (nv) → (6, nv)."""
        return self._call("jacobian_rate", q, dq, frame=frame, kind=kind, out=out, stream=stream)

    def frame_velocity(
        self,
        q: Device,
        dq: Device,
        frame: str | None = None,
        kind: str = "body",
        *,
        out: Any = None,
        stream: Any = None,
    ) -> Any:
        """Twist (omega, v) of a frame; (nq), (nv) → (6)."""
        return self._call("frame_velocity", q, dq, frame=frame, kind=kind, out=out, stream=stream)

    def frame_acceleration(
        self,
        q: Device,
        dq: Device,
        ddq: Device,
        frame: str | None = None,
        kind: str = "body",
        *,
        out: Any = None,
        stream: Any = None,
    ) -> Any:
        """d/dt of the frame's twist; (nq), (nv), (nv) → (6)."""
        return self._call("frame_acceleration", q, dq, ddq, frame=frame, kind=kind, out=out, stream=stream)

    # ── dynamics ──

    def inverse_dynamics(
        self,
        q: Device,
        dq: Device,
        ddq: Device,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        out: Any = None,
        stream: Any = None,
    ) -> Any:
        """τ; (nq), (nv), (nv) → (nv). Wrenches ``{frame: (..., 6)}``; friction has a method of its own."""
        given = wrench_by_robot, wrench_on_robot, out, stream
        return self._with_wrenches("inverse_dynamics", (q, dq, ddq), *given)

    def forward_dynamics(
        self,
        q: Device,
        dq: Device,
        tau: Device,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        out: Any = None,
        stream: Any = None,
    ) -> Any:
        """q̈; (nq), (nv), (nv) → (nv). Raises SingularMassMatrixError where a joint moves nothing with inertia."""
        given = wrench_by_robot, wrench_on_robot, out, stream
        return self._with_wrenches("forward_dynamics", (q, dq, tau), *given)

    def drive_torques(
        self,
        q: Device,
        dq: Device,
        ddq: Device,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        out: Any = None,
        stream: Any = None,
    ) -> Any:
        """What the gears carry, and what the rotors take before them, a pair; (nv) each."""
        given = wrench_by_robot, wrench_on_robot, out, stream
        return self._with_wrenches("drive_torques", (q, dq, ddq), *given)

    def mass_matrix(self, q: Device, *, out: Any = None, stream: Any = None) -> Any:
        """M; (nq) → (nv, nv)."""
        return self._call("mass_matrix", q, out=out, stream=stream)

    def bias_forces(self, q: Device, dq: Device, *, out: Any = None, stream: Any = None) -> Any:
        """h = c + g; (nq), (nv) → (nv)."""
        return self._call("bias_forces", q, dq, out=out, stream=stream)

    def coriolis_forces(self, q: Device, dq: Device, *, out: Any = None, stream: Any = None) -> Any:
        """c; (nq), (nv) → (nv)."""
        return self._call("coriolis_forces", q, dq, out=out, stream=stream)

    def coriolis_matrix(self, q: Device, dq: Device, *, out: Any = None, stream: Any = None) -> Any:
        """C with C dq = c; (nq), (nv) → (nv, nv)."""
        return self._call("coriolis_matrix", q, dq, out=out, stream=stream)

    def christoffel(self, q: Device, *, out: Any = None, stream: Any = None) -> Any:
        """Γ_ijk; (nq) → (nv, nv, nv)."""
        return self._call("christoffel", q, out=out, stream=stream)

    def gravity_forces(self, q: Device, *, out: Any = None, stream: Any = None) -> Any:
        """g; (nq) → (nv)."""
        return self._call("gravity_forces", q, out=out, stream=stream)

    def friction_forces(self, dq: Device, *, load: Device = None, out: Any = None, stream: Any = None) -> Any:
        """The torques that overcome joint friction; (nv) → (nv)."""
        if load is None:
            return self._call("friction_forces", dq, out=out, stream=stream)
        return self._call("friction_under_load", dq, load, out=out, stream=stream)

    def regressor(self, q: Device, dq: Device, ddq: Device, *, out: Any = None, stream: Any = None) -> Any:
        """Y with τ = Y π; (nq), (nv), (nv) → (nv, 10 nbodies)."""
        return self._call("regressor", q, dq, ddq, out=out, stream=stream)

    # ── derivatives ──

    def inverse_dynamics_derivatives(
        self,
        q: Device,
        dq: Device,
        ddq: Device,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        out: Any = None,
        stream: Any = None,
    ) -> Any:
        """∂τ/∂q and ∂τ/∂dq, a pair; (nq), (nv), (nv) → (nv, nv) each."""
        given = wrench_by_robot, wrench_on_robot, out, stream
        return self._with_wrenches("inverse_dynamics_derivatives", (q, dq, ddq), *given)

    def forward_dynamics_derivatives(
        self,
        q: Device,
        dq: Device,
        tau: Device,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        out: Any = None,
        stream: Any = None,
    ) -> Any:
        """∂ddq/∂q, ∂ddq/∂dq and ∂ddq/∂τ; (nq), (nv), (nv) → (nv, nv) each."""
        given = wrench_by_robot, wrench_on_robot, out, stream
        return self._with_wrenches("forward_dynamics_derivatives", (q, dq, tau), *given)

    # ── statics, energies, momentum ──

    def wrench_torques(
        self, q: Device, wrench_by_robot: Device, frame: str | None = None, *, out: Any = None, stream: Any = None
    ) -> Any:
        """J_b' F alone; (nq), (6) → (nv)."""
        return self._call("wrench_torques", q, wrench_by_robot, frame=frame, out=out, stream=stream)

    def holding_torques(
        self,
        q: Device,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        out: Any = None,
        stream: Any = None,
    ) -> Any:
        """The torques of static equilibrium; (nq) → (nv)."""
        return self._with_wrenches("holding_torques", (q,), wrench_by_robot, wrench_on_robot, out, stream)

    def joint_wrenches(
        self,
        q: Device,
        dq: Device,
        ddq: Device,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        out: Any = None,
        stream: Any = None,
    ) -> Any:
        """The wrench each moving body receives across its joint; → (nbodies, 6)."""
        given = wrench_by_robot, wrench_on_robot, out, stream
        return self._with_wrenches("joint_wrenches", (q, dq, ddq), *given)

    def kinetic_energy(self, q: Device, dq: Device, *, out: Any = None, stream: Any = None) -> Any:
        """½ dq' M dq; (nq), (nv) → ()."""
        return self._call("kinetic_energy", q, dq, out=out, stream=stream)

    def potential_energy(self, q: Device, *, out: Any = None, stream: Any = None) -> Any:
        """Of the moving bodies; (nq) → ()."""
        return self._call("potential_energy", q, out=out, stream=stream)

    def momentum(self, q: Device, dq: Device, frame: str = "base", *, out: Any = None, stream: Any = None) -> Any:
        """Spatial momentum at the base origin, or with ``frame="com"`` about the centre of mass; (nq), (nv) → (6)."""
        if frame not in ("base", "com"):
            raise UnknownNameError.of("momentum frame", frame, ("base", "com"))
        return self._call("momentum" if frame == "base" else "momentum_about_com", q, dq, out=out, stream=stream)

    def center_of_mass(self, q: Device, *, out: Any = None, stream: Any = None) -> Any:
        """Of the moving bodies, in the base frame; (nq) → (3)."""
        return self._call("center_of_mass", q, out=out, stream=stream)

    def com_jacobian(self, q: Device, *, out: Any = None, stream: Any = None) -> Any:
        """J with d(center_of_mass)/dt = J dq; (nq) → (3, nv)."""
        return self._call("com_jacobian", q, out=out, stream=stream)


def _with_opposite(program: Program, names: set[str]) -> Program:
    """The program of which some inputs enter with the opposite sign."""
    owners = [port.name for port in program.inputs for _ in range(port.size)]
    made: list[Instruction] = []
    place: list[int] = []
    for op, args, value in program.instructions:
        made.append(Instruction(op, tuple(place[a] for a in args), value))
        if op == "input" and owners[int(value)] in names:
            made.append(Instruction("neg", (len(made) - 1,), 0.0))
        place.append(len(made) - 1)
    return Program(tuple(made), tuple(place[r] for r in program.results), program.inputs, program.outputs)
