"""Programs to LLVM assembly: blocks of vector instructions, partitions, loops over batches and time."""

from __future__ import annotations
