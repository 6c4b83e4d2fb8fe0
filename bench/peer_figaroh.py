"""A log identified with FIGAROH as its functions are meant to be used: fit on one log, error on another.

    python bench/peer_figaroh.py ROBOT.urdf TRAIN.csv TEST.csv

It runs in an environment with ``figaroh``, apart from ours, and prints JSON; see beside_figaroh.py.
"""

from __future__ import annotations

import json
import sys
import time
from importlib.metadata import version
from typing import Any

import numpy as np
from figaroh.identification.identification_tools import (
    calculate_first_second_order_differentiation,
    low_pass_filter_data,
)
from figaroh.tools.load_robot import load_robot
from figaroh.tools.qrdecomposition import QRDecomposer
from figaroh.tools.regressor import build_regressor_basic, build_regressor_reduced, get_index_eliminate

CUTOFF = 5.0
SETTINGS = {
    "has_friction": True,
    "has_actuator_inertia": True,
    "has_joint_offset": True,
    "is_joint_torques": True,
    "act_idxq": [0, 1],
    "act_idxv": [0, 1],
    "cut_off_frequency_butterworth": 4.0 * CUTOFF,  # of its formula, ts f / 2 of half the rate
}


def identified(urdf: str, train: str, test: str) -> dict[str, Any]:
    """Base parameters by least squares on one log, and what they leave of the torques of another."""
    robot = load_robot(urdf, load_by_urdf=True)

    def rows(path: str) -> tuple[Any, Any]:
        table = np.loadtxt(path, delimiter=",", skiprows=1)
        settings = SETTINGS | {"ts": float(np.diff(table[:, 0]).mean())}
        smooth = low_pass_filter_data(table[:, [1, 2, 5, 6]], settings)
        q, dq, ddq = calculate_first_second_order_differentiation(robot.model, smooth[:, :2], settings)
        return build_regressor_basic(robot, q, dq, ddq, settings), smooth[: len(q), 2:].T

    W, tau = rows(train)
    without_effect, names = get_index_eliminate(W, {f"p{k}": 0.0 for k in range(W.shape[1])})
    W_e = build_regressor_reduced(W, without_effect)
    base = QRDecomposer().decompose(W_e, names, tau.ravel()).base_indices
    phi = np.linalg.lstsq(W_e[:, base], tau.ravel(), rcond=None)[0]
    W, tau = rows(test)
    errors = tau - (build_regressor_reduced(W, without_effect)[:, base] @ phi).reshape(tau.shape)
    joints = np.sqrt((errors**2).mean(axis=1) / (tau**2).mean(axis=1))
    return {"groups": len(base), "all": float(np.sqrt((errors**2).sum() / (tau**2).sum())), "joints": joints.tolist()}


if __name__ == "__main__":
    found = identified(*sys.argv[1:4])
    print(json.dumps({**found, "seconds": time.process_time(), "version": version("figaroh")}))
