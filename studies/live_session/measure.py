"""Time of an answer and memory of a session with its page.

    python -m studies.live_session.measure [UPDATES]

Poses of a simulated rig are taken one by one up to 60; the CPU time of each answer includes what the page is told. Then
one pose of the first 12 is left out and taken back UPDATES times (default 1000), with the resident memory at the end of
each tenth; last, X is held against `calibrate` on the same file, bit by bit.
"""

from __future__ import annotations

import sys
import time
import warnings
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import uq_handeye as uq

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))


def resident() -> float:
    """Return the resident memory of this process (MB)."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * 4096 / 1e6


def main(updates: int = 1000) -> None:
    """Measure and print."""
    warnings.simplefilter("ignore")
    poses = uq.simulate(n_poses=60, noise=NOISE, seed=1)
    with TemporaryDirectory() as folder, uq.live(folder, port=0) as session:
        spent = []
        for robot, camera in zip(poses.robot, poses.camera, strict=True):
            start = time.process_time()
            session.add(robot, camera)
            spent.append(time.process_time() - start)
        print(f"answers, CPU s: median {np.median(spent):.3f}, at 60 poses {spent[-1]:.3f}, largest {max(spent):.3f}")
        expected = uq.calibrate(uq.read_poses(Path(folder) / "poses.jsonl"))
        print("X bit-equal to calibrate:", np.array_equal(session.result.X, expected.X) if session.result else None)
    with TemporaryDirectory() as folder, uq.live(folder, port=0) as session:
        for robot, camera in zip(poses.robot[:12], poses.camera[:12], strict=True):
            session.add(robot, camera)
        for k in range(updates):
            (session.take_back if k % 2 else session.leave_out)(5)
            if k % max(updates // 10, 1) == 0:
                print(f"after {k} updates: {resident():.1f} MB")
        print(f"after {updates} updates: {resident():.1f} MB")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
