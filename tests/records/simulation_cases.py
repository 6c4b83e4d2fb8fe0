"""Robots of several files of records of simulations."""

from __future__ import annotations

ARM = """<robot name="arm">
<link name="ground"/>
<link name="upper"><inertial><origin xyz="0.11 -0.03 0.05"/><mass value="2.3"/>
 <inertia ixx="0.031" iyy="0.044" izz="0.027" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="slide"><inertial><origin xyz="-0.02 0.07 0.13"/><mass value="1.1"/>
 <inertia ixx="0.012" iyy="0.015" izz="0.009" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="waist" type="revolute"><parent link="ground"/><child link="upper"/><origin xyz="0.1 0.2 0.3"/>
 <axis xyz="0 0 1"/><limit lower="-1.125" upper="0.875" effort="3" velocity="2.5"/>
 <dynamics damping="0.4" friction="0.3"/></joint>
<joint name="reach" type="prismatic"><parent link="upper"/><child link="slide"/><origin xyz="0.3 0.05 -0.07"/>
 <axis xyz="1 0 0"/><limit lower="-0.25" upper="0.375" effort="8" velocity="1.25"/>
 <dynamics damping="2.1" friction="1.7"/></joint>
</robot>"""
"""A turning and a sliding joint, with friction and with limits that differ by side."""
