"""Wording of standard arguments and errors, and functions that insert it into docstrings.

In the source, a docstring lists only unusual arguments. :func:`complete` at the end of a module adds the other arguments of the
signature and their errors from the tables here, and so do the page generator and the wheel build. This module does not import
the library, so that the build can load it alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from types import FunctionType
from typing import Any

ENTRIES: Mapping[str, str] = {
    "Blist": "(6, n) array_like, body screw axes as columns",
    "Glist": "(n, 6, 6) array_like, spatial inertias in the link frames",
    "Mlist": "(n + 1, 4, 4) array_like, home pose of each link frame in the previous one",
    "Slist": "(6, n) array_like, space screw axes as columns",
    "T": "(..., 4, 4) array_like, pose",
    "Tf": "float, duration, above 0 [s]",
    "V": "(..., 6) array_like or Twist, body twist (omega, v) [rad/s, m/s]",
    "actuated": "iterable of str, optional, for constraints, joints with a motor; None: those that the file drives",
    "angle": "float, tolerance [rad]",
    "bounds": "Limits, optional; None: the robot's own",
    "dV": "(..., 6) array_like or Twist, optional, rate of the twist [rad/s², m/s²]",
    "ddq": "(nv,) array_like, joint accelerations [rad/s², m/s²]",
    "density": "float, optional [kg/m³]",
    "distance": "float, tolerance [m]",
    "dq": "(nv,) array_like, joint velocities [rad/s, m/s]",
    "duration": "float, T, above 0 [s]",
    "false_alarms": "float, fraction of contact-free readings that exceed the threshold",
    "frame": "str, optional, a link of the robot; None: its tip",
    "friction": "bool, include joint friction",
    "gravity": "(3,) array_like, in the base frame [m/s²]",
    "inertia": '"error", "accept" or "repair", treatment of bodies with an impossible inertia',
    "kind": '"body", "space" or "world_aligned", axes and reference point as in :meth:`.Robot.jacobian`',
    "limits": "(nv,) array_like, optional, torque limits in place of the robot's own [N m, sliding joints: N]",
    "lock": "{joint: position}, optional, joints to lock [rad, m]",
    "mass": "float, optional [kg]; give this or ``density``",
    "near": "(nq,) array_like, optional, initial guess for closing the loops; None: any",
    "out": "array, optional, receives the result",
    "overwrite": "bool, replace an existing file",
    "path": "str or Path",
    "precision": '"double" or "float"',
    "prefix": "str, optional, prefix of the function names; None: the robot's name",
    "progress": "callable, optional, called with the finished fraction, 0 to 1",
    "q": "(nq,) array_like, configuration",
    "quantities": "names as for :meth:`.Robot.kernel`, with options as ``(name, {option: value})``",
    "quantity": "str, name of a quantity",
    "radius": "float [m]",
    "redundant": '"error" or "accept", treatment of linearly dependent rows',
    "rng": "numpy Generator or seed",
    "robot": "Robot",
    "rows": 'str or iterable, optional, rows of the twist by name, ``"vx vz"``, or index, 0 to 5; None: all six',
    "size": "int or tuple of int, batch shape",
    "tau": "(nv,) array_like, joint torques [N m, sliding joints: N]",
    "thetalist": "(..., n) array_like, joint angles",
    "time": "(n,) array [s], increasing",
    "tip": "str, optional, default frame",
    "wrench_by_robot": "{frame: (6,)}, optional, wrenches (m, f) the robot applies, each in its frame [N m, N]",
    "wrench_on_robot": "{frame: (6,)}, optional, wrenches (m, f) the world applies to the robot, each in its frame [N m, N]",
}
"""Wording of each parameter, by its name."""

ROOMS: Mapping[str, Mapping[str, str]] = {
    "algorithms": {
        "end": "(4, 4) array_like, pose at s = 1",
        "start": "(4, 4) array_like, pose at s = 0",
    },
    "bodies": {
        "G": "SpatialInertia",
        "dV": "(..., 6) array_like or Twist, rate of the body twist [rad/s², m/s²]",
        "length": "float [m]",
        "r": "(..., 3) array_like, the body's point in {b} [m]",
    },
    "control": {"t": "float [s]"},
    "diagnosis": {"report": "DoctorReport"},
    "identification": {
        "base": "BaseParameters",
        "ddq": "(n, nv) array",
        "dq": "(n, nv) array",
        "friction_speed": "(nv,) array, v_0 [rad/s or m/s]",
        "level": "float, confidence level of the intervals",
        "model": "Model",
        "q": "(n, nq) array",
        "sizes": "(p,) array, largest possible size of each unknown parameter",
        "time": "(n,) array [s]",
        "values": "(p,) array, values of the unknown parameters",
        "which": "(k,) array, indices of parameters",
    },
    "joints": {
        "angles": "(nq,) array of symbols, q as the argument of sines and cosines",
        "cosine_sine": "function that returns cosine and sine of a chart's entry",
        "q": "(nq,) or (..., nq) array, coordinates of the joint",
    },
    "lie": {
        "R": "(..., 3, 3) array_like, rotation matrix",
        "V": "(..., 6) array_like, exponential coordinates (omega, v) [rad, m]",
        "direction": "(..., 3) array_like, nonzero; it is normalised",
        "frame": "str, frame of the coordinates",
        "pitch": "(...) array_like, h [m/rad]; infinite for a pure translation",
        "point": "(..., 3) array_like, q [m]",
        "w": "(..., 3) array_like, exponential coordinates [rad]",
    },
    "model": {
        "g": "(3,) array_like, gravity in the base frame [m/s²]",
        "model": "Model",
        "where": "str, place of the description, for messages",
    },
    "modern_robotics": {
        "Ftip": "(..., 6) array_like, wrench that the end-effector applies, in its frame [N m, N]",
        "Ftipmat": "(N, 6) array_like, wrenches that the end-effector applies, or 0 for none [N m, N]",
        "Gtildelist": "(n, 6, 6) array_like, spatial inertias of the controller's model",
        "Kd": "float or (n,) array_like, derivative gain",
        "Ki": "float or (n,) array_like, integral gain",
        "Kp": "float or (n,) array_like, proportional gain",
        "M": "(4, 4) array_like, home pose of the end-effector in the space frame",
        "Mtildelist": "(n + 1, 4, 4) array_like, home poses of the controller's model",
        "N": "int, number of points, 2 or more",
        "R": "(..., 3, 3) array_like, rotation",
        "V": "(..., 6) array_like, twist (omega, v)",
        "Xend": "(4, 4) array_like, pose at the end",
        "Xstart": "(4, 4) array_like, pose at the start",
        "ddthetalist": "(..., n) array_like, joint accelerations",
        "ddthetalistd": "(..., n) array_like, joint accelerations of the reference",
        "ddthetamat": "(N, n) array_like, joint accelerations",
        "ddthetamatd": "(N, n) array_like, joint accelerations of the reference",
        "dt": "float, time step [s]",
        "dthetalist": "(..., n) array_like, joint rates",
        "dthetalistd": "(..., n) array_like, joint rates of the reference",
        "dthetamat": "(N, n) array_like, joint rates",
        "dthetamatd": "(N, n) array_like, joint rates of the reference",
        "eint": "(..., n) array_like, integral of the error up to the previous step",
        "eomg": "float, tolerance of the rotation error [rad]",
        "ev": "float, tolerance of the position error [m]",
        "expc3": "(..., 3) array_like, omg theta [rad]",
        "expc6": "(..., 6) array_like, S theta",
        "g": "(3,) array_like, gravity in the space frame [m/s²]",
        "gtilde": "(3,) array_like, gravity of the controller's model [m/s²]",
        "intRes": "int, Euler steps in each time step",
        "mat": "(..., k, k) array_like; k = 3 for SO(3), 4 for SE(3)",
        "method": "3, cubic time scaling, or 5, quintic",
        "omg": "(..., 3) array_like",
        "p": "(..., 3) array_like, position [m]",
        "plot": "bool, draw the angles (the book's package always opens a window)",
        "se3mat": "(..., 4, 4) array_like, [S] theta",
        "so3mat": "(..., 3, 3) array_like, [omg] theta [rad]",
        "t": "(...) array_like, time [s]",
        "taulist": "(..., n) array_like, joint torques [N m, sliding joints: N]",
        "thetaend": "(n,) array_like, joint angles at the end",
        "thetalist0": "(n,) array_like, initial guess",
        "thetalistd": "(..., n) array_like, joint angles of the reference",
        "thetamat": "(N, n) array_like, joint angles",
        "thetamatd": "(N, n) array_like, joint angles of the reference",
        "thetastart": "(n,) array_like, joint angles at the start",
    },
    "motion": {
        "degrees": "bool, angles are in degrees unless the column names its unit",
        "kind": '"position", "velocity", "acceleration" or "torque"',
        "limits": "Limits, optional; velocity limits help to distinguish a jump from a fast motion",
        "model": "Model",
    },
    "plots": {
        "joints": "sequence of str, joints to draw; none: all",
        "motion": "DrawnMotion",
        "path": "str or Path; the suffix sets the kind (.png, .pdf, .svg)",
        "report": "TorqueReport",
        "scene": "Scene, optional, the robot's appearance",
    },
    "robot": {
        "model": "the other library's model of the same robot",
        "every": "int, keep every n-th state",
        "joint_names": "sequence of n str, optional",
        "weights": "(nv,) array_like, w",
    },
    "sensing": {
        "F": "(..., 6) array_like, wrench (m, f) on the load [N m, N]",
        "V": "(..., 6) array_like or Twist, optional, body twist of {f} [rad/s, m/s]",
        "axes": "slice, components to compare; ``slice(3, 6)`` for the forces",
        "com": "(3,) array_like, in {f} [m]",
        "gravity": "(..., 3) array_like, in {w} [m/s²]; with ``pose=np.eye(3)``: in {f}",
        "log": "ReadingLog",
        "noise": "(moment [N m], force [N]), standard deviations of a reading",
        "point": "(..., 3) array_like, in the frame of F [m]",
        "pose": "(..., 4, 4) or (..., 3, 3) array_like, T_wf or R_wf",
        "sensor": "ForceTorqueSensor",
    },
    "simulation": {"model": "Model"},
    "statics": {
        "com": "(3,) array_like, centre of mass of the payload in the frame [m]",
        "edges": "int, initial number of edges of each friction cone",
    },
    "symbolic": {"steps": "iterable of str, optional, names of the steps to write; None: all"},
    "testing": {
        "actual": "array_like",
        "desired": "array_like, of the same shape",
        "joints": "int, number of joints, including fixed and mimic joints",
        "kinds": "sequence of str, joint types to choose from",
    },
    "trajectories": {
        "dt": "float, above 0 [s]",
        "q0": "(nq,) array_like, configuration at the start",
        "q1": "(nq,) array_like, configuration at the end",
        "t": "(...) array_like [s]",
    },
    "viz": {
        "fps": "float, frames per second",
        "path": "str or Path, .gif or .mp4",
        "motion": "DrawnMotion",
        "progress": "callable, optional, called with the number of frames drawn and their total",
        "scene": "Scene, optional, the robot's appearance",
        "speed": "float, playback speed relative to real time",
    },
}
"""Wording that replaces the general one within a package, by names of the package and the parameter."""

_WRENCH_ERROR = ("UnknownNameError", "A wrench acts on a frame that the robot does not have.")
_LISTS_ERROR = "The lists do not describe a chain, or array sizes do not match it."
ERRORS: Mapping[str, tuple[tuple[str, str], ...]] = {
    "Mlist": (("ShapeError, ModelError, InertiaError", _LISTS_ERROR),),
    "q": (("ShapeError", "The last axes are not the robot's sizes, or batch shapes do not broadcast."),),
    "frame": (
        ("UnknownNameError", "The robot has no such frame."),
        ("FrameError", "No frame is named, and the robot has no single tip."),
    ),
    "wrench_by_robot": (_WRENCH_ERROR,),
    "wrench_on_robot": (_WRENCH_ERROR,),
}
"""Classes of errors and their causes, by the parameter that causes them; only where it has the general wording."""

RETURNS: Mapping[str, str] = {
    "Averaged": "scaling : Averaged",
    "Axis": "axis : Axis",
    "BaseParameters": "base : BaseParameters",
    "ClosedForm": "terms : ClosedForm",
    "ConstrainedRobot": "closed : Robot, with the constraint",
    "CollisionThreshold": "threshold : CollisionThreshold",
    "ConsistentRobot": "robot : ConsistentRobot",
    "ContactWrench": "found : ContactWrench",
    "Equilibrium": "answer : Equilibrium",
    "ExcitingMotion": "found : ExcitingMotion",
    "Explanation": "explanation : Explanation",
    "Fastest": "motion : Fastest",
    "IKResult": "found : IKResult",
    "Identification": "found : Identification",
    "IdentifiedRobot": "found : IdentifiedRobot",
    "JointPath": "path : JointPath",
    "JointTorques": "tau : (..., n) array [N m, sliding joints: N]",
    "LargestWrench": "found : LargestWrench",
    "LimitCurves": "curves : LimitCurves",
    "MissingExtraError": "error : MissingExtraError",
    "Model": "model : Model",
    "Motion": "motion : Motion",
    "MotorSide": "side : MotorSide",
    "Path": "path : Path of the file written",
    "PayloadMap": "found : PayloadMap",
    "Polynomial": "scaling : Polynomial",
    "PosePath": "path : PosePath",
    "PoseProposal": "proposal : PoseProposal",
    "Poses": "T : (..., 4, 4) array",
    "Program": "program : Program",
    "ReadingLog": "log : ReadingLog",
    "RegionPayload": "found : RegionPayload",
    "RigidBody": "body : RigidBody",
    "Robot": "robot : Robot",
    "Rotations": "R : (..., 3, 3) array",
    "SimulationResult": "result : SimulationResult",
    "SpatialInertia": "G : SpatialInertia",
    "TaskState": "state : TaskState",
    "Trajectory": "trajectory : Trajectory",
    "Trapezoid": "scaling : Trapezoid",
    "Twist": "V : Twist",
    "Twists": "V : (..., 6) array, (omega, v)",
    "UnknownNameError": "error : UnknownNameError",
    "Wrench": "F : Wrench",
    "bool": "answer : bool",
    "str": "text : str",
    "tuple[Path, ...]": "paths : tuple of Path, the files written",
    "tuple[Violation, ...]": "found : tuple of Violation",
}
"""Section Returns by the annotation of the result."""

SECTIONS = (
    "Parameters",
    "Attributes",
    "Returns",
    "Yields",
    "Raises",
    "Warns",
    "See Also",
    "Notes",
    "References",
    "Examples",
)
"""Docstring sections in numpydoc order."""


def complete_docstring(doc: str, names: Sequence[str], room: str, result: str = "") -> str:
    """Complete the sections Parameters, Returns and Raises of a docstring, in the order of the signature.

    ``names`` are the parameters of the function, ``room`` is a package with its own wording in :data:`ROOMS`, and ``result`` is
    the annotation of the result. Docstrings without a section Returns, Yields or Examples stay unchanged.
    """
    wording = {**ENTRIES, **ROOMS.get(room, {})}
    if result not in RETURNS and not any(name in wording for name in names):
        return doc
    sections, indent = _sections(doc)
    if sections.keys().isdisjoint({"Returns", "Yields", "Examples"}):
        return doc
    own_entries = _entries(sections.get("Parameters", ()), indent)
    entry_of: dict[str, list[str]] = {}  # lines by name of the parameter
    for entry in own_entries:
        names_in_entry, _, _ = entry[0].partition(" : ")  # as in "q0, q1 : (nq,) array_like"
        for name in names_in_entry.split(","):
            entry_of[name.strip()] = entry
    errors: dict[str, str] = {}
    is_complete = True
    for name in names:
        if name in entry_of or name not in wording:
            continue
        is_complete = False
        entry_of[name] = [f"{indent}{name} : {wording[name]}"]
        has_own_wording = name in ROOMS.get(room, {})
        if name in ERRORS and not has_own_wording:
            errors.update(ERRORS[name])
    lacks_result = "Returns" not in sections and "Yields" not in sections and result in RETURNS
    if is_complete and not lacks_result:
        return doc
    if lacks_result:
        sections["Returns"] = [indent + RETURNS[result]]
    ordered: list[list[str]] = []
    entries_by_signature = [entry_of.get(name, []) for name in names]
    for entry in entries_by_signature + own_entries:
        if entry and entry not in ordered:  # an entry with two names stands once
            ordered.append(entry)
    sections["Parameters"] = list(chain.from_iterable(ordered))
    if errors:
        sections["Raises"] = _with_errors(sections.get("Raises", []), errors, indent)
    text = "\n".join(sections[""])
    for title in SECTIONS:
        if sections.get(title):
            underline = "-" * len(title)
            text += f"\n\n{indent}{title}\n{indent}{underline}\n" + "\n".join(sections[title])
    return f"{text}\n{indent}"


def _with_errors(raised: list[str], errors: Mapping[str, str], indent: str) -> list[str]:
    """Lines ``raised`` of the section Raises, after lines on those ``errors`` (text by name) that it does not have yet."""
    own_names: set[str] = set()
    for entry in _entries(raised, indent):
        own_names.update(name.strip() for name in entry[0].split(","))
    added: list[str] = []
    for name, text in errors.items():
        if name not in own_names:
            added += [indent + name, f"{indent}    {text}"]
    return added + raised


def room_of(folders: Sequence[str]) -> str:
    """Deepest of a module's folders that has its own wording in :data:`ROOMS`; empty if none has."""
    for folder in reversed(folders):
        if folder in ROOMS:
            return folder
    return ""


def complete(module: Mapping[str, Any]) -> None:
    """Complete the docstrings of a module's functions and methods; ``module`` is its ``globals()``."""
    module_name = module["__name__"]
    room = room_of(module["__package__"].split(".")[1:])
    for value in list(module.values()):
        if getattr(value, "__module__", None) != module_name:  # imported from elsewhere
            continue
        members = [value]
        if isinstance(value, type):
            members += vars(value).values()
        for member in members:
            function = getattr(member, "__func__", member)  # of a class method
            if not isinstance(function, FunctionType) or function.__doc__ is None:
                continue
            if "\n" in function.__doc__:  # a docstring of one line has no sections
                result = function.__annotations__.get("return", "")
                function.__doc__ = complete_docstring(function.__doc__, signature_names(function), room, result)


def signature_names(function: Any) -> list[str]:
    """Parameter names of a function without ``self`` and ``cls``; of a decorated function, those of the original."""
    wrapped = getattr(function, "__wrapped__", function)
    if wrapped.__name__ != function.__name__:  # not a decorator: its signature is its own
        wrapped = function
    code = wrapped.__code__
    names = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
    return [name for name in names if name not in ("self", "cls")]


def _sections(doc: str) -> tuple[dict[str, list[str]], str]:
    """Lines of each section by title, and the indentation. The text before the first section has an empty title."""
    lines = doc.rstrip().split("\n")
    sections: dict[str, list[str]] = {}
    title = ""  # of the section that is being read
    first_line = 0  # index of the first line of this section
    indent = ""
    for k, line in enumerate(lines):
        heading = lines[k - 1].strip()
        if line.endswith("---") and heading in SECTIONS:  # a heading and its underline begin the next section
            sections[title] = _without_trailing_blanks(lines[first_line : k - 1])
            title = heading
            first_line = k + 1
            indent = line[: -len(heading)]  # the underline is as long as the heading
    sections[title] = lines[first_line:]
    return sections, indent


def _without_trailing_blanks(lines: list[str]) -> list[str]:
    """Lines without trailing empty lines."""
    while lines and not lines[-1].strip():
        lines = lines[:-1]
    return lines


def _entries(lines: Sequence[str], indent: str) -> list[list[str]]:
    """Entries of a section. An entry is a line with the further indented lines after it."""
    entries: list[list[str]] = []
    for line in lines:
        if entries and line.startswith(indent + " "):
            entries[-1].append(line)
        else:
            entries.append([line])
    return entries
