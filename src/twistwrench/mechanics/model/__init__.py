"""Robots as frozen data, and the builder that checks them."""

from __future__ import annotations
