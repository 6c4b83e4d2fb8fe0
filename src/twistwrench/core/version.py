"""The version of this release, and whether it is on a package index."""

__version__ = "0.1.0"
ON_INDEX = False
"""True in what is built with ``TWISTWRENCH_ON_INDEX=1``, for a package index, where extras are installed by name."""
