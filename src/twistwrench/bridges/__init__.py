"""The traced programs of a robot as functions of other packages: JAX, PyTorch, CasADi, JavaScript."""
