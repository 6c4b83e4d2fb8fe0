"""Extension of griffe for the pages: docstrings completed from the glossary, as ``help()`` shows them."""

from __future__ import annotations

import re
from typing import Any

import griffe

from twistwrench.core.glossary import complete_docstring, room_of

_MAPPING = re.compile(r"^(\s*\w+ : )\{([^{}]+: [^{}]+)\}", re.MULTILINE)
"""Type of a parameter, as in ``known : {name: float}, optional``; griffe takes braces for a set of choices."""


class Glossary(griffe.Extension):
    """Completes the docstring of each function."""

    def on_function(self, *, func: griffe.Function, **_: Any) -> None:
        """Complete the docstring of a function that was read."""
        if func.docstring is not None and func.parent.path != func.package.path:
            names = [p.name for p in func.parameters if p.name not in ("self", "cls")]
            folders = func.module.filepath.relative_to(func.package.filepath.parent).parts[:-1]
            text = complete_docstring(func.docstring.value, names, room_of(folders), str(func.returns))
            func.docstring.value = _MAPPING.sub(r"\1dict of \2", text)
