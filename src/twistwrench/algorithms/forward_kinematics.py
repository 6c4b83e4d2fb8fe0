"""Where the frames are: products of joint poses along the tree. Modern Robotics chapter 4."""

from __future__ import annotations

import numpy as np

from ..model.model import BASE, Model
from ..typing import Array
from .recursion import ancestors, base_poses, joint_poses


def forward_kinematics(model: Model, q: Array, frame: str) -> Array:
    """T_s,frame; (4, 4)."""
    place = model.frame(frame)
    T = joint_poses(model, q)
    X = place.pose
    for i in ancestors(model, place.body):
        X = T[i] @ X
    return np.asarray(X)


def link_poses(model: Model, q: Array) -> Array:
    """T_s,link of every link, in the order of the model's frames; (nlinks, 4, 4)."""
    T_s = base_poses(model, joint_poses(model, q))
    return np.stack([f.pose if f.body == BASE else T_s[f.body] @ f.pose for f in model.frames.values()])
