"""The command line: a file for each command, with its options, its run and its report."""

from .main import main

__all__ = ["main"]
