"""Hints on the unit of loads: payloads that only grams explain."""

from __future__ import annotations

import pytest
from click.testing import CliRunner

from twistwrench.cli.main import main

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")


@pytest.mark.parametrize(
    "words",
    [
        ["torques", "ur5", "--trajectory", "demo", "--payload", "{}"],
        ["move", "ur5", "--to", "0.1,-1.5,0.1,0,0,0", "--payload", "{}"],
        ["payload", "ur5", "--tool", "{}"],
        pytest.param(["simulate", "ur5", "--duration", "0.01", "--payload", "{}"], marks=pytest.mark.slow),
    ],
    ids=lambda words: words[0],
)
def test_a_payload_that_only_grams_explain_is_asked_for_after_the_verdict(words):
    """3000 kg on an arm of 17 kg, whose verdict stays; 100 kg may be meant, and 3e6 kg are no payload in grams either."""
    said = {
        mass: CliRunner().invoke(main, [word.format(mass) for word in words]).output for mass in ("3000", "100", "3e6")
    }
    text = " ".join(said["3000"].split())
    assert "a payload of 3000 kg is 177 times the mass" in text and "if these are grams, give 3." in text
    assert all("grams" not in said[mass] for mass in ("100", "3e6"))
    assert said["3000"].split(":")[0] == said["100"].split(":")[0]
