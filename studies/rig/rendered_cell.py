"""Relative poses of four rendered fixed cameras against their truth: joint and separate fits, shared errors or none.

Run ``UQ_HANDEYE_DATA=DIR python -m studies.rig.rendered_cell``; the folder holds ``metric_medium``.
"""

import os
from itertools import combinations
from pathlib import Path

import numpy as np

import uq_handeye as uq
from uq_handeye.read import read_pose_file

from .consistency import error, rms


def run(folder: Path) -> None:
    """Print RMS and mean d^2/6 of the relative poses."""
    robot = uq.read_stream(folder / "robot.csv", "robot")
    arm = uq.ArmPoses(robot.poses, tuple(robot.timestamps.tolist()))
    views, truth = [], {}
    for k in range(1, 5):
        seen = uq.read_stream(folder / f"camera_{k}.csv", "camera")
        views.append(uq.View(f"c{k}", "board", seen.poses, tuple(seen.timestamps.tolist())))
        truth[f"c{k}"] = np.asarray(read_pose_file(folder / f"truth_{k}.csv")[1])[0]
    cameras = dict.fromkeys(truth, "world")
    # all errors that poses share, those of known intrinsics, none
    for shared in (True, ("accuracy", "scale"), False):
        found = uq.calibrate_rig(uq.Rig({"arm": arm}, cameras, {"board": "arm"}, tuple(views)), shared=shared)
        joint, squares = [], []
        for pair, (one, two) in zip(found.pairs, combinations(truth, 2), strict=True):
            joint.append(error(pair.pose, np.linalg.inv(truth[one]) @ truth[two]))
            squares.append(joint[-1] @ np.linalg.solve(pair.covariance, joint[-1]) / 6)
        print(f"shared={shared}: joint {rms(joint)}, mean d^2/6 {np.mean(squares):.2f}")
        try:
            alone = {
                view.camera: uq.calibrate_rig(
                    uq.Rig({"arm": arm}, {view.camera: "world"}, {"board": "arm"}, (view,)), shared=shared
                ).poses[0]
                for view in views
            }
        except uq.NotConvergedError as failed:
            print(f"shared={shared}: separate: {failed}")
            continue
        apart = [error(np.linalg.inv(alone[i]) @ alone[j], np.linalg.inv(truth[i]) @ truth[j])
                 for i, j in combinations(truth, 2)]  # fmt: skip
        print(f"shared={shared}: separate {rms(apart)}")


if __name__ == "__main__":
    run(Path(os.environ["UQ_HANDEYE_DATA"]) / "metric_medium")
