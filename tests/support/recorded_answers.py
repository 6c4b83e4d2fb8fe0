"""Answers on record: calls whose complete results are compared with those in a file beside the tests.

A law says what must hold; a record says what did hold, for every option, kind and side of a limit that a law has no sentence
for. Calls are asymmetric on purpose: no equal links, no zero, no entry that another one could stand in for.
"""

from __future__ import annotations

import dataclasses
import enum
import inspect
import json
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from twistwrench.core.answers.answer import Answer

RELATIVE = 1e-7
"""Relative difference that other processors and versions of BLAS may make; a call of less certain digits states its own."""
ABSOLUTE = 1e-11
"""Difference from zero that rounding may make, in SI units and as a share of an array's largest entry."""
LISTED = 48
"""Entries of an array up to which it is recorded whole. Of larger ones, sums with four sets of weights stand for all entries."""
SHOWN = 8
"""Differences that a failure shows."""


class Records:
    """Calls of one test file, and their results in ``<room>.json`` beside it.

    ``@records.of`` adds a function: its name says what is on record. It may take a ``folder`` to write into. Arrays of more
    than ``listed`` entries stand as sums.
    """

    def __init__(self, test_file: str, *, listed: int = LISTED) -> None:
        path = Path(test_file)
        self.path = path.with_name(path.stem.removeprefix("test_") + ".json")
        self.listed = listed
        self.calls: dict[str, tuple[Callable[..., object], float]] = {}

    @property
    def names(self) -> list[str]:
        return list(self.calls)

    def of(self, call: Callable[..., object] | None = None, *, relative: float = RELATIVE) -> Any:
        def add(call: Callable[..., object]) -> Callable[..., object]:
            assert call.__name__ not in self.calls, f"two calls are named {call.__name__}"
            self.calls[call.__name__] = (call, relative)
            return call

        return add if call is None else add(call)

    def compare(self, name: str, folder: Path) -> None:
        """Assert that a call's result is the one on record."""
        recorded = json.loads(self.path.read_text("utf-8"))
        remedy = f"python -m tests.records {self.path.stem}"
        assert name in recorded, f"{name} is not on record: {remedy}"
        assert recorded.keys() <= self.calls.keys(), (
            f"No call has the answers {recorded.keys() - self.calls.keys()}: {remedy}"
        )
        _, relative = self.calls[name]
        found = list(differences(recorded[name], self._result(name, folder), name, relative))
        shown = "\n".join(found[:SHOWN])
        assert not found, f"{len(found)} differences from {self.path.name}:\n{shown}"

    def write(self, folder: Path) -> str:
        """Record all calls; an entry that is equal within its tolerance keeps its digits."""
        old = json.loads(self.path.read_text("utf-8")) if self.path.exists() else {}
        new: dict[str, object] = {}
        changed = 0
        for name, (_, relative) in self.calls.items():
            own_folder = folder / self.path.stem / name
            own_folder.mkdir(parents=True, exist_ok=True)
            new[name] = self._result(name, own_folder)
            if name in old and not any(differences(old[name], new[name], name, relative)):
                new[name] = old[name]
                continue
            changed += 1
        lines = [f'"{name}": {_compact_json(value)}' for name, value in sorted(new.items())]
        self.path.write_text("{\n" + ",\n".join(lines) + "\n}\n", "utf-8")
        return (
            f"{self.path.name}: {len(new)} answers, {changed} new or changed, {self.path.stat().st_size / 1000:.0f} kB"
        )

    def _result(self, name: str, folder: Path) -> object:
        call, _ = self.calls[name]
        takes_folder = "folder" in inspect.signature(call).parameters
        result = call(folder) if takes_folder else call()
        text = json.dumps(plain_values(result, self.listed), ensure_ascii=False)
        return json.loads(text.replace(str(folder), "FOLDER"))


def refusal(call: Callable[[], object]) -> str:
    """Type and message of the error that a call raises."""
    try:
        result = call()
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    raise AssertionError(f"No error, but {result!r}")


def plain_values(value: object, listed: int = LISTED) -> Any:
    """Value as JSON has it: numbers, texts, lists and dictionaries; fields of dataclasses, data and text of answers."""
    if value is None or isinstance(value, bool | np.bool_):
        return None if value is None else bool(value)
    if isinstance(value, enum.Enum):
        return str(value)
    if isinstance(value, str):
        return value
    if isinstance(value, int | np.integer):
        return int(value)
    if isinstance(value, float | np.floating):
        return _number(float(value))
    if isinstance(value, np.ndarray):
        return _array(value, listed)
    if isinstance(value, Mapping):
        return {str(key): plain_values(entry, listed) for key, entry in value.items()}
    if isinstance(value, set | frozenset):
        return sorted((plain_values(entry, listed) for entry in value), key=str)
    if isinstance(value, list | tuple):
        return [plain_values(entry, listed) for entry in value]
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, Answer):
        data = {key: entry for key, entry in value.to_dict().items() if key not in ("version", "schema")}
        return {"text": str(value).splitlines(), "data": plain_values(data, listed)}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = [field.name for field in dataclasses.fields(value) if not field.name.startswith("_")]
        return {"type": type(value).__name__} | {name: plain_values(getattr(value, name), listed) for name in fields}
    raise TypeError(f"{type(value).__name__} has no plain values: return its arrays, texts or numbers")


def _compact_json(value: object) -> str:
    return json.dumps(value, ensure_ascii=False, separators=(",", ":"))


def _number(x: float) -> float | str:
    return float(f"{x:.9g}") if np.isfinite(x) else str(x)


def _array(a: np.ndarray, listed: int) -> Any:
    if a.size <= listed or a.dtype.kind not in "fiub":
        return plain_values(a.tolist(), listed)
    entries = a.astype(float).ravel()
    finite = np.where(np.isfinite(entries), entries, 0.0)
    index = np.arange(1.0, len(entries) + 1.0)
    return {
        "shape": list(a.shape),
        "not finite": int(np.sum(~np.isfinite(entries))),
        "size": _number(float(np.abs(finite).sum())),
        "sums": [_number(float(np.sin(k * index) @ finite)) for k in (1.0, 1.7, 2.9, 0.013)],
        "first": [_number(x) for x in entries[:6]],
    }


def differences(recorded: Any, found: Any, place: str, relative: float) -> Iterator[str]:
    """Places where two plain values differ by more than a relative tolerance, with what was recorded and found."""
    if isinstance(recorded, dict) and isinstance(found, dict):
        for key in sorted({*recorded, *found}):
            if key not in recorded or key not in found:
                yield f"{place}.{key}: {'new' if key in found else 'gone'}"
                continue
            size = recorded.get("size") if key == "sums" else None
            if isinstance(size, float | int) and len(recorded[key]) == len(found[key]):
                for k, (a, b) in enumerate(zip(recorded[key], found[key], strict=True)):
                    if abs(a - b) > relative * size + ABSOLUTE:
                        yield f"{place}.sums[{k}]: {a!r} recorded, {b!r} found"
                continue
            yield from differences(recorded[key], found[key], f"{place}.{key}", relative)
        return
    if isinstance(recorded, list) and isinstance(found, list) and len(recorded) == len(found):
        largest = max((abs(x) for x in recorded if isinstance(x, float | int)), default=0.0)
        for k, (a, b) in enumerate(zip(recorded, found, strict=True)):
            if _is_number(a) and _is_number(b):
                if abs(a - b) > relative * abs(a) + ABSOLUTE * max(1.0, largest):
                    yield f"{place}[{k}]: {a!r} recorded, {b!r} found"
                continue
            yield from differences(a, b, f"{place}[{k}]", relative)
        return
    if _is_number(recorded) and _is_number(found):
        if abs(recorded - found) > relative * abs(recorded) + ABSOLUTE:
            yield f"{place}: {recorded!r} recorded, {found!r} found"
        return
    if isinstance(recorded, str) and isinstance(found, str) and _same_text(recorded, found, relative):
        return
    if recorded != found or type(recorded) is not type(found):
        yield f"{place}: {recorded!r} recorded, {found!r} found"


def _is_number(value: Any) -> bool:
    return isinstance(value, float | int) and not isinstance(value, bool)


_SHOWN_NUMBER = re.compile(r"-?\d+(?:\.\d+)?e[+-]?\d+|-?\d+\.\d+")
_ROUNDING_SHOWN = 1e-9
"""Numbers in texts that are rounding errors, in any unit: which ones they are depends on the processor."""
_ALL_DIGITS = 8
"""Digits from which on a text shows a number as it was computed, and not rounded for a reader."""


def _same_text(recorded: str, found: str, relative: float) -> bool:
    """Equal words, however versions of Rich space them, and equal numbers: to one unit of their last digit."""
    recorded, found = _without_layout(recorded), _without_layout(found)
    if recorded == found:
        return True
    if _SHOWN_NUMBER.split(recorded) != _SHOWN_NUMBER.split(found):
        return False
    pairs = zip(_SHOWN_NUMBER.findall(recorded), _SHOWN_NUMBER.findall(found), strict=True)
    return all(_same_shown_number(a, b, relative) for a, b in pairs)


def _digits_shown(number: str) -> int:
    return len(number.partition("e")[0].strip("-0.").replace(".", ""))


def _without_layout(text: str) -> str:
    return re.sub("─+", "─", " ".join(text.split()))


def _same_shown_number(a: str, b: str, relative: float) -> bool:
    x, y = float(a), float(b)
    if max(abs(x), abs(y)) < _ROUNDING_SHOWN:
        return True
    mantissa, _, exponent = a.partition("e")
    if max(map(_digits_shown, (a, b))) >= _ALL_DIGITS:
        return abs(x - y) <= relative * abs(x)
    decimals = len(mantissa.partition(".")[2])
    if len(b.partition("e")[0].partition(".")[2]) != decimals:
        return False
    unit = 10.0 ** (int(exponent or 0) - decimals)
    return abs(x - y) <= 1.01 * unit
