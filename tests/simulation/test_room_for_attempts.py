"""What steps of dopri5 are off by does not depend on how many of them there is room for."""

from __future__ import annotations

import numpy as np

import twistwrench as tw
from twistwrench.simulation.methods import trial_steps


def test_errors_of_all_steps_count_whatever_room_there_is(monkeypatch):
    found = []
    for rows in (256, 7):
        monkeypatch.setattr(trial_steps, "BUFFER_ROWS", rows)
        run = tw.robots.planar_2r().simulate([0.4, 0.2], None, 4.0, 4.0, method="dopri5")
        found.append((run.q[-1], run.error_estimate))
    np.testing.assert_array_equal(found[0][0], found[1][0])
    np.testing.assert_allclose(found[0][1], found[1][1], rtol=1e-9)
