"""Any form of what is compiled, on whole arrays: where nothing compiles, or a program is too long for it."""

from __future__ import annotations

from typing import Any

from ..program.column_groups import ColumnGroups
from ..program.forms import Form
from ..program.products import Products
from ..program.program import Program
from ..program.recurrence import Recurrence
from .numpy import NumpyKernel
from .numpy_columns import NumpyColumns
from .numpy_products import NumpyProducts
from .numpy_search import NumpySearch
from .numpy_steps import NumpySteps


def on_numpy(form: Form, name: str, doc: str) -> Any:
    """What is called like the compiled ufunc."""
    if isinstance(form, Program):
        return NumpyKernel(form, name, doc)
    if isinstance(form, Products):
        return NumpyProducts(form, name, doc)
    if isinstance(form, ColumnGroups):
        return NumpyColumns(form, name, doc)
    return NumpySteps(form, name, doc) if isinstance(form, Recurrence) else NumpySearch(form, name, doc)
