"""A small arm in which nothing is equal: tilted axes beside their frames' origins, a sliding joint, a joint beside the tip."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import twistwrench as tw

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
