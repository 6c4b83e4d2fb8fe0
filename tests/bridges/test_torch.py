"""PyTorch's functions: values to the bit of the kernels, first and second derivatives against differences of their own."""

from __future__ import annotations

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.robot.arguments import CONFIGURATIONS
from twistwrench.robot.quantities import QUANTITIES

torch = pytest.importorskip("torch", reason="PyTorch is not installed: make bridges")
NEEDS_A_GPU = pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU that PyTorch can use")


def states(robot, quantity, options, batch):
    rng = np.random.default_rng(0)
    return [
        robot.random_configuration(k, *batch) if p.name in CONFIGURATIONS else rng.normal(size=(*batch, *p.shape))
        for k, p in enumerate(robot.program(quantity, **options).inputs)
    ]


def unit(q, nv):
    """Entries of a floating base's configuration with a quaternion of length one."""
    if q.shape[-1] == nv:
        return q
    return torch.cat([q[..., :4] / q[..., :4].norm(dim=-1, keepdim=True), q[..., 4:]], -1)


@pytest.mark.parametrize("quantity", [n for n, row in QUANTITIES.items() if "constraints" not in row.options])
@pytest.mark.parametrize("name", ["ur5", "panda", "quadruped"])
def test_values_are_the_kernels_to_the_bit(name, quantity):
    if (name, quantity) == ("quadruped", "christoffel"):
        pytest.skip("its rates are not its velocities")
    robot = getattr(tw.robots, name)()
    options = {"frame": "FL_foot"} if name == "quadruped" and "frame" in QUANTITIES[quantity].options else {}
    given = states(robot, quantity, options, (3,))
    found, expected = robot.to_torch(quantity, **options)(*given), robot.kernel(quantity, **options)(*given)
    several = isinstance(expected, tuple)
    for theirs, ours in zip(found if several else (found,), expected if several else (expected,), strict=True):
        np.testing.assert_array_equal(theirs.numpy(), ours)


@pytest.mark.parametrize("quantity", ["inverse_dynamics", "mass_matrix", "kinetic_energy", "forward_dynamics"])
@pytest.mark.parametrize("name", ["ur5", "floating_box"])
def test_gradients_are_those_of_differences(name, quantity):
    robot = getattr(tw.robots, name)()
    function = robot.to_torch(quantity)
    given = [torch.tensor(x, requires_grad=True) for x in states(robot, quantity, {}, (2,))]
    assert torch.autograd.gradcheck(lambda q, *rest: function(unit(q, robot.nv), *rest), given, atol=1e-4)


@pytest.mark.parametrize("quantity", ["gravity_forces", "kinetic_energy", "potential_energy"])
@pytest.mark.parametrize("name", ["planar_2r", "floating_box"])
def test_second_derivatives_are_those_of_differences(name, quantity):
    robot = getattr(tw.robots, name)()
    function = robot.to_torch(quantity)
    given = [torch.tensor(x, requires_grad=True) for x in states(robot, quantity, {}, ())]
    assert torch.autograd.gradgradcheck(lambda q, *rest: function(unit(q, robot.nv), *rest), given, atol=1e-4)


def test_functional_transforms_give_the_analytic_derivatives():
    robot = tw.robots.ur5()
    q, dq, ddq = (torch.tensor(x) for x in states(robot, "inverse_dynamics", {}, (5,)))
    found = torch.func.vmap(torch.func.jacrev(robot.to_torch("inverse_dynamics")))(q, dq, ddq)
    expected, _ = robot.inverse_dynamics_derivatives(q.numpy(), dq.numpy(), ddq.numpy())
    np.testing.assert_allclose(found.numpy(), expected, rtol=0, atol=1e-10)


@pytest.mark.filterwarnings("ignore:.*torch.jit.script.*:FutureWarning")  # PyTorch's own, where it prepares jvp
def test_what_is_not_there_forward_is_there_backward():
    robot = tw.robots.planar_2r()
    function, q = robot.to_torch("potential_energy"), torch.ones(2, dtype=torch.float64)
    for forward in (torch.func.jacfwd(function), torch.func.hessian(function)):
        with pytest.raises(tw.KernelError, match=r"backward only.*jacrev\(jacrev\(f\)\) the Hessian"):
            forward(q)
    with torch.autograd.forward_ad.dual_level(), pytest.raises(tw.KernelError, match="backward only"):
        function(torch.autograd.forward_ad.make_dual(q, q))
    found = torch.func.jacrev(torch.func.jacrev(function))(q)
    expected = torch.func.jacrev(robot.to_torch("gravity_forces"))(q)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10)


def test_third_derivatives_are_not_left_out():
    """Of a pendulum's energy they are minus the first ones: by backward passes, and by torch.func."""
    robot = tw.robots.pendulum()
    function, q = robot.to_torch("potential_energy"), torch.ones(1, dtype=torch.float64, requires_grad=True)
    slope, nested = function(q), function
    for _ in range(3):
        (slope,) = torch.autograd.grad(slope.sum(), q, create_graph=True)
        nested = torch.func.jacrev(nested)
    for found in (slope, nested(q.detach())):
        np.testing.assert_allclose(found.detach().ravel(), -robot.gravity_forces([1.0]), rtol=1e-12)


def test_a_state_that_is_broadcast_gets_the_sum_of_its_gradients():
    robot = tw.robots.planar_2r()
    q = torch.zeros(2, dtype=torch.float64, requires_grad=True)
    dq = torch.ones((4, 2), dtype=torch.float64)
    robot.to_torch("inverse_dynamics")(q, dq, dq).sum().backward()
    J, _ = robot.inverse_dynamics_derivatives(np.zeros(2), np.ones(2), np.ones(2))
    np.testing.assert_allclose(q.grad.numpy(), 4 * J.sum(axis=0), rtol=1e-12)


def test_float32_stays_float32_and_memory_is_shared():
    robot = tw.robots.pendulum()
    assert robot.to_torch("gravity_forces")(torch.ones(1, dtype=torch.float32)).dtype == torch.float32
    assert robot.to_torch("gravity_forces")(torch.ones(1, dtype=torch.int8)).dtype == torch.float64


@pytest.mark.filterwarnings("ignore:The .grad attribute of a Tensor:UserWarning")  # PyTorch itself looks at it
def test_compiled_by_pytorch_it_is_the_same_function():
    """The graph breaks at the kernel, which runs as it is; so do gradients."""
    robot = tw.robots.planar_2r()
    function = robot.to_torch("inverse_dynamics")  # not called before
    q, dq, ddq = (torch.tensor(x) for x in states(robot, "inverse_dynamics", {}, (3,)))

    def cost(q):
        return function(q.sin(), dq, ddq).square().sum()

    found = []
    for run in (torch.compile(cost, backend="eager"), cost):
        at = q.clone().requires_grad_()
        value = run(at)
        found.append((value.detach(), *torch.autograd.grad(value, at)))
    for compiled, plain in zip(*found, strict=True):
        np.testing.assert_array_equal(compiled, plain)


def test_later_calls_trace_nothing(monkeypatch):
    robot = tw.robots.planar_2r()
    function = robot.to_torch("inverse_dynamics")
    some = [x.requires_grad_() for x in some_states()]
    slopes(function, *some)
    monkeypatch.setattr(type(robot.engine), "program", None)
    slopes(function, *some)


def test_views_of_complex_tensors_are_real_numbers():
    z = torch.tensor([1 + 2j, 3 - 1j], dtype=torch.complex128).conj()
    function = tw.robots.planar_2r().to_torch("gravity_forces")
    np.testing.assert_array_equal(function(z.imag), function(z.imag.resolve_neg()))


def test_bad_input_is_named():
    robot = tw.robots.pendulum()
    function = robot.to_torch("gravity_forces")
    with pytest.raises(tw.ShapeError, match="q has shape"):
        function(torch.ones(3))
    with pytest.raises(tw.ShapeError, match="q wanted"):
        function()
    with pytest.raises(tw.ShapeError, match=r"q \(3,\), dq \(4,\) do not broadcast"):
        robot.to_torch("coriolis_forces")(torch.ones(3, 1), torch.ones(4, 1))
    with pytest.raises(tw.ValueRangeError, match=r"complex128"):
        function(torch.ones(1, dtype=torch.complex128))
    with pytest.raises(tw.ValueRangeError, match=r"q is torch.bool, real numbers wanted"):
        function(torch.ones(1, dtype=torch.bool))
    with pytest.raises(tw.ValueRangeError, match=r"q is torch.sparse_coo, a dense tensor wanted: q.to_dense"):
        function(torch.ones(1, dtype=torch.float64).to_sparse())
    for wrong in ("a", [[1.0], [1.0, 2.0]], None, np.ones(1, complex)):
        with pytest.raises(tw.TwistWrenchError, match="to_torch gravity_forces: q"):
            function(wrong)
    with pytest.raises(tw.ValueRangeError, match=r"meta.*\.cpu\(\)"):
        function(torch.ones(1, device="meta"))


# ── on a GPU ──


def slopes(function, q, dq, ddq):
    """First derivatives of a cost by all inputs, and second ones by q along a direction."""
    given = [x.clone().requires_grad_() for x in (q, dq, ddq)]
    cost = function(*given).square().sum()
    first = torch.autograd.grad(cost, given, create_graph=True)
    (second,) = torch.autograd.grad((first[0] * torch.ones_like(first[0])).sum(), given[:1])
    return [x.detach() for x in (cost, *first, second)]


def some_states(**options):
    """With batches that broadcast, and one state for all."""
    numbers = torch.Generator().manual_seed(0)
    shapes = (4, 1, 2), (3, 2), (2,)
    return [torch.randn(*shape, generator=numbers, dtype=torch.float64).to(**options) for shape in shapes]


@NEEDS_A_GPU
def test_tensors_on_a_gpu_stay_there_and_have_the_same_derivatives():
    robot = tw.robots.planar_2r()
    function = robot.to_torch("inverse_dynamics")
    for x, y in zip(slopes(function, *some_states(device="cuda")), slopes(function, *some_states()), strict=True):
        assert x.device.type == "cuda"
        np.testing.assert_allclose(x.cpu(), y, rtol=0, atol=1e-11 * float(y.abs().max()))


@NEEDS_A_GPU
def test_tensors_on_several_devices_are_refused():
    q = torch.ones(2)
    with pytest.raises(tw.ValueRangeError, match="Move all to one device"):
        tw.robots.planar_2r().to_torch("inverse_dynamics")(q.cuda(), q, q)
