"""Extension of griffe for the pages: docstrings completed from the glossary, as ``help()`` shows them."""

from __future__ import annotations

from typing import Any

import griffe

from twistwrench.core.glossary import completed


class Glossary(griffe.Extension):
    """Completes the docstring of each function."""

    def on_function(self, *, func: griffe.Function, **_: Any) -> None:
        """Complete the docstring of a function that was read."""
        parts = func.path.split(".")
        if func.docstring is not None and len(parts) > 2:
            names = [p.name for p in func.parameters if p.name not in ("self", "cls")]
            func.docstring.value = completed(func.docstring.value, names, parts[1], str(func.returns))
