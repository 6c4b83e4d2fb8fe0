"""PyTorch on the processor: our functions beside ADAM's, for one state and for a batch, and with the gradient backward.

ADAM gives M and h of a floating base, of any batch shape: torques are made of them as its users do.
"""

from typing import Any

import torch

from bench.bridge_panda import (
    BATCH,
    KERNEL,
    OURS,
    QUANTITIES,
    STATES,
    Functions,
    Panda,
    installed,
    repeated,
    require_agreement,
    timed,
)

PACKAGES = ("torch", "adam-robotics")


def times(panda: Panda, rounds: int) -> dict[str, Any]:
    """Every contender's times by quantity, for one call and a batch."""
    torch.set_num_threads(1)
    missing: dict[str, str] = {}
    functions = {OURS: _ours(panda)}
    try:
        functions["ADAM"] = _adam(panda)
    except ImportError as error:
        missing["ADAM"] = str(error)
    rows = {}
    for quantity in (*QUANTITIES, "gradient"):
        kernel, few = panda.kernels[quantity], panda.states(STATES)
        for name, mine in functions.items():
            found = mine[quantity](*map(torch.as_tensor, few))
            require_agreement("PyTorch", name, quantity, found.detach(), kernel(*few))
        many = panda.states(BATCH)
        for how, given, count in (
            ("one call", tuple(x[0].copy() for x in many), 1),
            (f"batch of {BATCH}", many, BATCH),
        ):
            tensors = tuple(map(torch.as_tensor, given))
            contenders = [repeated(KERNEL, kernel, given, count)]
            contenders += [repeated(name, f[quantity], tensors, count) for name, f in functions.items()]
            rows[f"{quantity}, {how}"] = timed(contenders, rounds)
    return {"packages": installed(*PACKAGES), "missing": missing, "rows": rows}


def _with_gradient(functions: Functions) -> Functions:
    """The gradient of |tau|^2 by q: forward and backward."""
    torques = functions["inverse_dynamics"]

    def gradient(q: Any, dq: Any, ddq: Any) -> Any:
        q = q.detach().requires_grad_()
        (found,) = torch.autograd.grad(torques(q, dq, ddq).square().sum(), q)
        return found

    return {**functions, "gradient": gradient}


def _ours(panda: Panda) -> Functions:
    inverse, mass, forward = (panda.robot.to_torch(name) for name in QUANTITIES)
    return _with_gradient(
        {"inverse_dynamics": inverse, "mass_matrix": lambda q, *_: mass(q), "forward_dynamics": forward}
    )


def _adam(panda: Panda) -> Functions:
    from adam.pytorch import KinDynComputations

    real = {"dtype": torch.float64, "device": torch.device("cpu")}
    gravity = torch.tensor([0, 0, -9.81, 0, 0, 0], **real)
    model = KinDynComputations(str(panda.path), list(panda.robot.joint_names), gravity=gravity, **real)

    def mass(q: Any, *_: Any) -> Any:
        return model.mass_matrix(_still(q), q)[..., 6:, 6:]

    def bias(q: Any, dq: Any) -> Any:
        return model.bias_force(_still(q), q, q.new_zeros((*q.shape[:-1], 6)), dq)[..., 6:]

    return _with_gradient(
        {
            "inverse_dynamics": lambda q, dq, ddq: (mass(q) @ ddq[..., None])[..., 0] + bias(q, dq),
            "mass_matrix": mass,
            "forward_dynamics": lambda q, dq, tau: torch.linalg.solve(mass(q), tau - bias(q, dq)),
        }
    )


def _still(q: Any) -> Any:
    """A base at the origin, for each state."""
    return torch.eye(4, dtype=q.dtype).expand(*q.shape[:-1], 4, 4)
