"""XML text of elements, for the writers: two blanks a level, numbers so that they are read again to the last bit."""

from __future__ import annotations

import re
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from numpy.typing import ArrayLike

from ..errors import ModelError
from .element import Element

_FORBIDDEN = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")


def new(tag: str, parent: Element | None = None, text: str = "", /, **attributes: str) -> Element:
    """A new element, appended to its parent's children."""
    element = Element(tag, attributes, 0, parent, content=text)
    if parent is not None:
        parent.add(element)
    return element


def figures(values: ArrayLike) -> str:
    """Numbers with blanks between, the fewest digits that are the same doubles; no minus before a zero.

    >>> figures([1, -0.0, 0.1, 1e-9])
    '1 0 0.1 1e-09'
    """
    return " ".join(_figure(float(x)) for x in np.ravel(np.asarray(values, float)))


def _figure(x: float) -> str:
    return str(int(x)) if x.is_integer() and abs(x) < 1e15 else repr(x)


def xml_text(root: Element) -> str:
    """The document of an element. Raises :class:`~twistwrench.ModelError` for characters that are not allowed in one."""
    lines = ['<?xml version="1.0" encoding="utf-8"?>']
    stack: list[tuple[Element | None, str, int]] = [(root, "", 0)]  # a chain may be longer than Python's stack is deep
    while stack:
        element, closing, depth = stack.pop()
        pad = "  " * min(depth, 60)
        if element is None:
            lines.append(f"{pad}{closing}")
            continue
        said = "".join(f" {name}={quoteattr(value)}" for name, value in element.attributes.items())
        if element.children:
            lines.append(f"{pad}<{element.tag}{said}>")
            stack.append((None, f"</{element.tag}>", depth))
            stack.extend((child, "", depth + 1) for child in reversed(element.children))
        elif element.content:
            lines.append(f"{pad}<{element.tag}{said}>{escape(element.content)}</{element.tag}>")
        else:
            lines.append(f"{pad}<{element.tag}{said}/>")
    text = "\n".join(lines) + "\n"
    if bad := _FORBIDDEN.search(text):
        line = text[: bad.start()].rpartition("\n")[2] + text[bad.start() :].partition("\n")[0]
        raise ModelError(
            f"no XML file can hold the character {bad[0]!r}, which is in {line.strip()[:100]!r}. Rename that."
        )
    return text
