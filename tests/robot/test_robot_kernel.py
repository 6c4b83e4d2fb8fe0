"""What ``robot.kernel`` hands out, and how wrong names and wrong shapes are told."""

from __future__ import annotations

import dataclasses
import pickle

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.compiler.runtime.gufunc import make_ufunc


@pytest.mark.parametrize(
    ("name", "quantity", "options", "signature"),
    [
        ("panda", "inverse_dynamics", {}, "(7),(7),(7)->(7)"),
        ("panda", "jacobian", {"frame": "panda_hand", "kind": "space"}, "(7)->(6,7)"),
        ("panda", "mass_matrix", {}, "(7)->(7,7)"),
        ("panda", "inverse_dynamics", {"wrenches": ("panda_hand", "panda_link3")}, "(7),(7),(7),(6),(6)->(7)"),
        ("cart_pole", "christoffel", {}, "(2)->(2,2,2)"),
        ("cart_pole", "kinetic_energy", {}, "(2),(2)->()"),
        ("floating_box", "frame_velocity", {}, "(7),(6)->(6)"),
    ],
)
def test_a_kernel_is_a_ufunc_with_the_robot_s_sizes(bundled, name, quantity, options, signature):
    kernel = bundled(name).kernel(quantity, **options)
    assert isinstance(kernel, np.ufunc)
    assert kernel.signature == signature
    assert kernel.__name__ == quantity
    assert name in kernel.__doc__
    assert kernel.nin == signature.split("->")[0].count("(")
    assert set(kernel.types) == {f"{'f' * kernel.nin}->f", f"{'d' * kernel.nin}->d"}
    assert bundled(name).kernel(quantity, **options) is kernel


@pytest.mark.parametrize(
    ("quantity", "options", "error", "told"),
    [
        ("mass_matrx", {}, tw.UnknownNameError, "'mass_matrx'.*Did you mean 'mass_matrix'.*bias_forces"),
        ("jacobian", {"frame": "link9"}, tw.UnknownNameError, "'link9'.*Known: base, link1, link2, tip"),
        ("jacobian", {"frame": ["link2"]}, tw.UnknownNameError, "Known: base, link1, link2, tip"),
        ("jacobian", {"kind": "spatial"}, tw.UnknownNameError, "'spatial'.*Known: body, space, world_aligned"),
        ("inverse_dynamics", {"wrenches": ("hand",)}, tw.UnknownNameError, "'hand'.*link1"),
        ("mass_matrix", {"frame": "tip"}, tw.KernelError, "mass_matrix takes no option 'frame'"),
        ("jacobian", {"flavour": "tip"}, tw.KernelError, "no option 'flavour'; it takes frame, kind"),
    ],
)
def test_unknown_names_list_the_choices(bundled, quantity, options, error, told):
    with pytest.raises(error, match=told):
        bundled("planar_2r").kernel(quantity, **options)


def a_hedgehog(spines):
    """A turning link with many frames on it."""
    links = "".join(f'<link name="l{k}"/>' for k in range(spines))
    joint = '<joint name="j{k}" type="fixed"><parent link="body"/><child link="l{k}"/></joint>'
    joints = "".join(joint.format(k=k) for k in range(spines))
    body = '<link name="world"/><link name="body"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" '
    body += 'ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="turn" type="continuous"><parent link="world"/>'
    return tw.load(f'<robot name="hedgehog">{body}<child link="body"/></joint>{links}{joints}</robot>')


def test_too_many_arrays_are_refused():
    robot = a_hedgehog(29)
    with pytest.raises(tw.KernelError, match="33 arrays; NumPy allows"):
        robot.kernel("inverse_dynamics", wrenches=robot.frame_names[2:])
    program = robot.program("inverse_dynamics", wrenches=robot.frame_names[2:5])
    assert make_ufunc(program, "few", "").nin == 6


def test_a_frame_named_twice_is_refused(bundled):
    with pytest.raises(tw.KernelError, match="named twice"):
        bundled("planar_2r").kernel("inverse_dynamics", wrenches=("tip", "tip"))


def test_methods_write_where_they_are_told(bundled):
    robot = bundled("planar_2r")
    q, out = np.ones((3, 2)), np.empty((3, 2))
    assert robot.inverse_dynamics(q, q, q, friction=True, out=out) is out
    assert np.array_equal(out, robot.inverse_dynamics(q, q, q, friction=True))
    matrices = np.empty((3, 2, 2))
    assert robot.mass_matrix(q, out=matrices) is matrices
    assert np.array_equal(matrices, robot.mass_matrix(q))


def test_a_robot_with_every_joint_locked_still_answers(bundled):
    arm = bundled("planar_2r")
    still = arm.lock({"joint1": 0.3, "joint2": -0.2})
    nothing = np.zeros(0)
    assert np.allclose(still.forward_kinematics(nothing, "tip"), arm.forward_kinematics([0.3, -0.2]))
    assert still.inverse_dynamics(nothing, nothing, nothing).shape == (0,)
    assert still.mass_matrix(nothing).shape == (0, 0)
    assert still.christoffel(nothing).shape == (0, 0, 0)
    assert np.isnan(still.center_of_mass(nothing)).all()


def test_a_failed_compilation_of_the_float32_loop_is_never_a_number(bundled, monkeypatch):
    robot = bundled("cart_pole")
    kernel = tw.Robot(robot.model).kernel("inverse_dynamics")
    x = np.ones((5, 2), np.float32)

    def fails(*_):
        raise tw.KernelError("on purpose")

    monkeypatch.setattr("twistwrench.compiler.runtime.gufunc.compile_form", fails)
    out = np.zeros((5, 4), np.float32)[:, ::2]
    with pytest.raises(tw.KernelError, match="on purpose"):
        kernel(x, x, x, out)
    assert np.isnan(out).all()
    monkeypatch.undo()
    assert np.isfinite(kernel(x, x, x)).all()


@pytest.mark.parametrize(
    "wrong",
    [
        lambda r: r.with_payload(5.0),
        lambda r: r.lock(["joint1"]),
        lambda r: r.inverse_dynamics([0, 0], [0, 0], [0, 0], wrench_by_robot=np.zeros(6)),
        lambda r: r.holding_torques(
            [0, 0], wrench_by_robot={"tip": np.zeros((2, 6))}, wrench_on_robot={"tip": np.zeros((3, 6))}
        ),
        lambda r: r.add([0, 0], [[1, 2], [3]]),
        lambda r: r.add("ab", [0, 0]),
        lambda r: r.subtract(np.zeros((2, 2)), np.zeros((3, 2))),
        lambda r: r.coordinates(joint1="x"),
        lambda r: r.random_configuration("x"),
        lambda r: r.random_configuration(0, 3.5),
        lambda r: r.random_configuration(0, -1),
        lambda r: r.reference("mass_matrix"),
        lambda r: r.forward_dynamics([0, 0], [0, 0], [0, 0, 0], friction=True),
    ],
)
def test_wrong_arguments_raise_errors_of_our_tree(bundled, wrong):
    with pytest.raises(tw.TwistWrenchError):
        wrong(bundled("planar_2r"))


@pytest.mark.parametrize("through", [lambda robot: robot, lambda robot: pickle.loads(pickle.dumps(robot))])
def test_models_are_read_only(bundled, through):
    with pytest.raises(ValueError, match="read-only"):
        through(bundled("planar_2r")).limits.upper[:] = 0.01


def test_one_bound_far_out_leaves_room_for_a_random_configuration():
    text = '<robot name="r"><link name="a"/><link name="b"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" '
    text += 'ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="j" type="prismatic"><parent link="a"/><child link="b"/>'
    robot = tw.load(text + '<limit lower="5" upper="1e9"/></joint></robot>')
    far = tw.Robot(dataclasses.replace(robot.model, limits=dataclasses.replace(robot.limits, upper=np.array([np.inf]))))
    q = far.random_configuration(0, 1000)
    assert q.min() >= 5 and q.max() <= 6


@pytest.mark.parametrize("jit", ["0", "1"])
@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ((np.zeros(3), np.zeros(2), np.zeros(2)), r"q has shape \(3,\).*wants 2.*joint1, joint2"),
        ((np.zeros(2), np.zeros((4, 3)), np.zeros(2)), r"dq has shape \(4, 3\)"),
        ((np.zeros(2), np.zeros(2), 1.0), r"ddq has shape \(\)"),
        ((np.zeros((2, 0)), np.zeros(2), np.zeros(2)), r"q has shape \(2, 0\)"),
        ((np.zeros((3, 2)), np.zeros((4, 2)), np.zeros(2)), r"the batch shapes do not broadcast: q \(3,\), dq \(4,\)"),
        (([[1, 2], [3]], np.zeros(2), np.zeros(2)), "q is not an array of real numbers"),
        ((np.zeros(2), ["a", "b"], np.zeros(2)), "dq is not an array of real numbers"),
    ],
)
def test_wrong_shapes_are_explained(monkeypatch, arguments, told, jit):
    monkeypatch.setenv("TWISTWRENCH_JIT", jit)
    robot = tw.robots.planar_2r()
    with pytest.raises(tw.ShapeError, match=f"inverse_dynamics: {told}"):
        robot.inverse_dynamics(*arguments)
    with pytest.raises((TypeError, ValueError)):  # the bare kernel refuses as well, in NumPy's words
        robot.kernel("inverse_dynamics")(*arguments)


@pytest.mark.parametrize(("jit", "axes"), [("0", 33), ("0", 62), ("1", 63)])
def test_more_axes_than_a_kernel_takes_are_explained(monkeypatch, jit, axes):
    """NumPy broadcasts 32 axes; compiled kernels take 64 with those of the result."""
    monkeypatch.setenv("TWISTWRENCH_JIT", jit)
    robot = tw.robots.planar_2r()
    with pytest.raises(tw.ShapeError, match=rf"mass_matrix: q has {axes} batch axes.*at most 32 axes"):
        robot.mass_matrix(np.zeros((1,) * axes + (2,)))


def test_labelled_wrenches_bring_their_frame(bundled):
    arm, q, F = bundled("planar_2r"), [0.3, 0.4], [0, 0, 1, 2, 3, 0]
    expected = arm.wrench_torques(q, F, frame="tip")
    assert np.array_equal(arm.wrench_torques(q, tw.Wrench(F, "tip")), expected)
    held = arm.holding_torques(q, wrench_by_robot={"tip": tw.Wrench(F, "tip")})
    assert np.allclose(held - arm.gravity_forces(q), expected)
    with pytest.raises(tw.FrameError, match=r"'link1'.*'tip'"):
        arm.holding_torques(q, wrench_by_robot={"tip": tw.Wrench(F, "link1")})


def test_several_quantities_in_one_kernel_are_those_of_their_own_kernels():
    robot = tw.robots.ur5()
    rng = np.random.default_rng(5)
    q, dq, ddq = robot.random_configuration(rng, 50), *rng.normal(size=(2, 50, 6))
    names = ("inverse_dynamics", "mass_matrix", "jacobian", "task_inertia")
    kernel = robot.kernel(*names, frame="wrist_3_link", wrenches=("tool0",))
    assert kernel.signature == "(6),(6),(6),(6)->(6),(6,6),(6,6),(6,6),(6)"
    F = rng.normal(size=(50, 6))
    tau, M, J, *_ = kernel(q, dq, ddq, F)
    np.testing.assert_allclose(
        tau, robot.inverse_dynamics(q, dq, ddq, wrench_by_robot={"tool0": F}), rtol=1e-12, atol=1e-12
    )
    np.testing.assert_allclose(M, robot.mass_matrix(q), rtol=1e-13, atol=1e-14)
    np.testing.assert_allclose(J, robot.jacobian(q, "wrist_3_link"), rtol=1e-13, atol=1e-14)


def test_what_several_quantities_share_is_computed_once():
    robot = tw.robots.panda()
    together = robot.program("forward_dynamics", "bias_forces")
    assert together.multiplications < robot.program("forward_dynamics").multiplications + 10


def test_several_quantities_asked_for_wrongly():
    robot = tw.robots.ur5()
    with pytest.raises(tw.KernelError, match="given twice"):
        robot.kernel("mass_matrix", "mass_matrix")
    with pytest.raises(tw.KernelError, match="none of mass_matrix, bias_forces takes an option 'frame'"):
        robot.kernel("mass_matrix", "bias_forces", frame="tool0")
    with pytest.raises(tw.UnknownNameError, match="no quantity named 'mass'"):
        robot.kernel("bias_forces", "mass")
    with pytest.raises(tw.UnknownNameError):
        robot.kernel()


@pytest.mark.parametrize("jit", ["0", "1"])
def test_complex_numbers_are_refused_by_every_target(monkeypatch, jit):
    monkeypatch.setenv("TWISTWRENCH_JIT", jit)
    robot = tw.robots.planar_2r()
    for ask in (robot.mass_matrix, lambda q: robot.reference("mass_matrix", q)):
        with pytest.raises(tw.ShapeError, match="not an array of real numbers"):
            ask(np.array([1j, 2.0]))


def test_options_of_kernels_that_cannot_be_meant():
    robot = tw.robots.ur5()
    with pytest.raises(tw.KernelError, match="'input' makes gravity"):
        robot.kernel("inverse_dynamics", gravity=np.array([0, 0, -9.81]))
    with pytest.raises(tw.KernelError, match="Give the names of frames"):
        robot.kernel("inverse_dynamics", wrenches=5)
    for q, F in (([np.nan] * 6, None), (np.zeros(6), [1, 2, 3, 4, 5, 6])):
        with pytest.raises(tw.TwistWrenchError):
            robot.closed_form(q, np.zeros(6), wrench_by_robot=F)
