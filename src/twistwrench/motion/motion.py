"""Motion: states of a robot over time from any source, with torques, limits, interpolation and files.

Logs, trajectories, simulations and rollouts produce motions; reports, plots, the viewer and controllers use them.
Files are read by :mod:`.motion_log`, and other libraries' tables by :mod:`.motion_io`.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.doubts import Doubt
from ..core.errors import HintedClass, ModelWarning, ShapeError, ValueRangeError
from ..core.files import as_path
from ..core.glossary import complete
from ..core.numbers import printed
from ..core.tables import csv_table, data_frame
from ..core.text import shorten
from ..core.typing import Array
from ..mechanics.model.limits import Limits
from ..robot.base import require_robot
from .bounds import LimitCheck, Violation, bounds_or_own, velocities_inside
from .column_names import time_column
from .contradictions import Contradictions
from .coordinates import Coordinates, joint_rates
from .doors import MotionDoors
from .plausibility import Instant, RecordedSteps, origin_of
from .smoothing import FEWEST, continuous, spline_rates, states_between

if TYPE_CHECKING:
    from ..robot import Robot
    from .motion_log import MotionLog


@dataclass(frozen=True, eq=False, repr=False)
class Motion(MotionDoors, metaclass=HintedClass):
    """States of one robot at increasing times.

    Parameters
    ----------
    time
        (n,) times [s], increasing.
    q
        (n, nq) coordinates.
    dq, ddq
        (n, nv) velocities and accelerations; if None, derived from q by a quintic spline.
    tau
        (n, nv) measured or applied torques [N m or N]; None if unknown.
    robot
        Robot of these states.

    Raises
    ------
    ShapeError, ValueRangeError
        Arrays have other shapes, times do not increase, numbers are not finite, or there are fewer than six samples
        without rates. Times that look like milliseconds, and rates that differ from the slopes, give a ModelWarning and
        an entry of ``notes``.

    Examples
    --------
    >>> import tempfile, numpy as np, twistwrench as tw
    >>> t = np.linspace(0, 1, 101)
    >>> motion = tw.Motion(t, np.outer(t**2, [1, -1]), robot=tw.robots.planar_2r())
    >>> motion.torques().shape, motion.at(0.5)[0].round(3).tolist()
    ((101, 2), [0.25, -0.25])
    >>> motion.violations(), motion.contradictions, list(motion.terms())
    ((), (), ['inertia', 'coriolis', 'gravity'])
    >>> list(motion.columns())[:3], motion.to_pandas().shape, motion.to_xarray().dq.sel(joint="joint2").shape
    (['time', 'joint1', 'joint2'], (101, 6), (101,))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     table, picture = motion.to_csv(f"{folder}/motion.csv"), motion.plot(f"{folder}/motion.svg")
    ...     table.read_text().split(",")[0], picture.name, motion.to_mcap(f"{folder}/motion.mcap").name
    ('time', 'motion.svg', 'motion.mcap')
    >>> motion.to_rerun("motion.rrd")  # doctest: +SKIP
    """

    time: Array
    q: Array
    dq: Array = None  # type: ignore[assignment]
    ddq: Array = None  # type: ignore[assignment]
    tau: Array | None = None
    robot: Robot = None  # type: ignore[assignment]
    notes: tuple[str, ...] = ()
    """Notes on assumptions and contradictions of its source."""
    in_seconds: bool = False
    """True if times are known to be seconds; long time steps then raise no doubt."""
    read: tuple[Doubt, ...] | None = None
    """Doubts found while the file was read; if None, :attr:`doubts` are found from the numbers."""
    epoch: int = 0
    """Stamp of time 0 in recordings [ns], since 1970 or on the clock of the original recording."""
    derived: str = ""
    """Source of derived rates: ``positions`` or ``velocities``; empty if all rates are given."""
    friction: bool = False
    """True if it was planned with joint friction, which :meth:`violations` then counts."""
    plan: bool = False
    """True for a planned or simulated motion: what no robot does is then a violation of limits, and not an error of a log."""
    command: Array | None = None
    """(n, nv) commanded positions [rad, m] of the joints at the same times, NaN for joints without; None if unknown."""

    def __post_init__(self) -> None:
        first_argument: object = self.time
        if isinstance(first_argument, str | Path):
            name = shorten(str(first_argument))
            raise TypeError(f'Motion takes arrays; to read a file: tw.Motion.from_file("{name}", robot)')
        if self.robot is None:
            raise ShapeError("Motion: robot= is missing: the robot whose states these are.")
        require_robot(self.robot, "Motion")
        model = self.robot.model
        t = np.asarray(arguments.finite(self.time, "Motion: time"), float)
        q = np.asarray(arguments.finite(self.q, "Motion: q", model.nq, names=self.robot.coordinate_names), float)
        if t.ndim != 1 or not len(t) or q.shape != (len(t), model.nq):
            raise ShapeError(f"Motion: time has shape {t.shape} and q {q.shape}; give (n,) and (n, {model.nq}).")
        for body in model.leaders:
            coordinate_slice, _ = body.places
            if not body.joint.is_configuration(q[:, coordinate_slice]):
                raise ValueRangeError(
                    f"Motion: q has a quaternion of zeros at joint {body.joint.name!r}, which is not a rotation."
                )
        does_not_increase = np.diff(t) <= 0
        if does_not_increase.any():
            k = int(np.argmax(does_not_increase))  # the first True
            raise ValueRangeError(
                f"Motion: time does not increase from sample {k} ({printed(t[k])} s) to the next ({printed(t[k + 1])} s)."
            )
        arrays = {label: self._checked_array(label, len(t)) for label in ("dq", "ddq", "tau", "command")}
        has_dq = arrays["dq"] is not None
        has_ddq = arrays["ddq"] is not None
        if not has_dq or not has_ddq:
            source = "velocities" if has_dq else "positions"
            object.__setattr__(self, "derived", source)
            arrays["dq"], derived_ddq = _derived_rates(self.robot, t, q, arrays["dq"])
            if not has_ddq:
                arrays["ddq"] = derived_ddq
        for label, array in {"time": t, "q": q, **arrays}.items():
            object.__setattr__(self, label, array)
        is_judged_by_source = bool(self.notes) or self.in_seconds or self.read is not None
        if is_judged_by_source:
            return
        # Only checks that take little time; :attr:`doubts` makes all of them.
        checks = Contradictions(self.coordinates, time_stated=False, runs=[self])
        if has_dq or has_ddq:
            doubts = checks.rate_doubts()
        else:
            checks.add(t, q)
            doubts = checks.time_doubts(self.robot.limits)
        for doubt in doubts:
            warnings.warn(f"Motion: {doubt}.", ModelWarning, stacklevel=3)
        if doubts:
            object.__setattr__(self, "notes", tuple(f"LOOK AGAIN: {doubt}" for doubt in doubts))

    def _checked_array(self, label: str, row_count: int) -> Array | None:
        """Array of a label as floats (row_count, nv); None if it is not given. Raises ShapeError and ValueRangeError."""
        given = getattr(self, label)
        if given is None:
            return None
        model = self.robot.model
        array = np.asarray(arguments.real(given, f"Motion: {label}", model.nv, names=model.velocity_names), float)
        required = array
        if label == "command":  # joints without commands are nan in all rows
            required = np.where(np.isnan(array).all(axis=0), 0.0, array)
        arguments.finite(required, f"Motion: {label}")  # only for its error
        if array.shape != (row_count, model.nv):
            raise ShapeError(f"Motion: {label} has shape {array.shape}; give ({row_count}, {model.nv}).")
        return array

    @classmethod
    def from_file(
        cls,
        path: str | Path,
        robot: Robot,
        *,
        columns: Mapping[str, str] | None = None,
        rate: float | None = None,
        degrees: bool = False,
        gain: Mapping[str, float] | None = None,
        topic: str | None = None,
        command_topic: str | None = None,
        episode: int | None = None,
        plan: bool = False,
    ) -> Motion:
        """Read a log with its commands, a plan or an archive of ``simulate --npz``, like the command ``torques``.

        Parameters
        ----------
        columns : {joint: column}, optional, and {"joint.vel": column}, ``.acc``, ``.torque``, ``.current``
            Columns that cannot be found by name, also ``.command``; ``{"log.csv:joint": column}`` applies only to that file.
        rate : float, optional, sampling rate of a file without a time column [Hz]
        gain : {joint: float}, optional, torque per ampere, for torque columns that are currents [N m/A]
        topic : str, optional, topic of a ROS recording; ``NAME:reference`` is the reference of a controller's state
        command_topic : str, optional, topic of the commands in a ROS recording
        episode : int, optional, episode of a LeRobot dataset
        plan : bool, the file is a planner's result and not a recording, as is known of a JointTrajectory

        Raises
        ------
        NotFoundError, TrajectoryError
            The file cannot be read. Contradictions in its data are in ``notes``, after ``LOOK AGAIN``.

        Examples
        --------
        >>> import twistwrench as tw
        >>> ur5 = tw.robots.ur5()
        >>> tw.Motion.from_file(tw.robots.path_of("ur5").with_name("ur5_demo.csv"), ur5)
        <Motion of 'ur5': 751 states, 0 to 6 s>
        """
        from .motion_log import MotionLog

        require_robot(robot, "Motion")
        reading: dict[str, Any] = {"columns": columns, "rate": rate, "degrees": degrees, "gain": gain}
        reading |= {"topic": topic, "command_topic": command_topic, "episode": episode, "plan": plan}
        log = MotionLog.open(path, robot.model, commands=True, **reading)
        return cls._from_log(log, robot)

    @classmethod
    def from_dataframe(
        cls,
        frame: Any,
        robot: Robot,
        *,
        columns: Mapping[str, str] | None = None,
        rate: float | None = None,
        degrees: bool = False,
        gain: Mapping[str, float] | None = None,
    ) -> Motion:
        """Read a pandas DataFrame with the column names of a file; inverse of :meth:`to_pandas`.

        Parameters
        ----------
        frame : pandas.DataFrame, with the time as index or column
            Seconds, dates or durations. An index of row numbers is not a time.
        columns : {joint: column}, optional, as for :meth:`from_file`
        rate : float, optional, sampling rate if there is no time [Hz]
        gain : {joint: float}, optional, as for :meth:`from_file`

        Raises
        ------
        TrajectoryError, ValueRangeError
            The columns or numbers are not a motion.

        Examples
        --------
        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> motion = tw.trajectories.move(arm, [0, 0], [1, 1], tw.trajectories.cubic(1.0)).sample(0.1)
        >>> again = tw.Motion.from_dataframe(motion.to_pandas(), arm)
        >>> bool((again.ddq == motion.ddq).all())
        True
        """
        from .motion_io import data_frame_file
        from .motion_log import MotionLog

        require_robot(robot, "Motion")
        file, notes_on_ignored_columns = data_frame_file(frame)
        reading: dict[str, Any] = {"columns": columns, "rate": rate, "degrees": degrees, "gain": gain}
        log = MotionLog.open(file, robot.model, commands=True, **reading)
        motion = cls._from_log(log, robot)
        with_notes = replace(motion, notes=(*motion.notes, *notes_on_ignored_columns))
        return with_notes._with_log(motion.log)

    @classmethod
    def _from_log(cls, log: MotionLog, robot: Robot) -> Motion:
        """Motion of a log, with its doubts as notes."""
        from .motion_log import ASKED

        rows = log.motion(log.table)
        doubts = log.doubts(robot.limits)
        doubt_texts: list[str] = []
        note_texts: list[str] = []
        for doubt in doubts:
            if doubt.refuses:
                doubt_texts.append(f"LOOK AGAIN: {doubt}")
            elif doubt.level != "note":
                doubt_texts.append(str(doubt))
            elif doubt.kind in ASKED:
                note_texts.append(str(doubt))
        rates: dict[str, Any] = {"dq": rows.dq, "ddq": rows.ddq}  # None for rates that the log does not have
        motion = cls(
            rows.time,
            rows.q,
            **rates,
            robot=robot,
            tau=rows.tau,
            command=rows.command,
            read=doubts,
            epoch=log.epoch,
            plan=log.plan,
            notes=(*log.notes, *doubt_texts, *note_texts),
            in_seconds=True,
        )
        return motion._with_log(log)

    def _with_log(self, log: MotionLog | None) -> Motion:
        """Set :attr:`log`, and return this motion."""
        object.__setattr__(self, "_log", log)
        return self

    @property
    def log(self) -> MotionLog | None:
        """Log of exactly these states, by which noise and columns are judged; None for arrays, parts and edits."""
        return getattr(self, "_log", None)

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, rows: slice) -> Motion:
        """Select states, ``motion[10:200]`` or ``motion[::10]``; times are unchanged. Raises ValueRangeError."""
        if not isinstance(rows, slice):
            raise ValueRangeError(
                f"Motion: rows are chosen by a slice, motion[10:200], got {arguments.value_text(rows)}. For the state "
                "at a time take motion.at(t), for a span motion.between(t0, t1)."
            )
        try:
            indices = np.arange(len(self))[rows]
        except (TypeError, ValueError) as error:
            raise ValueRangeError(f"Motion: {rows} chooses no rows: {error}. Write motion[10:200].") from None
        if not len(indices):
            raise ValueRangeError(f"Motion: {rows} leaves none of the {len(self)} states.")
        selected_arrays: dict[str, Any] = {}
        for name in ("time", "q", "dq", "ddq", "tau", "command"):
            array = getattr(self, name)
            if array is not None:
                selected_arrays[name] = array[rows]
        return replace(self, **selected_arrays)

    def between(self, begin: float, end: float) -> Motion:
        """Part of the motion between two times, inclusive.

        Parameters
        ----------
        begin, end : float, times [s]; times of states are unchanged

        Raises
        ------
        ValueRangeError
            There are too few states in between.

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> motion = tw.Motion(np.linspace(0, 1, 101), np.zeros((101, 2)), robot=tw.robots.planar_2r())
        >>> motion.between(0.2, 0.5)
        <Motion of 'planar_2r': 31 states, 0.2 to 0.5 s>
        """
        begin = arguments.number(begin, "begin")
        end = arguments.number(end, "end")
        after_end = np.nextafter(end, np.inf)  # a state at the end itself is included
        first_row, stop_row = np.searchsorted(self.time, [begin, after_end]).tolist()
        if not first_row < stop_row:
            raise ValueRangeError(
                f"Motion: no state lies between {printed(begin)} and {printed(end)} s; this is {self!r}."
            )
        return self[first_row:stop_row]

    def __repr__(self) -> str:
        doubts = [note for note in self.notes if note.startswith("LOOK AGAIN")]
        span = f"{printed(self.time[0])} to {printed(self.time[-1])} s"
        parts = [f"Motion of {self.robot.name!r}: {len(self)} states, {span}", *doubts]
        return f"<{'; '.join(parts)}>"

    @property
    def duration(self) -> float:
        """Duration from the first to the last state [s]."""
        return float(self.time[-1] - self.time[0])

    @cached_property
    def doubts(self) -> tuple[Doubt, ...]:
        """Doubts and notes about the states, without dynamics; each has kind, joints, sentence and level.

        Checks: rates that differ from the slopes, jumps, angles far beyond limits, time that looks like milliseconds,
        repeated or late rows, torque spikes.
        """
        if self.read is not None:
            return self.read
        checks = Contradictions(self.coordinates, time_stated=False, runs=[self])
        checks.add(self.time, self.q)
        origin = origin_of([(self.q, self.tau)], plan=self.plan)
        doubts = checks.doubts(self.robot.limits, origin=origin)
        step_doubts = self._steps.doubts(self.robot.limits, origin, doubts)
        return (*doubts, *step_doubts)

    @cached_property
    def instants(self) -> tuple[Instant, ...]:
        """Instants at which rows are missing, repeated or wrong, or a speed changes from one row to the next."""
        return tuple(self._steps.instants)

    @cached_property
    def _steps(self) -> RecordedSteps:
        """Differences of successive rows."""
        steps = RecordedSteps(self.coordinates, [(self.time, self.q)])
        steps.add(self.time, self.q)
        return steps

    @property
    def contradictions(self) -> tuple[Doubt, ...]:
        """Doubts about contradictory states, which make all results unreliable."""
        return tuple(doubt for doubt in self.doubts if doubt.refuses)

    @cached_property
    def coordinates(self) -> Coordinates:
        """Names and units of the entries of q, dq and tau."""
        return Coordinates.from_model(self.robot.model)

    def at(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """State of the motion at given times; before and after the motion, its end states at rest.

        Parameters
        ----------
        t : (...) array_like [s]

        Returns
        -------
        q : (..., nq) array
        dq : (..., nv) array [rad/s, m/s]
        ddq : (..., nv) array [rad/s², m/s²]

        Notes
        -----
        Quintic Hermite interpolation in the joint twists: q has the velocities and accelerations of both samples, and
        dq and ddq are its derivatives.
        """
        t = np.asarray(arguments.finite(t, "Motion.at: t"), float)
        q, dq, ddq = states_between(self.robot, self.time, self.q, self.dq, self.ddq, t)
        is_inside = (t >= self.time[0]) & (t <= self.time[-1])
        moves = is_inside[..., None]
        return q, np.where(moves, dq, 0.0), np.where(moves, ddq, 0.0)

    def __call__(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Same as :meth:`at`, so that a motion can be a controller's reference."""
        return self.at(t)

    def torques(self, *, friction: bool = False) -> Array:
        """Torques required for the motion, by inverse dynamics.

        Returns
        -------
        tau : (n, nv) array [N m, sliding joints: N]

        Notes
        -----
        MR section 8.3. In the first and the last sample, a joint with zero velocity that accelerates has the friction of
        the motion just inside.
        """
        return np.asarray(self.robot.inverse_dynamics(self.q, self._dq_for_friction, self.ddq, friction=friction))

    @property
    def _dq_for_friction(self) -> Array:
        """Velocities (n, nv); at the first and the last sample they have the signs of the velocities just inside the motion."""
        return velocities_inside(self.time, self.dq, self.ddq, self.time[0], self.time[-1])

    def terms(self, *, friction: bool = False) -> dict[str, Array]:
        """Torques split into the terms of the equation of motion.

        Returns
        -------
        terms : {name: (n, nv) array}, ``inertia``, ``coriolis``, ``gravity`` (with springs), and ``friction`` if
        requested
        """
        robot = self.robot
        gravity = robot.holding_torques(self.q)
        coriolis = robot.coriolis_forces(self.q, self.dq)
        tau = robot.inverse_dynamics(self.q, self.dq, self.ddq)
        terms = {"inertia": tau - coriolis - gravity, "coriolis": coriolis, "gravity": gravity}
        if friction:
            terms["friction"] = robot.friction_forces(self._dq_for_friction, load=tau)
        return terms

    def violations(
        self, bounds: Limits | None = None, *, friction: bool | None = None, tau: Array | None = None
    ) -> tuple[Violation, ...]:
        """Violated limits of position, velocity, acceleration and torque, worst first.

        Parameters
        ----------
        friction : bool, optional, count joint friction; None: if the motion was planned with it
        tau : (n, nv) array, optional, torques to check, such as motor torques of a closed robot
            [N m, sliding joints: N]; default: inverse dynamics

        Returns
        -------
        found : tuple of Violation
        """
        check = LimitCheck(self.robot.model, bounds_or_own(self.robot, bounds))
        if tau is None:
            if friction is None:
                friction = self.friction
            tau = self.torques(friction=friction)
            check.add_dynamics(self.robot, self.time, self.q, self.dq, self.ddq)
        elif np.shape(tau) != self.dq.shape:
            raise ShapeError(
                f"violations: tau has shape {np.shape(tau)}, and the motion {self.dq.shape}: a row for each state."
            )
        check.add(self.time, self.q, self.dq, self.ddq, np.asarray(tau, float))
        return check.violations()

    def columns(self, *, degrees: bool = False) -> dict[str, Array]:
        """Columns by their names in files: the coordinate's name, with ``.vel``, ``.acc``, ``.torque`` and ``.command``.

        Parameters
        ----------
        degrees : bool, use degrees for angles, noted in the names: ``elbow [deg]``, ``elbow.vel [deg/s]``

        Returns
        -------
        columns : {name: (n,) array}, time first
        """
        coordinates = self.coordinates
        units_per_radian = np.degrees(1.0) if degrees else 1.0
        rate_factor = np.where(coordinates.angular_velocity, units_per_radian, 1.0)
        factors = {
            "q": np.where(coordinates.angular, units_per_radian, 1.0),
            "dq": rate_factor,
            "ddq": rate_factor,
            "tau": np.ones(len(rate_factor)),
            "command": rate_factor,
        }
        columns = {time_column(coordinates.names): self.time}
        for part, factor in factors.items():
            array = getattr(self, part)
            if array is None:
                continue
            names = coordinates.headers(part, degrees=degrees)
            named_columns = zip(names, (array * factor).T, strict=True)
            # without NaN, which stands for a joint without commands
            columns |= {name: column for name, column in named_columns if not np.isnan(column[0])}
        return columns

    def to_csv(self, path: str | Path, *, degrees: bool = False) -> Path:
        """Write a CSV file for ``twistwrench torques``.

        Parameters
        ----------
        degrees : bool, use degrees for angles, noted in the header: ``elbow [deg]``, ``elbow.vel [deg/s]``

        Returns
        -------
        path : Path of the written file

        Raises
        ------
        ValueRangeError
            The file cannot be written.
        """
        path = as_path(path)
        columns = self.columns(degrees=degrees)
        with csv_table(path, columns) as table:
            table.numbers(np.column_stack(list(columns.values())))
        return path

    def to_pandas(self) -> Any:
        """Data frame with the time [s] as index and a column for each entry.

        Returns
        -------
        frame : pandas.DataFrame

        Raises
        ------
        MissingExtraError
            pandas is not installed.
        """
        columns = self.columns()
        time_name, *_ = columns
        return data_frame(columns).set_index(time_name)

    def to_xarray(self) -> Any:
        """Dataset of q, dq, ddq, and of tau and command if known, with named axes: time, coordinate, joint.

        Returns
        -------
        dataset : xarray.Dataset

        Raises
        ------
        MissingExtraError
            xarray is not installed.
        """
        from .motion_io import labelled_dataset

        arrays = {"q": self.q, "dq": self.dq, "ddq": self.ddq}
        if self.tau is not None:
            arrays["tau"] = self.tau
        if self.command is not None:
            arrays["command"] = self.command
        return labelled_dataset(self.robot.model, self.time, arrays)

    def with_robot(self, robot: Robot) -> Motion:
        """Same states for another robot with the same coordinates, such as one with a payload.

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> t = np.linspace(0, 1, 101)
        >>> motion = tw.Motion(t, np.outer(t**2, [1, -1]), robot=tw.robots.planar_2r())
        >>> loaded = motion.with_robot(motion.robot.with_payload(tw.SpatialInertia.from_com(1.0)))
        >>> bool((abs(loaded.torques()) > abs(motion.torques())).all())
        True
        """
        if require_robot(robot, "Motion.with_robot").coordinate_names != self.robot.coordinate_names:
            raise ValueRangeError(
                f"the motion belongs to robot {self.robot.name!r}, whose coordinates differ from those of {robot.name!r}."
            )
        return replace(self, robot=robot)._with_log(self.log)


def _derived_rates(robot: Robot, t: Array, q: Array, dq: Array | None) -> tuple[Array, Array]:
    """Velocities and accelerations (n, nv) by a quintic spline of q, or of the velocities ``dq`` if they are known."""
    if len(t) < FEWEST:
        raise ValueRangeError(
            f"Motion: {len(t)} samples are too few to derive rates from; give dq and ddq, or {FEWEST} samples. "
            "tw.trajectories.move makes a motion between a few poses."
        )
    if dq is not None:
        ddq, _ = spline_rates(t, dq)
        return dq, ddq
    q = continuous(robot.model, q)
    return joint_rates(robot.model, q, *spline_rates(t, q))


complete(globals())
