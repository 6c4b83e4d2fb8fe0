"""Kernels and C functions of closed robots."""

from __future__ import annotations

import ctypes
import shutil
import subprocess

import numpy as np
import pytest
from mechanisms import four_bar

import twistwrench as tw


@pytest.fixture(scope="module")
def spatial():
    return four_bar().close("rocker_pin", "coupler_pin", "wx wz vx vy vz", redundant="accept")


def test_a_kernel_is_the_method_with_the_independent_rows(spatial):
    q = spatial.consistent([0.3, 0.4, 1.2])
    dq, tau = spatial.project_velocity(q, [1.0, 0, 0]), np.array([1.0, 2.0, 3.0])
    ddq, lam, pivots = spatial.kernel("constrained_dynamics")(q, dq, tau)
    whole = spatial.forward_dynamics(q, dq, tau)
    assert np.abs(ddq - whole.ddq).max() < 1e-12 and np.abs(lam - whole.lam[[2, 4]]).max() < 1e-10
    assert (pivots > 0).all()
    A, M = spatial.kernel("constraint_jacobian", "mass_matrix")(q)
    assert A.shape == (2, 3) and np.array_equal(M, spatial.open().mass_matrix(q))
    slopes = spatial.kernel("constraint_bias", by="dq")(q, dq)
    assert slopes.shape == (2, 3)
    with pytest.raises(tw.KernelError, match=r"robot\.open\(\)"):
        spatial.kernel("forward_dynamics")


@pytest.mark.skipif(not shutil.which("cc"), reason="no C compiler: cc is not on the path")
def test_constrained_dynamics_in_c_is_the_method(spatial, tmp_path):
    header, source, test = spatial.export_c(["constrained_dynamics", "bias_forces"], tmp_path)
    assert "four_bar_constrained_dynamics" in header.read_text()
    done = subprocess.run(
        ["cc", "-std=c99", source, test, "-o", tmp_path / "test", "-lm"], capture_output=True, text=True
    )
    assert done.returncode == 0 and subprocess.run([tmp_path / "test"], capture_output=True).returncode == 0
    subprocess.run(["cc", "-std=c99", "-shared", "-fPIC", source, "-o", tmp_path / "four_bar.so", "-lm"], check=True)
    q = spatial.consistent([0.3, 0.4, 1.2])
    dq, tau = spatial.project_velocity(q, [1.0, 0, 0]), np.array([1.0, 2.0, 3.0])
    results = [np.zeros(n) for n in (3, 2, 2)]
    pointers = [x.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for x in (q, dq, tau, *results)]
    ctypes.CDLL(str(tmp_path / "four_bar.so")).four_bar_constrained_dynamics(*pointers)
    assert np.abs(results[0] - spatial.forward_dynamics(q, dq, tau).ddq).max() < 1e-12
