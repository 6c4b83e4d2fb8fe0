"""A small arm in which nothing is equal: tilted axes beside their frames' origins, a sliding joint, a joint beside the tip."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import twistwrench as tw


def packed(*arrays):
    """Size and weighted sums of all entries of arrays: short in a record, and least entries may differ by rounding."""
    entries = np.concatenate([np.ravel(np.asarray(array, float)) for array in arrays])
    finite = np.where(np.isfinite(entries), entries, 0.0)
    index = np.arange(1.0, len(entries) + 1.0)
    sums = [float(np.sin(k * index) @ finite) for k in (1.0, 1.7, 0.013)]
    return {"count": int(np.isfinite(entries).sum()), "size": float(np.abs(finite).sum()), "sums": sums}


LEANING = """<?xml version="1.0"?>
<robot name="leaning">
  <link name="plinth"/>
  <link name="pillar"><inertial><origin xyz="0.03 -0.05 0.21" rpy="0.2 -0.1 0.3"/><mass value="5.3"/>
    <inertia ixx="0.061" iyy="0.052" izz="0.033" ixy="0.004" ixz="-0.003" iyz="0.005"/></inertial></link>
  <link name="boom"><inertial><origin xyz="0.17 0.04 -0.02" rpy="-0.3 0.2 0.1"/><mass value="3.1"/>
    <inertia ixx="0.021" iyy="0.034" izz="0.043" ixy="0.003" ixz="0.002" iyz="-0.004"/></inertial></link>
  <link name="arm"><inertial><origin xyz="0.13 0.02 0.05" rpy="0.1 0.4 -0.2"/><mass value="1.7"/>
    <inertia ixx="0.011" iyy="0.017" izz="0.014" ixy="-0.001" ixz="0.002" iyz="0.003"/></inertial></link>
  <link name="claw"><inertial><origin xyz="0.01 0.02 0.03"/><mass value="0.2"/>
    <inertia ixx="0.001" iyy="0.002" izz="0.0015" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="hand"><inertial><origin xyz="0.02 -0.03 0.06" rpy="0.5 0.1 -0.4"/><mass value="0.6"/>
    <inertia ixx="0.003" iyy="0.004" izz="0.0025" ixy="0.0002" ixz="-0.0003" iyz="0.0001"/></inertial></link>
  <link name="tool"/>
  <joint name="waist" type="revolute"><parent link="plinth"/><child link="pillar"/>
    <origin xyz="0.05 -0.11 0.32" rpy="0.12 -0.2 0.4"/><axis xyz="0.1 -0.2 0.9"/>
    <limit lower="-2.6" upper="2.2" effort="90" velocity="2.1"/></joint>
  <joint name="slide" type="prismatic"><parent link="pillar"/><child link="boom"/>
    <origin xyz="0.12 0.07 0.41" rpy="-0.3 0.1 0.2"/><axis xyz="-0.8 0.15 0.2"/>
    <limit lower="-0.45" upper="0.25" effort="200" velocity="0.9"/></joint>
  <joint name="elbow" type="revolute"><parent link="boom"/><child link="arm"/>
    <origin xyz="0.36 -0.04 0.09" rpy="0.5 0.3 -0.6"/><axis xyz="0.15 -0.9 0.3"/>
    <limit lower="-1.9" upper="2.4" effort="40" velocity="3.1"/></joint>
  <joint name="finger" type="prismatic"><parent link="arm"/><child link="claw"/>
    <origin xyz="0.1 0.2 0.05" rpy="0.2 0.1 0.3"/><axis xyz="0 1 0"/>
    <limit lower="-0.02" upper="0.05" effort="15" velocity="0.3"/></joint>
  <joint name="bend" type="revolute"><parent link="arm"/><child link="hand"/>
    <origin xyz="0.29 0.06 -0.05" rpy="-0.2 0.4 0.7"/><axis xyz="0.85 0.3 -0.2"/>
    <limit lower="-2.8" upper="2.5" effort="12" velocity="4.2"/></joint>
  <joint name="flange" type="fixed"><parent link="hand"/><child link="tool"/>
    <origin xyz="0.07 0.11 0.16" rpy="0.3 -0.5 0.2"/></joint>
</robot>
"""
"""Robot file: the tip of the chain is not the only leaf, so it must be named."""
OFFSETS = {"waist": (0.04, 0.06, -0.02), "elbow": (-0.03, 0.05, 0.07), "bend": (0.02, -0.06, 0.05)}
"""Points on the axes of the turning joints, each in its joint's frame."""


def leaning_arm():
    """Robot of the file."""
    return tw.load(LEANING)


def offset_arm():
    """The same robot with its axes beside the origins of the joints' frames, as MJCF files have them."""
    model = leaning_arm().model
    bodies = list(model.bodies)
    for i, body in enumerate(bodies):
        point = OFFSETS.get(body.joint.name)
        if point is None:
            continue
        w = body.joint.axes[0, :3]
        axes = np.concatenate([w, np.cross(point, w)])[None]
        bodies[i] = replace(body, joint=replace(body.joint, axes=axes))
    return tw.Robot(replace(model, bodies=tuple(bodies)))


SHORT = """<?xml version="1.0"?>
<robot name="short">
  <link name="plinth"/>
  <link name="pillar"><inertial><origin xyz="0.03 -0.05 0.21" rpy="0.2 -0.1 0.3"/><mass value="5.3"/>
    <inertia ixx="0.061" iyy="0.052" izz="0.033" ixy="0.004" ixz="-0.003" iyz="0.005"/></inertial></link>
  <link name="boom"><inertial><origin xyz="0.17 0.04 -0.02" rpy="-0.3 0.2 0.1"/><mass value="3.1"/>
    <inertia ixx="0.021" iyy="0.034" izz="0.043" ixy="0.003" ixz="0.002" iyz="-0.004"/></inertial></link>
  <link name="arm"><inertial><origin xyz="0.13 0.02 0.05" rpy="0.1 0.4 -0.2"/><mass value="1.7"/>
    <inertia ixx="0.011" iyy="0.017" izz="0.014" ixy="-0.001" ixz="0.002" iyz="0.003"/></inertial></link>
  <link name="grip"><inertial><origin xyz="0.02 -0.03 0.06" rpy="0.5 0.1 -0.4"/><mass value="0.6"/>
    <inertia ixx="0.003" iyy="0.004" izz="0.0025" ixy="0.0002" ixz="-0.0003" iyz="0.0001"/></inertial></link>
  <joint name="waist" type="revolute"><parent link="plinth"/><child link="pillar"/>
    <origin xyz="0.05 -0.11 0.32" rpy="0.9 -0.4 0.4"/><axis xyz="0.1 -0.2 0.9"/>
    <limit lower="-2.6" upper="2.2" effort="90" velocity="2.1"/></joint>
  <joint name="slide" type="prismatic"><parent link="pillar"/><child link="boom"/>
    <origin xyz="0.12 0.07 0.41" rpy="-0.3 0.1 0.2"/><axis xyz="-0.8 0.15 0.2"/>
    <limit lower="-0.45" upper="0.25" effort="200" velocity="0.9"/></joint>
  <joint name="elbow" type="revolute"><parent link="boom"/><child link="arm"/>
    <origin xyz="0.36 -0.04 0.09" rpy="0.5 0.3 -0.6"/><axis xyz="0.15 -0.9 0.3"/>
    <limit lower="-1.9" upper="2.4" effort="40" velocity="3.1"/></joint>
  <joint name="flange" type="fixed"><parent link="arm"/><child link="grip"/>
    <origin xyz="0.07 0.11 0.16" rpy="0.3 -0.5 0.2"/></joint>
</robot>
"""
"""Three joints, one of them slides, and a fixed link with a mass of its own."""


def short_arm():
    """Robot of the short file."""
    return tw.load(SHORT)


VISCOUS = np.array([1.3, 7.0, 0.45])
COULOMB = np.array([2.1, 5.5, 0.8])
INERTIA = np.array([0.31, 1.9, 0.12])
OFFSET = np.array([0.35, -1.2, 0.22])
FREQUENCIES = np.array([[0.23, 0.71, 1.13], [0.31, 0.59, 1.37], [0.19, 0.83, 1.51]])
"""Three sines of each joint [Hz]."""
AMPLITUDES = np.array([[0.8, -0.35, 0.12], [0.13, 0.06, -0.03], [0.6, 0.4, -0.15]])


def states_at(time):
    """Positions, velocities and accelerations of the short arm: sums of sines, different for each joint."""
    w = 2 * np.pi * FREQUENCIES
    angles = np.multiply.outer(time, w) + np.array([[0.3, 1.1, 2.0], [0.7, 0.1, 1.6], [1.9, 0.4, 0.9]])
    q = (AMPLITUDES * np.sin(angles)).sum(axis=2)
    dq = (AMPLITUDES * w * np.cos(angles)).sum(axis=2)
    ddq = -(AMPLITUDES * w**2 * np.sin(angles)).sum(axis=2)
    return q, dq, ddq


def torques_at(robot, time, *, mass=1.0):
    """Torques of the short arm with friction, motor inertias, offsets, and a fast ripple in place of noise."""
    q, dq, ddq = states_at(time)
    tau = mass * np.asarray(robot.inverse_dynamics(q, dq, ddq))
    tau = tau + VISCOUS * dq + COULOMB * np.tanh(dq / 0.03) + INERTIA * ddq + OFFSET
    ripple = np.sin(np.multiply.outer(time, [37.0, 41.0, 53.0])) + 0.7 * np.sin(
        np.multiply.outer(time, [19.3, 23.1, 29.7]) ** 1.1
    )
    return tau + ripple * np.array([0.4, 0.9, 0.15])
