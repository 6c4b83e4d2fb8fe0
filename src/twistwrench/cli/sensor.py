"""The commands ``twistwrench sensor identify | compensate | poses``. What is heavy is imported inside the one that needs it."""

from __future__ import annotations

import click

from .command_texts import about
from .sensor_compensate import compensate_command
from .sensor_identify import identify_command
from .sensor_poses import poses_command


@click.group(cls=click.Group, **about("sensor"))
def sensor() -> None:
    """Six-axis force-torque sensors: find the tool's mass, remove its weight, propose poses.

    LOG is a CSV file with mx,my,mz,fx,fy,fz and an orientation (qw,qx,qy,qz or r11…r33 or gx,gy,gz),
    or 'demo' or 'demo-motion', which are bundled.
    """


sensor.add_command(identify_command)
sensor.add_command(compensate_command)
sensor.add_command(poses_command)
