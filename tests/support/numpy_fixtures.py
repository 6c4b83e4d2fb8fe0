"""A fixture for files whose robots are used a few times each: a pytest plugin."""

from __future__ import annotations

import pickle

import pytest

from twistwrench.robot import engine


@pytest.fixture(scope="module")
def on_numpy():
    """Programs run on NumPy here: nothing to compile, and that compiled ones agree is another test's business.

    Robots that are equal byte for byte, such as a file that each command loads anew, share their programs.
    """
    forms = {}
    trace = engine.execution_form

    def traced_once(model, names, options):
        key = pickle.dumps((model, names, options))
        if key not in forms:
            forms[key] = trace(model, names, options)
        return forms[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TWISTWRENCH_JIT", "0")
        patch.setattr(engine, "execution_form", traced_once)
        yield
