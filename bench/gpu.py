"""The bundled panda on a GPU: ``robot.export_cuda``, ``to_jax`` and ``to_torch`` there beside a kernel of the processor.

``python -m bench.gpu`` writes ``bench/GPU.md``. It needs an NVIDIA GPU, ``nvcc``, and JAX and PyTorch with CUDA. Arrays are in
the GPU's memory before and after, so that copies are not counted. Every result is compared with the processor's first.
"""

import os

os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")

import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jax
import numpy as np
import torch

import twistwrench as tw
from bench.cuda_launch import compile_kernel, launch
from bench.machine import describe
from twistwrench.compiler.printers.cuda import OPTIONS

QUANTITIES = ("inverse_dynamics", "mass_matrix", "forward_dynamics", "inverse_dynamics_derivatives")
SAMPLES = (4096, 65_536, 1_048_576)
ROUNDS, REPEATS = 7, 20
FOLDER = Path(__file__).parent


def main() -> None:
    """Measure, and write the table."""
    jax.config.update("jax_enable_x64", True)
    robot = tw.robots.panda()
    gpu = subprocess.run(["nvidia-smi", "--query-gpu=name", "--format=csv,noheader"], capture_output=True, text=True)
    machine = describe()
    lines = [
        "# On a GPU",
        "",
        f"{gpu.stdout.strip()}; one core of {machine['cpu']}; {machine['date']}. Python {machine['python']}, "
        f"JAX {jax.__version__}, PyTorch {torch.__version__}. Nanoseconds per state of the bundled panda, medians of "
        f"{ROUNDS} rounds; arrays are in the GPU's memory, copies are not counted. `python -m bench.gpu` measures again.",
        "",
        "| quantity | states | CUDA, float | CUDA, double | JAX, double | PyTorch, double | processor, one core |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for quantity in QUANTITIES:
        lines += _rows(robot, quantity)
        (FOLDER / "GPU.md").write_text("\n".join(lines) + "\n")


def _rows(robot: tw.Robot, quantity: str) -> Iterator[str]:
    program, kernel = robot.program(quantity), robot.kernel(quantity)
    by_jax, by_torch = jax.jit(jax.vmap(robot.to_jax(quantity))), robot.to_torch(quantity)
    libraries = {}
    for precision in ("float", "double"):
        with tempfile.TemporaryDirectory() as folder:
            (file,) = robot.export_cuda(quantity, folder, precision=precision)
            libraries[precision] = compile_kernel(file.read_text(), file.stem, Path(folder), OPTIONS)
    for samples in SAMPLES:
        rng = np.random.default_rng(0)
        given = [np.ascontiguousarray(rng.standard_normal((samples, *port.shape))) for port in program.inputs]
        expected = _tuple(kernel(*given))
        cells = []
        for precision, dtype, tolerance in (("float", np.float32, 1e-3), ("double", np.float64, 1e-10)):
            inputs = [a.astype(dtype) for a in given]
            outputs = [np.full(e.shape, np.nan, dtype) for e in expected]
            seconds = [launch(libraries[precision], inputs, outputs, samples, REPEATS) for _ in range(ROUNDS)]
            _require_equal(f"CUDA {precision}", quantity, outputs, expected, tolerance)
            cells.append(statistics.median(seconds))
        on_jax = [jax.device_put(a, jax.devices("gpu")[0]) for a in given]
        _require_equal("JAX", quantity, _tuple(by_jax(*on_jax)), expected, 1e-10)
        cells.append(_seconds(lambda f=by_jax, x=on_jax: jax.block_until_ready(f(*x)), REPEATS))
        on_torch = [torch.as_tensor(a, device="cuda") for a in given]
        _require_equal("PyTorch", quantity, [t.cpu() for t in _tuple(by_torch(*on_torch))], expected, 1e-10)
        cells.append(_seconds(lambda f=by_torch, x=on_torch: (f(*x), torch.cuda.synchronize()), 1))
        cells.append(_seconds(lambda f=kernel, x=given: f(*x), 1))
        yield f"| {quantity} | {samples:,} | " + " | ".join(f"{1e9 * s / samples:.3g}" for s in cells) + " |"


def _seconds(call: Callable[[], Any], repeats: int) -> float:
    times = []
    for _ in range(ROUNDS):
        begin = time.perf_counter()
        for _ in range(repeats):
            call()
        times.append((time.perf_counter() - begin) / repeats)
    return statistics.median(times)


def _tuple(result: Any) -> tuple[Any, ...]:
    return tuple(result) if isinstance(result, tuple | list) else (result,)


def _require_equal(package: str, quantity: str, found: Any, expected: Any, tolerance: float) -> None:
    """Largest difference over the largest entry of the array."""
    for f, e in zip(found, expected, strict=True):
        difference = np.abs(np.asarray(f) - e).max() / np.abs(e).max()
        if not difference <= tolerance:
            raise AssertionError(f"{package}, {quantity}: {difference:.1e} apart from the processor's kernel")


if __name__ == "__main__":
    main()
