"""What help says of each command beside its docstring: a summary, and examples that run as they stand."""

from __future__ import annotations

from typing import Any, NamedTuple


class CommandText(NamedTuple):
    """Of one command."""

    summary: str
    examples: tuple[str, ...] = ()


_TEXTS = {
    "": CommandText("", ("torques ur5 --trajectory demo --payload 10", "doctor ur5", "torques --help")),
    "torques": CommandText(
        "Torques of a motion: which joint is over its limit, and why.",
        (
            "torques ur5 --trajectory demo --payload 10 --why",
            "torques ur5 --trajectory demo --payload 5 --csv torques.csv --plot torques.png",
        ),
    ),
    "info": CommandText("Joints, limits, masses, inertias, frames and the tree.", ("info panda", "info ur5 --json")),
    "robots": CommandText("The robots that have a name.", ("robots", "robots panda")),
    "verify": CommandText("Check the dynamics against independent formulas and libraries.", ("verify ur5",)),
    "payload": CommandText(
        "The largest payload at a pose, and the joint that limits it.",
        ("payload ur5", "payload ur5 --at shoulder_lift_joint=-0.6 --at elbow_joint=0.9 --com 0,0,0.1"),
    ),
    "simulate": CommandText(
        "How the robot moves: states, energies, events.",
        ("simulate ur5 --duration 0.5", "simulate planar_2r --at joint1=0.5 --csv fall.csv --plot fall.png"),
    ),
    "view": CommandText(
        "The robot in the browser, as a page, or as a film.",
        (
            "view ur5 --trajectory demo --payload 5 --html ur5.html",
            "view panda --section 8.1.3 --html mass_matrix.html",
        ),
    ),
    "plot": CommandText(
        "Pictures of a motion: causes of torques, power, phase planes.",
        ("plot ur5 --trajectory demo --payload 5 --what power --out power.png",),
    ),
    "move": CommandText(
        "A motion from one configuration to another, also the fastest.",
        (
            "move ur5 --to 0.9,-0.9,1.0,-0.4,1.2,1.0 --fastest",
            "move ur5 --from=-0.5,-1.9,1.9,-0.3,1.5,0 --by 0.1,0,-0.1 --csv move.csv",
        ),
    ),
    "derive": CommandText(
        "Equations of motion in symbols: text, LaTeX, C or NumPy.", ("derive planar_2r", "derive cart_pole --latex -")
    ),
    "convert": CommandText("Write the robot as URDF, MJCF or SDF.", ("convert panda panda.xml",)),
    "export": CommandText(
        "The robot's dynamics as C99 source.",
        ("export panda --c . --quantity inverse_dynamics --quantity mass_matrix",),
    ),
    "doctor": CommandText(
        "What is wrong with a robot file, and the repair.",
        ("doctor ur5", "doctor quadruped --page quadruped.html --json"),
    ),
    "identify": CommandText(
        "Masses, inertias and friction from logs.",
        ("identify my_arm.urdf log.csv --test other_log.csv --report report.html",),
    ),
    "excite": CommandText(
        "A motion whose log identifies the robot best.", ("excite panda --seconds 20 --harmonics 5 --out motion.csv",)
    ),
    "log": CommandText("What is in the log of a motion."),
    "log info": CommandText("Rates, gaps, and the range and noise of each column.", ("log info log.csv",)),
    "sensor compensate": CommandText(
        "Take weight, inertia and bias off a log; find contacts.", ("sensor compensate demo --sensor demo",)
    ),
    "sensor identify": CommandText(
        "Find mass, centre of mass and bias from a log.",
        ("sensor identify demo", "sensor identify demo --save hand.json"),
    ),
    "sensor poses": CommandText(
        "Propose the orientations to read next.", ("sensor poses", "sensor poses demo --count 3")
    ),
    "sensor": CommandText("Six-axis sensors: identify a tool, take its weight off readings."),
}


def about(command: str) -> dict[str, Any]:
    """Keyword arguments of click's decorators for a command, named by the words behind `twistwrench`."""
    summary, examples = _TEXTS[command]
    said = {"short_help": summary} if summary else {}
    if examples:
        lines = "\n".join(f"  twistwrench {line}" for line in examples)
        said["epilog"] = f"\b\nExamples:\n{lines}"
    return said
