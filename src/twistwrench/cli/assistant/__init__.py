"""Commands as tools of coding assistants, by the Model Context Protocol."""

from __future__ import annotations
