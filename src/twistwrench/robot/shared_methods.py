"""Methods that robots and closed robots share: inverse kinematics, closing loops, export, simulation."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.glossary import complete
from .arguments import Kind, Rows

if TYPE_CHECKING:
    from .constraints.closed_robot import ClosedRobot
    from .export.request import Quantities
    from .ik import IKResult
    from .ik_search import LoopClosureSolver
    from .robot import Robot


@cache
def _inverse_kinematics() -> Callable[..., IKResult]:
    """Import the solver at the first call; an import statement costs a large part of a nearby solution's time."""
    from .ik import solve

    return solve


class SharedMethods:
    """Methods of open and closed robots; the methods with a leading underscore differ between them."""

    def open(self) -> Robot:
        """Robot with its loops open."""
        raise NotImplementedError

    def _closed(self) -> ClosedRobot:
        """Robot with its closed loops; a robot without loops has none."""
        raise NotImplementedError

    def _searched_loops(self) -> LoopClosureSolver | None:
        """Solver for the loop gaps, as rows of a search."""
        return None

    def _constraint_options(self, name: str) -> Mapping[str, Any]:  # noqa: ARG002  a closed robot looks at it
        """Constraint options of a quantity."""
        return {}

    def inverse_kinematics(
        self,
        T: ArrayLike,
        frame: str | Sequence[str] | None = None,
        q0: ArrayLike | None = None,
        *,
        rows: Rows | Mapping[str, Rows] = None,
        restarts: int = 30,
        rng: np.random.Generator | int | None = 0,
        angle: float = 1e-10,
        distance: float = 1e-10,
        nearest: bool = False,
        clearance: float | None = None,
    ) -> IKResult:
        """Inverse kinematics: configurations, inside joint limits and with loops closed, at which a frame has the pose T.

        Parameters
        ----------
        T : (4, 4) array_like, desired pose in the base frame [m]; (k, 4, 4) for k frames at once
        frame : str, optional, a link of the robot; its tip if None; a sequence of k names for k frames at once
        q0 : (nq,) array_like, optional, start of the search, loops closed or not; None: neutral, or a closed
            configuration
        rows : str or iterable, optional, rows of the twist that count; ``"vx vy vz"`` selects the position only;
            a mapping of frames to rows if frames differ
        restarts : int, number of random starts if the first one fails; with loops closed for a closed robot
        rng : numpy Generator or seed, for the random starts
        nearest : bool, use the remaining degrees of freedom to come as near to ``q0`` as possible
        clearance : float, optional, smallest distance between links [m], as computed by :meth:`clearance`
            A solution below it is replaced by the nearest sufficient one from ``restarts`` random starts.

        Returns
        -------
        found : IKResult
            Poses reached, remaining errors and reasons, and for a closed robot the gaps of its loops. Only solutions
            within the tolerances count as reached.

        Notes
        -----
        Damped Newton method, MR section 6.2. Any batch of T and q0. The error of several frames is the root of the sum
        of squares. ``nearest`` continues from the solution with at most 240 Newton steps in the null space of the
        poses. It finds the nearest configuration on the same branch only (Siciliano et al., Robotics, section 3.5.1).
        The gaps of closed loops are further rows, so that poses and loops are satisfied together. If a pose is not
        reached, the result is the nearest closed configuration found, if there is one.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.ur5()
        >>> found = arm.inverse_kinematics(arm.forward_kinematics([0.1, -1, 1, 0.2, 0.3, 0]))
        >>> bool(found.converged), found.q.shape
        (True, (6,))
        """
        options = angle, distance, nearest, self._searched_loops()
        found = _inverse_kinematics()(self.open(), T, frame, q0, rows, restarts, rng, *options)
        if clearance is None:
            return found
        from .ik import clear_of_links

        robot, poses = self.open(), np.asarray(T)
        core = 2 if frame is None or isinstance(frame, str) else 3
        return clear_of_links(
            found,
            np.broadcast_to(poses, (*found.q.shape[:-1], *poses.shape[-core:])),
            lambda target, starts: _inverse_kinematics()(robot, target, frame, starts, rows, 0, rng, *options),
            robot._clearance_search(),
            arguments.positive(clearance, "inverse_kinematics: clearance", "m", zero=True),
            robot.random_configuration(rng, restarts),
        )

    def close(
        self,
        frame_a: str,
        frame_b: str,
        rows: Rows = None,
        *,
        pose: ArrayLike | None = None,
        near: ArrayLike | None = None,
        redundant: Literal["error", "accept"] = "error",
    ) -> ClosedRobot:
        """Closed loop: the robot with ``frame_b`` constrained to ``frame_a``; see :class:`.closed_robot.ClosedRobot`.

        The selected rows of the twist of {b} relative to {c}, along the axes of {c}, are zero, and {b} lies on {c} in
        these directions. Loops are closed one after another. MR section 8.7.

        Parameters
        ----------
        frame_a, frame_b : str, frames of the robot; ``"ground"`` is the base
        rows : str or iterable, optional, rows of the twist that are constrained
            All six (None) are a weld; ``"vx vy vz"`` is a ball joint; all but ``wz`` is a hinge about z.
        pose : (4, 4) array_like, optional, pose of {c} in {a}; None: the identity

        Raises
        ------
        ConstraintError
            No configuration with closed loops is found, or rows depend on others and ``redundant`` is not "accept".

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> at_the_wall = tw.se3.exp([0, 0, 0, 1.5, 0, 0])
        >>> arm.close("ground", arm.tip, rows="vx vz", pose=at_the_wall)
        <ClosedRobot 'planar_3r': ground–tip vx vz; 1 degree of freedom>
        >>> arm.close("ground", "tip", rows="vz").close("ground", "tip", rows="wy").row_names
        ('ground–tip vz', 'ground–tip #2 wy')
        """
        from .constraints.closures import closure

        return self._closed()._with(closure(self.open().model, frame_a, frame_b, rows, pose), near, redundant)

    def constrain(
        self,
        frame: str,
        rows: Rows,
        kind: Kind = "body",
        *,
        near: ArrayLike | None = None,
        redundant: Literal["error", "accept"] = "error",
    ) -> ClosedRobot:
        """Velocity constraint: the robot with selected rows of a frame's twist zero, as for a wheel or a blade.

        The position stays free. To constrain it, as for a hand on a plane, use :meth:`close` with ``"ground"``.

        Parameters
        ----------
        frame : str, a frame of the robot
        rows : str or iterable, rows of the twist that are zero
        kind : "body", "space" or "world_aligned", as for :meth:`jacobian`
            With ``"body"``, ``"vz"`` is along the frame's own z in any orientation. For a hand on a level table, use
            ``kind="world_aligned"``.

        Raises
        ------
        ConstraintError
            Rows depend on others and ``redundant`` is not "accept".

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.floating_box().constrain("box", "vy")
        <ClosedRobot 'floating_box': box vy; 5 degrees of freedom>
        >>> tw.robots.floating_box().constrain("box", "vy").constrain("box", "vz").row_names
        ('box vy', 'box #2 vz')
        """
        from .constraints.closures import rolling

        return self._closed()._with(rolling(self.open().model, frame, rows, kind), near, redundant)

    def export_c(
        self,
        quantities: Quantities,
        path: str | Path,
        *,
        precision: Literal["double", "float"] = "double",
        prefix: str | None = None,
        test: bool = True,
    ) -> tuple[Path, ...]:
        """C code export: quantities as C99 functions that need only ``math.h`` and no heap memory.

        docs/export.md shows the files. A closed robot also exports quantities with its constraints.

        Parameters
        ----------
        path : str or Path, a folder, or the .c file; the header is written beside it
        test : bool, also write a program that compares the functions with the kernels

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

        return export_c(self.open(), self._requests(quantities), path, precision=precision, prefix=prefix, test=test)

    def export_st(
        self,
        quantities: Quantities,
        path: str | Path,
        *,
        precision: Literal["double", "float"] = "double",
        prefix: str | None = None,
        test: bool = True,
        style: Literal["function_block", "codesys"] = "function_block",
        torque: Literal["joint", "motor"] = "joint",
    ) -> Path:
        """Structured Text export: quantities as function blocks (IEC 61131-3) for PLCs. Not yet run on a PLC.

        docs/export.md shows the file. The tests execute it with an interpreter based on an independent parser.

        Parameters
        ----------
        path : str or Path, a folder, or a file with suffix .st, .scl, .exp or .txt
        precision : "double" or "float", numbers of type LREAL or REAL
        test : bool, also write a program that compares the blocks with stored results
        style : "function_block" or "codesys"
            "codesys" adds a block for the interface ISMDynamics, to be completed by hand; it exports only
            ``inverse_dynamics``, with gravity as an input.
        torque : "joint" or "motor"
            "motor" converts the torques of ``inverse_dynamics`` to the motor shafts, as :meth:`motor_loads` does.

        Returns
        -------
        file : Path

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
        ...     file = tw.robots.ur5().export_st(["inverse_dynamics", "gravity_forces"], folder)
        ...     print("FUNCTION_BLOCK ur5_inverse_dynamics" in file.read_text())
        True
        """
        from .export.structured_text import export_st

        wanted: Any = self._requests(quantities)
        return export_st(
            self.open(), wanted, path, precision=precision, prefix=prefix, test=test, style=style, torque=torque
        )

    def export_ros2(self, path: str | Path, *, license: str = "Apache-2.0") -> tuple[Path, ...]:  # noqa: A002
        """ROS 2 package export: a plug-in of ``inverse_dynamics_solver`` with a test. Not yet built with colcon.

        docs/export.md shows the files. The plug-in compares joints and masses with ``robot_description``.

        Parameters
        ----------
        path : str or Path, the folder to create; its last part is the name of the package
        license : str, for package.xml

        Returns
        -------
        files : tuple of Path

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
        precision: Literal["double", "float"] = "double",
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

        return export_cuda(self.open(), self._requests(quantities), path, precision=precision, prefix=prefix)

    def _requests(self, quantities: Quantities) -> list[tuple[str, dict[str, Any]]]:
        """Quantities with their options, including the constraints."""
        from .export.request import named

        return [(name, {**self._constraint_options(name), **options}) for name, options in named(quantities)]


complete(globals())
