"""Doubts about the logs of a fit."""
