"""Generated C beside ours: the recursions on Pinocchio's model in CasADi's symbols, compiled by gcc.

CasADi writes straight-line C for a robot, as its users export it for controllers. It is compiled as it is and called state by
state; and once more with its inputs and results in blocks of 8, so that gcc computes them side by side (of blocks of 8 to 256,
with both orders of copying, the fastest). Beside them stand our batch, and our own C of ``export_c``, called state by state.
"""

import ctypes
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bench import machine
from bench.cases import CASES, Case, States, difference
from bench.ours import Ours
from bench.peer_pinocchio_cpp import DOUBLES
from bench.timing import ROUNDS, Contender, interleave

try:
    import casadi
except ImportError:  # of the extra casadi: other sections run without it
    casadi = None

QUANTITIES = ("inverse_dynamics", "forward_dynamics")
BLOCK = 8
AGREEMENT = 1e-9
SNAP = 1e-12
FLAGS = ("-O3", "-march=native", "-shared", "-fPIC", "-w")
FAST = "-ffast-math"
"""For generated C only, of which it shortens forward dynamics by a seventh; ours keeps IEEE arithmetic."""
SIDE_BY_SIDE = (FAST, "-fopenmp-simd", "-fno-builtin-sin", "-fno-builtin-cos", "-mprefer-vector-width=512")
"""With them gcc calls the vector functions of the C library, and does not join sine and cosine to one that has no such form."""
OURS, OURS_C = "twistwrench, batch", "twistwrench export_c, gcc, state by state"
SCALAR, BLOCKS = "Pinocchio's model in CasADi, gcc, state by state", f"the same C, gcc, {BLOCK} states at a time"


def times(rounds: int = ROUNDS, cases: tuple[Case, ...] = CASES, size: int = 4096) -> dict[str, Any]:
    """By robot with a fixed base and by quantity: times, agreement, and the seconds that gcc takes."""
    where, robots = machine.describe(), {}
    if shutil.which("gcc") is None:
        return {"date": where["date"], "cpu": where["cpu"], "rounds": rounds, "missing": "no gcc: `apt install gcc`"}
    if casadi is None:
        missing = "no CasADi: `pip install -e '.[casadi]'`"
        return {"date": where["date"], "cpu": where["cpu"], "rounds": rounds, "missing": missing}
    for case in cases:
        if not case.floating_base:
            with tempfile.TemporaryDirectory() as folder:
                robots[case.name] = {
                    quantity: _timed(case, quantity, rounds, size, Path(folder)) for quantity in QUANTITIES
                }
    return {"date": where["date"], "cpu": where["cpu"], "rounds": rounds, "robots": robots}


def _timed(case: Case, quantity: str, rounds: int, size: int, folder: Path) -> dict[str, Any]:
    ours, states = Ours(case), States.random(case, size)
    inputs = ours.inputs(quantity, states)
    method = ours.method(quantity)
    expected = np.array(method(*inputs))
    result = np.empty_like(expected)
    text = _casadi_source(case, ours, quantity)
    exported = ours.robot.export_c(quantity, folder / "ours.c", prefix="ours", test=False)
    compiled = {
        SCALAR: _library(text + _scalar_loop(case.model.nv), folder / f"{quantity}_scalar", (*FLAGS, FAST)),
        BLOCKS: _library(_in_blocks(text, case.model.nv), folder / f"{quantity}_blocks", (*FLAGS, *SIDE_BY_SIDE)),
        OURS_C: _library(
            _our_loop(exported[1], quantity, case.model.nv), folder / f"{quantity}_ours", FLAGS, exported[0].parent
        ),
    }
    contenders = [Contender(OURS, _repeated(lambda: method(*inputs, out=result)), size)]
    agreement = {}
    for name, (library, _) in compiled.items():
        given = inputs if name == OURS_C else tuple(np.ascontiguousarray(x) for x in inputs)
        found = np.empty_like(expected)
        call = _call(library, given, found)
        call()
        agreement[name] = difference(found, expected)
        if not agreement[name] <= AGREEMENT:
            raise SystemExit(
                f"generated C: {name} computes another {quantity}: {agreement[name]:.1e}. Nothing is timed"
            )
        contenders.append(Contender(name, _repeated(call), size))
    seconds = {name: taken for name, (_, taken) in compiled.items()}
    found = interleave(contenders, rounds, clock=time.thread_time_ns)
    return {
        "timings": {name: asdict(timing) for name, timing in found.items()},
        "agreement": agreement,
        "compiling": seconds,
    }


def _repeated(call: Callable[[], object]) -> Callable[[int], None]:
    def sweep(count: int) -> None:
        for _ in range(count):
            call()

    return sweep


# ── The recursions in CasADi's symbols


def _casadi_source(case: Case, ours: Ours, quantity: str) -> str:
    x = [casadi.SX.sym(name, case.model.nv) for name in ("q", "dq", "x")]
    back = np.argsort(ours.v_index).tolist()  # our order of joints, as for every contender here
    q, dq, third = (casadi.vertcat(*(each[k] for k in back)) for each in x)
    recursion = _newton_euler if quantity == "inverse_dynamics" else _articulated_bodies
    found = recursion(case.model, q, dq, third)
    ordered = casadi.vertcat(*(found[int(k)] for k in ours.v_index))
    function = casadi.Function("generated", x, [ordered], {"cse": True})
    writer = casadi.CodeGenerator("generated.c")
    writer.add(function)
    return str(writer.dump())


@dataclass(frozen=True)
class _Joint:
    """Pose of a joint's frame in its parent's, and the axis; motions and forces are pairs, the linear part first."""

    R: Any
    p: Any
    axis: Any
    turns: bool

    def along(self, rate: Any) -> tuple[Any, Any]:
        """Motion of the joint itself."""
        return (0 * self.axis, self.axis * rate) if self.turns else (self.axis * rate, 0 * self.axis)

    def on_axis(self, linear: Any, angular: Any) -> Any:
        return (self.axis.T @ (angular if self.turns else linear))[0]

    def from_parent(self, linear: Any, angular: Any) -> tuple[Any, Any]:
        """A motion, in the joint's frame."""
        return self.R.T @ (linear - casadi.cross(self.p, angular)), self.R.T @ angular

    def to_parent(self, force: Any, moment: Any) -> tuple[Any, Any]:
        """A force, in the parent's frame."""
        turned = self.R @ force
        return turned, self.R @ moment + casadi.cross(self.p, turned)


def _joints(model: Any, q: Any) -> dict[int, _Joint]:
    found = {}
    for k in range(1, model.njoints):
        joint, place = model.joints[k], model.jointPlacements[k]
        kind, x = joint.shortname(), q[joint.idx_v]
        if kind[:-1] not in ("JointModelR", "JointModelP"):
            raise SystemExit(f"generated C: {kind} is not written here")
        axis, turns = np.eye(3)["XYZ".index(kind[-1])], kind[-2] == "R"
        fixed = _sparse(
            np.where(np.abs(place.rotation) < SNAP, 0.0, place.rotation)
        )  # as ours: no products with rounding errors
        e = _sparse(axis)
        turn = casadi.sparsify(
            e @ e.T + casadi.cos(x) * _sparse(np.eye(3) - np.outer(axis, axis)) + casadi.sin(x) * casadi.skew(e)
        )
        p = _sparse(place.translation) + (0 if turns else fixed @ e * x)
        found[k] = _Joint(fixed @ turn if turns else fixed, p, e, turns)
    return found


def _sparse(values: Any) -> Any:
    """Numbers as symbols, without their zeros."""
    return casadi.SX(casadi.sparsify(casadi.DM(np.asarray(values))))


def _inertia(body: Any) -> tuple[Any, Any, Any]:
    """Mass, centre of mass, and moment about it."""
    return body.mass, _sparse(body.lever), _sparse(body.inertia)


def _newton_euler(model: Any, q: Any, dq: Any, ddq: Any) -> Any:
    joints, zero = _joints(model, q), casadi.SX(3, 1)
    v, a = {0: (zero, zero)}, {0: (_sparse(-model.gravity.linear), zero)}
    f = dict.fromkeys(range(model.njoints), (zero, zero))
    for k, joint in joints.items():
        i, p = model.joints[k].idx_v, model.parents[k]
        own, more = joint.along(dq[i]), joint.along(ddq[i])
        v[k] = tuple(x + y for x, y in zip(joint.from_parent(*v[p]), own, strict=True))
        product = casadi.cross(v[k][1], own[0]) + casadi.cross(v[k][0], own[1]), casadi.cross(v[k][1], own[1])
        a[k] = tuple(x + y + z for x, y, z in zip(joint.from_parent(*a[p]), more, product, strict=True))
        f[k] = _own_force(_inertia(model.inertias[k]), v[k], a[k])
    tau = casadi.SX(model.nv, 1)
    for k in reversed(joints):
        tau[model.joints[k].idx_v] = joints[k].on_axis(*f[k])
        up = joints[k].to_parent(*f[k])
        f[model.parents[k]] = tuple(x + y for x, y in zip(f[model.parents[k]], up, strict=True))
    return tau


def _own_force(inertia: tuple[Any, Any, Any], v: Any, a: Any) -> tuple[Any, Any]:
    """I a + v × I v about the frame's origin."""
    mass, c, I = inertia
    momentum = mass * (v[0] - casadi.cross(c, v[1]))
    spin = I @ v[1] + casadi.cross(c, momentum)
    force = mass * (a[0] - casadi.cross(c, a[1]))
    moment = I @ a[1] + casadi.cross(c, force)
    return force + casadi.cross(v[1], momentum), moment + casadi.cross(v[1], spin) + casadi.cross(v[0], momentum)


def _articulated_bodies(model: Any, q: Any, dq: Any, tau: Any) -> Any:
    joints, zero = _joints(model, q), casadi.SX(3, 1)
    v, c, inertia, bias = {0: (zero, zero)}, {}, {}, {}
    for k, joint in joints.items():
        own = joint.along(dq[model.joints[k].idx_v])
        v[k] = tuple(x + y for x, y in zip(joint.from_parent(*v[model.parents[k]]), own, strict=True))
        c[k] = casadi.cross(v[k][1], own[0]) + casadi.cross(v[k][0], own[1]), casadi.cross(v[k][1], own[1])
        mass, lever, I = _inertia(model.inertias[k])
        C = casadi.skew(lever)
        inertia[k] = mass * casadi.SX.eye(3), -mass * C, casadi.sparsify(I - mass * C @ C)
        bias[k] = _own_force((mass, lever, I), v[k], (zero, zero))
    U, d, u = {}, {}, {}
    for k in reversed(joints):
        joint, (A, B, D), p = joints[k], inertia[k], model.parents[k]
        U[k] = (B @ joint.axis, D @ joint.axis) if joint.turns else (A @ joint.axis, B.T @ joint.axis)
        d[k] = joint.on_axis(*U[k])
        u[k] = tau[model.joints[k].idx_v] - joint.on_axis(*bias[k])
        if p:
            force, moment = U[k]
            A, B, D = (
                _symmetric(A - force @ force.T / d[k]),
                B - force @ moment.T / d[k],
                _symmetric(D - moment @ moment.T / d[k]),
            )
            rest = u[k] / d[k]
            pushed = (
                bias[k][0] + A @ c[k][0] + B @ c[k][1] + force * rest,
                bias[k][1] + B.T @ c[k][0] + D @ c[k][1] + moment * rest,
            )
            R, P = joint.R, casadi.skew(joint.p)
            A, B, D = _symmetric(R @ A @ R.T), R @ B @ R.T, _symmetric(R @ D @ R.T)
            shifted = B - A @ P
            moved = A, shifted, _symmetric(D + P @ shifted - B.T @ P)
            inertia[p] = tuple(x + y for x, y in zip(inertia[p], moved, strict=True))
            bias[p] = tuple(x + y for x, y in zip(bias[p], joint.to_parent(*pushed), strict=True))
    a, ddq = {0: (_sparse(-model.gravity.linear), zero)}, casadi.SX(model.nv, 1)
    for k, joint in joints.items():
        i = model.joints[k].idx_v
        reached = tuple(x + y for x, y in zip(joint.from_parent(*a[model.parents[k]]), c[k], strict=True))
        ddq[i] = (u[k] - U[k][0].T @ reached[0] - U[k][1].T @ reached[1]) / d[k]
        a[k] = tuple(x + y for x, y in zip(reached, joint.along(ddq[i]), strict=True))
    return ddq


def _symmetric(matrix: Any) -> Any:
    """The upper half, twice: its entries are computed once."""
    return casadi.triu2symm(casadi.triu(matrix))


# ── C around them


def _scalar_loop(nv: int) -> str:
    return f"""
void sweep(long n, const double* q, const double* dq, const double* x, double* out) {{
  for (long i = 0; i < n; ++i) {{
    const double* arg[3] = {{q + i * {nv}, dq + i * {nv}, x + i * {nv}}};
    double* res[1] = {{out + i * {nv}}};
    generated(arg, res, 0, 0, 0);
  }}
}}
"""


def _in_blocks(text: str, nv: int) -> str:
    """The generated function with entry k of an input at ``[k][i]``, within a loop over the states of a block."""
    body = text[text.index("static int casadi_f0(") :]
    body = body[body.index("{") + 1 : body.index("\n}\n")]
    body = re.sub(r"arg\[(\d)\]\? arg\[\1\]\[(\d+)\] : 0", r"in[\1][\2][i]", body)
    body = re.sub(r"if \(res\[0\]!=0\) res\[0\]\[(\d+)\]=", r"result[\1][i]=", body)
    declared, statements = body.split(";", 1)
    names = declared.replace("casadi_real", "").strip()
    return f"""
#include <math.h>
#define casadi_real double
#define casadi_sq(x) ((x)*(x))
void sweep(long n, const double* q, const double* dq, const double* x, double* out) {{
  const double* given[3] = {{q, dq, x}};
  for (long start = 0; start < n; start += {BLOCK}) {{
    double in[3][{nv}][{BLOCK}], result[{nv}][{BLOCK}];
    for (int m = 0; m < 3; ++m)
      for (int k = 0; k < {nv}; ++k)
        for (int i = 0; i < {BLOCK}; ++i) in[m][k][i] = given[m][(start + i) * {nv} + k];
    #pragma omp simd
    for (int i = 0; i < {BLOCK}; ++i) {{
      double {names};
      {statements.replace("return 0;", "")}
    }}
    for (int k = 0; k < {nv}; ++k)
      for (int i = 0; i < {BLOCK}; ++i) out[(start + i) * {nv} + k] = result[k][i];
  }}
}}
"""


def _our_loop(source: Path, quantity: str, nv: int) -> str:
    return f"""{source.read_text()}
void sweep(long n, const double* q, const double* dq, const double* x, double* out) {{
  for (long i = 0; i < n; ++i) ours_{quantity}(q + i * {nv}, dq + i * {nv}, x + i * {nv}, out + i * {nv});
}}
"""


def _library(text: str, path: Path, flags: tuple[str, ...], include: Path | None = None) -> tuple[ctypes.CDLL, float]:
    """The compiled library, and the seconds that it took."""
    source, library = path.with_suffix(".c"), path.with_suffix(".so")
    source.write_text(text)
    start = time.perf_counter()
    where = () if include is None else (f"-I{include}",)
    subprocess.run(["gcc", *flags, *where, str(source), "-o", str(library), "-lm"], check=True)
    return ctypes.CDLL(str(library)), time.perf_counter() - start


def _call(library: ctypes.CDLL, inputs: tuple[np.ndarray, ...], out: np.ndarray) -> Callable[[], None]:
    arrays = [each.ctypes.data_as(DOUBLES) for each in (*inputs, out)]
    count = ctypes.c_long(len(out))

    def call() -> None:
        library.sweep(count, *arrays)

    return call
