"""The second half of a call: room for the results, the loop, a look at what came out, and what is returned."""

from __future__ import annotations

from ..program.port import Port
from .call_way import SIZE, TUPLE_ITEMS
from .call_writer import BACK, CONTIGUOUS_AND_ALIGNED, WARNS, WRITABLE, CallWriter
from .fast_call_checks import spoiled


class ResultWriter(CallWriter):
    """Writes what follows once the data of all arguments are found."""

    def results_and_run(self, outs: str) -> None:
        """Room for results, the loop, a look at what came out, and what is returned."""
        w, way = self.w, self.way
        fresh, lent, run, kept = (w.label(stem) for stem in ("fresh", "lent", "run", "kept"))
        if way.out >= 0:
            none = w.new(f"icmp eq ptr {outs}, {self.known('none')}")
            self.fork(f"or i1 {none}, {w.new(f'icmp eq ptr {outs}, null')}", fresh, lent)
            self.begin(lent)
            self.lent(outs)
            after_lent = self.label
            w.do(f"br label %{run}")
        else:
            w.do(f"br label %{fresh}")
        self.begin(fresh)
        self.allocate()
        after_fresh = self.label
        w.do(f"br label %{run}")
        self.begin(run)
        mine = w.new(f"phi i1 [true, %{after_fresh}]" + (f", [false, %{after_lent}]" if way.out >= 0 else ""))
        w.do(f"call void {self.known('loop')}(ptr {self.data}, ptr @one, ptr @steps, ptr null)")
        bad = "false"
        for k, port in enumerate(way.outputs, start=len(self.given)):
            found, self.label = spoiled(w, self.at(self.data, k), port.size, self.label)
            bad = w.new(f"or i1 {bad}, {found}")
        wrong, fine, drop, hand = (w.label(stem) for stem in ("wrong", "fine", "drop", "hand"))
        w.do(f"br i1 {bad}, label %{wrong}, label %{fine}")
        self.begin(wrong)  # results that are not finite are made again the slow way, where NumPy says so
        w.do(f"br i1 {mine}, label %{drop}, label %slow")
        self.begin(drop)
        self.drop(len(way.outputs))
        w.do("br label %slow")
        self.begin(fine)
        w.do(f"br i1 {mine}, label %{hand}, label %{kept}")
        self.begin(kept)
        w.do(f"call void {self.known('incref')}(ptr {outs})")
        w.do(f"ret ptr {outs}")
        self.begin(hand)
        self.hand_over()

    def lent(self, outs: str) -> None:
        """The caller's arrays, where they can be written to and share no memory with each other or with what is read."""
        w, way = self.w, self.way
        objects = [outs]
        if len(way.outputs) > 1:
            self.check(f"icmp eq ptr {self.field(outs, 'type', 'ptr')}, {self.known('tuple_type')}")
            self.check(f"icmp eq i64 {self.at(w.at(outs, SIZE), 0, 'i64')}, {len(way.outputs)}")
            objects = [self.at(w.at(outs, TUPLE_ITEMS), k) for k in range(len(way.outputs))]
        wanted = CONTIGUOUS_AND_ALIGNED | WRITABLE
        for k, (item, port) in enumerate(zip(objects, way.outputs, strict=True)):
            place = self.array(item, port, (wanted | BACK | WARNS, wanted))
            ports = (*self.given, *way.outputs)
            for j in range(len(self.given) + k):
                other = self.at(self.data, j)
                self.check(f"or i1 {self.ends_before(place, port, other)}, {self.ends_before(other, ports[j], place)}")
            self.put(self.data, len(self.given) + k, place)

    def ends_before(self, one: str, port: Port, other: str) -> str:
        """Whether the numbers of one array end before those of another begin."""
        end = self.w.at(one, port.size * self.way.precision.bytes)
        return self.w.new(f"icmp ule ptr {end}, {other}")

    def allocate(self) -> None:
        """New arrays; a scalar is computed in a room of our own."""
        w = self.w
        for k, port in enumerate(self.way.outputs):
            if not port.shape:
                self.put(self.data, len(self.given) + k, self.rooms[len(self.given) + k])
                continue
            descriptor = self.known("descriptor")
            w.do(f"call void {self.known('incref')}(ptr {descriptor})")  # the new array takes a reference over
            made = w.new(
                f"call ptr {self.known('new_array')}(ptr {self.known('array_type')}, ptr {descriptor}, i32 {len(port.shape)}, "
                f"ptr @shape{k}, ptr null, ptr null, i32 0, ptr null)"
            )
            self.made(made, k)
            self.put(self.results, k, made)
            self.put(self.data, len(self.given) + k, self.field(made, "data", "ptr"))

    def made(self, item: str, before: int) -> None:
        """Go on where Python made an object, else drop what was made before and leave with its error."""
        got, failed = self.w.label("made"), self.w.label("failed")
        self.fork(f"icmp eq ptr {item}, null", failed, got)
        self.begin(failed)
        self.drop(before)
        self.w.do("ret ptr null")
        self.begin(got)

    def drop(self, count: int) -> None:
        """Let go of so many new arrays."""
        for k in range(count):
            if self.way.outputs[k].shape:
                self.w.do(f"call void {self.known('decref')}(ptr {self.at(self.results, k)})")

    def hand_over(self) -> None:
        """Return what was made: an array, a scalar, or a tuple."""
        w, outputs = self.w, self.way.outputs
        if len(outputs) > 1:
            several = w.new(f"call ptr {self.known('new_tuple')}(i64 {len(outputs)})")
            self.made(several, len(outputs))
            for k in range(len(outputs)):
                self.put(w.at(several, TUPLE_ITEMS), k, self.at(self.results, k))
            w.do(f"ret ptr {several}")
        elif outputs[0].shape:
            w.do(f"ret ptr {self.at(self.results, 0)}")
        else:
            room = self.rooms[len(self.given)]
            scalar = w.new(f"call ptr {self.known('new_scalar')}(ptr {room}, ptr {self.known('descriptor')}, ptr null)")
            w.do(f"ret ptr {scalar}")
