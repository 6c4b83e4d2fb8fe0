"""Moving links that ought to have a mass and have none: their weight is missing from every torque."""

from __future__ import annotations

from .model import BASE, Body, Model


def massless_links(model: Model) -> tuple[str, ...]:
    """The moving links without mass that must stand for something real, in document order.

    A moving body, with all links fixed to it, that has neither mass nor moments is named

    * if nothing that it carries has a mass either: its joint then moves nothing;
    * if it has a shape in the file (``model.shaped``): what can be seen has a weight;
    * if no link of the file has a shape, and the next joint stands away from its own: something has to reach there.

    Other massless bodies join several joints to one, such as the three of a ball joint or those of a base that slides
    and turns, and are left alone. So are bodies with moments and no mass, such as rotors whose mass is counted with
    their housing. A massless frame on a fixed joint is part of the body it is fixed to.

    Parameters
    ----------
    model
        The robot's model, fixed links fused.

    Returns
    -------
    tuple of str
        The links' names; empty where every moving body has what it needs.

    Examples
    --------
    >>> from twistwrench.model.builder import ModelBuilder
    >>> builder = ModelBuilder("swing")
    >>> builder.add_link("base")
    >>> builder.add_link("rod")
    >>> builder.add_joint("hinge", "revolute", "base", "rod", axis=(0, 1, 0))
    >>> massless_links(builder.build())
    ('rod',)
    """
    n = len(model.bodies)
    has = [_has_inertia(body) for body in model.bodies]
    carries, reaches, shaped = list(has), [False] * n, [False] * n
    for i in reversed(range(n)):  # parents come before children
        body = model.bodies[i]
        if body.parent != BASE:
            carries[body.parent] |= carries[i]
            reaches[body.parent] |= _stands_away(body)
    for link, frame in model.frames.items():
        if link in model.shaped and frame.body != BASE:
            shaped[frame.body] = True
    real = shaped if model.shaped else reaches
    named = {body.link for i, body in enumerate(model.bodies) if not has[i] and (not carries[i] or real[i])}
    return tuple(link for link in model.frames if link in named)


def _has_inertia(body: Body) -> bool:
    return bool(body.inertia.parameters.any())


def _stands_away(body: Body) -> bool:
    """Whether the joint of a body is displaced from its parent's origin, by more than rounding of a rotation."""
    return max(map(abs, body.placement[:3, 3].tolist())) > 1e-9
