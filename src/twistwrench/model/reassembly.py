"""The model of an outline: the way back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .actuation import with_actuators
from .assembly import assemble
from .default_tip import default_tip
from .friction import Friction
from .mimic import find_drives
from .model import Model
from .outline import Outline
from .tree import find_tree


def assembled(found: Outline) -> Model:
    """The model of an outline: the way back. Nothing is judged again, and nothing is said of it.

    >>> import twistwrench as tw
    >>> from twistwrench.model.outline import outline
    >>> arm = tw.robots.ur5().model
    >>> assembled(outline(arm)).joint_names == arm.joint_names
    True
    """
    tree = find_tree(found.links, found.joints)
    model = assemble(
        found.name,
        found.links,
        tree,
        find_drives(found.joints),
        floating_base=found.floating,
        snap=found.snap,
        gravity=found.gravity,
        source=found.source,
        additions=found.additions,
    )
    armature = [found.armature[name] for name in model.joint_names]
    model = replace(model, armature=np.concatenate([np.zeros(0), *armature]), payloads=found.payloads)
    model = with_actuators(model, found.actuators)
    laws = [found.friction[name] for name in model.joint_names]  # of motors too
    columns = {
        what: np.concatenate([np.zeros(0), *(getattr(law, what) for law in laws)]) for what in vars(model.friction)
    }
    return replace(model, friction=Friction(**columns), tip=default_tip(model))
