"""What every part of a call's code is written with: addresses, fields of arrays, forks to the slow callable."""

from __future__ import annotations

from ..program.port import Port
from .call_way import BYTES_DATA, FIELDS, POINTERS, Way
from .llvm_text import LlvmWriter

CONTIGUOUS_AND_ALIGNED, WRITABLE, BACK, WARNS = 0x1 | 0x100, 0x400, 0x2000, 1 << 31
"""NumPy's flags of arrays; the last two are of arrays whose writing has consequences."""


class CallWriter:
    """The lines of the function, and the tables it works with."""

    def __init__(self, way: Way) -> None:
        self.way, self.w, self.label = way, LlvmWriter(way.precision, 1), "entry"
        w = self.w
        self.given = (*way.inputs, *way.mapped)
        self.context = w.at("%self", BYTES_DATA)
        self.data = w.new(f"alloca [{len(self.given) + len(way.outputs)} x ptr], align 8")
        self.results = w.new(f"alloca [{len(way.outputs)} x ptr], align 8")
        self.slots = w.new(f"alloca [{way.parameters} x ptr], align 8")
        self.rooms = [w.new(f"alloca [{port.size} x {w.element}], align 64") for port in (*self.given, *way.outputs)]

    def known(self, what: str | int) -> str:
        """An address of the context, by its name or its number."""
        number = POINTERS.index(what) if isinstance(what, str) else len(POINTERS) + what
        return self.at(self.context, number)

    def at(self, table: str, number: int, kind: str = "ptr") -> str:
        """An entry of a table."""
        return self.w.new(f"load {kind}, ptr {self.w.at(table, 8 * number)}, align 8")

    def put(self, table: str, number: int, value: str) -> None:
        """Set a pointer of a table."""
        self.w.do(f"store ptr {value}, ptr {self.w.at(table, 8 * number)}, align 8")

    def begin(self, label: str) -> None:
        """Start a basic block."""
        self.w.begin(label)
        self.label = label

    def fork(self, condition: str, yes: str, no: str) -> None:
        """Go to the one label where it holds, else to the other."""
        self.w.do(f"br i1 {self.w.new(condition)}, label %{yes}, label %{no}")

    def check(self, condition: str) -> None:
        """Go on where it holds, else the slow way."""
        further = self.w.label("ok")
        self.fork(condition, further, "slow")
        self.begin(further)

    def field(self, array: str, name: str, kind: str) -> str:
        """A field of an array."""
        return self.w.new(f"load {kind}, ptr {self.w.at(array, FIELDS[name])}, align 4")

    def array(self, array: str, port: Port, flags: tuple[int, int] = (CONTIGUOUS_AND_ALIGNED,) * 2) -> str:
        """The data of an array that is as wanted; dimensions are read only where there are as many."""
        w, (mask, wanted) = self.w, flags
        self.check(f"icmp eq ptr {self.field(array, 'type', 'ptr')}, {self.known('array_type')}")
        self.check(f"icmp eq ptr {self.field(array, 'descr', 'ptr')}, {self.known('descriptor')}")
        self.check(f"icmp eq i32 {self.field(array, 'nd', 'i32')}, {len(port.shape)}")
        found = self.field(array, "flags", "i32")
        self.check(f"icmp eq i32 {w.new(f'and i32 {found}, {mask}')}, {wanted}")
        dims = self.field(array, "dims", "ptr")
        for axis, size in enumerate(port.shape):
            self.check(f"icmp eq i64 {self.at(dims, axis, 'i64')}, {size}")
        return self.field(array, "data", "ptr")
