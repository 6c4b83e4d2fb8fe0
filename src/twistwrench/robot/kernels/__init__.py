"""Parts of the kernels of a robot: options, large robots, the disk cache, and exp and log."""
