"""A sensor file whose uncertainty is not one of variances is refused in one line, by `sensor compensate` and by Python."""

from __future__ import annotations

import json
import math

import pytest
from click.testing import CliRunner

from twistwrench.cli.main import main

NEGATIVE, ASYMMETRIC, INDEFINITE, ZERO_NOISE = "negative", "asymmetric", "indefinite", "zero noise"


@pytest.fixture(scope="module")
def sensor(tmp_path_factory):
    path = tmp_path_factory.mktemp("sensor") / "sensor.json"
    done = CliRunner().invoke(main, ["sensor", "identify", "demo", "--save", str(path)])
    assert done.exit_code == 0, done.output
    return json.loads(path.read_text())


@pytest.mark.parametrize("damage", [NEGATIVE, ASYMMETRIC, INDEFINITE, ZERO_NOISE])
def test_an_uncertainty_that_is_not_one_ends_in_one_error(sensor, tmp_path, damage):
    content = json.loads(json.dumps(sensor))
    uncertainty = content["uncertainty"]
    if damage == ZERO_NOISE:
        uncertainty["noise"] = [0.0] * 6
    elif damage == INDEFINITE:  # a correlation of 1.5
        C = uncertainty["covariance"]
        C[0][1] = C[1][0] = 1.5 * math.sqrt(C[0][0] * C[1][1])
    else:
        uncertainty["covariance"][0][0 if damage == NEGATIVE else 1] = -1.0 if damage == NEGATIVE else 1e9
    (tmp_path / "s.json").write_text(json.dumps(content))
    for more in ((), ("--contacts", "1e-6")):
        command = ["sensor", "compensate", "demo-motion", "--sensor", str(tmp_path / "s.json"), *more]
        done = CliRunner().invoke(main, command)
        assert done.exit_code in (0, 1, 2), done.output
        if damage != ZERO_NOISE:
            assert done.exit_code == 2 and "covariance" in done.stderr and done.stderr.count("\n") == 1, done.output
