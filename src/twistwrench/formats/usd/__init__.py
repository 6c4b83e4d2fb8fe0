"""USD with UsdPhysics: bodies of a stage, their mass properties, and the joints of an articulation.

https://openusd.org/release/api/usd_physics_page_front.html. Pixar's library ``pxr`` (package usd-core, an extra) opens
the stage. Numbers are converted to SI by the stage's ``metersPerUnit`` and ``kilogramsPerUnit``, and angles to radians;
most are in single precision. Links are the rigid bodies, in their own frames without scale. Appearance, contacts and
drive gains are skipped.
"""

from __future__ import annotations

from .reader import read_usd

__all__ = ["read_usd"]
