"""What ``--help`` shows: a command's own options, those that say how the robot is read, and commands to copy."""

from __future__ import annotations

import click


class RobotOption(click.Option):
    """An option that says how the robot is read: one that all commands share."""


class OwnOptionsFirst(click.Command):
    """A command whose help lists its own options before those of the robot."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write them in two sections."""
        records = [(p, p.get_help_record(ctx)) for p in self.get_params(ctx) if isinstance(p, click.Option)]
        own = [record for param, record in records if record and not isinstance(param, RobotOption)]
        shared = [record for param, record in records if record and isinstance(param, RobotOption)]
        for title, rows in (("Options", own), ("How the robot is read", shared)):
            if rows:
                with formatter.section(title):
                    formatter.write_dl(rows)


_EXAMPLES = {
    "convert": ("convert panda panda.xml",),
    "derive": (
        "derive planar_2r",
        "derive cart_pole --latex -",
    ),
    "doctor": (
        "doctor ur5",
        "doctor quadruped --page quadruped.html --json",
    ),
    "excite": ("excite panda --seconds 20 --harmonics 5 --out motion.csv",),
    "export": ("export panda --c . --quantity inverse_dynamics --quantity mass_matrix",),
    "identify": ("identify my_arm.urdf log.csv --test other_log.csv --report report.html",),
    "info": (
        "info panda",
        "info ur5 --json",
    ),
    "log info": ("log info log.csv",),
    "move": (
        "move ur5 --to 0.9,-0.9,1.0,-0.4,1.2,1.0 --fastest",
        "move ur5 --from=-0.5,-1.9,1.9,-0.3,1.5,0 --by 0.1,0,-0.1 --csv move.csv",
    ),
    "payload": (
        "payload ur5",
        "payload ur5 --at shoulder_lift_joint=-0.6 --at elbow_joint=0.9 --com 0,0,0.1",
    ),
    "plot": ("plot ur5 --trajectory demo --payload 5 --what power --out power.png",),
    "robots": (
        "robots",
        "robots panda",
    ),
    "sensor compensate": ("sensor compensate demo --sensor demo",),
    "sensor identify": (
        "sensor identify demo",
        "sensor identify demo --save hand.json",
    ),
    "sensor poses": (
        "sensor poses",
        "sensor poses demo --count 3",
    ),
    "simulate": (
        "simulate ur5 --duration 0.5",
        "simulate planar_2r --at joint1=0.5 --csv fall.csv --plot fall.png",
    ),
    "torques": (
        "torques ur5 --trajectory demo --payload 10 --why",
        "torques ur5 --trajectory demo --payload 5 --csv torques.csv --plot torques.png",
    ),
    "twistwrench": (
        "torques ur5 --trajectory demo --payload 10",
        "doctor ur5",
        "torques --help",
    ),
    "verify": ("verify ur5",),
    "view": (
        "view ur5 --trajectory demo --payload 5 --html ur5.html",
        "view panda --section 8.1.3 --html mass_matrix.html",
    ),
}
"""Lines to copy, by command, after ``twistwrench``: all but those of logs run as they stand."""


def examples(command: str) -> str:
    """The end of a command's help: lines to copy."""
    lines = "\n".join(f"  twistwrench {example}" for example in _EXAMPLES[command])
    return f"\b\nExamples:\n{lines}"
