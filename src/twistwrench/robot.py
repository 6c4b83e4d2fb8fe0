"""Robot, the front door: a model, and one method per quantity, each a compiled kernel. The bridge between the two towers.

Every method takes any leading batch shape and broadcasts, as NumPy does. Shapes in docstrings are those of one state.
"""

from __future__ import annotations

import operator
import re
import warnings
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import quantities
from .algorithms.motors import MotorLoads, motor_loads
from .algorithms.power import PowerBalance, power_balance
from .algorithms.reach import Reach, doubtful, independent_rows, usual_sizes
from .algorithms.regressor import PARAMETER_NAMES
from .algorithms.task_space import ROWS, row_numbers
from .bodies.inertia import SpatialInertia
from .core import arguments, lazy
from .core.tables import is_table
from .derived import is_symbolic
from .errors import (
    FrameError,
    KernelError,
    ModelError,
    ModelWarning,
    ShapeError,
    SingularMassMatrixError,
    UnknownNameError,
    ValueRangeError,
)
from .kernels import threads
from .kernels.interpreter import compiles
from .model import configuration, edit
from .model.actuator import Actuator
from .model.model import Limits, Model
from .model.snap import DEFAULT_SNAP
from .model.varied import matching, nominal
from .program.program import Program
from .program.recurrence import Recurrence
from .screws.wrench import Wrench

if TYPE_CHECKING:
    from .algorithms.closed_form import ClosedForm
    from .closed import ClosedRobot
    from .cuda import CudaRobot
    from .explanation import Explanation
    from .export.request import Quantities
    from .inverse_kinematics import InverseKinematics
    from .simulation import SimulationResult
    from .simulation.rollout import Rollout
    from .simulation.torque_laws import TorqueLaw

Array = NDArray[Any]
Wrenches = Mapping[str, ArrayLike | Wrench]
Rows = str | Iterable[int | str] | None

__all__ = ["Robot", "from_dh", "from_screws", "load"]


def load(
    source: str | Path,
    *,
    floating_base: bool = False,
    lock: Mapping[str, ArrayLike] | None = None,
    tip: str | None = None,
    mimic: str = "follow",
    inertia: str = "error",
    snap: float = DEFAULT_SNAP,
    gravity: ArrayLike = (0.0, 0.0, -9.81),
) -> Robot:
    """Read a robot from a file, or from XML text (first non-blank character ``<``).

    ``floating_base`` lets the root link float; ``lock`` ``{joint: position}`` fixes joints; ``tip`` is the frame meant when
    none is named; ``mimic`` is ``"follow"`` or ``"independent"``; ``inertia`` says what to do with impossible ones:
    ``"error"``, ``"accept"`` or ``"repair"``; entries of fixed rotations within ``snap`` of 0 or ±1 are exactly that;
    ``gravity`` (3,) m/s² is in the base frame.

    Raises: NotFoundError, RobotFileError, ModelError, InertiaError, UnknownNameError.

    >>> import twistwrench as tw
    >>> robot = tw.load(tw.robots.path_of("ur5"))
    >>> robot.nv, robot.tip
    (6, 'tool0')
    """
    from .io import load_model

    return Robot(
        load_model(
            source,
            floating_base=floating_base,
            lock=lock,
            tip=tip,
            mimic=mimic,
            inertia=inertia,
            snap=snap,
            gravity=gravity,
        )
    )


def from_screws(*lists: Any, **options: Any) -> Robot:
    """A robot from the book's M, Slist, Mlist, Glist; see :func:`twistwrench.io.screw_lists.from_screws` for the options."""
    from .io import screw_lists

    return Robot(screw_lists.from_screws(*lists, **options))


def from_dh(table: Any, **options: Any) -> Robot:
    """A robot from Denavit–Hartenberg parameters: ``{"theta": …, "d": …, "a": …, "alpha": …}``, n numbers each.

    Options: ``convention`` (``"standard"`` or ``"modified"``), ``columns`` of an (n, 4) table, ``joint_types``, ``masses``,
    ``coms``, ``moments_about_com``, ``tool``, ``joint_names``, ``name``, ``gravity``, ``inertia``: what they mean, and what
    is refused, is said by :func:`twistwrench.io.dh.from_dh`.

    >>> import twistwrench as tw
    >>> tw.from_dh({"a": [1.0, 1.0]}, masses=[1.0, 1.0]).forward_kinematics([0.0, 0.0])[:3, 3].tolist()
    [2.0, 0.0, 0.0]
    """
    from .io import dh

    return Robot(dh.from_dh(table, **options))


class Robot:
    """A robot whose dynamics are compiled when first asked for. Immutable: every edit returns a new one.

    >>> import numpy as np, twistwrench as tw
    >>> arm = tw.robots.planar_2r()
    >>> np.round(arm.mass_matrix([0.0, np.pi / 2]), 12).tolist()
    [[3.0, 1.0], [1.0, 1.0]]
    """

    def __init__(self, model: Model) -> None:
        self.model = model
        self._kernels: dict[Any, Any] = {}
        self._called: dict[Any, Any] = {}
        self._called_once: set[Any] = set()
        self._regressor: Any = None
        self._ways: dict[Any, tuple[Array, Array, Array]] = {}
        self._judged: set[tuple[str | None, str, tuple[int, ...]]] = set()

    def __repr__(self) -> str:
        return f"<Robot {self.name!r}: {len(self.model.bodies)} moving bodies, nq = {self.nq}, nv = {self.nv}>"

    def __getstate__(self) -> Model:
        return self.model

    def __setstate__(self, model: Model) -> None:
        self.__init__(model)  # type: ignore[misc]

    # ── what it is ──

    @property
    def name(self) -> str:
        """The robot's name in its file."""
        return self.model.name

    @property
    def nq(self) -> int:
        """Number of coordinates."""
        return self.model.nq

    @property
    def nv(self) -> int:
        """Number of velocities."""
        return self.model.nv

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints that have coordinates, in the order of q."""
        return tuple(b.joint.name for b in self.model.leaders)

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """A name for each entry of q: the joint's, with a suffix where it has several."""
        return tuple(b.joint.name + s for b in self.model.leaders for s in b.joint.coordinate_suffixes)

    @property
    def body_names(self) -> tuple[str, ...]:
        """The moving bodies, each by the link its joint carries, in the order of :meth:`joint_wrenches`."""
        return tuple(body.link for body in self.model.bodies)

    @property
    def link_names(self) -> tuple[str, ...]:
        """Every link of the file, in document order."""
        return tuple(self.model.frames)

    @property
    def frame_names(self) -> tuple[str, ...]:
        """Every frame a method can be asked about: the links."""
        return tuple(self.model.frames)

    @property
    def tip(self) -> str | None:
        """The frame meant when none is named; None when the robot has no single tip."""
        return self.model.tip

    @property
    def defects(self) -> tuple[str, ...]:
        """What the robot's file says that is doubtful."""
        return self.model.defects

    @property
    def limits(self) -> Limits:
        """Joint limits, (nv,) each, inf where none is given."""
        return self.model.limits

    @property
    def gravity(self) -> Array:
        """Gravity in the base frame, (3,) m/s²."""
        return self.model.gravity

    @property
    def actuators(self) -> Mapping[str, Actuator]:
        """What drives the joints, by the joint whose coordinate it moves; see :meth:`with_actuators`."""
        return self.model.actuators

    @property
    def parameters(self) -> Array:
        """π, the ten inertial parameters of each moving body, fixed links fused; (10 nbodies,). MR section 8.2."""
        return np.concatenate([np.zeros(0), *(body.inertia.parameters for body in self.model.bodies)])

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """A name for each of :attr:`parameters`: ``<body>.m``, ``<body>.mcx`` … ``<body>.Izz``."""
        return tuple(f"{body.link}.{p}" for body in self.model.bodies for p in PARAMETER_NAMES)

    @property
    def neutral(self) -> Array:
        """Every joint at zero, inside its limits or not; (nq,)."""
        return self.model.neutral

    @property
    def screws(self) -> Any:
        """The book's M, Slist, Blist, Mlist, Glist, link frames as in the file; serial chains only."""
        from .io.screw_lists import screw_lists

        return screw_lists(self.model)

    def screws_at_com(self) -> Any:
        """The same with link frames at the centres of mass along principal axes: the book's diagonal G."""
        from .io.screw_lists import screw_lists

        return screw_lists(self.model, at_com=True)

    # ── configurations ──

    def coordinates(self, **joints: ArrayLike) -> Array:
        """q from joint names, the others neutral; (nq,).

        >>> import twistwrench as tw
        >>> tw.robots.planar_2r().coordinates(joint2=0.5).tolist()
        [0.0, 0.5]
        """
        return configuration.from_names(self.model, joints)

    def random_configuration(
        self, rng: np.random.Generator | int | None = None, size: int | tuple[int, ...] = ()
    ) -> Array:
        """Random q inside the limits; unbounded joints within ±π or ±1 m; (*size, nq)."""
        try:
            shape = tuple(operator.index(n) for n in (size if isinstance(size, tuple | list) else (size,)))
            generator = np.random.default_rng(rng)
        except (TypeError, ValueError):
            raise ValueRangeError(
                f"rng={rng!r}, size={size!r}: give a seed or a numpy Generator, and whole numbers of samples."
            ) from None
        if any(n < 0 for n in shape):
            raise ValueRangeError(f"size={size!r} has a negative number of samples.")
        return configuration.random_configuration(self.model, generator, shape)

    @lazy.by_blocks(lambda robot, _: [(robot.nq,)])
    def add(self, q: ArrayLike, dv: ArrayLike) -> Array:
        """q ⊕ dv: move each joint along its constant joint twist for unit time; (nq), (nv) → (nq)."""
        q, dv = self._states("add", q=q, dv=dv)
        return configuration.add(self.model, q, dv).astype(np.result_type(q, dv), copy=False)

    @lazy.by_blocks(lambda robot, _: [(robot.nv,)])
    def subtract(self, q1: ArrayLike, q0: ArrayLike) -> Array:
        """q1 ⊖ q0: the dv with ``add(q0, dv)`` at the pose of q1; (nq), (nq) → (nv)."""
        q1, q0 = self._states("subtract", q1=q1, q0=q0)
        return configuration.subtract(self.model, q1, q0).astype(np.result_type(q1, q0), copy=False)

    # ── edits ──

    def with_payload(self, payload: SpatialInertia, frame: str | None = None) -> Robot:
        """A robot that carries ``payload`` at ``frame``, whose inertia is given in that frame.

        >>> import twistwrench as tw
        >>> ur5 = tw.robots.ur5()
        >>> loaded = ur5.with_payload(tw.SpatialInertia.from_com(5.0, (0, 0, 0.1)), frame="tool0")
        >>> bool(abs(loaded.gravity_forces(ur5.neutral)[1]) > abs(ur5.gravity_forces(ur5.neutral)[1]))
        True
        """
        if not isinstance(payload, SpatialInertia):
            raise ShapeError(
                f"a payload is a SpatialInertia, got {payload!r}: for a point mass, tw.SpatialInertia.from_com(mass, com)."
            )
        return Robot(edit.with_payload(self.model, payload, frame))

    def with_gravity(self, gravity: ArrayLike) -> Robot:
        """The same robot under another gravity, (3,) m/s² in the base frame."""
        return Robot(edit.with_gravity(self.model, gravity))

    def with_actuators(self, source: str | Path | Mapping[str, Any], *, stiff: bool = False) -> Robot:
        """The robot with motors, gears, rotors, elastic joints and friction laws from a YAML file, text, or mapping.

        ``stiff=True`` takes elastic gears to be rigid, so that no motor has a coordinate of its own, and warns of it.
        Raises NotFoundError, ModelError and UnknownNameError, which name the entry. docs/actuation.md shows the file.

        >>> import twistwrench as tw
        >>> drives = {"actuators": {"joint1": {"ratio": 100, "rotor": {"inertia": "200 g cm^2", "extra": True}}}}
        >>> arm = tw.robots.planar_2r()
        >>> float((arm.with_actuators(drives).mass_matrix([0, 0]) - arm.mass_matrix([0, 0]))[0, 0].round(9))
        0.2
        """
        from .io.actuators import add_actuators

        return Robot(add_actuators(self.model, source, stiff=stiff))

    def lock(self, joints: Mapping[str, float | Sequence[float]]) -> Robot:
        """A robot whose named joints are fixed at the given coordinates."""
        if not isinstance(joints, Mapping):
            raise ShapeError(f"lock takes a dict {{joint: position}}, got {joints!r}.")
        return Robot(edit.lock(self.model, joints))

    # ── kernels ──

    def kernel(self, *names: str, **options: Any) -> np.ufunc:
        """The bare compiled function of one quantity, or of several at once: a ``numpy.ufunc`` with the robot's own sizes.

        Options by quantity: ``frame=``, ``kind=``, ``rows=``, ``wrenches=(frame, …)`` (further inputs, one wrench each,
        applied by the robot), ``gravity="input"`` (a further input, (3,) m/s² in the base frame, in place of the robot's
        own), ``parameters=(pattern, …)`` (the last input, a number for each of ``robot.varying(*patterns)``, so that every
        sample may have its own masses, inertias, lengths, friction). ``by="q"`` gives the derivative of any quantity by that
        input, or by several, along :meth:`add` on q; ``form``, ``mode`` and ``values`` are those of
        :func:`twistwrench.differentiate`. Of several quantities, inputs of one name are one
        input, and what the quantities share is computed once; an option goes to those that take it. Raises
        UnknownNameError for unknown names, KernelError for options that do not apply.

        >>> import twistwrench as tw
        >>> tw.robots.ur5().kernel("inverse_dynamics").signature
        '(6),(6),(6)->(6)'
        >>> tw.robots.ur5().kernel("mass_matrix", "bias_forces").signature
        '(6),(6)->(6,6),(6)'
        """
        wanted = self._wanted(names, options)
        key = tuple((name, *full.items()) for name, full in wanted.items())
        kernel = self._kernels.get(key)
        if kernel is None:
            if any(name in quantities.NEED_INVERSE for name in wanted):
                self._require_invertible()
            if self._is_composed(wanted):
                from .composed import ComposedDerivatives

                self._kernels[key] = ComposedDerivatives(self, options)
                return self._kernels[key]
            program = quantities.program_of_several(self.model, wanted)
            title = ", ".join(wanted)
            inputs, outputs = (", ".join(port.name for port in ports) for ports in (program.inputs, program.outputs))
            doc = f"{title} of {self.name}, compiled. Inputs: {inputs}. Outputs: {outputs}."
            kernel = self._kernels[key] = _make_kernel(program, title, doc)
        return kernel

    def _is_composed(self, wanted: Mapping[str, Mapping[str, Any]]) -> bool:
        """Whether these are derivatives that would be too long unrolled."""
        from . import composed

        plain = all(set(options) <= {"wrenches"} for options in wanted.values())
        return plain and tuple(wanted) == ("forward_dynamics_derivatives",) and self.nv >= composed.FROM

    def _wanted(self, names: tuple[str, ...], options: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
        """Each quantity with the options that are its own."""
        if not names:
            raise UnknownNameError.of("quantity", "", quantities.QUANTITIES)
        if len(set(names)) < len(names):
            raise KernelError(f"a quantity is asked for twice: {', '.join(names)}. Name each once.")
        if len(names) == 1:
            return {names[0]: quantities.checked_options(self.model, names[0], options)}
        takes = {n: quantities.options_of(n) for n in names}
        for option in options:
            if not any(option in mine for mine in takes.values()):
                raise KernelError(f"none of {', '.join(names)} takes an option {option!r}.")
        return {
            n: quantities.checked_options(self.model, n, {k: v for k, v in options.items() if k in mine})
            for n, mine in takes.items()
        }

    @property
    def cuda(self) -> CudaRobot:
        """The same quantities for arrays in a GPU's memory (CuPy, PyTorch); see :class:`twistwrench.cuda.CudaRobot`."""
        if "cuda" not in self._kernels:
            from .cuda import CudaRobot

            self._kernels["cuda"] = CudaRobot(self)
        return self._kernels["cuda"]

    def varying(self, *patterns: str) -> dict[str, float]:
        """The parameters that patterns such as ``"*.mass"`` mean, in a kernel's order, with the robot's own numbers.

        ``<link>.mass``, ``.com_x`` …, ``.Ixx`` … (about the centre of mass), ``<joint>.x`` … (its place in the body that
        carries it), ``<joint>.viscous`` and the other laws of friction. A massless link's mass is a payload.

        >>> import numpy as np, twistwrench as tw
        >>> ur5 = tw.robots.ur5()
        >>> ur5.varying("*.viscous", "tool0.mass")["tool0.mass"]
        0.0
        >>> holding = ur5.kernel("gravity_forces", parameters=("tool0.mass",))
        >>> payloads = np.array([[0.0], [5.0]])
        >>> holding([0, -1, 1, 0, 0, 0], payloads)[:, 1].round(2).tolist()
        [-39.18, -69.68]
        """
        known = nominal(self.model)
        return {name: known[name] for name in matching(self.model, patterns or ("*",))}

    def program(self, *names: str, **options: Any) -> Program:
        """The straight-line program behind a kernel, for counting its operations."""
        return quantities.program_of_several(self.model, self._wanted(names, options))

    def export_c(
        self,
        quantities: Quantities,
        path: str | Path,
        *,
        precision: str = "double",
        prefix: str | None = None,
        test: bool = True,
    ) -> tuple[Path, ...]:
        """Write quantities as C99 functions that allocate nothing and need ``math.h`` only; the paths of what was written.

        ``quantities``: names as for :meth:`kernel`, with options as ``(name, {option: value})``; ``path``: a folder, or the .c
        file, the header goes beside it; ``precision``: ``"double"`` or ``"float"``; ``prefix``: what the functions' names begin
        with, else the robot's name; ``test``: write a program that compares the functions with the kernels, too.

        Raises UnknownNameError, KernelError for options that do not apply and for what no program without branches computes,
        SingularMassMatrixError, and ValueRangeError for a path that cannot be written. docs/export.md shows the files.

        >>> import tempfile, twistwrench as tw
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     files = tw.robots.ur5().export_c(["mass_matrix", ("jacobian", {"kind": "space"})], folder)
        ...     print("void ur5_mass_matrix(const double q[6], double M[36]);" in files[0].read_text())
        True
        """
        from .export import export_c

        return export_c(self, quantities, path, precision=precision, prefix=prefix, test=test)

    def reference(self, name: str, *arrays: ArrayLike, **options: Any) -> Any:
        """The same quantity by the algorithm itself on floats, one state at a time: the readable oracle.

        On symbols, in a function that is traced, it gives symbols.
        """
        full = quantities.checked_options(self.model, name, options)
        if "derivative" in full:
            raise KernelError(f"reference {name}: algorithms know no by=; kernel({name!r}, by=…) does.")
        traced = is_symbolic(arrays)
        quantity = quantities.QUANTITIES[name]
        given = [np.asarray(a) for a in self._brought(name, arrays, options)]
        if not traced:
            given = _numbers(f"reference {name}", {}, **{f"input {k}": a for k, a in enumerate(given, start=1)})
        symbols = [a.astype(object) for a in given]
        shapes = quantity.shapes(self.model) + [("wrench", (6,))] * len(full.get("wrenches", ()))
        shapes += [("gravity", (3,))] * ("gravity" in full)
        shapes += [("parameters", (len(full.get("parameters", ())),))] * ("parameters" in full)
        if len(symbols) != len(shapes):
            raise ShapeError(
                f"reference {name}: {len(symbols)} arrays given, {', '.join(n for n, _ in shapes)} wanted."
            )
        for (label, shape), array in zip(shapes, symbols, strict=True):
            if array.shape != shape:
                raise ShapeError(f"reference {name}: {label} has shape {array.shape}, one state has {shape}.")
        try:
            with np.errstate(divide="raise"):
                found = quantities.evaluated(quantity, self.model, symbols, full)
            if traced:
                return found
        except (ZeroDivisionError, FloatingPointError):
            raise ValueRangeError(
                f"reference {name}: a matrix to be inverted is singular at this state. The method of that name goes on."
            ) from None
        return tuple(np.asarray(x, float) for x in found) if isinstance(found, tuple) else np.asarray(found, float)

    def _call(self, name: str, *arrays: Any, out: Any = None, **options: Any) -> Any:
        for array in arrays:
            if type(array) is not np.ndarray:
                arrays = self._brought(name, arrays, options)
                if any(map(lazy.is_lazy, arrays)):
                    return self._later(name, arrays, out, options)
                break
        key = (name, *options.values()) if options else name
        try:
            kernel = self._called.get(key)
        except TypeError:  # an option nothing can be kept under; kernel() says what is wrong with it
            kernel = None
        if kernel is None:
            if is_symbolic(arrays):
                return self.reference(name, *arrays, **options)
            kernel = self.kernel(name, **options)
            self._called[key] = kernel
            if all(value in (None, "body", ()) for value in options.values()):
                self._called_once.add(key)
        elif key in self._called_once:  # called again, so perhaps often
            self._called_once.discard(key)
            self._put_in_front(name, kernel)
        if isinstance(out, tuple):
            _refuse_overlap(name, out)
        try:
            if out is not None:
                _refuse_text(out)
            return threads.call(kernel, arrays, out)
        except (TypeError, ValueError) as problem:
            if is_symbolic(arrays):
                return self.reference(name, *arrays, **options)
            if lazy.is_asking_for_type():
                return _of_type(kernel, arrays)
            explained = self._misfit(name, arrays, options) or problem
            if explained is problem and out is not None:
                explained = _unfit(name, out, self.program(name, **options), arrays)
            raise explained from None

    def _brought(self, name: str, arrays: Sequence[Any], options: Mapping[str, Any]) -> tuple[Any, ...]:
        """The arrays of a quantity as NumPy's, or Dask's, tables in the robot's order."""
        labels, found = quantities.QUANTITIES[name].inputs, []
        for k, array in enumerate(arrays):
            label, names = labels[k] if k < len(labels) else f"input {k + 1}", None
            if is_table(array):
                wanted = self._inputs(name, options)
                label = wanted[k][0] if k < len(wanted) else label
                names = self._names_of(label)
            found.append(arguments.brought(array, f"{name}: {label}", names or ()))
        return tuple(found)

    def _names_of(self, label: str) -> tuple[str, ...]:
        """The names of the last axis of an input, by which a table is read; none where it has none."""
        if label in ("q", "q0", "q1"):
            return self.coordinate_names
        return () if label in ("wrench", "gravity", "parameters") else self.model.velocity_names

    def _states(self, name: str, **arrays: ArrayLike) -> list[Array]:
        """Arrays of states by their labels, float64 or float32; tables in the robot's order, Dask arrays lazy."""
        return _numbers(name, {label: self._names_of(label) for label in arrays}, **arrays)

    def _inputs(self, name: str, options: Mapping[str, Any]) -> list[tuple[str, tuple[int, ...]]]:
        """Names and shapes of what the kernel of a quantity takes."""
        wanted = quantities.inputs_of(self.model, name, quantities.checked_options(self.model, name, options))
        return [("wrench" if label.startswith("wrench at ") else label, core) for label, core in wanted]

    def _later(self, name: str, arrays: Sequence[Any], out: Any, options: Mapping[str, Any]) -> Any:
        """The quantity of Dask arrays: Dask arrays of the results, computed when asked for."""
        signature = self.kernel(name, **options).signature
        if (problem := self._misfit(name, arrays, options)) is not None:
            raise problem
        _refuse_out(name, out)
        return lazy.later(partial(_now, self, name, options), str(signature), arrays)

    def _put_in_front(self, name: str, kernel: Any) -> None:
        """Let calls with plain arrays of one state reach the kernel at once; all others come to the method as before."""
        method = getattr(Robot, name, None)
        if method is not None and getattr(type(self), name) is method and name not in vars(self):
            from .kernels.call import make_call

            direct = make_call(kernel, method.__get__(self), name)
            if direct is not None:
                vars(self)[name] = direct

    def _misfit(self, name: str, arrays: Sequence[Any], options: Mapping[str, Any]) -> ShapeError | None:
        """A shape error that names the argument, or None where types and shapes fit."""
        batches = []
        for (label, core), a in zip(self._inputs(name, options), arrays, strict=False):
            if not np.can_cast(a.dtype, float):
                return _not_real(name, label, a)
            if a.ndim < 1 or a.shape[-1:] != core:
                names = self.coordinate_names if label == "q" else self.joint_names
                which = f" (one per entry of {', '.join(names)})" if label != "wrench" and core[0] <= 12 else ""
                what = "(m, f), angular part first" if label == "wrench" else f"{core[0]} in the last axis{which}"
                return ShapeError(f"{name}: {label} has shape {a.shape}, but robot {self.name!r} wants {what}.")
            batches.append((label, a.shape[:-1]))
        try:
            np.broadcast_shapes(*(b for _, b in batches))
        except ValueError:
            listed = ", ".join(f"{label} {shape}" for label, shape in batches)
            return ShapeError(f"{name}: the batch shapes do not broadcast: {listed}.")
        return None

    def _require_invertible(self) -> None:
        """Raise SingularMassMatrixError if M has no inverse at a generic configuration, naming the joints involved."""
        if self.nv == 0:
            return
        M = self.reference("mass_matrix", self.random_configuration(0))
        names = [b.joint.name for b in self.model.leaders for _ in range(b.joint.nv)]
        d = np.sqrt(np.abs(np.diagonal(M)))
        scale = np.where(d > 0, d, 1.0)
        values, vectors = np.linalg.eigh(M / np.outer(scale, scale))
        null = np.abs(values) <= 1e-13 * self.nv
        if not null.any():
            return
        lost = np.abs(vectors[:, null]).max(axis=1)
        guilty = list(dict.fromkeys(n for n, x in zip(names, lost, strict=True) if x > 0.1))
        raise SingularMassMatrixError(
            f"the mass matrix of robot {self.name!r} has no inverse: joints {', '.join(guilty)} move nothing with inertia "
            "of its own. Lock them (robot.lock), give their links mass, or use inverse dynamics, which needs no inverse."
        )

    # ── kinematics ──

    def forward_kinematics(self, q: ArrayLike, frame: str | None = None, *, out: Array | None = None) -> Array:
        """T_s,frame, pose of a frame (None: the tip) in the base frame; (nq) → (4, 4)."""
        return self._call("forward_kinematics", q, frame=frame, out=out)

    def link_poses(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """T_s,link of all of :attr:`link_names` at once; (nq) → (nlinks, 4, 4)."""
        return self._call("link_poses", q, out=out)

    def jacobian(
        self, q: ArrayLike, frame: str | None = None, kind: str = "body", *, out: Array | None = None
    ) -> Array:
        """J with V = J dq, of a frame (None: the tip); (nq) → (6, nv), angular rows first. MR eq. 5.11, 5.18.

        ``kind``: ``"body"``, the twist in the frame itself; ``"space"``, at the base origin; ``"world_aligned"``, at the
        frame's origin with the base's axes.
        """
        return self._call("jacobian", q, frame=frame, kind=kind, out=out)

    def jacobian_rate(
        self, q: ArrayLike, dq: ArrayLike, frame: str | None = None, kind: str = "body", *, out: Array | None = None
    ) -> Array:
        """d/dt of :meth:`jacobian`; (nq), (nv) → (6, nv)."""
        return self._call("jacobian_rate", q, dq, frame=frame, kind=kind, out=out)

    def frame_velocity(
        self, q: ArrayLike, dq: ArrayLike, frame: str | None = None, kind: str = "body", *, out: Array | None = None
    ) -> Array:
        """Twist (omega, v) of a frame (None: the tip), ``kind`` as for the Jacobian; (nq), (nv) → (6)."""
        return self._call("frame_velocity", q, dq, frame=frame, kind=kind, out=out)

    def frame_acceleration(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        frame: str | None = None,
        kind: str = "body",
        *,
        out: Array | None = None,
    ) -> Array:
        """d/dt of :meth:`frame_velocity`, gravity not included; (nq), (nv), (nv) → (6).

        The rate of a twist's six numbers: the acceleration of a body's point has ω × v beside it, unless ``kind`` is
        ``"world_aligned"``.
        """
        return self._call("frame_acceleration", q, dq, ddq, frame=frame, kind=kind, out=out)

    def inverse_kinematics(
        self, T: ArrayLike, frame: str | None = None, q0: ArrayLike | None = None, **options: Any
    ) -> InverseKinematics:
        """Configurations at which a frame (None: the tip) has the pose T, inside the joints' limits; (4, 4), (nq) → (nq).

        Newton's method from ``q0`` (None: neutral), damped, and from random places where that fails. Options: ``rows``
        (``"vx vy vz"``: position only), ``restarts``, ``rng``, ``angle`` and ``distance``, the tolerances. The result says
        which poses were reached, what is left, and why; nothing else counts as reached. Any batch of T and q0. MR section 6.2.
        Raises ShapeError, ValueRangeError, FrameError, UnknownNameError.

        >>> import twistwrench as tw
        >>> arm = tw.robots.ur5()
        >>> found = arm.inverse_kinematics(arm.forward_kinematics([0.1, -1, 1, 0.2, 0.3, 0]))
        >>> bool(found.converged), found.q.shape
        (True, (6,))
        """
        from .inverse_kinematics import solve

        return solve(self, T, frame, q0, **options)

    # ── dynamics ──

    def inverse_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        friction: bool = False,
        out: Array | None = None,
    ) -> Array:
        """τ = M q̈ + h + Σ J'F_by - Σ J'F_on; (nq), (nv), (nv) → (nv). MR eq. 8.54.

        Wrenches are dicts ``{frame: (..., 6)}``, (m, f) expressed in that frame: ``wrench_by_robot`` is what the robot
        applies to the world there, ``wrench_on_robot`` what the world applies to the robot. ``friction=True`` adds the
        torque that overcomes the joints' friction.

        >>> import numpy as np, twistwrench as tw
        >>> robot = tw.robots.planar_2r()
        >>> np.round(robot.inverse_dynamics([0, 0], [0, 0], [0, 0]), 2).tolist()
        [29.43, 9.81]
        """
        first = None if friction else out  # friction still needs dq, which out may be
        tau = self._with_wrenches("inverse_dynamics", (q, dq, ddq), wrench_by_robot, wrench_on_robot, first)
        if friction and lazy.is_lazy(tau):
            _refuse_out("inverse_dynamics", out)
        return np.add(tau, self.friction_forces(dq, load=tau), out=out) if friction else tau

    def forward_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        tau: ArrayLike,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        friction: bool = False,
        out: Array | None = None,
    ) -> Array:
        """q̈ = M⁻¹ (τ - h - Σ J'F_by + Σ J'F_on); (nq), (nv), (nv) → (nv). MR section 8.5.

        ``friction=True`` takes what the joints' friction costs off τ first; a joint at rest is taken to slide freely.
        Raises SingularMassMatrixError where a joint moves nothing with inertia.
        """
        if friction:
            tau = self._call("torque_past_friction", dq, tau)
        return self._with_wrenches("forward_dynamics", (q, dq, tau), wrench_by_robot, wrench_on_robot, out)

    def mass_matrix(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """M, symmetric and full; (nq) → (nv, nv). MR eq. 8.57."""
        return self._call("mass_matrix", q, out=out)

    def bias_forces(self, q: ArrayLike, dq: ArrayLike, *, out: Array | None = None) -> Array:
        """h = c + g, what remains of τ at q̈ = 0; (nq), (nv) → (nv)."""
        return self._call("bias_forces", q, dq, out=out)

    def coriolis_forces(self, q: ArrayLike, dq: ArrayLike, *, out: Array | None = None) -> Array:
        """c, the velocity-product terms; (nq), (nv) → (nv)."""
        return self._call("coriolis_forces", q, dq, out=out)

    def coriolis_matrix(self, q: ArrayLike, dq: ArrayLike, *, out: Array | None = None) -> Array:
        """C with C dq = c and dM/dt - 2C skew; (nq), (nv) → (nv, nv). The Christoffel one on one-degree joints."""
        return self._call("coriolis_matrix", q, dq, out=out)

    def christoffel(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """Γ_ijk, Christoffel symbols of the first kind; (nq) → (nv, nv, nv). MR eq. 8.12.

        Raises ValueRangeError on robots with planar or floating joints, whose rates are not derivatives of coordinates.
        """
        return self._call("christoffel", q, out=out)

    def gravity_forces(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """g, the torques that hold the robot against gravity; (nq) → (nv)."""
        return self._call("gravity_forces", q, out=out)

    def friction_forces(self, dq: ArrayLike, *, load: ArrayLike | None = None, out: Array | None = None) -> Array:
        """The torques that overcome joint friction at dq; (nv) → (nv). MR section 8.9.4.

        ``load`` (nv): the torques the joints carry, for friction that grows with them. At rest friction may be anything
        up to the static one, and the law gives 0.
        """
        if load is None:
            return self._call("friction_forces", dq, out=out)
        return self._call("friction_under_load", dq, load, out=out)

    def regressor(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike, *, out: Array | None = None) -> Array:
        """Y with τ = Y π, π being :attr:`parameters`; (nq), (nv), (nv) → (nv, 10 nbodies). Springs and friction apart.

        >>> import numpy as np, twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> Y = arm.regressor([0, 0], [0, 0], [0, 0])
        >>> np.round(Y @ arm.parameters, 2).tolist()
        [29.43, 9.81]
        """
        return self._call("regressor", q, dq, ddq, out=out)

    # ── derivatives ──

    def inverse_dynamics_derivatives(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        out: Any = None,
    ) -> tuple[Array, Array]:
        """∂τ/∂q and ∂τ/∂dq; (nq), (nv), (nv) → (nv, nv) each; ∂τ/∂ddq is M. By q along :meth:`add`, friction left out.

        Wrenches keep their numbers in their frames, which move along. ``out`` is a pair of arrays.

        >>> import numpy as np, twistwrench as tw
        >>> by_q, by_dq = tw.robots.planar_2r().inverse_dynamics_derivatives([np.pi / 2, 0], [0, 0], [0, 0])
        >>> np.round(by_q, 2).tolist()
        [[-29.43, -9.81], [-9.81, -9.81]]
        """
        by_q, by_dq = self._with_wrenches(
            "inverse_dynamics_derivatives", (q, dq, ddq), wrench_by_robot, wrench_on_robot, out
        )
        return by_q, by_dq

    def forward_dynamics_derivatives(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        tau: ArrayLike,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        out: Any = None,
    ) -> tuple[Array, Array, Array]:
        """∂ddq/∂q, ∂ddq/∂dq and ∂ddq/∂τ = M⁻¹; (nq), (nv), (nv) → (nv, nv) each. As above otherwise.

        Raises SingularMassMatrixError where a joint moves nothing with inertia.
        """
        by_q, by_dq, inverse = self._with_wrenches(
            "forward_dynamics_derivatives", (q, dq, tau), wrench_by_robot, wrench_on_robot, out
        )
        return by_q, by_dq, inverse

    def inverse_dynamics_gradient(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        weights: ArrayLike,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        out: Any = None,
    ) -> tuple[Array, Array, Array]:
        """∂(w·τ)/∂(q, dq, ddq) for weights w (nv); (nv) each. At a few times the cost of τ, by reverse mode.

        >>> import numpy as np, twistwrench as tw
        >>> by_q, by_dq, by_ddq = tw.robots.planar_2r().inverse_dynamics_gradient([np.pi / 2, 0], [0, 0], [0, 0], [1, 1])
        >>> by_q.round(2).tolist()
        [-39.24, -19.62]
        """
        how = {"by": ("q", "dq", "ddq"), "form": "weighted"}
        given = (q, dq, ddq, weights)
        by_q, by_dq, by_ddq = self._with_wrenches(
            "inverse_dynamics", given, wrench_by_robot, wrench_on_robot, out, **how
        )
        return by_q, by_dq, by_ddq

    def inverse_dynamics_hessian_product(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        weights: ArrayLike,
        along_q: ArrayLike,
        along_dq: ArrayLike,
        along_ddq: ArrayLike,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        out: Any = None,
    ) -> tuple[Array, Array, Array]:
        """∂²(w·τ)/∂(q, dq, ddq)² times a direction; weights w and the direction's parts (nv) → (nv) each.

        That is the Hessian at 0 of (u, a, b) ↦ w·τ(q ⊕ u, dq + a, ddq + b), ⊕ being :meth:`add`: symmetric on every robot.

        >>> import numpy as np, twistwrench as tw
        >>> arm, still = tw.robots.planar_2r(), [0, 0]
        >>> curved = arm.inverse_dynamics_hessian_product(still, still, still, [1, 0], [1, 0], still, still)
        >>> curved[0].round(2).tolist()
        [-29.43, -9.81]
        """
        how = {"by": ("q", "dq", "ddq"), "form": "hessian_along"}
        given = (q, dq, ddq, weights, along_q, along_dq, along_ddq)
        by_q, by_dq, by_ddq = self._with_wrenches(
            "inverse_dynamics", given, wrench_by_robot, wrench_on_robot, out, **how
        )
        return by_q, by_dq, by_ddq

    def jacobian_derivative(
        self, q: ArrayLike, frame: str | None = None, kind: str = "body", *, out: Array | None = None
    ) -> Array:
        """∂J/∂q of :meth:`jacobian`, last axis along :meth:`add`; (nq) → (6, nv, nv). Its product with dq is dJ/dt."""
        return self._call("jacobian_derivative", q, frame=frame, kind=kind, out=out)

    def mass_matrix_derivative(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """∂M/∂q, last axis along :meth:`add`; (nq) → (nv, nv, nv). Its product with dq is dM/dt.

        >>> import numpy as np, twistwrench as tw
        >>> tw.robots.planar_2r().mass_matrix_derivative([0, np.pi / 2])[:, :, 1].round(2).tolist()
        [[-2.0, -1.0], [-1.0, 0.0]]
        """
        return self._call("mass_matrix", q, by="q", out=out)

    # ── statics ──

    def wrench_torques(
        self, q: ArrayLike, wrench_by_robot: ArrayLike | Wrench, frame: str | None = None, *, out: Array | None = None
    ) -> Array:
        """J_b' F alone, for a wrench the robot applies at the frame (None: the tip); (nq), (6) → (nv). MR eq. 5.26.

        A labelled wrench brings its own frame; a label that says otherwise is a FrameError.
        """
        if isinstance(wrench_by_robot, Wrench):
            frame = wrench_by_robot.frame if frame is None else frame
            wrench_by_robot = self._wrench(frame, wrench_by_robot)
        return self._call("wrench_torques", q, wrench_by_robot, frame=frame, out=out)

    def holding_torques(
        self,
        q: ArrayLike,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        out: Array | None = None,
    ) -> Array:
        """g + Σ J'F_by - Σ J'F_on, the torques of static equilibrium; (nq) → (nv)."""
        return self._with_wrenches("holding_torques", (q,), wrench_by_robot, wrench_on_robot, out)

    def joint_wrenches(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        out: Array | None = None,
    ) -> Array:
        """The wrench each moving body receives across its joint, in its own frame; → (nbodies, 6), as in body_names."""
        return self._with_wrenches("joint_wrenches", (q, dq, ddq), wrench_by_robot, wrench_on_robot, out)

    def _with_wrenches(
        self,
        name: str,
        arrays: tuple[ArrayLike, ...],
        by_robot: Wrenches | None,
        on_robot: Wrenches | None,
        out: Any,
        **options: Any,
    ) -> Any:
        """Call a kernel that takes the wrenches applied by the robot as further inputs."""
        total: dict[str, Array] = {}
        for sign, wrenches in ((1.0, by_robot), (-1.0, on_robot)):
            _check_mapping(wrenches)
            for frame, F in (wrenches or {}).items():
                mine = sign * self._wrench(frame, F)
                try:
                    total[frame] = total[frame] + mine if frame in total else mine
                except ValueError:
                    raise ShapeError(
                        f"the wrenches by and on the robot at {frame!r} have batch shapes that do not broadcast: "
                        f"{total[frame].shape[:-1]} and {mine.shape[:-1]}."
                    ) from None
        if not total:
            return self._call(name, *arrays, out=out, **options)
        if all(getattr(a, "dtype", None) == np.float32 for a in arrays):  # wrenches as lists do not make them double
            given = {**(by_robot or {}), **(on_robot or {})}
            total = {f: F if hasattr(given[f], "dtype") else F.astype(np.float32) for f, F in total.items()}
        frames = sorted(total)  # whatever the order they were given in, one kernel
        return self._call(name, *arrays, *(total[f] for f in frames), out=out, **options, wrenches=tuple(frames))

    def _wrench(self, frame: str, F: ArrayLike | Wrench) -> Array:
        self.model.frame(frame)
        if isinstance(F, Wrench):
            if F.frame != frame:
                raise FrameError(
                    f"a wrench in {F.frame!r} was given for frame {frame!r}: move it first, T @ F with "
                    f"T = Pose(…, to={frame!r}, of={F.frame!r})."
                )
            F = F.values
        given = arguments.brought(F, f"the wrench at {frame!r}")
        array = _numbers("wrench", {}, **{f"the one at {frame!r}": given})[0]
        if array.shape[-1:] != (6,):
            raise ShapeError(
                f"the wrench at {frame!r} has shape {array.shape}, expected six numbers (m, f), moment first."
            )
        small = np.can_cast(given.dtype, np.float32)  # as a kernel takes it: float16 does not make results double
        return array.astype(np.float32, copy=False) if small else array

    # ── task space and constraints ──

    @lazy.by_blocks(lambda _, given: [(len(row_numbers(given.get("rows"))),) * 2])
    def task_inertia(self, q: ArrayLike, frame: str | None = None, kind: str = "body", rows: Rows = None) -> Array:
        """Λ of F = Λ dV + η on the chosen rows of J, (J M⁻¹ J')⁻¹; (nq) → (r, r). MR section 8.6.

        ``frame`` (None: the tip) and ``kind`` as for :meth:`jacobian`; ``rows`` by name, ``"vx vz"``, or number, 0 to 5; None
        is all six. Where J loses rank, Λ is the pseudo-inverse, which acts on the directions that remain:
        :meth:`lost_directions` are the others. A 0 on its diagonal does not mean light: no motion along that row is possible,
        so no inertia is defined. A ModelWarning, once for a robot and its rows, names rows that are lost at every
        configuration, as a planar arm's are without ``rows``. Raises SingularMassMatrixError as :meth:`forward_dynamics` does.

        >>> import numpy as np, twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> arm.task_inertia([0, np.pi / 2], kind="world_aligned", rows="vx vz").round(12).tolist()
        [[1.0, 0.0], [0.0, 2.0]]
        """
        return self._task("task_inertia", (q,), frame, kind, rows)

    @lazy.by_blocks(lambda _, given: [(len(row_numbers(given.get("rows"))),)])
    def task_bias(
        self, q: ArrayLike, dq: ArrayLike, frame: str | None = None, kind: str = "body", rows: Rows = None
    ) -> Array:
        """η of F = Λ dV + η on the chosen rows of J, Λ (J M⁻¹ h - (dJ/dt) dq); (nq), (nv) → (r). MR section 8.6.

        Arguments, and what happens where J loses rank, as for :meth:`task_inertia`.
        """
        return self._task("task_bias", (q, dq), frame, kind, rows)

    def lost_directions(self, q: ArrayLike, frame: str | None = None, kind: str = "body", rows: Rows = None) -> Array:
        """The directions of the chosen rows in which the frame cannot be moved; (nq) → (lost, r).

        Orthonormal rows F with F'J = 0: wrenches there are borne without torques, and Λ is zero on them. A batch has as many
        rows for each configuration as the one that has lost most; those of the others are zero after their own.

        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> abs(arm.lost_directions([0, 0], kind="world_aligned", rows="vx vz").round(12)).tolist()
        [[1.0, 0.0]]
        """
        q = np.asarray(arguments.finite(q, "lost_directions: q", self.nq, names=self.coordinate_names), float)
        chosen = list(row_numbers(rows))
        sizes = self._usual_ways(frame, kind)[2][chosen]
        return Reach.of(self.jacobian(q, frame, kind)[..., chosen, :], self.mass_matrix(q), sizes).lost

    def _task(self, name: str, arrays: tuple[ArrayLike, ...], frame: str | None, kind: str, rows: Rows) -> Array:
        """Λ or η by the kernel; where its pivots are near zero, once more by singular values."""
        chosen = row_numbers(rows)
        arrays = self._brought(name, arrays, {})
        if self.nv == 0:
            self.jacobian(arrays[0], frame, kind)  # for the door's sake
            batch = np.broadcast_shapes(*(np.shape(a)[:-1] for a in arrays))
            return np.zeros((*batch, len(chosen), len(chosen))[: len(batch) + 3 - len(arrays)])
        with np.errstate(all="ignore"):
            found, pivots = self._call(name, *arrays, frame=frame, kind=kind, rows=chosen)
        sizes = self._usual_ways(frame, kind)[2][list(chosen)]
        known = np.ones(pivots.shape[:-1], bool)
        for array in arrays:
            known = known & np.isfinite(array).all(axis=-1)
        found[~known] = np.nan  # and not what an elimination of NaN leaves
        again = doubtful(pivots, sizes) & known
        if again.any():
            self._warn_of_lost_rows(frame, kind, chosen)
            q, *dq = (np.broadcast_to(np.asarray(a, float), (*again.shape, np.shape(a)[-1]))[again] for a in arrays)
            J, M = self.jacobian(q, frame, kind)[:, chosen], self.mass_matrix(q)
            Lambda = Reach.of(J, M, sizes).pseudoinverse
            if dq:
                free = np.linalg.solve(M, self.bias_forces(q, dq[0])[..., None])  # M⁻¹ h
                dJ_dq = self.jacobian_rate(q, dq[0], frame, kind)[:, chosen] @ dq[0][..., None]
                found[again] = (Lambda @ (J @ free - dJ_dq))[..., 0]
            else:
                found[again] = Lambda
        return np.asarray(found)

    def _usual_ways(self, frame: str | None, kind: str) -> tuple[Array, Array, Array]:
        """J (8, 6, nv) and M (8, nv, nv) at some configurations, and how large the rows of J usually are through M; (6,)."""
        found = self._ways.get((frame, kind))
        if found is None:
            self._require_invertible()
            some = self.random_configuration(0, 8)
            J = np.stack([self.reference("jacobian", q, frame=frame, kind=kind) for q in some])
            M = np.stack([self.reference("mass_matrix", q) for q in some])
            found = self._ways[frame, kind] = (J, M, usual_sizes(J, M))
        return found

    def _warn_of_lost_rows(self, frame: str | None, kind: str, chosen: tuple[int, ...]) -> None:
        """Warn, the first time, of rows that are lost at every configuration."""
        if (asked := (frame, kind, chosen)) in self._judged:
            return
        self._judged.add(asked)
        order = sorted(chosen, key=lambda row: (row < 3, row))  # moving before turning, as one would choose
        J, M, sizes = self._usual_ways(frame, kind)
        kept = [order[k] for k in independent_rows(J[:, order], M, sizes[order])]
        if len(kept) < len(chosen):
            still = [k for k in chosen if not independent_rows(J[:, [k]], M, sizes[[k]])]
            follow = [k for k in chosen if k not in kept and k not in still]
            keep, stay, go = (" ".join(ROWS[k] for k in chosen if k in some) for some in (kept, still, follow))
            lost = " and ".join([f"{stay} never move"] * bool(stay) + [f"the others determine {go}"] * bool(go))
            advice = f"choose independent ones, rows={keep!r}" if keep else "this frame does not move along any of them"
            warnings.warn(
                f"robot {self.name!r}: of the {len(chosen)} rows of {frame or self.tip!r} ({kind!r}) only {len(kept)} can move "
                f"independently at any configuration: {lost}. Λ is 0 where no motion is possible, and no inertia is defined "
                f"there; {advice}.",
                ModelWarning,
                stacklevel=5,
            )

    def closed_form(self, q: ArrayLike, dq: ArrayLike, *, wrench_by_robot: Wrenches | None = None) -> ClosedForm:
        """The terms of the equation of motion by the block matrices of MR section 8.4, and those matrices; one state.

        q (nq,), dq (nv,). Slow, and without any of the recursions by which the terms are computed elsewhere.

        >>> import twistwrench as tw
        >>> terms = tw.robots.planar_2r().closed_form([0, 0.5], [1, 1])
        >>> terms.A.shape, terms.L.shape, terms.M.shape
        ((12, 2), (12, 12), (2, 2))
        """
        q, dq = (
            arguments.finite(
                arguments.one(x, f"closed_form: {name}", n, names=self._names_of(name)), f"closed_form: {name}", n
            )
            for name, x, n in (("q", q, self.nq), ("dq", dq, self.nv))
        )
        _check_mapping(wrench_by_robot)
        wrenches = {frame: self._wrench(frame, F) for frame, F in (wrench_by_robot or {}).items()}
        if batched := [frame for frame, F in wrenches.items() if F.ndim > 1]:
            raise ShapeError(f"closed_form: the wrench at {batched[0]!r} is a batch; one state takes six numbers.")
        from .algorithms.closed_form import closed_form

        return closed_form(self.model, q, dq, wrenches)

    def close(
        self,
        frame_a: str,
        frame_b: str,
        rows: Rows = None,
        *,
        pose: ArrayLike | None = None,
        near: ArrayLike | None = None,
        redundant: str = "error",
    ) -> ClosedRobot:
        """A robot with a closed loop: ``frame_b`` held on ``frame_a``; see :class:`twistwrench.closed.ClosedRobot`.

        With {c} the frame at ``pose`` (4, 4) in {a} (None: {a} itself), the chosen ``rows`` of the twist of {b} as {c} sees it,
        along the axes of {c}, are zero, and {b} lies on {c} in these directions. Three rows of turning and three of moving
        (None) are a weld; ``"vx vy vz"`` a ball joint; all but ``wz`` a hinge about z. ``"ground"`` is the base. Loops are
        closed one after another. The search for configurations at which the loops close starts at ``near``, else anywhere.

        Raises ConstraintError where none is found, and where rows depend on the others, unless ``redundant="accept"``.

        >>> import numpy as np, twistwrench as tw
        >>> arm = tw.robots.planar_3r()
        >>> at_the_wall = tw.se3.exp([0, 0, 0, 1.5, 0, 0])
        >>> arm.close("ground", arm.tip, rows="vx vz", pose=at_the_wall)
        <ClosedRobot 'planar_3r': ground–tip vx vz; 1 degree of freedom>
        """
        from .closed import ClosedRobot

        return ClosedRobot(self).close(frame_a, frame_b, rows, pose=pose, near=near, redundant=redundant)

    def constrain(
        self, frame: str, rows: Rows, kind: str = "body", *, near: ArrayLike | None = None, redundant: str = "error"
    ) -> ClosedRobot:
        """A robot whose velocity alone is constrained: chosen rows of a frame's twist are zero, as for a wheel or a blade.

        ``kind`` as for :meth:`jacobian`: ``"vz"`` is along the frame's own z (``"body"``), wherever that points. A hand that
        stays on a level table wants the world's, ``kind="world_aligned"``. No position goes with it; where one does, as for
        a hand on a plane, :meth:`close` with ``"ground"`` keeps it. Raises ConstraintError as that does.

        >>> import twistwrench as tw
        >>> tw.robots.floating_box().constrain("box", "vy")
        <ClosedRobot 'floating_box': box vy; 5 degrees of freedom>
        """
        from .closed import ClosedRobot

        return ClosedRobot(self).constrain(frame, rows, kind, near=near, redundant=redundant)

    # ── actuation ──

    def drive_torques(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
    ) -> tuple[Array, Array]:
        """What the gears carry, and what the rotors take before them, both as felt at the joints; (nv) each.

        They add up to τ. Divided by the ratio they are the book's τ_gear / G and the rotor's own part of τ_motor. MR
        section 8.9.3.
        """
        carried, rotor = self._with_wrenches("drive_torques", (q, dq, ddq), wrench_by_robot, wrench_on_robot, None)
        return carried, rotor

    @lazy.by_blocks(lambda robot, _: [(len(robot.actuators),)] * 6, MotorLoads)
    def motor_loads(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        friction: bool = False,
    ) -> MotorLoads:
        """Torque, speed, current, voltage, power and heat of the motor of each actuator. MR section 8.9.

        Rotors are accelerated before the gear; the rest, and joint friction if asked for, go through it at its
        efficiency. Raises ModelError for a robot without actuators: see :meth:`with_actuators`.
        """
        if not self.actuators:
            raise ModelError(f"robot {self.name!r} has no actuators. Describe them: robot.with_actuators(file).")
        given = {"wrench_by_robot": wrench_by_robot, "wrench_on_robot": wrench_on_robot}
        carried, rotor = self.drive_torques(q, dq, ddq, **given)
        if friction:
            carried = carried + self.friction_forces(dq, load=carried + rotor)
        (dq,) = self._states("motor_loads", dq=dq)
        return motor_loads(self.model, dq.astype(float), carried, rotor)

    @lazy.by_blocks(lambda *_: [()] * 4, PowerBalance)
    def power_balance(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        tau: ArrayLike,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        friction: bool = False,
    ) -> PowerBalance:
        """Where the power goes at one state under torques τ, () W each: positive comes in, and the sum is zero.

        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> balance = arm.power_balance([0.1, 0.2], [1.0, -1.0], [30.0, 5.0])
        >>> round(float(balance.joints), 9), abs(float(sum(balance))) < 1e-12
        (25.0, True)
        """
        given: dict[str, Any] = {"wrench_by_robot": wrench_by_robot, "wrench_on_robot": wrench_on_robot}
        ddq = self.forward_dynamics(q, dq, tau, friction=friction, **given)
        dq, tau = self._states("power_balance", dq=dq, tau=tau)
        moving = self.inverse_dynamics(q, dq, ddq)  # M ddq + h: dq times it is d/dt of the energy
        pushing = self.holding_torques(q, **given) - self.holding_torques(q)
        lost = self.friction_forces(dq, load=moving + pushing) if friction else np.zeros_like(dq)
        return power_balance(dq, tau, moving, pushing, lost)

    def explain(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        *,
        wrench_by_robot: Wrenches | None = None,
        wrench_on_robot: Wrenches | None = None,
        friction: bool = False,
    ) -> Explanation:
        """τ of each joint, split by term and by the link, rotor or payload that causes it; adds up to τ.

        Any batch shape; the table and the picture are of one state. Raises ShapeError as inverse dynamics does.

        >>> import twistwrench as tw
        >>> arm = tw.robots.planar_2r().with_payload(tw.SpatialInertia.from_com(2.0))
        >>> why = arm.explain([0, 0], [0, 1], [0, 0])
        >>> why.of("payload at tip", "gravity").round(2).tolist()
        [39.24, 19.62]
        """
        wrenches: dict[str, Any] = {"wrench_by_robot": wrench_by_robot, "wrench_on_robot": wrench_on_robot}
        q, dq, ddq = map(np.asarray, self._states("explain", q=q, dq=dq, ddq=ddq))
        tau = np.asarray(self.inverse_dynamics(q, dq, ddq, **wrenches), float)
        apart: dict[str, Array] = {}
        for sign, given in ((1.0, wrench_by_robot), (-1.0, wrench_on_robot)):
            for frame, F in (given or {}).items():
                found = sign * self.wrench_torques(q, self._wrench(frame, F), frame)
                apart[f"wrench at {frame}"] = found + apart.get(f"wrench at {frame}", 0.0)
        if self.model.springs:
            apart["springs"] = self.holding_torques(q) - self.gravity_forces(q)
        if friction and self.model.friction.any:
            apart["friction"] = self.friction_forces(dq, load=tau)
        if self._regressor is None:  # asked once in a while: not worth the second that compiling takes
            from .targets.numpy import NumpyKernel

            self._regressor = NumpyKernel(self.program("regressor"), "regressor", "")
        from .explanation import explained

        return explained(self.model, self._regressor, (q, dq, ddq), apart)

    # ── motion ──

    def simulate(
        self,
        q0: ArrayLike | None = None,
        dq0: ArrayLike | None = None,
        duration: float = 1.0,
        dt: float = 1e-3,
        **options: Any,
    ) -> SimulationResult:
        """The motion from q0 (nq,) and dq0 (nv,), None: neutral and at rest; a state every ``dt`` s for ``duration`` s.

        ``method``: ``"dopri5"``, which adapts its steps to ``rtol`` and ``atol``; ``"rk4"``, ``"semi_implicit"``, ``"euler"``,
        and the variational ``"midpoint"``, ``"variational"``, ``"variational6"``, with steps of ``dt``. ``tau``: torques (nv,),
        or a function of (t, q, dq); ``controller``: such a function, asked every ``dt``, its torques held until the next time.
        ``wrench_on_robot``: ``{frame: (m, f) or a function of (t, q, dq)}``, in that frame. ``friction=True``: that of the
        joints, eased off below ``creep``, or in semi-implicit steps an impulse that stops and holds them. ``contacts``:
        ``tw.simulation.Plane`` and ``JointStops``; ``limits="stop"`` ends where a joint reaches a limit; ``events``:
        ``tw.simulation.Event``. ``every``: keep one state in so many.

        Raises SimulationError for an unstable step and a controller that fails, with all that was computed in ``.result``;
        ShapeError, ValueRangeError, UnknownNameError for what cannot be meant. docs/simulation.md explains and measures.

        >>> import twistwrench as tw
        >>> swing = tw.robots.pendulum().simulate([3.0], [0.0], duration=2.0)
        >>> len(swing), swing.stopped, swing.relative_drift < 1e-7
        (2001, 'reached the end, 2 s', True)
        """
        from .simulation import simulate

        return simulate(self, q0, dq0, duration, dt, **options)

    def rollout(
        self,
        q0: ArrayLike,
        dq0: ArrayLike,
        tau: ArrayLike | TorqueLaw | None = None,
        *,
        dt: float = 1e-3,
        **options: Any,
    ) -> Rollout:
        """Motions from any batch of states, all steps of ``dt`` s in one kernel; (..., nq), (..., nv) → (..., n, nq).

        ``tau``: torques (nv) for all steps, (..., steps, nv) step by step, or ``tw.simulation.PD`` or ``ComputedTorque``.
        ``steps`` or ``duration`` say how long, ``every`` keeps one state in so many. ``integrator``: ``"semi_implicit"`` or
        ``"rk4"``. ``wrench_on_robot``: ``{frame: (m, f)}``, (6) or (..., steps, 6). ``parameters``: ``{name: (...)}`` of
        :meth:`varying`, a payload's mass for each sample. ``friction=True``: that of the joints, as in :meth:`simulate`.
        ``torque_limits``: True clips to ``limits.effort``, numbers (nv) to these.
        ``torques=True`` returns those applied, too; ``out=(q, dq)`` writes into arrays of yours, for large results again and
        again. Motions that become unstable are named in the result's ``.unstable``.
        Raises ShapeError, ValueRangeError, UnknownNameError, SingularMassMatrixError. docs/rollouts.md explains.

        >>> import numpy as np, twistwrench as tw
        >>> arm = tw.robots.planar_2r()
        >>> many = arm.rollout(np.random.default_rng(0).normal(size=(100, 2)), [0, 0], steps=200, every=10)
        >>> many.q.shape, bool(many.unstable.any())
        ((100, 21, 2), False)
        """
        from .simulation.rollout import rollout

        return rollout(self, q0, dq0, tau, dt=dt, **options)

    # ── energies, momentum, centre of mass ──

    def kinetic_energy(self, q: ArrayLike, dq: ArrayLike, *, out: Array | None = None) -> Any:
        """½ dq' M dq; (nq), (nv) → (), J."""
        return self._call("kinetic_energy", q, dq, out=out)

    def potential_energy(self, q: ArrayLike, *, out: Array | None = None) -> Any:
        """Of the moving bodies, zero with their centre of mass at the base origin; (nq) → (), J."""
        return self._call("potential_energy", q, out=out)

    def momentum(self, q: ArrayLike, dq: ArrayLike, frame: str = "base", *, out: Array | None = None) -> Array:
        """Spatial momentum (angular, linear) of the moving bodies at the base origin; (nq), (nv) → (6).

        ``frame="com"``: about the centre of mass, axes of the base (centroidal momentum).
        """
        if frame not in ("base", "com"):
            raise UnknownNameError.of("momentum frame", frame, ("base", "com"))
        return self._call("momentum" if frame == "base" else "momentum_about_com", q, dq, out=out)

    def center_of_mass(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """Of the moving bodies, in the base frame; (nq) → (3), m."""
        return self._call("center_of_mass", q, out=out)

    def com_jacobian(self, q: ArrayLike, *, out: Array | None = None) -> Array:
        """J with d(center_of_mass)/dt = J dq; (nq) → (3, nv)."""
        return self._call("com_jacobian", q, out=out)


def _check_mapping(wrenches: Any) -> None:
    if wrenches is not None and not isinstance(wrenches, Mapping):
        raise ShapeError("wrenches are a dict {frame: (m, f)}, for the frame is part of what a wrench says.")


def _now(robot: Robot, name: str, options: Mapping[str, Any], *arrays: Array) -> Any:
    """A quantity of NumPy arrays; a function that travels to other processes."""
    return robot._call(name, *arrays, **options)


def _of_type(kernel: Any, arrays: Sequence[Array]) -> Any:
    """Results of the type and rank that arrays of these types and ranks give, of no samples."""
    batch = (0,) * (max(a.ndim for a in arrays) - 1)
    dtype: Any = np.float32 if all(np.can_cast(a.dtype, np.float32) for a in arrays) else np.float64
    cores = [core.count(",") + bool(core) for core in re.findall(r"\(([^)]*)\)", kernel.signature.partition("->")[2])]
    found = tuple(np.empty(batch + (0,) * rank, dtype) for rank in cores)
    return found if len(found) > 1 else found[0]


def _numbers(name: str, names: Mapping[str, Sequence[str]], /, **arrays: ArrayLike) -> list[Array]:
    """Arrays of float64, or of float32 where that is what was given; tables by ``names``, Dask arrays lazy."""
    found = []
    for label, given in arrays.items():
        array = arguments.brought(given, f"{name}: {label}", names.get(label, ()))
        if not np.can_cast(array.dtype, float):
            raise _not_real(name, label, array)
        found.append(array if array.dtype == np.float32 else array.astype(float))
    return found


def _not_real(name: str, label: str, given: Any) -> ShapeError:
    """The error for numbers that are neither float32 nor float64, nor exactly one of them."""
    dtype = given.dtype
    if dtype.kind == "f":
        what = f"is of {dtype.name}, and kernels compute in float32 or float64. Say that it may be rounded: "
        return ShapeError(f"{name}: {label} {what}np.asarray({label}, float).")
    hint = " If all of them are real numbers, np.asarray(…, float) makes one." if dtype.kind == "O" else ""
    if is_symbolic((given,)):
        hint = f" Symbols go through the methods of robot.kernel's quantities; {name} takes numbers only."
    return ShapeError(
        f"{name}: {label} is not an array of real numbers but of {dtype.name}: {str(given)[:60]!r}.{hint}"
    )


def _refuse_out(name: str, out: Any) -> None:
    """Nothing can be written now that is computed later."""
    if out is not None:
        raise ShapeError(
            f"{name}: out= is for results that are computed now, and those of Dask arrays are computed later. Leave it out."
        )


def _refuse_overlap(name: str, out: tuple[Any, ...]) -> None:
    """Two results in one memory are two wrong results, and NumPy lets them."""
    arrays = [a for a in out if isinstance(a, np.ndarray)]
    if any(np.shares_memory(a, b) for k, a in enumerate(arrays) for b in arrays[:k]):
        raise ShapeError(
            f"{name}: two arrays of out= share memory. Give each result memory of its own; or leave it out."
        )


def _refuse_text(out: Any) -> None:
    """NumPy would write numbers into an array of text, cut to its width."""
    if any(
        getattr(getattr(a, "dtype", None), "kind", "f") in "SUT" for a in (out if isinstance(out, tuple) else (out,))
    ):
        raise TypeError


def _unfit(name: str, out: Any, program: Program, arrays: Sequence[Any]) -> ShapeError:
    """The error for an ``out`` that the results do not fit in."""
    given = [np.asarray(a) for a in arrays]
    batch = np.broadcast_shapes(*(a.shape[: a.ndim - len(p.shape)] for a, p in zip(given, program.inputs, strict=True)))
    kind = "float32" if all(np.can_cast(a.dtype, np.float32) for a in given) else "float64"
    wanted = " and ".join(f"one of shape {batch + port.shape}" for port in program.outputs)
    shown = [
        f"a{' writable' if a.flags.writeable else ' read-only'} array of {a.dtype.name} and shape {a.shape}"
        if isinstance(a, np.ndarray)
        else f"a {type(a).__name__}"
        for a in (out if isinstance(out, tuple) else (out,))
    ]
    several = "a tuple of arrays" if len(program.outputs) > 1 else "an array"
    return ShapeError(
        f"{name}: out= is {' and '.join(shown)}. Give {several} of {kind} that can be written to, {wanted}; or leave it out."
    )


LARGEST_COMPILED = 1_000_000
"""Programs beyond this many instructions run on NumPy. Compiling takes some 0.02 to 0.1 ms an instruction (bench/NOTES.md), so
two minutes at most; the regressor of a chain of 100 links has 800,000."""


def _make_kernel(given: Program | Recurrence, name: str, doc: str) -> Any:
    program = given.program if isinstance(given, Recurrence) else given
    # NumPy's ufuncs cannot have an axis of no elements, as those of a robot with every joint locked; compiled loops copy
    # samples of three axes at most, and second derivatives of matrices have four.
    empty = any(port.size == 0 or len(port.shape) > 3 for port in [*program.inputs, *program.outputs])
    if empty or not compiles() or len(program.instructions) > LARGEST_COMPILED:
        from .targets.numpy import NumpyKernel
        from .targets.numpy_steps import NumpySteps

        return NumpySteps(given, name, doc) if isinstance(given, Recurrence) else NumpyKernel(given, name, doc)
    from .kernels.ufunc import make_ufunc

    return make_ufunc(given, name, doc)
