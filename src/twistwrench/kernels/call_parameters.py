"""The parameters of a method, and the way of calling it that the arguments of one kind of call make."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ..program.forms import Form
from ..program.port import Port
from ..targets.call_way import Way
from ..targets.processor import DOUBLE, SINGLE
from .call_form import CallForm
from .kept_kernels import KernelOutline


@dataclass(frozen=True)
class CallParameters:
    """Those of a method, without its first."""

    names: tuple[str, ...]
    positional: int
    defaults: dict[str, Any]

    @classmethod
    def of(cls, method: Any) -> CallParameters:
        """Those of a bound method."""
        function = method.__func__
        code, given = function.__code__, function.__defaults__ or ()
        places = code.co_varnames[1 : code.co_argcount]
        names = code.co_varnames[1 : code.co_argcount + code.co_kwonlyargcount]
        defaults = dict(zip(places[len(places) - len(given) :], given, strict=True)) | (function.__kwdefaults__ or {})
        return cls(names, len(places), defaults)

    def doc(self, method: Any, name: str) -> str:
        """The method's own, behind a line from which ``inspect.signature`` reads its parameters."""
        shown = [f"{p}={self.defaults[p]!r}" if p in self.defaults else p for p in self.names]
        if self.positional < len(shown):
            shown.insert(self.positional, "*")
        return f"{name}({', '.join(shown)})\n--\n\n{method.__func__.__doc__ or ''}"


def way_of(program: Form | KernelOutline, parameters: CallParameters, asked: CallForm) -> Way | None:
    """How the builtin is called; None where none can be."""
    ports = (*program.inputs, *program.outputs)
    count = len(program.inputs) - len(asked.keys)
    names, options = parameters.names, dict(asked.options)
    scalar = len(program.outputs) > 1 and not all(port.shape for port in program.outputs)
    strange = {*options, *([asked.mapping] if asked.mapping else [])} - {*names[count:]}
    several = any(n != 1 for n in asked.batch)
    if several or scalar or strange or count > len(names) or any(not port.size for port in ports):
        return None
    if any(name not in parameters.defaults for name in names[count:] if name not in options):
        return None
    rest = [k for k in range(count, len(names)) if names[k] not in ("out", asked.mapping)]
    defaults = parameters.defaults

    def is_default(name: str) -> bool:
        return (
            name not in options
            or options[name] is defaults.get(name)
            or (type(options[name]) is str and options[name] == defaults.get(name))
        )

    inputs, outputs = (
        tuple(Port(port.name, asked.batch + port.shape) for port in some) for some in (program.inputs, program.outputs)
    )
    return Way(
        inputs[:count],
        inputs[count:],
        outputs,
        SINGLE if asked.char == SINGLE.char else DOUBLE,
        len(names),
        parameters.positional,
        tuple((k, is_default(names[k])) for k in rest),
        names.index(asked.mapping) if asked.mapping else -1,
        asked.negative,
        names.index("out") if "out" in names else -1,
        len(asked.batch),
    )
