"""The forms of what is compiled: a program, or one with a loop around it or behind it."""

from __future__ import annotations

from .column_groups import ColumnGroups
from .products import Products
from .program import Program
from .recurrence import Recurrence
from .search import Search

Form = Program | Products | ColumnGroups | Recurrence | Search


def program_of(form: Form) -> Program:
    """The program without its loop."""
    return form if isinstance(form, Program) else form.program
