"""What a compiled kernel is made of: the vector instructions for one block of states, by what they ask of the processor.

They are read off the assembly that LLVM writes of the very modules a kernel is compiled from, for x86-64 and for AArch64.
"""

import os
import re
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from typing import Any
from unittest.mock import patch

PARTS = ("products", "sums", "loads", "stores", "rest")
"""What takes an execution unit; the rest are shuffles, comparisons, logic, divisions. Moves between registers take none."""

AROUND = r"loop|prepare\w*|gather|scatter|wrap\b.*"
"""Functions that run once a call, or for samples that are not whole rows, or for angles out of reach."""
RARE = r"_?(wrap|in_reach|block)\b"
"""What is called for angles out of reach."""
GROUP, ALONE = "blocks", "block"
"""Where there is the first, it takes several blocks of states through each part of a program, and the second what is left."""

_VECTOR = re.compile(r"%[xyz]mm\d+|\b[vq]\d+\b")
_PRODUCTS = re.compile(r"v?(fn?m(add|sub)\d*|mul)[ps][sd]$|fml[as]$|fmul$|fn?m(add|sub)$")
_SUMS = re.compile(r"v?(add|sub)[ps][sd]$|fadd$|fsub$")
_MOVES = re.compile(r"v?mov|v?p?broadcast|ldr|ldp|ldur|ld1|str|stp|stur|st1|fmov")


def of_kernel(kernel: Any, precision: Any) -> Counter[str]:
    """The instructions for one block of states, the bytes of memory they work in, the "frame", and how many are run in one
    stretch, its "length": all of them, unless a group of blocks goes through part after part."""
    texts = texts_of(kernel, precision)
    if not texts:
        raise SystemExit(f"LLVM had no part in {kernel}: its instructions cannot be counted")
    grouped = any(re.search(rf"^_?{GROUP}:", text, re.MULTILINE) for text in texts)
    each = [_counted(lines, in_loop=False) for text in texts for lines in _functions(text, ALONE if grouped else "")]
    found = sum(each, Counter[str]())
    length = max(map(total, each)) if grouped else total(found)
    return found + Counter({"frame": max(map(frame, texts)), "length": length})


def texts_of(kernel: Any, precision: Any) -> list[str]:
    """The assembly of all modules of a kernel: it is compiled once more, as far as that, and never linked."""
    import llvmlite.binding as llvm

    from twistwrench.compiler.runtime.gufunc import owner_of
    from twistwrench.compiler.runtime.jit import compile_form
    from twistwrench.core.errors import KernelError

    owner, texts, emit = owner_of(kernel), [], llvm.TargetMachine.emit_object
    if owner is None:
        return []

    def look(machine: Any, module: Any) -> bytes:
        llvm.initialize_native_asmparser()  # for instructions that are given to LLVM as they are
        texts.append(machine.emit_assembly(module))
        return emit(
            machine, llvm.parse_assembly("")
        )  # a kernel without code is refused once all modules have been seen

    with (
        suppress(KernelError),
        patch.dict(os.environ, {"TWISTWRENCH_CACHE_DIR": "off"}),
        patch.object(llvm.TargetMachine, "emit_object", look),
    ):
        compile_form(owner.program, precision)
    return list(dict.fromkeys(texts))


def counted(text: str, *, in_loop: bool = False) -> Counter[str]:
    """How many of each part; "moves" between registers, and those that are "folded": arithmetic on an operand in memory.

    "loops" says how often a function jumps back: if it does, some instructions run more often than they are counted. `in_loop`
    takes those of the last loop alone.
    """
    return sum((_counted(lines, in_loop=in_loop) for lines in _functions(text)), Counter[str]())


def frame(text: str) -> int:
    """Bytes of a function's own memory, where most is needed: what does not fit in registers."""
    sizes = [re.fullmatch(r"subq?\t(?:sp, sp, #(\d+)|\$(\d+), %rsp)", line) for f in _functions(text) for line in f]
    return max((int(size[1] or size[2]) for size in sizes if size), default=0)


def total(parts: dict[str, int]) -> int:
    """All that take an execution unit."""
    return sum(parts.get(part, 0) for part in PARTS)


def _functions(text: str, but: str = "") -> Iterator[list[str]]:
    """The lines that are labels or instructions of each function that is about a block of states, but for one."""
    around, name, lines = re.compile(f"_?({AROUND}|{but})"), "", []
    for whole in text.splitlines():
        line = re.split(r"\s*(?:#+ |//)", whole)[0].strip()
        if re.match(r"(?!\.?L)[\w.$]+:", line):
            if not around.fullmatch(name):
                yield lines
            name, lines = line.rstrip(":"), []
        elif line and (line.endswith(":") or not line.startswith(".")):
            lines.append(line)
    if not around.fullmatch(name):
        yield lines


def _counted(lines: list[str], *, in_loop: bool) -> Counter[str]:
    blocks, rare, places, loops = [Counter[str]()], set(), {}, []
    for line in lines:
        if line.endswith(":"):
            places[line.rstrip(":")] = len(blocks)
            blocks.append(Counter())
            continue
        operation, _, operands = line.partition("\t")
        if operation in ("bl", "call", "callq"):
            rare |= {len(blocks) - 1} if re.match(RARE, operands) else set()
        elif operation.startswith(("j", "b.", "cb", "tb")) or operation == "b":
            target = operands.split(",")[-1].strip()
            if target in places and len(blocks) - 1 not in rare:
                loops.append(slice(places[target], len(blocks)))
            blocks.append(Counter())
        elif _VECTOR.search(operands):
            blocks[-1].update(_parts(operation, operands))
    kept = range(len(blocks))[loops[-1]] if in_loop and loops else range(len(blocks))
    return sum((blocks[k] for k in kept if k not in rare), Counter[str]()) + Counter({"loops": len(loops)})


def _parts(operation: str, operands: str) -> list[str]:
    in_memory = "(" in operands or "[" in operands
    if _PRODUCTS.match(operation):
        return ["products", "folded"] if in_memory else ["products"]
    if _SUMS.match(operation):
        return ["sums", "folded"] if in_memory else ["sums"]
    if not _MOVES.match(operation):
        return ["rest"]
    if not in_memory:
        return ["rest"] if "broadcast" in operation else ["moves"]
    stores = operands.endswith(")") if "%" in operands else operation.startswith("st")
    each = ["stores" if stores else "loads"]
    return each * 2 if operation in ("ldp", "stp") else each
