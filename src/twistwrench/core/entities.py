"""Entities of XML, which can exhaust memory or read other files: refused before another parser sees a text."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


def refuse_entities(data: str | bytes, error_of: Callable[[str], Exception]) -> None:
    """Raise ``error_of(name)`` if an XML text declares an entity; ill-formed texts raise ExpatError.

    >>> refuse_entities("<robot/>", ValueError)
    >>> refuse_entities('<!DOCTYPE r [<!ENTITY a "aa">]><r/>', ValueError)
    Traceback (most recent call last):
    ValueError: a
    """
    from xml.parsers import expat

    def refuse(name: str, *_: Any) -> None:
        raise error_of(name)

    parser = expat.ParserCreate()
    parser.EntityDeclHandler = parser.UnparsedEntityDeclHandler = refuse
    parser.Parse(data, True)
