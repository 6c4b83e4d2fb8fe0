"""JAX: our functions beside those of ADAM, frax and MJX, jitted, for one state and for a batch.

ADAM gives M and h of a floating base, frax M and h: torques are made of them as their users do. MJX's inverse dynamics cannot
be differentiated backward (it has a loop with a condition), and has no mass matrix to itself. Compiling is not timed.
"""

import os

os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false")  # one core, as all else here

from typing import Any

import jax
import jax.numpy as jnp

from bench.bridge_panda import (
    BATCH,
    KERNEL,
    OURS,
    QUANTITIES,
    Functions,
    Panda,
    installed,
    repeated,
    require_agreement,
    timed,
)
from bench.timing import Contender

PACKAGES = ("jax", "adam-robotics", "frax", "mujoco-mjx")


def times(panda: Panda, rounds: int) -> dict[str, Any]:
    """Every contender's times by quantity, for one call and a batch."""
    jax.config.update("jax_enable_x64", True)
    missing: dict[str, str] = {}
    functions = {OURS: _ours(panda), **_peers(panda, missing)}
    rows = {}
    for quantity in (*QUANTITIES, "gradient", "slope"):
        for how, each in _contenders(panda, functions, quantity).items():
            rows[f"{quantity}, {how}"] = timed(each, rounds)
    return {"packages": installed(*PACKAGES), "missing": missing, "rows": rows}


def _contenders(panda: Panda, functions: dict[str, Functions], quantity: str) -> dict[str, list[Contender]]:
    """One call and a batch; of slopes a batch only, for XLA takes half a minute for each of ADAM's."""
    kernel, many = panda.kernels[quantity], panda.states(BATCH)
    one = tuple(x[0].copy() for x in many)
    single = [repeated(KERNEL, kernel, one, 1)]
    batch = [repeated(KERNEL, kernel, many, BATCH)]
    for name, mine in functions.items():
        if quantity not in mine:
            continue
        function, takes_batches = mine[quantity], name == "ADAM" and quantity in QUANTITIES
        together, given = jax.jit(function if takes_batches else jax.vmap(function)), [jnp.asarray(x) for x in many]
        require_agreement("JAX", name, quantity, together(*given), kernel(*many))
        single.append(repeated(name, jax.jit(function), [x[0] for x in given], 1, jax.block_until_ready))
        batch.append(repeated(name, together, given, BATCH, jax.block_until_ready))
    return {**({} if quantity == "slope" else {"one call": single}), f"batch of {BATCH}": batch}


def _with_derivatives(functions: Functions) -> Functions:
    """The gradient of |tau|^2 and the slope of tau, both by q and backward."""
    torques = functions["inverse_dynamics"]
    return {
        **functions,
        "gradient": jax.grad(lambda q, dq, ddq: (torques(q, dq, ddq) ** 2).sum()),
        "slope": jax.jacrev(torques),
    }


def _ours(panda: Panda) -> Functions:
    inverse, mass, forward = (panda.robot.to_jax(name) for name in QUANTITIES)
    return _with_derivatives(
        {"inverse_dynamics": inverse, "mass_matrix": lambda q, *_: mass(q), "forward_dynamics": forward}
    )


def _peers(panda: Panda, missing: dict[str, str]) -> dict[str, Functions]:
    found = {}
    for name, make in (("ADAM", _adam), ("frax", _frax), ("MJX", _mjx)):
        try:
            found[name] = make(panda)
        except ImportError as error:
            missing[name] = str(error)
    return found


def _adam(panda: Panda) -> Functions:
    """Of any batch shape, which is how ADAM is used on batches."""
    from adam.jax import KinDynComputations

    names, gravity = list(panda.robot.joint_names), jnp.array([0, 0, -9.81, 0, 0, 0])
    model = KinDynComputations(str(panda.path), names, gravity=gravity)

    def parts(q: Any, dq: Any) -> tuple[Any, Any]:
        base = jnp.broadcast_to(jnp.eye(4), (*q.shape[:-1], 4, 4))
        h = model.bias_force(base, q, jnp.zeros((*q.shape[:-1], 6)), dq)
        return model.mass_matrix(base, q)[..., 6:, 6:], h[..., 6:]

    def torques(q: Any, dq: Any, ddq: Any) -> Any:
        M, h = parts(q, dq)
        return jnp.einsum("...ij,...j->...i", M, ddq) + h

    def accelerations(q: Any, dq: Any, tau: Any) -> Any:
        M, h = parts(q, dq)
        return jnp.linalg.solve(M, (tau - h)[..., None])[..., 0]

    return _with_derivatives(
        {
            "inverse_dynamics": torques,
            "mass_matrix": lambda q, dq, _: parts(q, dq)[0],
            "forward_dynamics": accelerations,
        }
    )


def _frax(panda: Panda) -> Functions:
    from frax import Robot

    model = Robot(str(panda.path), joint_ordering=list(panda.robot.joint_names))
    return _with_derivatives(
        {
            "inverse_dynamics": lambda q, dq, ddq: model.mass_matrix(q) @ ddq + model.nonlinear_bias(q, dq),
            "mass_matrix": lambda q, *_: model.mass_matrix(q),
            "forward_dynamics": lambda q, dq, tau: model.forward_dynamics(q, dq, tau, None),
        }
    )


def _mjx(panda: Panda) -> Functions:
    from mujoco import mjx

    theirs = panda.robot.to_mujoco()
    theirs.dof_damping[:] = theirs.dof_frictionloss[:] = 0  # friction neither
    theirs.opt.disableflags |= 1 << 4 | 1 << 0  # contacts and constraints: not part of what is compared
    model = mjx.put_model(theirs)

    def state(q: Any, dq: Any) -> Any:
        return mjx.make_data(model).replace(qpos=q, qvel=dq)

    return {
        "inverse_dynamics": lambda q, dq, ddq: mjx.inverse(model, state(q, dq).replace(qacc=ddq)).qfrc_inverse,
        "forward_dynamics": lambda q, dq, tau: mjx.forward(model, state(q, dq).replace(qfrc_applied=tau)).qacc,
    }
