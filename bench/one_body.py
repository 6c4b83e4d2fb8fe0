"""One rigid body and the groups SO(3), SE(3), on rows of random numbers: ours beside NumPy and SciPy."""

import os
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

import twistwrench as tw
from bench import machine
from bench.cases import difference
from bench.timing import ROUNDS, Contender, interleave
from twistwrench import se3, so3

Function = Callable[..., np.ndarray]

SIZES = (4096, 10**6)
SEED = 8
CHECKED = 64  # rows on which both must agree before anything is timed
TOLERANCE = 1e-8
BYTES_A_ROW = 4096  # what a row takes at most, stacked 6x6 matrices and their temporaries included
LONG = 10**5  # rows from which a round takes seconds: a third of the rounds
OURS, STACKED, NUMPY = "twistwrench", "NumPy, stacked 6x6 matrices", "NumPy, Rodrigues' formula"


@dataclass(frozen=True)
class Match:
    """One function of ours on arrays of rows, and its peers by name: none where nobody has the like."""

    name: str
    ours: Function
    inputs: tuple[np.ndarray, ...]
    peers: dict[str, Function]


def times(rounds: int = ROUNDS, sizes: tuple[int, ...] = SIZES) -> dict[str, Any]:
    """Nanoseconds per row for every function and size; sizes that memory does not hold are written down as left out."""
    room = _free_bytes()
    held = [size for size in sizes if room is None or size * BYTES_A_ROW <= room]
    left_out = [size for size in sizes if size not in held]
    where = machine.describe()  # this section may be newer than the others
    results: dict[str, Any] = {
        "date": where["date"],
        "cpu": where["cpu"],
        "left_out": left_out,
        "rounds": {},
        "rows": {},
    }
    for size in held:
        few = rounds if size < LONG else max(rounds // 3, 3)
        results["rounds"][str(size)] = few
        results["rows"][str(size)] = {match.name: _timed(match, size, few) for match in matches(size)}
    return results


def _timed(match: Match, size: int, rounds: int) -> dict[str, Any]:
    print(f"{match.name}: {size} rows", flush=True)
    few = [x[:CHECKED] for x in match.inputs]
    agreement = {name: difference(match.ours(*few), peer(*few)) for name, peer in match.peers.items()}
    for name, error in agreement.items():
        if not error < TOLERANCE:
            raise SystemExit(f"{match.name}: {name} disagrees by {error:.1e}: nothing is timed")
    contenders = [Contender(n, _repeat(f, match.inputs), size) for n, f in {OURS: match.ours, **match.peers}.items()]
    timings = {name: asdict(timing) for name, timing in interleave(contenders, rounds).items()}
    return {"agreement": agreement, "timings": timings}


def matches(size: int) -> Iterator[Match]:
    """All that is timed, on so many random rows."""
    rng = np.random.default_rng(SEED)
    V, dV, F = rng.normal(size=(3, size, 6))
    w, T = V[:, :3].copy(), se3.exp(V)
    body = tw.RigidBody(tw.SpatialInertia.box((0.1, 0.2, 0.3), mass=1.2))
    G = body.inertia.matrix

    def wrench(V: np.ndarray, dV: np.ndarray) -> np.ndarray:
        return dV @ G.T - np.einsum("nji,nj->ni", _ad(V), V @ G.T)

    def acceleration(V: np.ndarray, F: np.ndarray) -> np.ndarray:
        return np.linalg.solve(G, (F + np.einsum("nji,nj->ni", _ad(V), V @ G.T)).T).T

    yield Match("body.wrench(V, dV)", body.wrench, (V, dV), {STACKED: wrench})
    yield Match("body.acceleration(V, F)", body.acceleration, (V, F), {STACKED: acceleration})
    yield Match("Ad(T) @ V", lambda T, V: tw.Ad(T) @ V, (T, V), {STACKED: _Ad_times})
    scipy = _scipy()
    yield Match("so3.exp(w)", so3.exp, (w,), {NUMPY: lambda w: _exp(w)[0], **scipy["so3.exp"]})
    yield Match("se3.exp(V)", se3.exp, (V,), {NUMPY: _pose, **scipy["se3.exp"]})
    yield Match("se3.log(T)", se3.log, (T,), scipy["se3.log"])


# ── peers ──


def _hat(w: np.ndarray) -> np.ndarray:
    W = np.zeros((len(w), 3, 3))
    W[:, 2, 1], W[:, 0, 2], W[:, 1, 0] = w.T
    return W - W.transpose(0, 2, 1)


def _ad(V: np.ndarray) -> np.ndarray:
    ad = np.zeros((len(V), 6, 6))
    ad[:, :3, :3] = ad[:, 3:, 3:] = _hat(V[:, :3])
    ad[:, 3:, :3] = _hat(V[:, 3:])
    return ad


def _Ad_times(T: np.ndarray, V: np.ndarray) -> np.ndarray:
    Ad = np.zeros((len(T), 6, 6))
    Ad[:, :3, :3] = Ad[:, 3:, 3:] = T[:, :3, :3]
    Ad[:, 3:, :3] = _hat(T[:, :3, 3]) @ T[:, :3, :3]
    return np.einsum("nij,nj->ni", Ad, V)


def _exp(w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rodrigues' formula, and the integral that goes with it; they fail at zero, where random rows are not."""
    angle = np.linalg.norm(w, axis=1)[:, None, None]
    W = _hat(w) / angle
    s, c, W2 = np.sin(angle), 1 - np.cos(angle), W @ W
    return np.eye(3) + s * W + c * W2, np.eye(3) + c / angle * W + (1 - s / angle) * W2


def _pose(V: np.ndarray) -> np.ndarray:
    T = np.zeros((len(V), 4, 4))
    T[:, 3, 3] = 1
    T[:, :3, :3], J = _exp(V[:, :3])
    T[:, :3, 3] = np.einsum("nij,nj->ni", J, V[:, 3:])
    return T


def _scipy() -> dict[str, dict[str, Function]]:
    """SciPy's compiled functions; those of SE(3) are there from SciPy 1.16 on."""
    found: dict[str, dict[str, Function]] = {"so3.exp": {}, "se3.exp": {}, "se3.log": {}}
    with suppress(ImportError):
        from scipy.spatial.transform import Rotation

        found["so3.exp"]["SciPy, Rotation"] = lambda w: Rotation.from_rotvec(w).as_matrix()
    with suppress(ImportError):
        from scipy.spatial.transform import RigidTransform

        name = "SciPy, RigidTransform"
        found["se3.exp"][name] = lambda V: RigidTransform.from_exp_coords(V).as_matrix()
        found["se3.log"][name] = lambda T: RigidTransform.from_matrix(T).as_exp_coords()
    return found


def _repeat(function: Function, inputs: tuple[np.ndarray, ...]) -> Callable[[int], None]:
    def sweep(times: int) -> None:
        for _ in range(times):
            function(*inputs)

    return sweep


def _free_bytes() -> int | None:
    """Memory that is free now; None where the system does not say."""
    try:
        return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return None
