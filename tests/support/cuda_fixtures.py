"""Fixtures of the tests of robot.cuda."""

from __future__ import annotations

import ctypes
import gc
import subprocess
from pathlib import Path

import pytest
from fake_gpu import Gpu

import twistwrench as tw
from twistwrench.kernels import cuda_driver, nvrtc


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cuda")
    made = folder / "fake_cuda.so"
    source = Path(__file__).with_name("fake_cuda.c")
    subprocess.run(["cc", "-std=gnu11", "-O1", "-shared", "-fPIC", source, "-o", made, "-ldl"], check=True)
    loaded = ctypes.CDLL(str(made))
    loaded.fake_folder(str(folder).encode())
    return loaded, str(made)


@pytest.fixture
def gpu(library, monkeypatch):
    loaded, path = library
    monkeypatch.setattr(cuda_driver, "_NAMES", ("no-such-driver.so", path))
    monkeypatch.setattr(nvrtc, "_places", lambda: iter(["no-such-compiler.so", path]))
    monkeypatch.setenv("TWISTWRENCH_CACHE_DIR", "off")
    cuda_driver.driver.cache_clear()
    nvrtc.compiler.cache_clear()
    made = Gpu(loaded)
    made.reset()
    yield made
    gc.collect()
    cuda_driver.driver.cache_clear()
    nvrtc.compiler.cache_clear()


@pytest.fixture
def arm():
    return tw.robots.planar_2r()
