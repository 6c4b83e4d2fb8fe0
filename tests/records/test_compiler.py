"""Programs, their loops, their forms on NumPy and their texts for compilers: complete answers on record. Nothing is compiled."""

from __future__ import annotations

import hashlib
import inspect
import re
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from recorded_answers import Records, refusal

from twistwrench.compiler.ir import autodiff
from twistwrench.compiler.ir.loops import ColumnGroup, ColumnSolve, Product, Products, Scan, Search, Source
from twistwrench.compiler.ir.program import Instruction, TensorSpec, axes_of
from twistwrench.compiler.ir.tracer import Trace, trace
from twistwrench.compiler.lowering import lower, partition, target_machine
from twistwrench.compiler.lowering.numpy_kernels import on_numpy
from twistwrench.compiler.lowering.reference_interpreter import evaluated, functions_of, last_uses
from twistwrench.compiler.lowering.target_machine import DOUBLE, SINGLE, CompilerFacts, Machine
from twistwrench.compiler.printers.c99 import FUSED_MACROS, CFunction, identifier, literal
from twistwrench.compiler.printers.cuda import CudaFunction
from twistwrench.compiler.runtime import (
    batch_threads,
    dispatch,
    dispatch_ir,
    elf_loader,
    interpreter,
    result_pool,
    xla_handler,
)

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)

X, Y, W = (0.7, -1.3, 2.6), (0.45, 3.2), np.array([[0.2, -0.4], [1.7, 0.9]])
INPUTS = [("x", (3,)), ("y at start", (2,)), ("W", (2, 2))]


def every_operation(x, y, W):
    """Results of every operation, alone and fused, each with operands of both signs somewhere."""
    a, b, c = x
    d, e = y
    sums = [a + b, a - c, 2.5 - b, -a, a * b, a / e, 3.0 / c, b / 4.0, a * 0.3 * 7.0, +c, (a - b) * -1.0, -(b * c)]
    fused = [a * b + c, a * b - c, c - a * b, -(a * d) - e, (a * e) + (b * d), d - c * 2.0]
    functions = [
        np.sin(a),
        np.cos(b),
        np.sin(a + d),
        np.cos(-c),
        np.tan(d),
        np.sqrt(e),
        np.exp(b),
        b.sign(),
        (-c).sign(),
        abs(b),
    ]
    composed = [np.tanh(b), np.log(e), np.arctan(c), a.arctan2(b), b.arctan2(-c), a.hypot(e)]
    powers = [a**2, a**3, e**0.5, e**1.5, a**-1, e**-2.5, e**1.3, a**0, e**2, e**d, c**5]
    limits = [a.clip(-0.5, 0.6), b.clip(-0.5, 0.6), d.clip(0.1, 0.9)]
    turned = [np.sin(a.turned(d)), np.cos(a.turned(d)), np.sin(c.turned(-b)), np.cos(c.turned(-b))]
    ends = [a.trace.min(a, d), a.trace.max(b, e), a.trace.min(b, a), a.trace.max(c, a)]
    one = np.array([*sums, *fused, *functions])
    return one, np.array([*composed, *powers, *limits, *turned, *ends]).reshape(4, 7), W @ np.array([a, b]) - d


OUTPUTS = ["sums", "composed", "x"]


def every():
    return trace(every_operation, INPUTS, OUTPUTS)


@records.of
def values_of_every_operation():
    program = every()
    elements = [*X, *Y, *W.ravel()]
    values = evaluated(program, elements, functions_of(np, np.where))
    spent = {k: sorted(v) for k, v in last_uses(program).items()}
    again = evaluated(program, elements, functions_of(np, np.where), last_uses(program))
    return [
        values,
        values == again,
        repr(program),
        program.counts(),
        program.flops,
        program.multiplications,
        program.digest,
        str(spent),
    ]


@records.of
def folded_expressions():
    owner = Trace()
    x, y = owner.input(0), owner.input(1)
    zero, two = owner.zero, owner.constant(2.0)
    forms = {
        "add": [x + 0.0, 0.0 + x, two + 3.0, x + (-y), (-x) + y, y + x is x + y, 2.0 + x is x + 2.0],
        "sub": [x - x, x - 0.0, two - 3.5, 0.0 - x, x - (-y), (-x) - y, 1.0 - (-x)],
        "neg": [-two, owner.neg(-x), -(x - y), -x],
        "mul": [x * 0.0, x * 1.0, x * -1.0, 3.0 * (2.0 * x), (-x) * y, x * (-y), y * x is x * y, two * 4.0, -2.0 * (-x), x * two],
        "div": [x / 4.0, zero / x, (-x) / y, x / (-y), 2.0 / x, x / zero, two / 8.0],
        "functions": [
            two.sqrt(), two.exp(), two.sin(), two.cos(), (-x).sin(), (-x).cos(), (-x).sign(), two.sign(), (-two).sign(), zero.sign(), x.turned(0.0), x.turned(0.5).sin(), x.turned(-0.25).cos(), 2.0**x,
        ],
        "limits": [
            owner.min(two, owner.constant(3.0)), owner.max(two, owner.constant(3.0)), owner.min(x, x), owner.max(y, y),
            owner.min(owner.constant(np.inf), x), owner.max(owner.constant(-np.inf), x), owner.min(x, two), owner.max(two, x),
        ],
    }  # fmt: skip
    answers = {name: [written(e) for e in expressions] for name, expressions in forms.items()}
    answers["refused"] = [
        refusal(lambda: x == y), refusal(lambda: bool(x)), refusal(lambda: x**65), refusal(lambda: x ** -64.5), refusal(lambda: x**"a"),
        refusal(lambda: x + Trace().input(0)), refusal(lambda: Trace().lift(x)),
    ]  # fmt: skip
    answers["powers"] = [written(x**n) for n in (0, 1, 2, 3, 6, 0.5, 2.5, -2)]
    arrays = np.array([1.0, -2.0])
    answers["arrays"] = [
        [written(e) for e in x_op]
        for x_op in (x + arrays, arrays - x, x - arrays, x * arrays, arrays / x, x / arrays, x**arrays)
    ]
    answers["refused traces"] = [
        refusal(lambda: trace(lambda x: (x, x), [("x", ())], ["one"])), refusal(lambda: trace(lambda x: x, [("x", ())], ["one", "two"])),
    ]  # fmt: skip
    answers["turned from zero"] = written(owner.zero.turned(x).sin())
    return answers


def written(expression):
    """Expression as text, with its operands; a long one by its operation alone."""
    if isinstance(expression, bool | np.bool_):
        return bool(expression)
    if expression.op in ("const", "input"):
        return f"{expression.value:.12g}" if expression.op == "const" else f"x{int(expression.value)}"
    text = f"{expression.op}({', '.join(written(e) for e in (expression.a, expression.b) if e is not None)})"
    return text if len(text) < 200 else f"{expression.op}(…)"


@records.of
def derivatives_of_every_operation():
    def derived(how):
        def function(x, y, W):
            results = [e for part in every_operation(x, y, W) for e in part.ravel() if hasattr(e, "trace")]
            known = {e: {k: e.trace.one} for k, e in enumerate([*x, *y])}
            known[y[1]] = {4: y[1].trace.constant(1.0), 5: x[0] * 2.0}  # moves along two directions
            if how == "along":
                return (np.array(autodiff.along(results, known, [0.3, -0.2, 0.5, 0.7, -1.1, 0.4])),)
            if how == "gradient":
                return (autodiff.gradient(results, [0.1 * k - 1.0 for k in range(len(results))], known, 6),)
            if how == "work":
                return (
                    np.array(
                        [
                            *autodiff.work(results, known),
                            *autodiff.work(results[:1], known),
                            *autodiff.work(results[:9], known),
                        ],
                        float,
                    ),
                )
            return (autodiff.jacobian(results, known, 6, how),)

        program = trace(function, INPUTS, ["J"])
        return on_numpy(program, "J", "")(X, Y, W)

    J = derived("forward")
    return {
        "by rows": J, "rows": J.sum(axis=1), "reverse": np.abs(derived("reverse") - J).max() < 1e-12, "auto": np.abs(derived("auto") - J).max() < 1e-12,
        "along": derived("along"), "gradient": derived("gradient"), "work": derived("work"),
    }  # fmt: skip


@records.of
@np.errstate(over="ignore")  # the largest double is no float32
def kernels_on_numpy():
    kernel = on_numpy(every(), "every", "Every operation.")
    rng = np.random.default_rng(3)
    many = rng.uniform(0.1, 2.0, (2, 1, 3)), rng.uniform(0.1, 2.0, (5, 2)), W
    answers = {
        "many": kernel(*many),
        "repr": repr(kernel),
        "types": [str(r.dtype) for r in kernel(*(np.asarray(a, "f4") for a in many))],
    }
    single = on_numpy(trace(lambda x, y: x * y + 1.0, [("x", ()), ("y", (2,))], ["z"]), "product", "")
    out = np.zeros((3, 2), "f4")
    single(np.float32([1, 2, 3]), np.float32([0.5, -0.25]), out=out)
    answers["one"] = [single(2.0, [1.0, 3.0]), out, single(np.array([1, 2], np.int8), [0.5, 1.0])]
    answers["refused"] = [
        refusal(lambda: single(1.0)), refusal(lambda: single(1j, [1, 2])), refusal(lambda: single(1.0, [1, 2, 3])), refusal(lambda: single(1.0, 2.0)),
        refusal(lambda: single(1.0, [1, 2], out=(out, out))), refusal(lambda: single([1, 2], [[1, 2]] * 3)).partition(":")[0],
        refusal(lambda: single(1.0, [1, 2], out=np.zeros(2, int))).partition(":")[0],
    ]  # fmt: skip
    long = rng.uniform(0.2, 1.0, (4099, 1))
    answers["more than one chunk"] = single(long[:, 0], np.array([0.5, 2.0])).sum(axis=0)
    return answers


# ── loops ──


def scan():
    def stage(q, v, s, q0, row, u, w):
        keep, weight = row
        force = u[0] - 0.7 * q - 0.2 * np.array([v[1], v[0]]) * w
        total = keep * s + weight * force
        return q0 + 0.1 * v + 0.05 * q, v + 0.1 * total, total, np.array([force[0] * w, u[1], q[1]])

    inputs = [("q", (2,)), ("v", (2,)), ("s", (2,)), ("q0", (2,)), ("row", (2,)), ("u", (2,)), ("w", ())]
    sources = (
        Source("state", 0),
        Source("state", 1),
        Source("state", 2),
        Source("start", 0),
        Source("stage"),
        Source("given"),
        Source("given"),
    )
    return Scan(
        trace(stage, inputs, ["q", "v", "s", "report"]), sources, visible=2, hidden=1, table=((0.0, 0.3), (1.0, 0.7))
    )


def plain_scan():
    def step(x, y, u):
        return np.array([x[0] + 0.1 * x[1], x[1] - 0.2 * np.sin(x[0]) + u[2] * y, x[2] * 0.9]), y + 0.01 * u[0]

    program = trace(step, [("x", (3,)), ("y", ()), ("u", (3,))], ["x", "y"])
    return Scan(program, (Source("state", 0), Source("state", 1), Source("given")), visible=2)


def search():
    """Roots of x² = target by Newton's method, each with the sign of its start."""

    def step(x, x0, memory, target):
        goal, tolerance = target[:2], target[2]
        x1 = 0.5 * (x + goal / x)
        error = abs(x1[0] * x1[0] - goal[0]) + abs(x1[1] * x1[1] - goal[1])
        found = 0.5 + 0.5 * (tolerance - error).sign()
        invalid = 0.5 - 0.5 * goal[0].sign()
        status = found * (1.0 - invalid) - invalid
        idle = memory[4] + 1.0
        return x1, np.array([x1[0], x1[1], status, error, idle, 1.0 - found * found])

    inputs = [("x", (2,)), ("x0", (2,)), ("memory", (6,)), ("target", (3,))]
    program = trace(step, inputs, ["x", "memory"])
    return Search(
        program,
        TensorSpec("target", (2,)),
        near=(1,),
        begins=(0.0, np.inf, 0.0, 1.0),
        least=(0.1, -3.0),
        most=(9.0, 4.0),
    )


def products():
    def factors(x):
        a, b, c = x
        rows = np.array([[a, b], [c, 1.0], [a * b, 2.0]])
        columns = np.array([[b, c, 0.5], [1.0, a, np.sin(c)]])
        return rows, columns, rows * 0.5 + 1.0, columns - a, -rows

    program = trace(factors, [("x", (3,))], ["r", "c", "r2", "c2", "r3"])
    matrices = (Product("M", (0, 1), (2, 3), ((0, 0, 0.25), (2, 1, -1.5))), Product("N", (4, 1), (0, 3)))
    return Products(program, matrices, ((2, 1, 0), (2, 2, 1), (0, 2, 2)))


def columns():
    def matrices(x):
        a, b, c = x
        A = np.array([[a, 0.0, b], [0.0, c, a * c], [b, 1.0, 0.0]])
        B = np.array([[0.0, c, a], [b, 0.0, 2.5], [a, b, 0.0]])
        return (
            A,
            B,
            np.array([[a * a + 1.0, b, c], [b, c * c + 2.0, a], [1.0, 0.5, b * b + 3.0]]),
            np.array([np.cos(a), b, c]),
        )

    program = trace(matrices, [("x", (3,))], ["A", "B", "L", "D"])

    def solve(rows):
        def solution(L, D, column):
            x = [column[k] if k in rows else 0.0 for k in range(3)]
            x[0] = (x[0] - L[0, 1] * x[1]) / L[0, 0] if 0 in rows else x[0]
            return np.array([x[0], x[1] * D[1] + x[0] * L[1, 0], x[2] - D[2] * x[0]])

        return trace(solution, [("L", (3, 3)), ("D", (3,)), ("column", (3,))], ["solution"])

    groups = (
        ColumnGroup(solve((0, 2)), ((0, 0), (1, 2))),
        ColumnGroup(solve((1, 2)), ((0, 1),)),
        ColumnGroup(solve((0, 1, 2)), ((0, 2), (1, 0), (1, 1))),
    )
    return ColumnSolve(program, 2, groups)


FORMS = {
    "program": every,
    "scan": scan,
    "plain scan": plain_scan,
    "search": search,
    "products": products,
    "columns": columns,
}


@records.of
def forms_and_their_parts():
    answers = {}
    for name, build in FORMS.items():
        form = build()
        answers[name] = [form.signature, str(form.inputs), str(form.outputs), batch_threads.cost_model(form)]
    s, c, search_form = scan(), columns(), search()
    answers["scan parts"] = [str(s.states), s.given, s.reported]
    answers["column parts"] = [
        c.first_entries,
        c.entry(1, 2, 1),
        [c.stored_rows(g) for g in c.groups],
        str([c.stored_entries(g) for g in c.groups]),
        c.zeros,
        c.program.zeros,
    ]
    answers["search parts"] = [str(search_form.x), str(search_form.status), str(search_form.settings)]
    answers["axes"] = [axes_of("(7),(k,7)->(m,7)"), axes_of("(),(3,4),(4)->(3),()")]
    return answers


@records.of
def loops_on_numpy():
    answers = {}
    s = on_numpy(scan(), "s", "")
    u, w = np.linspace(-1.0, 2.0, 24).reshape(2, 6, 2), np.linspace(0.5, 1.5, 6)
    out = np.zeros((2, 3, 2)), np.zeros((2, 3, 2)), np.zeros((2, 3, 3))
    answers["scan"] = [repr(s), *s(np.array([0.3, -0.2]), np.array([[1.0, 0.5], [0.2, -0.7]]), u, w, out=out)]
    f = on_numpy(search(), "f", "")
    targets = np.array([[4.0, 9.0], [2.0, 3.0], [-1.0, 2.0], [0.3, 400.0]])
    places = np.stack([np.linspace(0.2, 8.0, 64), np.linspace(-2.9, 3.7, 64)], axis=1)
    reached = (places[:, 1] ** 2)[None]
    for steps, attempts in ((3, 0), (4, 2), (9, 1)):
        settings = np.array([steps, attempts, 1e-9, 1.5])
        answers[f"search, {steps} steps and {attempts} attempts"] = list(
            f(targets, np.array([20.0, -5.0]), settings, places, reached)
        )
    out = np.zeros((4, 2)), np.zeros((4, 3))
    f(targets, np.array([20.0, -5.0]), np.array([9, 1, 1e-9, 1.5]), places, reached, out=out)
    answers["search, out"] = [*out, repr(f)]
    x = np.array([[0.7, -1.3, 2.6], [0.2, 0.5, -0.9]])
    for name, build in (("products", products), ("columns", columns)):
        kernel = on_numpy(build(), name, "")
        results = [np.zeros((2, 3, 3)), np.zeros((2, 3, 3))]
        kernel(x, out=tuple(results))
        answers[name] = [
            repr(kernel),
            *kernel(x),
            all(np.array_equal(a, b) for a, b in zip(results, kernel(x), strict=True)),
        ]
    return answers


# ── texts ──


def text_of(text):
    """Digest, length and counts of the words that follow an equal sign, of a module of LLVM assembly."""
    operations = Counter(match.group(1) for match in re.finditer(r"^ +(?:%\S+ = )?(\w+)", text, re.MULTILINE))
    return [
        hashlib.sha256(text.encode()).hexdigest()[:16],
        len(text.splitlines()),
        str(dict(sorted(operations.items()))),
    ]


MACHINES = {
    "two lanes": Machine("x86_64-unknown-linux-gnu", "x86-64", "", 128, fused=False),
    "four lanes": Machine("x86_64-unknown-linux-gnu", "haswell", "+fma", 256),
    "eight lanes": Machine("x86_64-unknown-linux-gnu", "skylake-avx512", "+avx512f", 512),
    "one lane": Machine("x86_64-unknown-linux-gnu", "haswell", "+fma", 256).narrowed(64),
}


@records.of
def texts_for_llvm():
    answers = {}
    for name, build in FORMS.items():
        form = build()
        for machine_name, machine in MACHINES.items():
            for precision in (DOUBLE, SINGLE):
                if precision is SINGLE and machine_name != "four lanes":
                    continue
                texts = list(lower.modules(form, precision, machine))
                answers[f"{name}, {machine_name}, {precision.llvm}"] = [text_of(text) for text in texts]
    return answers


@records.of
def texts_of_long_programs():
    answers = {}
    limits = {(lower, "MAX_INSTRUCTIONS"): 60, (partition, "PARTITION"): 40, (partition, "PARTITIONS_PER_MODULE"): 3, (lower, "MAX_UNCUT_INSTRUCTIONS"): 50,
              (lower, "INSTRUCTIONS_PER_BLOCK"): 30, (lower, "CUT_OUTPUTS"): 7, (lower, "MAX_UNCUT_OUTPUTS"): 20, (partition, "CUT_OUTPUTS"): 9}  # fmt: skip
    with pytest.MonkeyPatch.context() as patch:
        for (module, name), value in limits.items():
            patch.setattr(module, name, value)
        for name in ("program", "search", "scan", "columns", "products"):
            for machine_name in ("two lanes", "one lane", "eight lanes"):
                texts = list(lower.modules(FORMS[name](), DOUBLE, MACHINES[machine_name]))
                answers[f"{name}, {machine_name}"] = [text_of(text) for text in texts]
        patch.setattr(lower, "MAX_INSTRUCTIONS", 10_000)
        patch.setattr(lower, "MAX_UNCUT_OUTPUTS", len(every().results))
        answers["just not wide"] = [text_of(text) for text in lower.modules(every(), DOUBLE, MACHINES["four lanes"])]
        patch.setattr(lower, "MAX_UNCUT_OUTPUTS", 20)
        answers["cut in blocks"] = [text_of(text) for text in lower.modules(every(), DOUBLE, MACHINES["four lanes"])]
        from twistwrench.compiler.lowering.spill_frame import SpillFrame

        frame = SpillFrame(every(), 40)
        answers["frame"] = [frame.starts, frame.size, str(frame.slots), str(frame.entries), str(frame.constants)]
    return answers


@records.of
def texts_of_calls():
    inputs = (TensorSpec("q", (3,)), TensorSpec("dq", (2, 4)), TensorSpec("h", ()))
    outputs = (TensorSpec("M", (3, 3)), TensorSpec("tau", (97,)), TensorSpec("e", ()))
    answers = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(dispatch_ir, "TUPLE_ITEMS", 24)  # differs between versions of Python
        for precision in (DOUBLE, SINGLE):
            layout = dispatch_ir.CallLayout(
                inputs, outputs, precision, parameters=6, positional=4, options=((3, True), (4, False)), out=5, batch=0
            )
            answers[f"call, {precision.llvm}"] = text_of(dispatch_ir.call_assembly(layout))
            one = replace(
                layout, inputs=inputs[:2], outputs=outputs[:1], parameters=3, positional=2, options=(), out=-1
            )
            answers[f"call of one, {precision.llvm}"] = text_of(dispatch_ir.call_assembly(one))
            batched = replace(
                layout,
                inputs=(TensorSpec("q", (1, 3)),),
                outputs=(TensorSpec("tau", (1, 700)),),
                parameters=2,
                positional=2,
                options=(),
                out=1,
                batch=1,
            )
            answers[f"batch, {precision.llvm}"] = text_of(dispatch_ir.call_assembly(batched))
            answers[f"handler, {precision.llvm}"] = text_of(
                xla_handler.handler_assembly(inputs, outputs, precision, (0, 3))
            )
    empty = (TensorSpec("q", (0,)), TensorSpec("a", (2, 5)))
    answers["handler of an empty array"] = text_of(
        xla_handler.handler_assembly(empty, (TensorSpec("b", (4,)),), DOUBLE, (1, 2))
    )
    answers["steps"] = [
        dispatch_ir.loop_steps((*inputs, *outputs), DOUBLE),
        dispatch_ir.loop_steps((TensorSpec("q", (1, 3, 2)),), SINGLE, 1),
    ]
    return answers


@records.of
def texts_in_c_and_cuda():
    program = every()
    small = trace(
        lambda x, y, u: (np.array([np.sin(x[0]) * y + np.cos(x[0]), x[1] - x[0] * y, y.sign(), 0.25]), np.exp(y)),
        [("x", (2,)), ("wrench at tool-tip", ()), ("u", (3,))],
        ["x", "y 2"],
    )
    angles = trace(
        lambda x: np.array([np.cos(x[1]) + np.sin(x[0]), np.sin(x[1]), np.cos(x[0]), x[0], x[0]]),
        [("x__1", (2,))],
        ["x_1_0"],
    )
    answers = {}
    for name, p in (("small", small), ("angles", angles)):
        answers[name] = [
            CFunction(name, p).definition.splitlines(),
            CFunction(name, p, "float").prototype,
            CFunction(name, p).fuses,
            CFunction(name, p).parameters,
        ]
        answers[f"{name} in CUDA"] = CudaFunction(f"{name}_row", p, "float").source.splitlines()[-40:]
    answers["every"] = [
        hashlib.sha256(CFunction("every", p, t).definition.encode()).hexdigest()[:16]
        for p, t in ((program, "double"), (scan().program, "float"))
    ]
    answers["every, lines"] = CFunction("every", program).definition.splitlines()[:60]
    answers["CUDA"] = [
        hashlib.sha256(CudaFunction("every", p, t).source.encode()).hexdigest()[:16]
        for p, t in ((program, "double"), (plain_scan().program, "float"))
    ]
    answers["a logarithm in float"] = hashlib.sha256(
        CFunction("every", program, "float").definition.encode()
    ).hexdigest()[:16]
    long = trace(lambda *a: a[0], [(f"a_rather_long_name_{k}", (2,)) for k in range(5)], ["result"])
    answers["long"] = CFunction("with_a_long_name", long).prototype.splitlines()
    answers["fits"] = [
        len(CFunction("f" * n, trace(lambda x: x, [("x", (2,))], ["y"])).prototype.splitlines())
        for n in (74, 75, 76, 77, 78, 79, 80, 81)
    ]
    answers["options"] = [
        CudaFunction("f", p).options
        for p in (small, replace(small, instructions=small.instructions + (Instruction("const", (), 1.0),) * 10_001))
    ]
    answers["names"] = [
        identifier("panda hand/tcp__2"),
        identifier("__a-"),
        literal(0.1, "float"),
        literal(1e300, "double"),
        literal(3.0, "float"),
        FUSED_MACROS.splitlines(),
    ]
    answers["refused"] = [
        refusal(lambda: literal(1e39, "float")),
        refusal(lambda: literal(np.inf, "double")),
        refusal(lambda: literal(np.nan, "float")),
    ]
    return answers


# ── machines and calls ──


@records.of
def machines_by_features():
    answers = {}
    triple = "x86_64-unknown-linux-gnu"
    levels = target_machine.X86_LEVELS
    everything = [name for names in levels.values() for name in names]
    with pytest.MonkeyPatch.context() as patch:
        for name, (facts_triple, present) in {
            "all": (triple, everything), "no avx512dq": (triple, [f for f in everything if f != "avx512dq"]), "avx without fma": (triple, ["sse2", "avx"]),
            "fma4": (triple, ["avx", "fma4"]), "old": (triple, ["sse2"]), "v2": (triple, [*levels["x86-64"], *levels["x86-64-v2"]]),
            "arm": ("aarch64-unknown-linux-gnu", ["neon"]), "apple": ("arm64-apple-darwin", []), "riscv": ("riscv64-linux", []),
        }.items():  # fmt: skip
            facts = CompilerFacts("15.0.7", facts_triple, "cpu", ",".join([*(f"+{f}" for f in present), "-sse4a"]))
            patch.setattr(target_machine, "compiler", lambda facts=facts: facts)
            patch.setattr(
                target_machine,
                "host",
                lambda facts=facts: target_machine._machine(facts.triple, facts.cpu, facts.features, facts.present),
            )
            answers[name] = {
                n: [m.cpu, m.vector_bits, m.fused, m.lanes(DOUBLE), m.lanes(SINGLE), m.features[-30:]]
                for n, m in target_machine.choices().items()
            }
            for chosen in ("", " HOST ", "x86-64-v4", "x86-64-v2", "armv8-a", "z80"):
                patch.setenv(target_machine.VARIABLE, chosen)
                try:
                    answers[f"{name}, {chosen}"] = target_machine.chosen().cpu
                except ValueError as error:
                    answers[f"{name}, {chosen}"] = str(error)
    answers["facts"] = [
        str(target_machine._facts_from_entry(e)) for e in (b"1\nx\ny\n+a", b"1\nx\ny", b"1\n2\n3\n4\n5", b"\xff")
    ]
    answers["precisions"] = [
        [p.bits, p.rounded(0.1), str(p.rounded(1e40)), str(p.rounded(-1e40)), p.pattern(-2.5), p.pattern(1.0)]
        for p in (DOUBLE, SINGLE)
    ]
    return answers


@records.of
def switches_and_threads():
    answers = {}
    with pytest.MonkeyPatch.context() as patch:
        for text in ("", "0", "1", " ON ", "off", "2", "yes"):
            patch.setenv("TWISTWRENCH_JIT", text)
            try:
                answers[f"switch {text!r}"] = interpreter.switched_on("TWISTWRENCH_JIT", "a", "b")
            except ValueError as error:
                answers[f"switch {text!r}"] = str(error)
        for text in ("", "3", " 4 ", "0", "1024", "1025", "-1", "1.5", "two", "123456789"):
            patch.setenv(batch_threads.VARIABLE, text)
            try:
                answers[f"threads {text!r}"] = batch_threads._count_from_environment()
            except ValueError as error:
                answers[f"threads {text!r}"] = str(error)
        for count in (0, 1025, 2.5, "3", True):
            answers[f"set {count!r}"] = refusal(lambda count=count: batch_threads.set_threads(count))
        answers["axes"] = [
            batch_threads._divided_axis(b, n)
            for b, n in (((2, 900), 4), ((900, 2), 4), ((3, 4, 3), 4), ((15, 16), 4), ((16, 3), 4), ((17, 400), 4))
        ]
        ports = TensorSpec("a", (3,)), TensorSpec("b", ())
        cases = [
            (np.zeros((4, 3)), np.zeros(4)), (np.zeros((4, 1, 3)), np.zeros(5)), (np.zeros((4, 3)), np.zeros(5)), (np.zeros(3), np.zeros(())), (np.zeros((4, 2)), np.zeros(4)),
            (np.zeros((4, 3), complex), np.zeros(4)), (np.zeros((4, 3), "f4"), np.zeros(4, "i2")), (np.zeros(()), np.zeros(4)), (np.ma.zeros((4, 3)), np.zeros(4)),
        ]  # fmt: skip
        answers["batches"] = [batch_threads._batch(case, ports) for case in cases]
        answers["single"] = [
            batch_threads._is_single(case)
            for case in (cases[0], cases[6], (np.zeros(2, "i4"),), (np.zeros(2, "f2"), np.zeros(2, "?")))
        ]
        answers["index"] = [
            str(batch_threads._index_before_axis(np.zeros(shape), ports[0], axis))
            for shape, axis in (((4, 5, 3), -1), ((4, 5, 3), -2), ((4, 1, 3), -1), ((5, 3), -2), ((5, 3), -1))
        ]
        a, whole = np.zeros((4, 3)), np.zeros((8, 3))
        outs = [
            (whole[:4],), (whole[::2],), whole[:4], (whole[:4], whole[4:]), (a,), ([],), (np.zeros((4, 3), "f4"),), (np.zeros((3, 4)),), (np.asfortranarray(np.zeros((4, 3))),),
        ]  # fmt: skip
        answers["outputs"] = [batch_threads._outputs(out, [(4, 3)], np.dtype(float), (a,)) is not None for out in outs]
        answers["overlapping outputs"] = (
            batch_threads._outputs((whole[:4], whole[2:6]), [(4, 3)] * 2, np.dtype(float), (a,)) is None
        )
        answers["types"] = [
            "".join(sorted(batch_threads.TO_SINGLE)),
            len(batch_threads.TO_DOUBLE - {"q", "Q", "l", "L"}),
        ]
    return {
        name: re.sub(r"has \d+ processors?", "has some processors", x) if isinstance(x, str) else x
        for name, x in answers.items()
    }


class FakeOwner:
    """Owner of a kernel of which only the shapes and the cost are known."""

    def __init__(self, cost):
        self.given = trace(lambda x, y: (x * y, x[0]), [("x", (3,)), ("y", ())], ["z", "w"])
        self.cost = cost

    def address(self, _precision):
        return 0


@records.of
def parts_of_calls():
    answers = {}
    with pytest.MonkeyPatch.context() as patch:
        for cost in (3, 20_000, 300_000):
            patch.setattr(batch_threads, "_owner_of", lambda cost=cost: lambda _kernel: FakeOwner(cost))
            for name, given in {
                "plain": (np.zeros((700, 3)), np.zeros(700)), "broadcast": (np.zeros((300, 1, 3)), np.zeros(5)), "inner": (np.zeros((2, 900, 3)), np.zeros((2, 1))),
                "single": (np.zeros((700, 3), "f4"), np.zeros(700, "f4")), "few": (np.zeros((2, 3)), 1.0), "list": ([[1.0, 2.0, 3.0]] * 90, np.zeros(90)),
            }.items():  # fmt: skip
                divided = batch_threads.cut(None, given, None, 3)
                shapes = (
                    None
                    if divided is None
                    else [
                        [[a.shape for a in (*p.inputs, *p.outputs)] for p in divided[0]],
                        [(r.shape, str(r.dtype)) for r in divided[1]],
                    ]
                )
                answers[f"{name}, {cost}"] = str(
                    shapes if shapes is None else [len(shapes[0]), shapes[0][0], shapes[0][-1], shapes[1]]
                )
    return answers


class FakeBlock:
    def __init__(self, size):
        self.size, self.offset, self.address = size, 0, 0
        self.memory = self

    def madvise(self, *_):
        return None


@records.of
def blocks_of_a_pool():
    answers = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(result_pool, "_Block", FakeBlock)
        patch.setattr(result_pool, "_Lease", lambda _pool, block: block)
        patch.setattr(result_pool, "bound", lambda: 24 * result_pool.PAGE)
        pages = result_pool.PAGE
        answers["sizes"] = [
            result_pool.ResultPool().acquire(int(n * pages)).size / pages
            for n in (0.2, 1.0, 1.1, 4.5, 7.5, 8.5, 9.1, 12.5, 16.5, 17.0, 22.0)
        ]
        pool = result_pool.ResultPool()
        first, second = pool.acquire(7 * pages), pool.acquire(10 * pages)
        state = lambda: [len(pool.blocks), len(pool.idle), sum(b.size for b in pool.blocks) // pages]  # noqa: E731
        steps = [state(), pool.acquire(8 * pages) is None, state()]
        pool.release(first)
        steps += [state(), pool.acquire(int(6.5 * pages)) is first, state()]
        pool.release(first)
        pool.release(second)
        third = pool.acquire(12 * pages)
        steps += [state(), first in pool.blocks, second in pool.blocks, third.size // pages]
        pool.clear()
        steps.append(state())
        answers["steps"] = steps
    for shapes in ([(17,), (200_000,), (3, 5)], [(2, 3), (4,)]):
        arrays = result_pool.result_arrays(shapes, np.dtype(float))
        starts = [a.__array_interface__["data"][0] for a in arrays]
        answers[str(shapes)] = [
            [a.shape for a in arrays],
            [s - starts[0] for s in starts],
            starts[0] % 64 == 0 or len(shapes) == 2,
        ]
    answers["limits"] = [result_pool.bound() > 0, result_pool.MAX_POOL, result_pool.MIN_SEPARATE]
    return answers


SECTIONS = np.dtype([(n, "<u4") for n in ("name", "type")] + [(n, "<u8") for n in ("flags", "address", "offset", "size")]
                    + [(n, "<u4") for n in ("link", "info")] + [("align", "<u8"), ("entry", "<u8")])  # fmt: skip


def elf_file(change=lambda rows: None, *, machine=62, magic=b"\x7fELF\x02\x01", relocation_type=4, cut=0):
    """Object file with two functions and a constant; ``change`` may alter the table of its sections."""
    code, constants = bytes(range(40)), bytes(range(100, 124))
    names = b"\0start\0cosh\0second\0"
    fields = [("name", "<u4"), ("kind", "u1"), ("other", "u1"), ("section", "<u2"), ("value", "<u8"), ("size", "<u8")]
    symbols = np.zeros(5, np.dtype(fields))
    symbols["name"], symbols["kind"] = (0, 1, 7, 12, 12), (0, 0x12, 0x10, 0x12, 0x03)
    symbols["section"], symbols["value"] = (0, 1, 0, 1, 2), (0, 4, 0, 20, 8)
    fields = [("place", "<u8"), ("type", "<u4"), ("symbol", "<u4"), ("addend", "<i8")]
    relocations = np.zeros(3, np.dtype(fields))
    relocations["place"], relocations["type"] = (6, 13, 36), (2, relocation_type, 2)
    relocations["symbol"], relocations["addend"] = (2, 4, 3), (-4, 3, -7)
    parts = [b"", code, constants, symbols.tobytes(), names, relocations.tobytes(), b"notes"]
    rows = np.zeros(7, SECTIONS)
    rows["type"] = (0, 1, 1, 2, 3, 4, 7)
    rows["flags"], rows["align"] = (0, 6, 2, 0, 0, 0, 0), (0, 16, 32, 8, 0, 8, 4)
    rows["link"], rows["info"], rows["size"] = (0, 0, 0, 4, 0, 3, 0), (0, 0, 0, 2, 0, 1, 0), list(map(len, parts))
    rows["offset"] = 64 + np.concatenate([[0], np.cumsum(rows["size"])[:-1]])
    change(rows)
    contents = b"".join(parts)
    header = bytearray(64)
    header[:6] = magic
    header[16:20] = (1).to_bytes(2, "little") + machine.to_bytes(2, "little")
    header[40:48] = (64 + len(contents)).to_bytes(8, "little")
    header[60:62] = len(rows).to_bytes(2, "little")
    raw = bytes(header) + contents + rows.tobytes()
    return raw[: len(raw) - cut]


@records.of
def object_files_and_their_image():
    file = elf_loader.read_elf(elf_file())
    answers = {
        "file": [
            str(file.sections),
            str(file.names),
            file.symbol_sections,
            file.offsets,
            [x.decode() for x in sorted(file.undefined())],
        ],
        "relocations": [[r.section, r.places, r.symbols, r.addends] for r in file.relocations],
    }
    other = file._replace(names=[b"", b"third", b"second", b"fourth", b""], symbol_sections=[0, 1, 0, 2, 2])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(elf_loader, "_library_function", lambda name: 0x0102030405060700 + len(name))
        for name, files in {"one": [file], "two": [file, other], "two, reversed": [other, file]}.items():
            image, offsets = elf_loader.link_files(files)
            answers[f"image of {name}"] = [image.tobytes().hex(), str(offsets)]
        for name, places in {"before": [-1], "after": [37], "at the end": [36]}.items():
            moved = file._replace(
                relocations=[elf_loader.Relocations(1, np.array(places), np.array([3]), np.array([-4]))]
            )
            try:
                answers[f"relocation {name}"] = elf_loader.link_files([moved])[0].tobytes().hex()
            except RuntimeError as error:
                answers[f"relocation {name}"] = str(error)
        unknown = file._replace(names=[b"", b"start", b"", b"second", b""])
        answers["unknown symbol"] = refusal(lambda: elf_loader.link_files([unknown]))
    answers["rounded"] = [elf_loader._round_up(*x) for x in ((0, 16), (1, 16), (16, 16), (17, 16))]

    def altered(field, row, value):
        return lambda rows: rows[field].__setitem__(row, value)

    for name, raw in {
        "machine": elf_file(machine=3), "magic": elf_file(magic=b"\x7fELF\x01\x01"), "relocation": elf_file(relocation_type=1), "cut": elf_file(cut=1),
        "written": elf_file(altered("flags", 1, 7)), "zeros": elf_file(altered("type", 2, 8)), "truncated": elf_file(altered("size", 2, 5000)),
        "align": elf_file(altered("align", 2, 8192)), "two tables of symbols": elf_file(altered("type", 6, 2)), "no table of symbols": elf_file(altered("type", 3, 3)),
    }.items():  # fmt: skip
        answers[name] = refusal(lambda raw=raw: elf_loader.read_elf(raw))
    for name, change in {
        "unwinding": altered("type", 2, 0x70000001), "align of a page": altered("align", 2, 4096), "no align": altered("align", 1, 0),
        "relocations of notes": altered("info", 5, 6), "not loaded": altered("flags", 2, 0),
    }.items():  # fmt: skip
        found = elf_loader.read_elf(elf_file(change))
        answers[name] = [{k: section.align for k, section in found.sections.items()}, len(found.relocations)]
    return answers


@records.of
def layouts_of_calls():
    program = trace(lambda q, h: (q * h, q + h), [("q", (3,)), ("h", ())], ["a", "b"])
    number = trace(lambda q: q @ q, [("q", (3,))], ["e"])
    two = trace(lambda q: (q @ q, q), [("q", (3,))], ["e", "f"])
    empty = trace(lambda q: q, [("q", (0,))], ["e"])

    def method(q, h, frame="tool", *, local=None, out=None): ...

    def short(q, needed, out=None): ...

    answers = {}
    for name, (form, function, given) in {
        "plain": (program, method, {}), "single": (program, method, {"char": "f"}), "a sample": (program, method, {"batch": (1, 1)}),
        "two samples": (program, method, {"batch": (2,)}), "option": (program, method, {"options": (("frame", "tool"), ("local", True))}),
        "another option": (program, method, {"options": (("frame", "hand"),)}), "unknown option": (program, method, {"options": (("nose", 1),)}),
        "needed": (number, short, {"options": (("needed", 3),)}), "not given": (number, short, {}), "too few": (program, lambda q: 0, {}),
        "number": (number, lambda q, out=None: 0, {}), "number in a tuple": (two, lambda q, out=None: 0, {}), "empty": (empty, lambda q, out=None: 0, {}),
        "no out": (number, lambda q: 0, {}),
    }.items():  # fmt: skip
        answers[name] = str(dispatch._layout(form, inspect.signature(function), dispatch.CallSignature(**given)))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(dispatch, "assemble", lambda text, symbol, _machine: [text, symbol])
        for arguments in ((5, 3, 2, 4), (9, 70, 0, 8)):
            text, symbol = dispatch._row_code.__wrapped__(*arguments, MACHINES["four lanes"])
            answers[f"row code {arguments}"] = [symbol, *text_of(text)]
    return answers


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
