"""Programs to LLVM assembly: blocks of vector instructions, partitions, loops over batches and time."""
