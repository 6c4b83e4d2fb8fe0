"""Causes of a fit's residual: candidates, search and doubts."""
