"""What the core can do at most: small loops, compiled as the kernels are, that do nothing but one thing.

`mixture` is vector instructions in given shares that wait for nothing; `stream` writes, or copies, a stretch of memory.
"""

from collections.abc import Callable, Mapping
from ctypes import CFUNCTYPE, c_int64, c_void_p
from functools import cache
from typing import Any

import numpy as np

from bench.instructions import PARTS
from bench.timing import Contender

LENGTH = 240  # instructions in the loop of a mixture: they stay in the decoder's cache
SPAN = 64  # vectors that it reads, and as many that it writes: they stay in the first cache
SWEEP = 24_000  # instructions, at least
CUT = 500  # instructions in a basic block, as in large kernels
UNROLLED = 4
STREAMS = ("plain", "past the cache", "copy")


def lanes() -> int:
    """Doubles side by side."""
    from twistwrench.compiler.lowering.target_machine import DOUBLE, chosen

    return chosen().lanes(DOUBLE)


def mixture(name: str, parts: Mapping[str, int]) -> Contender:
    """Vector instructions in these shares (the names are those of `instructions`); a sample is one instruction."""
    return _loop(name, parts, LENGTH, SPAN)


def as_long(name: str, parts: Mapping[str, int]) -> Contender:
    """The same, as many as a kernel runs in one stretch, in as large a frame: so they have to be fetched as a kernel's are."""
    return _loop(name, parts, max(parts["length"], LENGTH), max(parts["frame"] // (16 * lanes()), SPAN))


def _loop(name: str, parts: Mapping[str, int], length: int, span: int) -> Contender:
    text = _mixture(lanes(), _spread(parts, length), span)
    run, buffer, passes = _compiled(text), aligned(2 * span * lanes() * 8), -(-SWEEP // length)
    return Contender(name, lambda times: run(buffer.ctypes.data, None, 0, times * passes), length * passes)


def stream(name: str, kind: str, size: int) -> Contender:
    """Writing `size` bytes over and over, or copying them from elsewhere; a sample is one byte."""
    step = UNROLLED * lanes() * 8
    steps = max(size // step, 1)
    run, to = _compiled(_stream(lanes(), kind)), aligned(steps * step)
    source = aligned(steps * step) if kind == "copy" else to
    return Contender(name, lambda times: run(to.ctypes.data, source.ctypes.data, steps, times), steps * step)


def aligned(size: int) -> np.ndarray:
    """So many bytes of zeros, already touched, at an address that vectors like."""
    room = np.zeros(size + 64, np.uint8)
    room[:] = 0
    start = -room.ctypes.data % 64
    return room[start : start + size]


def _spread(parts: Mapping[str, int], length: int) -> list[str]:
    """One loop's instructions in turn, each kind evenly spread; products and sums share the operands in memory alike."""
    wanted = {part: float(parts.get(part, 0)) for part in PARTS}
    arithmetic = wanted["products"] + wanted["sums"]
    folded = min(parts.get("folded", 0) / arithmetic, 1.0) if arithmetic else 0.0
    for part in ("products", "sums"):
        wanted[f"{part} folded"] = folded * wanted[part]
        wanted[part] *= 1 - folded
    scale = sum(wanted.values())
    sequence, done = [], dict.fromkeys(wanted, 0)
    for k in range(1, length + 1):
        part = max(wanted, key=lambda p: k * wanted[p] / scale - done[p])
        done[part] += 1
        sequence.append(part)
    return sequence


def _mixture(lanes: int, sequence: list[str], span: int) -> str:
    """A loop of these instructions in LLVM assembly: arithmetic in many chains, so that none waits for the one before."""
    kinds = {part.split()[0] for part in sequence}
    many = 1 if _register() == "x" and lanes < 8 else 2  # AVX-512 and NEON have twice the registers
    chains = {
        "products": 14 if kinds <= {"products"} else 8,
        "sums": 0 if "sums" not in kinds else 4 if "rest" in kinds else 6,
        "rest": 2 if "rest" in kinds else 0,
    }
    names = [f"{part}{k}" for part, count in chains.items() for k in range(count * many)]
    now, v = {name: f"%{name}" for name in names}, f"<{lanes} x double>"
    lines: list[str] = []
    turns = dict.fromkeys([*chains, "loads", "stores"], 0)
    for k, part in enumerate(sequence):
        if k and k % CUT == 0:
            lines += [f"%never{k} = icmp eq ptr %to, null", f"br i1 %never{k}, label %out, label %body{k // CUT}"]
            lines.append(f"body{k // CUT}:")
        kind, _, folded = part.partition(" ")
        number, turns[kind] = turns[kind], turns[kind] + 1
        place = 8 * lanes * (number % span + (span if kind == "stores" else 0))
        if kind in ("loads", "stores") or folded:
            lines.append(f"%a{k} = getelementptr i8, ptr %to, i64 {place}")
        if kind == "loads":
            lines.append(f"%x{k} = load volatile {v}, ptr %a{k}, align {8 * lanes}")
            continue
        if kind == "stores":
            lines.append(f"store volatile {v} %c, ptr %a{k}, align {8 * lanes}")
            continue
        operand = "%c"
        if folded:
            operand = f"%m{k}"
            lines.append(f"{operand} = load {v}, ptr %a{k}, align {8 * lanes}")
        name = f"{kind}{number % (chains[kind] * many)}"
        lines += _arithmetic(kind, f"%y{k}", now[name], operand, lanes)
        now[name] = f"%y{k}"
    starts = [f"%{name}.0 = load volatile {v}, ptr %to, align {8 * lanes}" for name in names]
    cuts = (len(sequence) - 1) // CUT
    last = f"body{cuts}" if cuts else "body"
    phis = [f"%{name} = phi {v} [%{name}.0, %entry], [{now[name]}, %{last}]" for name in names]
    ends = [f"store volatile {v} {now[name]}, ptr %to, align {8 * lanes}" for name in names]
    return "\n".join(
        [
            f"declare {v} @llvm.fma.v{lanes}f64({v}, {v}, {v})",
            "define void @ceiling(ptr %to, ptr %from, i64 %steps, i64 %times) {",
            "entry:",
            f"%c = load volatile {v}, ptr %to, align {8 * lanes}",
            *starts,
            "br label %body",
            "body:",
            f"%n = phi i64 [0, %entry], [%next, %{last}]",
            *phis,
            *lines,
            "%next = add i64 %n, 1",
            "%more = icmp slt i64 %next, %times",
            "br i1 %more, label %body, label %end",
            "end:",
            *ends,
            "br label %out",
            "out:",
            "ret void",
            "}",
        ]
    )


def _arithmetic(kind: str, result: str, value: str, operand: str, lanes: int) -> list[str]:
    v = f"<{lanes} x double>"
    if kind == "products" and not _fused():
        return [f"{result} = fmul {v} {value}, {operand}"]
    if kind == "products":
        return [f"{result} = call {v} @llvm.fma.v{lanes}f64({v} %c, {v} {operand}, {v} {value})"]
    if kind == "sums":
        return [f"{result} = fadd {v} {value}, {operand}"]
    picks = ", ".join(f"i32 {k + 1 + (lanes - 1 if odd else 0)}" for k in range(0, lanes, 2) for odd in (0, 1))
    turned = f"{result}.0 = shufflevector {v} {value}, {v} %c, <{lanes} x i32> <{picks}>"
    # Empty machine code in between, or LLVM would make one shuffle of two.
    return [turned, f'{result} = call {v} asm "", "={_register()},0"({v} {result}.0)']


def _register() -> str:
    """The letter of vector registers in inline assembly."""
    from twistwrench.compiler.lowering.target_machine import chosen

    return "x" if chosen().triple.startswith("x86") else "w"


def _fused() -> bool:
    from twistwrench.compiler.lowering.target_machine import chosen

    return chosen().fused


def _stream(lanes: int, kind: str) -> str:
    v = f"<{lanes} x double>"
    hint = ", !nontemporal !0" if kind == "past the cache" else ""
    body = []
    for k in range(UNROLLED):
        body += [f"%t{k} = getelementptr i8, ptr %row, i64 {8 * lanes * k}"]
        value = "%c"
        if kind == "copy":
            value = f"%x{k}"
            body += [f"%f{k} = getelementptr i8, ptr %source, i64 {8 * lanes * k}"]
            body += [f"{value} = load {v}, ptr %f{k}, align {8 * lanes}"]
        body += [f"store {v} {value}, ptr %t{k}, align {8 * lanes}{hint}"]
    return "\n".join(
        [
            "define void @ceiling(ptr %to, ptr %from, i64 %steps, i64 %times) {",
            "entry:",
            f"%c = load volatile {v}, ptr %to, align {8 * lanes}",
            "br label %sweep",
            "sweep:",
            "%n = phi i64 [0, %entry], [%n.next, %swept]",
            "br label %body",
            "body:",
            "%k = phi i64 [0, %sweep], [%k.next, %body]",
            f"%place = mul i64 %k, {8 * lanes * UNROLLED}",
            "%row = getelementptr i8, ptr %to, i64 %place",
            "%source = getelementptr i8, ptr %from, i64 %place",
            *body,
            "%k.next = add i64 %k, 1",
            "%inside = icmp slt i64 %k.next, %steps",
            "br i1 %inside, label %body, label %swept",
            "swept:",
            "%n.next = add i64 %n, 1",
            "%more = icmp slt i64 %n.next, %times",
            "br i1 %more, label %sweep, label %end",
            "end:",
            "ret void",
            "}",
            "!0 = !{i32 1}",
        ]
    )


@cache
def _compiled(text: str) -> Callable[..., Any]:
    """The loop as a function; its code is kept for good."""
    import llvmlite.binding as llvm

    code = target().emit_object(llvm.parse_assembly(text))
    builder = llvm.JITLibraryBuilder().add_object_img(code).export_symbol("ceiling")
    library = builder.link(_linker(), f"ceiling{hash(text)}")
    function = CFUNCTYPE(None, c_void_p, c_void_p, c_int64, c_int64)(library["ceiling"])
    function.library = library
    return function


def assembly(text: str) -> str:
    """The same in the processor's words."""
    import llvmlite.binding as llvm

    return str(target().emit_assembly(llvm.parse_assembly(text)))


@cache
def _linker() -> Any:
    import llvmlite.binding as llvm

    return llvm.create_lljit_compiler(target())


def target() -> Any:
    """LLVM's, told what it is told for kernels."""
    import llvmlite.binding as llvm

    from twistwrench.compiler.lowering.target_machine import chosen

    machine = chosen()
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    llvm.initialize_native_asmparser()
    return llvm.Target.from_triple(machine.triple).create_target_machine(
        cpu=machine.cpu, features=machine.features, opt=2, reloc="pic", codemodel="small"
    )
