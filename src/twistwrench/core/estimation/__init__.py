"""Linear regression: least squares, covariance, cross-validation and observability."""

from __future__ import annotations
