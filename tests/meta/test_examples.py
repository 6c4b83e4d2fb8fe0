"""Every example runs, and writes what it says it writes."""

from __future__ import annotations

import runpy
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from places import ROOT

import twistwrench as tw

EXAMPLES = ROOT / "examples"


@pytest.mark.slow
def test_the_intermediate_axis(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    example = runpy.run_path(str(EXAMPLES / "intermediate_axis.py"))
    example["main"](tmp_path, frames=2)
    assert (tmp_path / "intermediate_axis.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "intermediate_axis.gif").read_bytes().startswith(b"GIF")
    said = capsys.readouterr().out
    assert "drift over 1800 steps" in said
    assert [Path(line[6:]) for line in said.splitlines()[1:]] == [
        tmp_path / f"intermediate_axis.{s}" for s in ("png", "gif")
    ]


def test_the_intermediate_axis_hides_what_the_surfaces_hide():
    """Against rays walked point by point through the union of sphere and ellipsoid."""
    pytest.importorskip("matplotlib")
    example = runpy.run_path(str(EXAMPLES / "intermediate_axis.py"))
    I, energy, towards = example["I"], 1.0 / example["I"][1], np.array([0.6, 0.64, 0.48])
    rng = np.random.default_rng(0)
    points = rng.standard_normal((400, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    points *= 1.01 * example["hull"](points, energy)[:, None]
    walked = points[:, None] + np.linspace(1e-3, 3, 3000)[:, None] * towards
    inside = ((walked**2).sum(axis=-1) < 1) | ((walked**2 / (energy * I)).sum(axis=-1) < 1)
    hidden = inside.any(axis=1)
    assert 100 < hidden.sum() < 300
    assert (example["visible"](points, towards, energy) == ~hidden).all()


def test_the_intermediate_axis_answers_help_and_refuses_what_is_no_folder(tmp_path):
    pytest.importorskip("matplotlib")
    (tmp_path / "taken").write_text("")
    for argument, code, words in (("--help", 0, "usage: "), ("taken", 2, "cannot write to the folder taken")):
        done = subprocess.run(
            [sys.executable, EXAMPLES / "intermediate_axis.py", argument], cwd=tmp_path, capture_output=True, text=True
        )
        assert done.returncode == code
        assert words in done.stdout + done.stderr
        assert "Traceback" not in done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["taken"]


# ── the Gymnasium environment ──


@pytest.fixture(scope="module")
def reach():
    pytest.importorskip("gymnasium")
    return SimpleNamespace(**runpy.run_path(str(EXAMPLES / "gymnasium_environment.py")))


def test_gymnasium_finds_nothing_wrong_with_the_environment(reach):
    """Warnings of its checker are errors here, as all are; the environment draws nothing."""
    from gymnasium.utils.env_checker import check_env

    check_env(reach.ReachOne(), skip_render_check=True)


def test_environments_of_a_batch_are_what_each_would_be_alone(reach):
    env = reach.Reach(5)
    seen, _ = env.reset(seed=3)
    assert env.observation_space.contains(seen)
    env.action_space.seed(0)
    q0, dq0, actions = env.q.copy(), env.dq.copy(), env.action_space.sample()
    seen, reward, terminated, truncated, _ = env.step(actions)
    assert env.observation_space.contains(seen) and not terminated.any() and not truncated.any()
    assert len(set(env.load)) > 1 and len(set(env.kp[:, 0, 0])) > 1
    for k in range(5):
        robot = reach.ROBOT.with_payload(tw.SpatialInertia.from_com(env.load[k])) if env.load[k] else reach.ROBOT
        law = tw.simulation.BatchPD(reach.references(actions[k]), env.kp[k, 0], reach.KD, gravity=False)
        alone = robot.rollout(q0[k], dq0[k], law, dt=reach.DT, steps=reach.STEPS)
        np.testing.assert_allclose(env.q[k], alone.q[-1], atol=1e-9)  # a load as a parameter, and as a body
        hand = robot.forward_kinematics(alone.q[-1])[:3, 3]
        assert reward[k] == pytest.approx(-np.linalg.norm(env.goal[k] - hand), abs=1e-9)


def test_environments_that_are_over_begin_anew_at_the_next_step(reach):
    env = reach.Reach(3)
    env.reset(seed=0)
    still = np.zeros((3, 7))
    env.age[1] = reach.LENGTH - 1
    goal = env.goal.copy()
    *_, truncated, _ = env.step(still)
    assert truncated.tolist() == [False, True, False] and np.array_equal(env.goal, goal)
    _, reward, terminated, truncated, _ = env.step(still)
    assert reward[1] == 0 and env.age.tolist() == [2, 0, 2] and not (truncated | terminated).any()
    assert (env.goal != goal).all(axis=1).tolist() == [False, True, False] and not env.dq[1].any()
    env.dq[2] = 1e7  # what no robot reaches
    *_, terminated, _, _ = env.step(still)
    assert terminated.tolist() == [False, False, True]


def test_mujoco_takes_the_same_steps_from_the_states_of_the_environment(reach):
    pytest.importorskip("mujoco")
    env = reach.Reach(4)
    env.reset(seed=1)
    actions = np.linspace(-1, 1, 28).reshape(4, 7)
    theirs = reach.mujoco_batch(env)(actions)
    env.step(actions)
    np.testing.assert_allclose(env.q, theirs, atol=1e-9)
