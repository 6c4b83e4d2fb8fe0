"""What the shortest way into a loop looks at: keywords, lists of numbers, results that are not finite; as LLVM assembly."""

from __future__ import annotations

from .llvm_text import LlvmWriter
from .processor import DOUBLE, Precision

FLOAT_VALUE = 16
"""Offset of the number in Python's float, and in NumPy's, which is one."""

_UNROLLED = 16
"""Vectors that are looked at one by one; more go in a loop."""


def helpers(precision: Precision, list_items: int, tuple_items: int, size: int, kind: int) -> str:
    """``sort``, and for doubles ``numbers``; the arguments are offsets in Python's objects."""
    return _sort(tuple_items, size) + (_numbers(list_items, tuple_items, size, kind) if precision is DOUBLE else "")


def _sort(tuple_items: int, size: int) -> str:
    """``sort`` puts arguments where their parameters are; false for a name it does not know and for one given twice."""
    w = LlvmWriter(DOUBLE, 1)
    with w.loop("%count", "entry") as k:
        argument = w.new(f"load ptr, ptr {_entry(w, '%args', k)}, align 8")
        w.do(f"store ptr {argument}, ptr {_entry(w, '%slots', k)}, align 8")
    some, none = w.label("named"), w.label("plain")
    named = w.new("icmp eq ptr %names, null")
    w.do(f"br i1 {named}, label %{none}, label %{some}")
    w.begin(none)
    w.do("ret i1 true")
    w.begin(some)
    several = w.new(f"load i64, ptr {w.at('%names', size)}, align 8")
    items = w.at("%names", tuple_items)
    with w.loop(several, some) as j:
        name = w.new(f"load ptr, ptr {_entry(w, items, j)}, align 8")
        place = w.new(f"call i64 @place(ptr %known, i64 %parameters, ptr {name})")
        _else_false(w, w.new(f"icmp sge i64 {place}, 0"))
        slot = _entry(w, "%slots", place)
        taken = w.new(f"load ptr, ptr {slot}, align 8")
        _else_false(w, w.new(f"icmp eq ptr {taken}, null"))
        argument = w.new(f"load ptr, ptr {_entry(w, '%args', w.new(f'add i64 %count, {j}'))}, align 8")
        w.do(f"store ptr {argument}, ptr {slot}, align 8")
    w.do("ret i1 true")
    arguments = "ptr %slots, i64 %parameters, ptr %known, ptr %args, i64 %count, ptr %names"
    return _place() + _function("i1", "sort", arguments, w, otherwise="ret i1 false")


def _place() -> str:
    """``place``: the number of a pointer in a table, or -1."""
    w = LlvmWriter(DOUBLE, 1)
    with w.loop("%length", "entry") as k:
        entry = w.new(f"load ptr, ptr {_entry(w, '%table', k)}, align 8")
        here, on = w.label("here"), w.label("on")
        w.do(f"br i1 {w.new(f'icmp eq ptr {entry}, %wanted')}, label %{here}, label %{on}")
        w.begin(here)
        w.do(f"ret i64 {k}")
        w.begin(on)
    w.do("ret i64 -1")
    return _function("i64", "place", "ptr %table, i64 %length, ptr %wanted", w)


def _numbers(list_items: int, tuple_items: int, size: int, kind: int) -> str:
    """``numbers`` copies the floats of a list or tuple; false where it is not one of so many, or has other things in it."""
    w = LlvmWriter(DOUBLE, 1)
    found = w.new(f"load ptr, ptr {w.at('%object', kind)}, align 8")
    listed, tupled = w.new(f"icmp eq ptr {found}, %list"), w.new(f"icmp eq ptr {found}, %tuple")
    _else_false(w, w.new(f"or i1 {listed}, {tupled}"))
    length = w.new(f"load i64, ptr {w.at('%object', size)}, align 8")
    last = _else_false(w, w.new(f"icmp eq i64 {length}, %length"))
    apart = w.new(f"load ptr, ptr {w.at('%object', list_items)}, align 8")  # in a tuple an item, or a number
    items = w.new(f"select i1 {listed}, ptr {apart}, ptr {w.at('%object', tuple_items)}")
    with w.loop("%length", last) as k:
        item = w.new(f"load ptr, ptr {_entry(w, items, k)}, align 8")
        its = w.new(f"load ptr, ptr {w.at(item, kind)}, align 8")
        pythons, numpys = w.new(f"icmp eq ptr {its}, %float"), w.new(f"icmp eq ptr {its}, %double")
        _else_false(w, w.new(f"or i1 {pythons}, {numpys}"))
        value = w.new(f"load double, ptr {w.at(item, FLOAT_VALUE)}, align 8")
        w.do(f"store double {value}, ptr {_entry(w, '%into', k)}, align 8")
    w.do("ret i1 true")
    arguments = "ptr %object, i64 %length, ptr %into, ptr %list, ptr %tuple, ptr %float, ptr %double"
    return _function("i1", "numbers", arguments, w, otherwise="ret i1 false")


def _entry(w: LlvmWriter, table: str, number: str) -> str:
    return w.at(table, w.new(f"mul i64 {number}, 8"))


def _else_false(w: LlvmWriter, condition: str) -> str:
    """Go on where it holds, else return false; the label control is in."""
    further = w.label("ok")
    w.do(f"br i1 {condition}, label %{further}, label %no")
    w.begin(further)
    return further


def _function(kind: str, name: str, arguments: str, w: LlvmWriter, otherwise: str = "") -> str:
    lines = [*w.lines, *(["no:", f"  {otherwise}"] if otherwise else [])]
    body = "\n".join(lines)
    return f"define internal {kind} @{name}({arguments}) noinline {{\nentry:\n{body}\n}}\n"


def spoiled(w: LlvmWriter, data: str, size: int, label: str) -> tuple[str, str]:
    """Whether numbers in a row are not all finite, an i1; takes and returns the label control is in.

    A number times zero is zero, but for infinities and what is not a number: so is the sum of many.
    """
    width = 512 // w.precision.bits
    while width > size:
        width //= 2
    kind = f"<{width} x {w.element}>"
    zero = f"splat ({w.element} {w.number(0.0)})"

    def times_zero(offset: int | str) -> str:
        place = w.at(data, offset)
        return w.new(f"fmul {kind} {w.new(f'load {kind}, ptr {place}, align {w.precision.bytes}')}, {zero}")

    def plus(a: str, b: str) -> str:
        return w.new(f"fadd {kind} {a}, {b}")

    step, sums = width * w.precision.bytes, [times_zero((size - width) * w.precision.bytes)]
    whole = size // width
    if whole <= _UNROLLED:
        sums += [times_zero(k * step) for k in range(whole)]
    else:
        head, body, end, following = (w.label(stem) for stem in ("head", "body", "end", "next"))
        first, counter, total = w.name(), w.name(), w.name()
        w.do(f"br label %{head}")
        w.begin(head)
        w.do(f"{counter} = phi i64 [0, %{label}], [%{following}, %{body}]")
        w.do(f"{total} = phi {kind} [{sums[0]}, %{label}], [{first}, %{body}]")
        w.do(f"br i1 {w.new(f'icmp slt i64 {counter}, {whole // 2}')}, label %{body}, label %{end}")
        w.begin(body)
        near = w.new(f"mul i64 {counter}, {2 * step}")
        pair = plus(times_zero(near), times_zero(w.new(f"add i64 {near}, {step}")))
        w.do(f"{first} = fadd {kind} {total}, {pair}")
        w.do(f"%{following} = add i64 {counter}, 1")
        w.do(f"br label %{head}")
        w.begin(end)
        label, sums = end, [total, *([times_zero((whole - 1) * step)] if whole % 2 else [])]
    while len(sums) > 1:
        sums = [*(plus(a, b) for a, b in zip(sums[::2], sums[1::2], strict=False)), *sums[len(sums) // 2 * 2 :]]
    unordered = w.new(f"fcmp uno {kind} {sums[0]}, {zero}")
    bits = w.new(f"bitcast <{width} x i1> {unordered} to i{width}")
    return w.new(f"icmp ne i{width} {bits}, 0"), label
