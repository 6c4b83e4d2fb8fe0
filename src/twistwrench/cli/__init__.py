"""The command line: one file per command, and the tables it prints."""

from .main import main

__all__ = ["main"]
