"""Statics: complete answers on record."""

from __future__ import annotations

import pytest
from recorded_answers import Records

import twistwrench as tw

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)


@records.of
def payload_of_a_ur5_at_its_demo_pose():
    return tw.check("ur5", "demo", payload=10)


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
