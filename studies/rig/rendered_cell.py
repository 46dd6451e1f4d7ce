"""Relative poses of four rendered fixed cameras against their truth: joint and separate fits, shared errors or none;
from finished poses, and from corners by intrinsics of which nothing is said, or known to a part in a million.

Run ``UQ_HANDEYE_DATA=DIR python -m studies.rig.rendered_cell``; the folder holds ``metric_medium``.
"""

import json
import os
import tempfile
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd

import uq_handeye as uq
from uq_handeye.calibration.calibrate_rig import calibrate_rig
from uq_handeye.read import read_pose_file

from .consistency import error, rms

INTRINSICS = {"fx": 1371.0227, "fy": 1371.0227, "cx": 959.5, "cy": 539.5}


def by_corners(folder: Path, known: bool) -> uq.RigCalibration:
    """Return the estimate from corners, in a rig file; ``known``: standard deviations of 1e-6 px beside intrinsics."""
    with tempfile.TemporaryDirectory() as own:
        lines = [f'[arms.arm]\nposes = "{folder}/robot.csv"', '[targets.board]\non = "arm"']
        given = {name: [value, 1e-6] if known else value for name, value in INTRINSICS.items()}
        (Path(own) / "intrinsics.json").write_text(json.dumps(given))
        for k in range(1, 5):
            seen = pd.read_csv(folder / f"corners_{k}.csv")
            seen.assign(row=seen["row"] - 1).to_csv(Path(own) / f"{k}.csv", index=False)  # its rows count from 1
            lines.append(f'[cameras.c{k}]\non = "world"\nintrinsics = "intrinsics.json"')
            lines.append(f'[[views]]\ncamera = "c{k}"\ntarget = "board"\ncorners = "{k}.csv"')
        (Path(own) / "rig.toml").write_text("\n".join(lines))
        return calibrate_rig(*uq.read_rig(Path(own) / "rig.toml"))


def joint_error(found: uq.RigCalibration, truth: dict[str, np.ndarray]) -> str:
    """Format RMS and mean d^2/6 of the relative poses."""
    joint, squares = [], []
    for pair, (one, two) in zip(found.pairs, combinations(truth, 2), strict=True):
        joint.append(error(pair.pose, np.linalg.inv(truth[one]) @ truth[two]))
        squares.append(joint[-1] @ np.linalg.solve(pair.covariance, joint[-1]) / 6)
    return f"joint {rms(joint)}, mean d^2/6 {np.mean(squares):.2f}"


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
        found = calibrate_rig(uq.Rig({"arm": arm}, cameras, {"board": "arm"}, tuple(views)), shared=shared)
        print(f"shared={shared}: {joint_error(found, truth)}")
        try:
            alone = {
                view.camera: calibrate_rig(
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
    for known in (False, True):
        print(f"corners, intrinsics {'known' if known else 'unknown'}: {joint_error(by_corners(folder, known), truth)}")


if __name__ == "__main__":
    run(Path(os.environ["UQ_HANDEYE_DATA"]) / "metric_medium")
