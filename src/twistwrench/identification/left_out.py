"""A robot without some of the links that its file has."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from ..bodies.inertia import SpatialInertia
from ..errors import UnknownNameError
from ..model.model import BASE
from ..robot import Robot


def without_links(robot: Robot, links: Iterable[str]) -> Robot:
    """Robot whose log was made without some of the links of its file, such as a hand; their frames stay.

    Parameters
    ----------
    robot : Robot
    links : iterable of str, links that a joint carries

    Returns
    -------
    robot : Robot

    Raises
    ------
    UnknownNameError
        There is no such link, or it does not move.

    Examples
    --------
    >>> import twistwrench as tw
    >>> arm = tw.robots.panda()
    >>> bare = without_links(arm, ["panda_hand"])
    >>> round(sum(b.inertia.mass for b in arm.model.bodies) - sum(b.inertia.mass for b in bare.model.bodies), 6)
    0.73
    """
    model = robot.model
    bodies, own = list(model.bodies), dict(model.link_inertias)
    moving = [name for name, frame in model.frames.items() if frame.body != BASE and name in own]
    for link in links:
        if link not in moving:
            raise UnknownNameError.of("link that moves", link, moving)
        frame = model.frames[link]
        body = bodies[frame.body]
        bodies[frame.body] = replace(body, inertia=body.inertia - own[link].in_frame(frame.pose))
        own[link] = SpatialInertia.zero()
    return Robot(replace(model, bodies=tuple(bodies), link_inertias=own))
