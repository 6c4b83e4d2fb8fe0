"""Methods that robots and closed robots share: inverse kinematics, closing loops, export."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ..core.glossary import complete
from .derivatives import Kind, Rows

if TYPE_CHECKING:
    from ..export.request import Quantities
    from .closed.closed_robot import ClosedRobot
    from .ik import IKResult
    from .ik_search import LoopClosureSolver
    from .robot import Robot


@cache
def _inverse_kinematics() -> Callable[..., IKResult]:
    """Imported at the first call; an import statement takes a good part of what a pose near by does."""
    from .ik import solve

    return solve


class IKMethods:
    """The methods of open and closed robots alike; what differs is asked of the robot by the names that begin here."""

    def _open(self) -> Robot:
        """The robot with its loops open."""
        raise NotImplementedError

    def _closed(self) -> ClosedRobot:
        """The robot with the loops that it has closed, none of an open one."""
        raise NotImplementedError

    def _searched_loops(self) -> LoopClosureSolver | None:
        """The gaps of its loops, as rows of a search."""
        return None

    def _constraint_options(self, name: str) -> Mapping[str, Any]:  # noqa: ARG002  a closed robot looks at it
        """What a quantity is told of the constraints."""
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
    ) -> IKResult:
        """Inverse kinematics: configurations, inside the joints' limits and with loops closed, at which a frame has the pose T.

        Parameters
        ----------
        T : (4, 4) array_like, wanted pose in the base frame [m]; (k, 4, 4) of k frames at once
        frame : str, optional, a link of the robot; its tip if None; a sequence of k names for k frames at once
        q0 : (nq,) array_like, optional, where the search starts, loops closed or not; None: neutral, or a closed configuration
        rows : str or iterable, optional, rows of the twist that count; ``"vx vy vz"`` asks for the position only;
            a mapping of frames to rows where frames differ
        restarts : int, random starts where the first fails; of a closed robot with its loops closed
        rng : numpy Generator or seed, for the random starts
        nearest : bool, whether what the poses leave free is used to come as near to ``q0`` as they let

        Returns
        -------
        found : IKResult
            It says which poses were reached, what is left, and why; nothing else counts as reached. Of a closed robot with
            the gap of its loops.

        Raises
        ------
        FrameError
            No frame is named, and the robot has no single tip.

        Notes
        -----
        Newton's method, damped, MR section 6.2. Any batch of T and q0. What is left of several frames is the root of the sum
        of squares. ``nearest`` goes on from what was found, by Newton steps in the poses' null space, 240 at most: what it
        reaches is the nearest on the way, not on other branches (Siciliano et al., Robotics, section 3.5.1).
        The gaps of closed loops are further rows, so that poses and loops are met together; what was not reached is a closed
        configuration as near as was found, where there is one.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.ur5()
        >>> found = arm.inverse_kinematics(arm.forward_kinematics([0.1, -1, 1, 0.2, 0.3, 0]))
        >>> bool(found.converged), found.q.shape
        (True, (6,))
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> T = arm.forward_kinematics(held.consistent([-0.6, 0.2, 2.2]), "link2")
        >>> found = held.inverse_kinematics(T, "link2", rows="wx wy wz")
        >>> bool(found.converged), bool(found.gap < 1e-12)
        (True, True)
        """
        return _inverse_kinematics()(
            self._open(), T, frame, q0, rows, restarts, rng, angle, distance, nearest, self._searched_loops()
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
        """Closed loop, or one more: the robot with ``frame_b`` held on ``frame_a``; see :class:`.closed_robot.ClosedRobot`.

        Parameters
        ----------
        frame_a, frame_b : str, frames of the robot; ``"ground"`` is the base
        rows : str or iterable, optional, rows of the twist that are held
            Three of turning and three of moving (None) are a weld; ``"vx vy vz"`` a ball joint; all but ``wz`` a hinge
            about z.
        pose : (4, 4) array_like, optional, of {c} in {a}; None: {a} itself

        Returns
        -------
        closed : ClosedRobot

        Raises
        ------
        ConstraintError
            No configuration is found at which the loops close, or rows depend on the others and ``redundant`` is not
            "accept".

        Notes
        -----
        The chosen rows of the twist of {b} as {c} sees it, along the axes of {c}, are zero, and {b} lies on {c} in
        these directions. Loops are closed one after another. MR section 8.7.

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
        from .closed.constraints import closure

        return self._closed()._with(closure(self._open().model, frame_a, frame_b, rows, pose), near, redundant)

    def constrain(
        self,
        frame: str,
        rows: Rows,
        kind: Kind = "body",
        *,
        near: ArrayLike | None = None,
        redundant: Literal["error", "accept"] = "error",
    ) -> ClosedRobot:
        """Velocity constraint, or one more: the robot with chosen rows of a frame's twist zero, as for a wheel or a blade.

        Parameters
        ----------
        frame : str, a frame of the robot
        rows : str or iterable, rows of the twist that are zero
        kind : "body", "space" or "world_aligned", as for :meth:`jacobian`
            ``"vz"`` is along the frame's own z (``"body"``), wherever that points. A hand that stays on a level table
            wants the world's, ``kind="world_aligned"``.

        Returns
        -------
        closed : ClosedRobot

        Raises
        ------
        ConstraintError
            Rows depend on the others and ``redundant`` is not "accept".

        Notes
        -----
        No position goes with it; where one does, as for a hand on a plane, :meth:`close` with ``"ground"`` keeps it.

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.floating_box().constrain("box", "vy")
        <ClosedRobot 'floating_box': box vy; 5 degrees of freedom>
        >>> tw.robots.floating_box().constrain("box", "vy").constrain("box", "vz").row_names
        ('box vy', 'box #2 vz')
        """
        from .closed.constraints import rolling

        return self._closed()._with(rolling(self._open().model, frame, rows, kind), near, redundant)

    def export_c(
        self,
        quantities: Quantities,
        path: str | Path,
        *,
        precision: Literal["double", "float"] = "double",
        prefix: str | None = None,
        test: bool = True,
    ) -> tuple[Path, ...]:
        """C code export: quantities as C99 functions that allocate nothing and need ``math.h`` only.

        Parameters
        ----------
        path : str or Path, a folder, or the .c file; the header goes beside it
        prefix : str, optional, what the functions' names begin with; None: the robot's name
        test : bool, write a program that compares the functions with the kernels, too

        Returns
        -------
        paths : tuple of Path, what was written

        Raises
        ------
        KernelError
            An option does not apply, or no program without branches computes it.
        SingularMassMatrixError
            A quantity needs M⁻¹, and M has none.
        ValueRangeError
            ``path`` cannot be written.

        Notes
        -----
        docs/export.md shows the files. A closed robot exports quantities with its constraints and those of the open one.

        Examples
        --------
        >>> import tempfile, twistwrench as tw
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     files = tw.robots.ur5().export_c(["mass_matrix", ("jacobian", {"kind": "space"})], folder)
        ...     print("void ur5_mass_matrix(const double q[6], double M[36]);" in files[0].read_text())
        True
        >>> arm = tw.robots.planar_3r()
        >>> held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     files = held.export_c(["constrained_dynamics", "mass_matrix"], folder)
        ...     print("double lambda[2]" in files[0].read_text())
        True
        """
        from ..export import export_c
        from ..export.request import named

        asked = [(name, {**self._constraint_options(name), **options}) for name, options in named(quantities)]
        return export_c(self._open(), asked, path, precision=precision, prefix=prefix, test=test)

    def export_cuda(
        self,
        quantities: Quantities,
        path: str | Path,
        *,
        precision: Literal["double", "float"] = "double",
        prefix: str | None = None,
    ) -> tuple[Path, ...]:
        """CUDA source export: quantities as CUDA C++ kernels with a thread for each sample.

        Parameters
        ----------
        path : str or Path, a folder, which gets a file for each kernel; or the .cu file of one kernel
        prefix : str, optional, first part of the kernels' names; None: the robot's name

        Returns
        -------
        paths : tuple of Path, the files written

        Raises
        ------
        KernelError
            An option does not apply, no program without branches computes the quantity, or the program is too long.
        SingularMassMatrixError
            A quantity needs M⁻¹, and M has none.
        ValueRangeError
            ``path`` cannot be written.

        Notes
        -----
        docs/export.md describes the launch. Compiled by nvcc and NVRTC in the tests, not yet run on a GPU.

        Examples
        --------
        >>> import tempfile, twistwrench as tw
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     (file,) = tw.robots.panda().export_cuda("inverse_dynamics", folder, precision="float")
        ...     print("void __launch_bounds__(THREADS) panda_inverse_dynamics" in file.read_text())
        True
        """
        from ..export import export_cuda
        from ..export.request import named

        asked = [(name, {**self._constraint_options(name), **options}) for name, options in named(quantities)]
        return export_cuda(self._open(), asked, path, precision=precision, prefix=prefix)


complete(globals())
