"""Pictures of a good report and of two bad ones, for docs/how-to/good_and_bad.md.

    python docs/figures/good_and_bad.py [FOLDER]

Writes report_good.png, report_cautions.png and report_not_usable.png (the first screen in a browser) to FOLDER
(default: docs/images), and prints the headline and the checks of each. Needs Chromium with its driver and Selenium
(extra `test`).
"""

from __future__ import annotations

import sys
import tempfile
import warnings
from pathlib import Path

import numpy as np

import uq_handeye as uq
from uq_handeye.read import write_files
from uq_handeye.report.page import report_html

sys.path.insert(0, str(Path(__file__).parent))
from report import screen

SIZE = 820, 1060
NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))


def good() -> uq.Calibration:
    """Return the calibration of 25 poses with large rotations, known noise and declared shared errors."""
    shared = [uq.SharedError.focal_length("0.1%"), uq.SharedError.target_scale("0.02%")]
    return uq.calibrate(uq.simulate(n_poses=25, noise=NOISE, seed=7), noise=NOISE, shared=shared)


def cautions() -> uq.Calibration:
    """Return the calibration of 12 poses with small rotations, a wrong detection, and 65 % of the noise declared."""
    poses = uq.simulate(n_poses=12, noise=NOISE, tilt="8deg", roll="8deg", seed=2)
    camera = poses.camera.copy()
    camera[7, :3, 3] += [0.0, 0.012, 0.02]
    small = uq.PoseNoise(NOISE.robot * 0.65**2, NOISE.camera * 0.65**2)
    return uq.calibrate(uq.PosePairs(poses.robot, camera, setup="eye-in-hand"), noise=small)


def not_usable() -> uq.Calibration:
    """Return the calibration of the good poses with the camera poses inverted."""
    poses = uq.simulate(n_poses=25, noise=NOISE, seed=7)
    inverted = uq.PosePairs(poses.robot, np.linalg.inv(poses.camera), setup="eye-in-hand")
    return uq.calibrate(inverted, noise=NOISE)


def main(folder: Path) -> None:
    pictures = {}
    for make in (good, cautions, not_usable):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", uq.InputWarning)
            result = make()
        print(f"{make.__name__}: {result.headline}")
        for check in result.checks:
            print(f"  {check.name:14}{check.status:9}{check.text}")
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as scratch:
            page = Path(scratch) / "report.html"
            page.write_text(report_html(result), encoding="utf-8")
            pictures[f"report_{make.__name__}.png"] = screen(page, f"{scratch}/profile", dark=False, size=SIZE)
    write_files(folder, pictures)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1] / "images")
