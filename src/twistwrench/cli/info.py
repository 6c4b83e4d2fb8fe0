"""The command ``twistwrench info``: what a robot is made of."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import click

from ..errors import ModelWarning, ValueRangeError
from ..outputs import check_outputs, replacing
from .robot_options import RobotOptions


def answer_info(options: RobotOptions, show: Callable[[Any], None], *, as_json: bool, csv_path: str | None) -> None:
    """Show a robot, print it as JSON, or write its joints as CSV."""
    from .tables.robot_info import info_view

    if as_json and csv_path is not None:
        raise ValueRangeError("--json prints the robot, and --csv writes its joints. Choose one.")
    if options.degrees and (as_json or csv_path is not None):
        raise ValueRangeError("--json and --csv are in SI units and radians. Leave --degrees out.")
    if csv_path is not None and csv_path != "-":
        check_outputs({"--csv": csv_path}, options.files)

    with warnings.catch_warnings(record=True) as remarks:
        warnings.simplefilter("always", ModelWarning)
        robot = options.load()
    for remark in remarks:  # those of the model itself stand below its tree
        if not any(defect in str(remark.message) for defect in robot.defects):
            warnings.warn_explicit(remark.message, remark.category, remark.filename, remark.lineno)
    if as_json or csv_path is not None:
        from ..report.robot_summary import as_text

        text = as_text(robot, "json" if as_json else "csv")
        if as_json or csv_path == "-":
            click.echo(text, nl=False)
        elif csv_path is not None:
            with replacing(csv_path) as scratch:
                scratch.write_text(text, encoding="utf-8", newline="")
            click.echo(f"wrote {csv_path}")
        return
    show(info_view(robot, degrees=options.degrees))
