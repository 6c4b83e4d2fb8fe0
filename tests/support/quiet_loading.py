"""Robots from files whose remarks are not what a test is about."""

from __future__ import annotations

import warnings

import twistwrench as tw


def load_quietly(source, **options):
    """``tw.load`` without its warnings about the model."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        return tw.load(source, **options)
