"""Robots and motions that several records of reports share."""

from __future__ import annotations

import functools
import warnings

import numpy as np

import twistwrench as tw
from twistwrench.core.answers.blocks import Branch, Table
from twistwrench.core.errors import ModelWarning

GRAVITY = (1.3, -2.1, -9.2)


def _link(name, mass, com, moments):
    ixx, iyy, izz, ixy, ixz, iyz = moments
    return (
        f'<link name="{name}"><inertial><origin xyz="{com}" rpy="0.2 -0.1 0.3"/><mass value="{mass}"/>'
        f'<inertia ixx="{ixx}" iyy="{iyy}" izz="{izz}" ixy="{ixy}" ixz="{ixz}" iyz="{iyz}"/></inertial></link>'
    )


def _joint(name, kind, parent, child, place, axis, limits, friction, extra=""):
    lower, upper, effort, velocity = limits
    viscous, coulomb = friction
    bound = "" if lower is None else f'lower="{lower}" upper="{upper}" '
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{place[0]}" rpy="{place[1]}"/><axis xyz="{axis}"/>{extra}'
        f'<limit {bound}effort="{effort}" velocity="{velocity}"/>'
        f'<dynamics damping="{viscous}" friction="{coulomb}"/></joint>'
    )


CRANE = "".join([
    '<robot name="crane">',
    _link("post", 11.5, "0.02 -0.03 0.1", (0.21, 0.17, 0.13, 0.011, -0.007, 0.013)),
    _link("turret", 6.2, "0.07 0.04 -0.05", (0.061, 0.052, 0.047, 0.004, -0.003, 0.005)),
    _link("jib", 3.9, "0.21 -0.05 0.03", (0.022, 0.094, 0.089, 0.003, 0.006, -0.002)),
    _link("slider", 1.7, "-0.04 0.06 0.11", (0.013, 0.017, 0.009, -0.001, 0.0012, 0.0007)),
    _link("claw_b", 0.43, "0.03 0.01 0.02", (0.0011, 0.0014, 0.0009, 0.0001, -0.0002, 0.00005)),
    _link("claw_a", 0.31, "0.02 -0.015 0.025", (0.0007, 0.0012, 0.0008, 0.00007, -0.0001, 0.00003)),
    '<link name="hook"/><joint name="hang" type="fixed"><parent link="slider"/><child link="hook"/>'
    '<origin xyz="0.05 -0.08 0.17" rpy="0.3 0.2 -0.4"/></joint>',
    '<link name="eye"/><joint name="bore" type="fixed"><parent link="post"/><child link="eye"/>'
    '<origin xyz="0.1 0.05 0.3"/></joint>',
    _joint("swivel", "revolute", "post", "turret", ("0.03 -0.02 0.4", "0.1 -0.2 0.3"), "0.1 -0.2 0.95",
           (-2.9, 2.4, 61, 2.3), (1.3, 2.1)),
    _joint("luff", "revolute", "turret", "jib", ("0.11 0.05 0.13", "-1.4 0.2 0.1"), "0.05 0.1 0.98",
           (-1.1, 1.7, 47, 1.9), (0.9, 1.4)),
    _joint("boom", "prismatic", "jib", "slider", ("0.37 0.02 -0.04", "0.2 1.3 0.1"), "0.1 0.05 0.99",
           (-0.15, 0.42, 83, 0.7), (12, 6.5)),
    _joint("pinch_b", "prismatic", "slider", "claw_b", ("0.06 0.02 0.2", "0.1 0 0.2"), "0 1 0.1",
           (-0.01, 0.05, 29, 0.21), (3, 0.8)),
    _joint("pinch_a", "prismatic", "slider", "claw_a", ("0.06 -0.03 0.2", "0.1 0 0.25"), "0 -1 0.1",
           (-0.02, 0.07, 17, 0.19), (0, 0), '<mimic joint="pinch_b" multiplier="1.2" offset="0.003"/>'),
    "</robot>",
])  # fmt: skip
"""A revolute pair, a boom that slides, and a gripper of which one finger follows the other; the tip is the hook."""
LEGS = ((1.1, 0.31, (0.33, 0.02), 0.02), (1.2, 0.27, (-0.21, 0.25), -0.03), (1.3, 0.29, (-0.17, -0.28), 0.05))
"""Mass of the thigh, of the shank, place of the hip and lean of the foot of each leg of the tripod."""
TRIPOD = "".join([
    '<robot name="tripod">',
    _link("hull", 4.1, "0.03 -0.02 0.05", (0.1, 0.2, 0.15, 0.011, -0.007, 0.003)),
    *(
        _link(f"thigh{k}", m, "0.02 0.01 -0.17", (0.012, 0.011, 0.003, 0.0002, 0.0001, -0.0001))
        + _link(f"shank{k}", n, "-0.01 0.02 -0.15", (0.003, 0.0032, 0.0007, 0.0001, 0.0002, -0.0001))
        + f'<link name="foot{k}"/><joint name="sole{k}" type="fixed"><parent link="shank{k}"/><child link="foot{k}"/>'
        f'<origin xyz="{lean} 0 -0.32"/></joint>'
        + _joint(f"hip{k}", "revolute", "hull", f"thigh{k}", (f"{place[0]} {place[1]} 0", "0 0 0"), "0 1 0",
                 (-1.2, 1.3 + 0.1 * k, 31 + 7 * k, 5), (0.1, 0.2))
        + _joint(f"knee{k}", "revolute", f"thigh{k}", f"shank{k}", ("0.01 0 -0.35", "0 0 0"), "0 1 0",
                 (-1.9, 0.4, 27 - 4 * k, 6), (0.1, 0.1))
        for k, (m, n, place, lean) in enumerate(LEGS)
    ),
    '<link name="mast"/><joint name="on_top" type="fixed"><parent link="hull"/><child link="mast"/><origin xyz="0.1 0.05 0.2"/></joint>',
    "</robot>",
])  # fmt: skip
"""Three legs of two joints that hang below a hull, each with its own masses and limits."""
AMPLITUDES = np.array([0.7, -0.5, 0.11, 0.012])
MIDDLES = np.array([0.2, 0.35, 0.1, 0.018])
RATES = np.array([2.1, 2.9, 3.7, 4.3])
PHASES = np.array([0.4, 1.1, 2.3, 3.1])


def quietly(call):
    """A call without its warnings."""

    def quiet(*arguments, **options):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ModelWarning)
            return call(*arguments, **options)

    return quiet


@functools.cache
def crane():
    return quietly(tw.load)(CRANE, gravity=GRAVITY, tip="hook")


@functools.cache
def tripod():
    return quietly(tw.load)(TRIPOD, tip="mast")


def uneven(rows, step=0.02):
    """Times with steps that vary by a third."""
    return np.cumsum(step * (1 + 0.3 * np.sin(1.7 * np.arange(rows))))


def swing(t, scale=1.0):
    """Positions, velocities and accelerations of sines."""
    phase = np.outer(t, RATES) + PHASES
    a = AMPLITUDES * scale
    return MIDDLES + a * np.sin(phase), a * RATES * np.cos(phase), -a * RATES**2 * np.sin(phase)


def motion(rows=23, scale=1.0, tau=None):
    t = uneven(rows)
    q, dq, ddq = swing(t, scale)
    return tw.Motion(t, q, dq, ddq, tau, robot=crane(), in_seconds=True)


def write_log(path, t, columns, heads):
    """A CSV file of the times and columns."""
    table = np.column_stack([t, *columns])
    header = ",".join(["time", *heads])
    np.savetxt(path, table, "%.9g", ",", header=header, comments="")
    return path


def heads(robot, *endings):
    return [f"{name}{ending}" for ending in endings for name in robot.coordinate_names]


# ── Answers in few characters


def styled(pieces):
    """Text with the styles of its pieces in angle brackets."""
    texts = []
    for piece in pieces:
        text, style = (piece, "") if isinstance(piece, str) else piece
        texts.append(f"‹{style}›{text}" if style and text else text)
    return "".join(texts)


def cell(content):
    return content if isinstance(content, str) else styled(content.pieces)


def column_of(column):
    values = [getattr(value, "value", None) if not isinstance(value, float | int) else value for value in column.values]
    shown = {
        "unit": column.unit,
        "cells": [cell("" if value is None else column.show(value)) for value in column.values],
        "look": [column.headed, column.words, column.whole, column.min_width, str(column.style), column.wide_only],
    }
    if any(value is not None for value in values):
        shown["values"] = values
    if column.limits is not None:
        shown["limits"] = list(column.limits)
    if column.narrow is not None:
        shown["narrow"] = column_of(column.narrow)
    return shown


def shown(blocks):
    """Blocks of an answer with their styles and all digits."""
    result = []
    for block in blocks:
        if isinstance(block, str):
            result.append(block)
        elif isinstance(block, Table):
            look = [str(block.style), int(block.level), block.most, block.of_limits, [str(s) for s in block.styles]]
            columns = {column.head: column_of(column) for column in block.columns}
            result.append({"title": block.heading, "look": look, "by": block.by, "columns": columns})
        elif isinstance(block, Branch):
            result.append(_branch(block))
        else:
            extra = [getattr(block, "do", ""), getattr(block, "reading", False), int(getattr(block, "level", 0))]
            result.append([type(block).__name__, styled(block.pieces), extra])
    return result


def _branch(block):
    return {"label": styled(block.label.pieces), "branches": [_branch(branch) for branch in block.branches]}


def said(answer):
    """Sentences, reasons, remedies and notes of an answer, and its tables in rows."""
    data = answer.to_dict()
    tables = {}
    for table in data.pop("tables"):
        heads = [f"{column['name']} [{column['unit']}]" for column in table["columns"]]
        tables[table["title"]] = [heads, *table["rows"]]
    for key in ("schema", "version", "call", "robot"):
        data.pop(key)
    return data | {"tables": tables}


def words_of(answer):
    """Sentences, reasons and remedies of an answer."""
    data = answer.to_dict()
    return {key: data[key] for key in ("sentences", "reasons", "remedies", "notes", "exit_code")}


def fields_of(value, *names):
    return {name: getattr(value, name) for name in names}
