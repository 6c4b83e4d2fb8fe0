"""Inverse kinematics: searches, remaining errors, reasons and branches on record."""

from __future__ import annotations

import warnings
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from recorded_answers import Records, refusal

import twistwrench as tw

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)


def joint_text(name, kind, parent, child, xyz, rpy, axis, limits="", more=""):
    bounds = f'<limit lower="{limits[0]}" upper="{limits[1]}" velocity="3" effort="90"/>' if limits else ""
    mass = f'<link name="{child}"><inertial><mass value="1"/><inertia ixx="1" iyy="1.1" izz="1.2" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    return f"""{mass}<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
    <origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>{bounds}{more}</joint>"""


WRISTED = f"""<robot name="wristed"><link name="foot"/>
{joint_text("waist", "revolute", "foot", "l1", "0.05 0.02 0.3", "0 0 0.1", "0 0 1", (-2.9, 2.7))}
{joint_text("shoulder", "revolute", "l1", "l2", "0.1 0 0.15", "0 0 0", "0 1 0", (-1.9, 2.1))}
{joint_text("elbow", "revolute", "l2", "l3", "0 0 0.6", "0 0 0", "0 1 0", (-2.4, 2.5))}
{joint_text("roll", "continuous", "l3", "l4", "0.3 0 0.05", "0 0 0", "1 0 0")}
{joint_text("pitch", "revolute", "l4", "l5", "0.25 0 0", "0 0 0", "0 1 0", (-1.8, 2.0))}
{joint_text("flange", "revolute", "l5", "tool", "0.1 0 0", "0.1 0 0", "1 0 0", (-7.0, 7.5))}
</robot>"""

STAND = f"""<robot name="stand"><link name="foot"/>
{joint_text("lift", "prismatic", "foot", "column", "0.1 0 0.2", "0.1 0 0", "0 0 1", (-0.2, 0.7))}
{joint_text("swing", "revolute", "column", "boom", "0.1 0.05 0.3", "0 0.2 0", "0.1 1 0.2", (-1.4, 1.2))}
{joint_text("left", "revolute", "boom", "left_hand", "0.4 0.2 0.1", "0.3 0 0", "0 0.3 1", (-1.5, 1.6))}
{joint_text("right", "revolute", "boom", "right_hand", "0.35 -0.3 0.05", "0 0.1 0.4", "1 0.2 0", (-1.3, 1.7))}
{joint_text("copy", "revolute", "left_hand", "finger", "0.1 0.05 0.2", "0 0.1 0.4", "0 1 0", (-9, 9), '<mimic joint="left" multiplier="-0.5" offset="0.1"/>')}
</robot>"""

BALL = """<mujoco model="pendulum"><worldbody><body name="bob" pos="0 0 1"><inertial pos="0.2 0 -0.5" mass="2" diaginertia="0.5 0.3 0.4"/>
  <joint name="socket" type="ball"/><body name="pin" pos="0.1 0.2 -0.6"><inertial pos="0.1 0 0" mass="1" diaginertia="0.1 0.1 0.1"/>
  <joint name="reach" type="slide" axis="1 0 2" range="-0.1 0.4"/><site name="hook" pos="0 0.1 -0.2"/></body></body></worldbody></mujoco>"""


@cache
def wristed():
    return tw.load(WRISTED)


@cache
def stand():
    return tw.load(STAND)


@cache
def ball():
    return tw.load(BALL)


Q = np.array([[0.4, 0.5, 0.9, 0.7, 0.6, -0.8], [-0.9, 0.3, 1.2, -0.5, -0.7, 1.1]])


def shown(found):
    """All of a result; remaining errors, which rounding makes, by their size."""

    def size(x):
        return np.where(np.asarray(x) < 1e-8, 0.0, x)

    return {
        "text": str(found) if not np.all(found.converged) or found.converged.ndim else "reached",
        "repr": repr(found)[:20],
        "q": found.q,
        "converged": found.converged,
        "angle": size(found.angle),
        "distance": size(found.distance),
        "gap": size(found.gap),
        "starts": found.starts,
        "held": found.held,
        "joints": found.joint_names,
        "rows": found.rows,
        "kind": str(found.q.dtype),
    }


def warned(call):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = call()
    return {"result": result, "warnings": [f"{w.category.__name__}: {w.message}" for w in caught]}


@records.of(relative=1e-5)
def poses_reached():
    arm = wristed()
    T = arm.forward_kinematics(Q)
    near = Q + np.array([0.1, -0.05, 0.08, -0.1, 0.07, 0.05])
    both = (
        stand().forward_kinematics([0.3, 0.4, 0.5, -0.6], "left_hand"),
        stand().forward_kinematics([0.3, 0.4, 0.5, -0.6], "right_hand"),
    )
    hook = ball().forward_kinematics([0.5, 0.5, -0.5, 0.5, 0.2], "hook")
    start = [0.25, 0.3, 0.4, -0.5]
    return {
        "near": shown(arm.inverse_kinematics(T, q0=near)),
        "one": shown(arm.inverse_kinematics(T[0], q0=near[0])),
        "one again": shown(arm.inverse_kinematics(T[0], q0=near[0])),
        "one for many": shown(arm.inverse_kinematics(T[1], q0=near)),
        "single precision": shown(arm.inverse_kinematics(T[0].astype(np.float32), q0=near[0].astype(np.float32))),
        "position": shown(arm.inverse_kinematics(T[0], q0=near[0], rows="vx vy vz")),
        "another frame": shown(
            arm.inverse_kinematics(arm.forward_kinematics(Q[0], "l4"), "l4", near[0], rows=(3, 4, 5, 1))
        ),
        "two hands": shown(stand().inverse_kinematics(both, ["left_hand", "right_hand"], start)),
        "two hands, rows": shown(
            stand().inverse_kinematics(
                both, ("left_hand", "right_hand"), start, rows={"left_hand": "vx vz", "right_hand": ["vy", "wx"]}
            )
        ),
        "one of a list": shown(stand().inverse_kinematics([both[0]], ["left_hand"], start, rows="vx vy vz")),
        "follower": shown(
            stand().inverse_kinematics(stand().forward_kinematics([0.3, 0.4, 0.5, -0.6], "finger"), "finger", start)
        ),
        "ball": shown(ball().inverse_kinematics(hook, "hook", [0.6, 0.4, -0.5, 0.5, 0.1])),
        "loose": arm.inverse_kinematics(T[0], q0=near[0], angle=0.01, distance=0.02).distance > 1e-9,
        "nearest": shown(arm.inverse_kinematics(T[0], q0=near[0], rows="vx vy vz wz", nearest=True)),
        "nearest of many": shown(arm.inverse_kinematics(T, q0=near[1], rows="vx vy vz wx", nearest=True)),
    }


@records.of(relative=1e-4)
def poses_searched_from_random_starts():
    arm = wristed()
    T = arm.forward_kinematics(Q[0])
    far = [-2.0, -1.5, -2.0, 0.0, -1.5, 3.0]
    found = {"neutral": [arm.inverse_kinematics(T).converged, arm.inverse_kinematics(T).q]}
    for rng in (0, 5):
        result = arm.inverse_kinematics(T, q0=far, rng=rng)
        found[f"rng {rng}"] = [result.converged, result.starts]
    found["few"] = [arm.inverse_kinematics(T, q0=far, restarts=k).starts for k in (0, 1, 2)]
    away = T.copy()
    away[:3, 3] = [3.0, 0.0, 0.5]
    found["many starts of no use"] = [
        arm.inverse_kinematics(away, restarts=k, rows="vx vy vz").starts for k in (0, 3, 70)
    ]
    return found


@records.of(relative=1e-4)
def poses_out_of_reach():
    arm, lift = wristed(), stand()
    T = arm.forward_kinematics(Q)
    T[0, :3, 3] += [1.5, 0.2, 0.1]
    found = {
        "one of two": [
            shown(arm.inverse_kinematics(T, q0=Q, restarts=2))["starts"],
            arm.inverse_kinematics(T, q0=Q, restarts=2).converged,
        ],
        "reason": [arm.inverse_kinematics(T, q0=Q, restarts=0).reason(k) for k in (0, 1)],
    }
    high = lift.forward_kinematics([0.3, 0.4, 0.5, -0.6], "boom")
    high[2, 3] += 1.0
    result = lift.inverse_kinematics(high, "boom", [0.3, 0.4, 0.5, -0.6], rows="vz", restarts=0)
    found["at a limit"] = [shown(result), result.reason()]
    corner = lift.forward_kinematics([0.6, 1.1, 0.5, -0.6], "boom") @ tw.se3.exp([0.02, 0.9, 0, 0, 0, 0.9])
    result = lift.inverse_kinematics(corner, "boom", [0.6, 1.1, 0.5, -0.6], restarts=0)
    found["at two limits"] = [result.held, result.reason()[:60], result.converged]
    bad = T.copy()
    bad[1, 0, 3] = np.nan
    result = arm.inverse_kinematics(bad, q0=Q, restarts=1)
    found["not a number"] = [
        result.reason(1),
        result.q[1],
        result.starts[1],
        result.converged,
        np.isnan(result.distance[1]),
    ]
    return found


@records.of(relative=1e-5)
def branches_of_a_pose():
    arm = wristed()
    T = arm.forward_kinematics(Q[0])
    found = arm.inverse_kinematics_branches(T, starts=48)
    wide = tw.load(WRISTED.replace('lower="-2.9" upper="2.7"', 'lower="-7" upper="7"'))
    again = wide.inverse_kinematics_branches(T, starts=48)
    planar = tw.robots.planar_2r()
    two = planar.inverse_kinematics_branches(planar.forward_kinematics([0.4, 0.9]), rows="vx vz wy", starts=12)
    place = planar.inverse_kinematics_branches(planar.forward_kinematics([0.4, 0.9]), rows="vx vy vz", starts=12)
    stretched = planar.forward_kinematics([0.4, 0.0])
    away = planar.forward_kinematics([0.4, 0.9])
    away[0, 3] += 5.0
    lift = stand()
    pose = lift.forward_kinematics([0.3, 0.4, 0.5, -0.6], "left_hand")
    return {
        "branches": found.q,
        "full turns left out": again.q,
        "two": [two.q, place.q, str(place)],
        "stretched": warned(lambda: planar.inverse_kinematics_branches(stretched, rows="vx vz", starts=9).q.shape),
        "none": planar.inverse_kinematics_branches(away, rows="vx vz", starts=5).q.shape,
        "loose": planar.inverse_kinematics_branches(
            planar.forward_kinematics([0.4, 0.9]), rows="vx vy vz", starts=12, angle=1e-4, distance=1e-4
        ).q.shape,
        "follower": lift.inverse_kinematics_branches(pose, "left_hand", rows="vx vy vz wz", starts=24).q,
        "refused": {
            "many joints": refusal(lambda: lift.inverse_kinematics_branches(pose, "left_hand", rows="vx vy vz")),
            "ball": refusal(lambda: ball().inverse_kinematics_branches(np.eye(4), "hook")),
            "poses": refusal(lambda: arm.inverse_kinematics_branches([T, T])),
            "not finite": refusal(lambda: arm.inverse_kinematics_branches(T * np.nan)),
            "starts": refusal(lambda: arm.inverse_kinematics_branches(T, starts=0)),
            "starts of a kind": refusal(lambda: arm.inverse_kinematics_branches(T, starts=2.5)),
            "rng": refusal(lambda: arm.inverse_kinematics_branches(T, rng="a")),
        },
    }


@records.of
def turns_that_are_left_out():
    from twistwrench.robot.inverse_kinematics import branches

    found = {}
    for label, robot in {"wristed": wristed(), "stand": stand()}.items():
        q = np.array([np.linspace(-6.0, 7.0, robot.nv), np.linspace(3.3, -3.1, robot.nv), np.full(robot.nv, 6.5)])
        found[label] = [
            branches._full_turn_mask(robot),
            branches._without_full_turns(robot, q),
            branches._difference_without_turns(robot, q, q[::-1]),
        ]
    return found


@records.of
def searches_refused():
    arm, lift = wristed(), stand()
    T = arm.forward_kinematics(Q[0])
    stone = tw.load('<robot name="stone"><link name="a"/></robot>')
    scaled = T.copy()
    scaled[:3, :3] *= 1.5
    calls = {
        "frame": lambda: arm.inverse_kinematics(T, "tol"),
        "frames": lambda: arm.inverse_kinematics([T, T], ["tool", 3]),
        "no frames": lambda: arm.inverse_kinematics([T, T], []),
        "frame twice": lambda: arm.inverse_kinematics([T, T], ["tool", "tool"]),
        "rows": lambda: arm.inverse_kinematics(T, rows="vx vq"),
        "rows of another": lambda: lift.inverse_kinematics([T, T], ["boom", "column"], rows={"bom": "vx"}),
        "rows of one": lambda: arm.inverse_kinematics(T, rows={"tool": "vx"}),
        "restarts": lambda: arm.inverse_kinematics(T, restarts=-1),
        "restarts half": lambda: arm.inverse_kinematics(T, restarts=1.5),
        "rng": lambda: arm.inverse_kinematics(T, rng="seed"),
        "negative seed": lambda: arm.inverse_kinematics(T, rng=-3),
        "angle": lambda: arm.inverse_kinematics(T, angle=0.0),
        "distance": lambda: arm.inverse_kinematics(T, distance=np.inf),
        "distance nan": lambda: arm.inverse_kinematics(T, distance=np.nan),
        "distance text": lambda: arm.inverse_kinematics(T, distance="1 mm"),
        "T": lambda: arm.inverse_kinematics(T[:3]),
        "T of many": lambda: lift.inverse_kinematics(T, ["boom", "column"]),
        "one of a list": lambda: lift.inverse_kinematics(T, ["boom"]),
        "no pose": lambda: arm.inverse_kinematics(scaled, restarts=0),
        "q0": lambda: arm.inverse_kinematics(T, q0=[1.0, 2.0]),
        "q0 not finite": lambda: arm.inverse_kinematics(T, q0=Q[0] * np.nan),
        "batches": lambda: arm.inverse_kinematics([T, T], q0=np.zeros((3, 6))),
        "still": lambda: stone.inverse_kinematics(np.eye(4), "a"),
        "no tip": lambda: lift.inverse_kinematics(T),
        "clearance": lambda: arm.inverse_kinematics(T, clearance=-0.1),
    }
    found = {}
    for label, call in calls.items():
        try:
            found[label] = str(call())[:60]
        except Exception as error:
            found[label] = f"{type(error).__name__}: {error}"
    return found


@records.of
def remaining_errors_and_reasons():
    from twistwrench.robot.inverse_kinematics.solve import IKResult, PoseRequest, clear_of_links, select_poses

    names = ("a", "b", "c")
    request = PoseRequest(names, ((0, 1, 2, 3, 4, 5), (4, 1)), 2)
    free = PoseRequest(names, ((3, 5, 0),))
    status = np.array(
        [
            [3.0, 0.0, 0.5, 0.3, -0.2, 0.4, 0.1, 0.2, -0.3, 0.7, -0.6, 2e-9, -5e-10, 0.0, 1.0, 0.0],
            [1.0, 1.0, 0.0, 1e-3, 2e-3, -1e-3, 3e-3, 0.0, 1e-3, 2e-3, 1e-3, 1e-12, 0.0, 1.0, 0.0, 1.0],
            [4.0, 0.0, 0.7, 0.3, -0.2, 0.4, 0.1, 0.2, -0.3, 0.7, -0.6, 9e-10, -5e-10, 1.0, 1.0, 0.0],
            [2.0, 0.0, 0.7, 0.0, 0.0, 0.0, 0.0, 0.2, np.nan, 0.7, -0.6, 9e-10, -5e-10, 0.0, 0.0, 0.0],
            [2.0, 0.0, 0.7, 0.1, 0.0, 0.0, 0.0, 0.2, 0.0, 0.7, -0.6, 0.0, 0.0, 0.0, 0.4, 0.0],
        ]
    )
    q = np.arange(15.0).reshape(5, 3)
    result = IKResult(q, status, request)
    short = IKResult(
        q[:2], np.array([[2.0, 0.0, 0.5, 0.3, 0.4, -0.2, 0, 1.0, 1.0], [1.0, 2.0, 0, 0.01, 0, 0, 0, 0, 0]]), free
    )
    some = select_poses(result, np.array([2, 0]), q[[2, 0]] + 0.5)

    def near(q):
        pair = ("l1", "tool")
        distance = np.abs(np.asarray(q)[..., 0] - 4.0) / 10.0 - 0.3
        return SimpleNamespace(distance=distance if np.ndim(distance) else float(distance), pair=pair)

    def search(target, starts):
        shift = float(target[0, 3])
        moved = starts + shift
        state = np.tile(status[1], (len(starts), 1))
        state[0, 1] = 0.0
        return IKResult(moved, state, request)

    reached = status.copy()
    reached[:, 1] = [1.0, 1.0, 0.0, 1.0, 1.0]
    targets = np.tile(np.eye(4), (5, 1, 1))
    targets[:, 0, 3] = [1.0, -2.0, 0.0, 0.5, 3.0]
    starts = np.array([[9.0, 0.1, 0.2], [6.5, 0.3, 0.1], [2.5, 0.7, -0.4], [12.0, 5.0, 1.0]])
    clear = {}
    for distance in (0.25, 0.05, 2.0):
        kept = clear_of_links(IKResult(q, reached, request), targets, search, near, distance, starts)
        clear[distance] = [kept.q, kept.converged, kept.starts, [kept.reason(k) for k in range(5)], kept.held]
    return {
        "angle": result.angle,
        "distance": result.distance,
        "gap": result.gap,
        "held": result.held,
        "starts": result.starts,
        "rows": [result.rows, short.rows],
        "reasons": [result.reason(k) for k in range(5)],
        "texts": [str(result), repr(result), str(short)],
        "of rows": [short.angle, short.distance, short.gap, short.held, short.reason(0), short.converged],
        "one": str(IKResult(q[1], status[1], request)),
        "one failed": str(IKResult(q[0], status[0], request)),
        "selected": [some.q, some.converged, some.angle],
        "kind": str(IKResult(q.astype(np.float32), status, request).angle.dtype),
        "clear": clear,
        "numbers": _search_numbers(),
    }


def _search_numbers():
    from twistwrench.robot.inverse_kinematics import branches, search, solve

    return [
        search.STEPS, search.POSTURE_STEPS, search.FIRST_LOOK, search.AT_ONCE, search.MIN_POSES_AT_ONCE,
        branches.IDENTICAL_BELOW, branches.MAX_EQUAL_DISPLACEMENT, branches.SINGULAR_VALUE_SHARE,
        solve.MAX_LOOP_GAP, solve.MAX_REMEMBERED_OPTIONS,
    ]  # fmt: skip


@records.of
def settings_of_a_search():
    from twistwrench.robot.inverse_kinematics import solve

    robot = stand()
    frames = solve._frames(robot, ["left_hand", "boom"], {"boom": "vx wz", "left_hand": "wy"})
    search = solve._search(robot, frames)
    one = solve._search(wristed(), solve._frames(wristed(), None, "vx vy"))
    of_ball = solve._search(ball(), solve._frames(ball(), "hook", None))
    starts = search.start_configurations(7)
    tables = [starts.table(0), starts.table(2)]
    q = np.array([[9.0, -9.0, 0.3, 1.65], [0.65, 1.19, -1.6, -2.0]])
    exact = np.array([0.7, 1.2, -1.5, 1.7])
    T = wristed().forward_kinematics(Q)
    target = wristed().forward_kinematics(Q + 0.1)
    return {
        "frames": frames,
        "weights": search.weights,
        "weights of one": one.weights,
        "settings": [search.settings((0.1, 0.2), 3), search.settings((0.1, 0.2), 3, 9)],
        "length": [search.length, one.length, of_ball.length],
        "limits": [
            search.lower,
            search.upper,
            search._lower_by_coordinate,
            search._upper_by_coordinate,
            of_ball.single_q,
        ],
        "limits with a ball": [of_ball._lower_by_coordinate, of_ball._upper_by_coordinate, of_ball.lower],
        "inside": [search.inside(q), of_ball.inside([9.0, 9.0, 9.0, 9.0, 9.0])],
        "rounded": [
            (search.round_to_type(x, np.dtype(np.float32)).astype(float) <= [0.7, 1.2, 1.6, 1.7]) for x in (exact,)
        ],
        "rounded below": search.round_to_type(np.array([-0.2, -1.4, -1.5, -1.3]), np.dtype(np.float32)).astype(float)
        >= [-0.2, -1.4, -1.5, -1.3],
        "starts": [[np.asarray(part).shape for part in table] for table in tables],
        "first": [starts.first(1), starts.first(0)],
        "tables": [tables[0][0][:2], tables[1][0][:2], tables[0][1][:, :1].ravel()],
        "none": [x.shape for x in search._no_starts],
        "shapes": [search.target_shape, one.target_shape],
        "twist left": [solve.twist_left(T, target, rows) for rows in ((0, 1, 2, 3, 4, 5), (3, 1), (5, 4, 0, 2))],
        "rigid": [solve._rigid(T * 1.0000001)[0], solve._rigid(T[0], (2, 4, 4)).shape],
        "batches": [
            solve._batch_shape(np.zeros(shape), np.zeros(start), (4, 4))
            for shape, start in (((3, 4, 4), (3, 6)), ((4, 4), (2, 6)), ((2, 1, 4, 4), (3, 6)), ((4, 4), (6,)))
        ],
        "seeds": [solve._draw_seed(k) for k in (0, 4)],
    }


@records.of(relative=1e-4)
def searches_in_parts():
    """More restarts than a table holds, postures, and several parts of one batch."""
    from twistwrench.robot.inverse_kinematics import search as search_module

    arm = wristed()
    T = arm.forward_kinematics(Q)
    found = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(search_module, "AT_ONCE", 4)
        patch.setattr(search_module, "MIN_POSES_AT_ONCE", 2)
        many = arm.inverse_kinematics(arm.forward_kinematics(np.tile(Q, (3, 1))), q0=np.tile(Q + 0.05, (3, 1)))
        found["parts"] = [many.q, many.converged]
    calls = [arm.inverse_kinematics(T[0], q0=Q[0] + 0.01, rows="vx vy vz wx", rng=k) for k in range(3)]
    found["seeds"] = [str(x.converged) for x in calls]
    found["generator"] = arm.inverse_kinematics(T[0], q0=Q[0] + 0.01, rng=np.random.default_rng(3)).converged
    found["remembered"] = sorted(str(key) for key in arm.engine.single_poses)[:3]
    fresh = tw.load(WRISTED)
    for k in range(18):
        fresh.inverse_kinematics(T[0], q0=Q[0], rng=k, restarts=0)
    found["remembered options"] = len(fresh.engine.single_poses)
    return found


@records.of
def clearances_kept(folder):
    """Links with shapes: a solution whose links touch is replaced, or refused with its reason."""
    text = WRISTED.replace(
        '<link name="l2"><inertial>',
        '<link name="l2"><collision><origin xyz="0 0 0.3"/><geometry><box size="0.1 0.12 0.5"/></geometry></collision><inertial>',
    ).replace(
        '<link name="tool"><inertial>',
        '<link name="tool"><collision><geometry><sphere radius="0.07"/></geometry></collision><inertial>',
    )
    path = folder / "arm.urdf"
    path.write_text(text)
    arm = tw.load(path)
    T = arm.forward_kinematics(Q[0])
    found = {}
    for clearance in (0.0, 0.1, 5.0):
        result = arm.inverse_kinematics(T, q0=Q[0], clearance=clearance, restarts=4)
        found[clearance] = [result.converged, result.starts, result.q]
        if clearance < 1.0:  # which solution comes nearest to 5 m is decided by random starts
            found[clearance].append(result.reason())
    many = arm.inverse_kinematics(T, q0=[Q[0], Q[0] + 0.01], clearance=5.0, restarts=2)
    found["many"] = [many.converged, many.reason(1).split(" are ")[0]]
    two = arm.inverse_kinematics([T], ["tool"], Q[0], clearance=0.1, restarts=2)
    found["list"] = [two.converged, two.q]
    return found


@records.of
def remembered_searches():
    """The quick way of repeated calls with one pose, with stand-ins for what is compiled."""
    from twistwrench.robot.inverse_kinematics import search, solve

    arm = tw.load(WRISTED)
    quick = search.SinglePose.__new__(search.SinglePose)
    quick.table, quick.settings, quick.look_settings, quick.start = ("table",), "all", "look", "neutral"
    found = {}
    good, bad, nan = (
        ("q", np.array([1.0, 1.0, 0.0])),
        ("q", np.array([1.0, 0.0, 0.5])),
        ("q", np.array([1.0, np.nan, 0.5])),
    )
    for label, looked, searched in (
        ("found", good, bad),
        ("searched", bad, good),
        ("not found", bad, bad),
        ("refused", None, good),
        ("not a number", bad, nan),
        ("nothing", bad, None),
    ):
        calls = []
        quick.call = lambda *x, looked=looked, calls=calls: calls.append(["look", *x]) or looked
        quick.kernel = lambda *x, searched=searched, calls=calls: calls.append(["search", *x]) or searched
        results = [quick.solve("T", None), quick.solve("T", "q0"), quick.near_by("T", "q0")]
        found[label] = [[None if r is None else "q" for r in results], calls]
    quick.call = None
    found["no builtin"] = quick.near_by("T", "q0")
    T = arm.forward_kinematics(Q[0])
    request = solve.PoseRequest(("a",), ((3,),))
    memory = arm.engine.single_poses
    stand_in = SimpleNamespace(
        solve=lambda T, q0: None if q0 is None else (np.array([7.0]), np.array([1.0, 1.0, 0.0, 0.25, 0.0]))
    )
    memory[(None, None, 30, 0, 1e-10, 1e-10)] = stand_in, request
    found["remembered"] = [arm.inverse_kinematics(T, q0=Q[0]).q, arm.inverse_kinematics(T).q.shape]
    found["other options"] = [
        arm.inverse_kinematics(T, q0=Q[0], **options).q.shape
        for options in (
            {"restarts": 3},
            {"rng": 1},
            {"angle": 1e-9},
            {"distance": 1e-9},
            {"rows": "vx vy"},
            {"nearest": True},
            {"frame": "tool"},
        )
    ]
    return found


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
