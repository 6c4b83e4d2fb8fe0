"""The command ``twistwrench info``: what a robot is made of."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import click

from ..errors import ModelWarning, ValueRangeError
from .robot_options import RobotOptions


def answer_info(options: RobotOptions, show: Callable[[Any], None], *, as_json: bool, as_csv: bool) -> None:
    """Show a robot, or print it as JSON or CSV."""
    from .tables.robot_info import info_view

    if as_json and as_csv:
        raise ValueRangeError("--json and --csv both write to the standard output. Choose one.")
    if options.degrees and (as_json or as_csv):
        raise ValueRangeError("--json and --csv are in SI units and radians. Leave --degrees out.")

    with warnings.catch_warnings(record=True) as remarks:
        warnings.simplefilter("always", ModelWarning)
        robot = options.load()
    for remark in remarks:  # those of the model itself stand below its tree
        if not any(defect in str(remark.message) for defect in robot.defects):
            warnings.warn_explicit(remark.message, remark.category, remark.filename, remark.lineno)
    if as_json or as_csv:
        from ..report.robot_summary import as_text

        click.echo(as_text(robot, "json" if as_json else "csv"), nl=False)
        return
    show(info_view(robot, degrees=options.degrees))
