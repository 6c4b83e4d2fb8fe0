"""Which numbers of a robot are symbols: what ``symbols=`` chooses."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from ..errors import UnknownNameError, ValueRangeError
from ..model.model import Model
from .symbols import BodyEntries, Entry, ModelEntries, Namer, Parameter

KINDS = ("lengths", "coms", "masses", "inertias", "gravity", "springs", "gears")
"""What ``symbols=`` can name as a whole; ``"all"`` and ``"none"`` beside them."""


def model_entries(model: Model, symbols: str | Iterable[str] = "all") -> ModelEntries:
    """Name the model's numbers, those that ``symbols`` chooses: kinds, names, ``"all"`` or ``"none"``.

    Raises :class:`~twistwrench.UnknownNameError` for names that the robot does not have.
    """
    every = Namer(model).entries()
    chosen = _chosen(symbols, every.parameters)

    def kept(entries: Any) -> Any:
        """An entry, or entries in tuples, as plain numbers where no symbol was chosen."""
        if isinstance(entries, tuple):
            return tuple(map(kept, entries))
        return entries if entries.parameter is None or entries.parameter.name in chosen else Entry(entries.value)

    bodies = tuple(
        BodyEntries(b.tag, **{name: kept(entry) for name, entry in vars(b).items() if name != "tag"})
        for b in every.bodies
    )
    parameters = tuple(p for p in every.parameters if p.name in chosen)
    return ModelEntries(bodies, kept(every.gravity), kept(every.springs), kept(every.armature), parameters)


def _chosen(symbols: str | Iterable[str], parameters: tuple[Parameter, ...]) -> set[str]:
    words = [symbols] if isinstance(symbols, str) else symbols
    try:
        words = [str(word).strip() for word in words]
    except TypeError:
        raise ValueRangeError(
            f"symbols={symbols!r}: give 'all', 'none', or a list of kinds ({', '.join(KINDS)}) and names such as 'L_1'."
        ) from None
    names = {p.name for p in parameters}
    chosen: set[str] = set()
    for word in words:
        if word == "all":
            chosen |= names
        elif word in KINDS:
            chosen |= {p.name for p in parameters if word in p.kinds}
        elif word in names:
            chosen.add(word)
        elif word != "none":
            raise UnknownNameError.of("symbol or kind of symbols", word, ["all", "none", *KINDS, *sorted(names)])
    return chosen
