"""The Robotics Toolbox for Python, in a process of its own: `python peer_rtb.py POSES.npz`, then lines `far 3` or `near 3`.

Each line is answered when so many sweeps over all poses are done, by the share of them that was reached. It stands alone: this
Python has no other packages of the benchmark.
"""

import sys
from typing import Any

import numpy as np

TOLERANCE = 0.5e-20
"""Half the square of what may be left, rad and m together: 1e-10, as ours by default."""


def main() -> None:
    try:
        import roboticstoolbox as rtb
    except ImportError:
        print("missing", flush=True)
        return
    chain = rtb.models.Panda().ets()
    poses = np.load(sys.argv[1])
    if np.abs(chain.fkine(poses["q"][0]).A - poses["T"][0]).max() > 1e-9:
        print("another robot", flush=True)
        return
    print("ready", rtb.__version__, flush=True)
    targets, starts = list(poses["T"]), list(poses["near"])
    for line in sys.stdin:
        which, count = line.split()
        q0 = starts if which == "near" else [None] * len(targets)
        for _ in range(int(count)):
            pairs = zip(targets, q0, strict=True)
            found = [chain.ik_LM(T, q0=start, tol=TOLERANCE, joint_limits=True) for T, start in pairs]
        print(float(np.mean([success_of(one) for one in found])), flush=True)


def success_of(answer: Any) -> bool:
    """Whether the pose was reached: of an object since version 1.5, of a tuple before."""
    return bool(answer.success if hasattr(answer, "success") else answer[1])


if __name__ == "__main__":
    main()
