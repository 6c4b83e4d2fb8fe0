"""Mechanics of MuJoCo that robots leave out: the remark on each, the same for files and for compiled models."""

from __future__ import annotations

from collections.abc import Mapping

LEFT_OUT: Mapping[str, str] = {
    "option/density": "fills the world with a fluid, whose forces are left out",
    "body/gravcomp": "is held against gravity (gravcomp), which is left out",
    "body/plugin": "is a plugin, whose forces are left out",
    "joint/damping": "has a damping that is a polynomial, of which the linear term alone is kept",
    "joint/stiffness": "has a stiffness that is a polynomial, of which the linear term alone is kept",
    "joint/springyield": "has a spring that yields (springyield), which is read as elastic",
    "ball/stiffness": "is a ball or free joint with a stiffness, which is left out",
    "ball/range": "is a ball joint with a limit, which is not kept",
    "actuator/unknown": "is not an actuator known here, and what it does is left out",
    "actuator/joint": "drives no hinge or slide, and what it does is left out",
    "actuator/damping": "has a damping that is a polynomial, of which the linear term alone is kept",
    "tendon/stiffness": "has a stiffness that is a polynomial, and its spring is left out",
    "tendon/springyield": "has a spring that yields (springyield), which is read as elastic",
    "deformable/flex": "is a deformable body, whose elastic forces are left out",
}
"""By element and attribute, as a file has them."""
