"""Programs as callable NumPy ufuncs: compiled, cached on disk, kept alive as long as they are used."""
