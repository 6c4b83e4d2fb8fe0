"""Robot files that nobody here wrote: each loads or is refused by name, and agrees with Pinocchio where it reads it too.

They lie outside the repository, beside it; without them these tests skip.
"""

from __future__ import annotations

import warnings
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from places import SHARED

from twistwrench.core.errors import InertiaError, MissingExtraError, ModelError, ModelWarning, RobotFileError
from twistwrench.formats import load_model
from twistwrench.mechanics.bodies.inertia import SpatialInertia
from twistwrench.mechanics.model.model import Model

FOLDER = SHARED / "robots"
FILES = {path.stem: path for path in sorted(FOLDER.rglob("*.urdf"))} or {
    "none": pytest.param(None, marks=pytest.mark.skip(reason="no robot files in ../shared/robots"))
}

REFUSED = {
    "biped2d_decl_not_first": (ModelError, "reversed limits"),
    "dfki_double_pendulum_no_world": (ModelError, "no link named 'world'"),
    "drake_joint_parsing_test": (RobotFileError, "<dynamics> of joint 'planar_joint'"),
    "eve_r3_min_effort": (ModelError, "velocity=-1"),
    "humanoid_pybullet_crlf_bad": (RobotFileError, "line 288, column 0"),
    "one_link_arm_no_world": (ModelError, "no link named 'world'"),
    "pendulum_tendon_cart_rail": (ModelError, "reversed limits"),
    "ros_fail_pr2_desc_double": (ModelError, "two links are called 'fl_caster_rotation_link'"),
    "ros_fail_pr2_desc_loop": (ModelError, "form a cycle"),
    "ros_fail_pr2_desc_parent_itself": (ModelError, "its own child"),
    "ros_fail_three_links_one_joint": (RobotFileError, "line 1, column 6"),
    "spherical_joint_limit": (RobotFileError, "unknown type 'spherical'"),
    "valkyrie_sim": ((RobotFileError, MissingExtraError), "xacro:v1_pelvis_sensors_usb"),  # a macro of another file
}
"""Files that no option makes loadable, and the reason that must be named."""

IMPOSSIBLE = {
    "atlas_drc_sdformat",
    "franka_panda_curobo_nonpsd",
    "kuka_iiwa7_allegro",
    "robotiq_3f",
    "robotiq_tendons",
    "two_joint_fixed",
    "ufactory_xarm6",
}
"""Files with moving bodies that cannot exist, which load with ``inertia="accept"`` or ``"repair"``."""


def load(path: Path, **options: object) -> Model:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        return load_model(path, **options)  # type: ignore[arg-type]


every_file = pytest.mark.parametrize("path", FILES.values(), ids=FILES.keys())
every_readable_file = pytest.mark.parametrize(
    "path", [path for name, path in FILES.items() if name not in REFUSED], ids=[n for n in FILES if n not in REFUSED]
)


@every_file
def test_every_file_loads_or_is_refused_by_reason(path):
    if path.stem in REFUSED:
        error, reason = REFUSED[path.stem]
        with pytest.raises(error, match=path.name) as caught:
            load(path, inertia="accept")
        assert reason in str(caught.value)
        return
    if path.stem in IMPOSSIBLE:
        with pytest.raises(InertiaError, match="cannot exist"):
            load(path)
        assert not any(body.inertia.defects() for body in load(path, inertia="repair").bodies)
    model = load(path, inertia="accept" if path.stem in IMPOSSIBLE else "error")
    assert model.nv > 0 or path.stem == "crazyflie_cf2x"


@every_readable_file
def test_joints_and_bodies_agree_with_pinocchio(path):
    theirs = pinocchio_model(path)
    ours = load(path, mimic="independent", inertia="accept", snap=0)
    assert ours.nv == theirs.nv
    assert {body.joint.name for body in ours.bodies} == set(theirs.names) - {"universe"}
    for body in ours.bodies:
        j = theirs.getJointId(body.joint.name)
        parent = "universe" if body.parent < 0 else ours.bodies[body.parent].joint.name
        assert theirs.names[theirs.parents[j]] == parent
        close(body.placement, theirs.jointPlacements[j].homogeneous)
        same_inertia(body.inertia, theirs.inertias[j])
    same_inertia(ours.base_inertia, theirs.inertias[0])


@every_readable_file
def test_link_frames_agree_with_pinocchio(path):
    pinocchio = pytest.importorskip("pinocchio", reason="Pinocchio is not installed")
    theirs = pinocchio_model(path)
    ours = load(path, mimic="independent", inertia="accept", snap=0)
    for name, frame in ours.frames.items():
        f = theirs.frames[theirs.getFrameId(name, pinocchio.FrameType.BODY)]
        joint = "universe" if frame.body < 0 else ours.bodies[frame.body].joint.name
        assert theirs.names[f.parentJoint] == joint
        close(frame.pose, f.placement.homogeneous)


@every_readable_file
def test_following_mimics_keeps_every_link_and_its_mass(path):
    follow, independent = [load(path, mimic=m, inertia="accept") for m in ("follow", "independent")]
    assert follow.nv == independent.nv - sum(body.follows for body in follow.bodies)
    assert list(follow.frames) == list(independent.frames)
    total = [sum(b.inertia.mass for b in model.bodies) + model.base_inertia.mass for model in (follow, independent)]
    assert total[0] == pytest.approx(total[1], rel=1e-12)


def close(a: object, b: object, scale: float = 1.0) -> None:
    # 1e-10: both sides do the same few dozen operations in another order, and Pinocchio's rpy goes through quaternions.
    assert np.abs(np.asarray(a) - np.asarray(b)).max() <= 1e-10 * scale


def same_inertia(ours: SpatialInertia, theirs: object) -> None:
    m, c, I = theirs.mass, theirs.lever, theirs.inertia  # type: ignore[attr-defined]
    close(ours.mass, m, max(1.0, m))
    close(ours.first_moment, m * c, max(1.0, m))
    close(ours.moment_about_com, I, max(1.0, np.abs(I).max()))


@cache
def pinocchio_model(path: Path) -> object:
    pinocchio = pytest.importorskip("pinocchio", reason="Pinocchio is not installed", exc_type=ImportError)
    try:
        return pinocchio.buildModelFromUrdf(str(path))
    except ValueError:
        pytest.skip("Pinocchio does not read this file")
