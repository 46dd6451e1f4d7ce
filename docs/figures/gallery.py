"""Write the gallery: first screens of ten recorded rigs, as `uq-handeye calibrate` prints them.

    UQ_HANDEYE_DATA=FOLDER python docs/figures/gallery.py

Every number on the page is printed by the program; nothing of the data is copied. Read the difference before you commit
it. The sentences around the screens are in this file.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

PAGE = Path(__file__).resolve().parents[1] / "how-to" / "gallery.md"
HEAD = """# Ten recorded rigs

First screens of recorded data sets, by the commands above them. Compare yours: which errors limit X, which checks are
cautions, and what the program asks for. Rigs that get no X are shown as they are. The page is written by
`docs/figures/gallery.py`.

"""
# Title, what it is, folder, arguments.
RIGS = (
    ("KUKA arm, large board", "Camera on the gripper, 28 x 17 corners.", "kuka_1", "robot.csv camera.csv"),
    (
        "Industrial arm, grid of dots",
        "Camera on the arm, corners of a printed grid.",
        "industrial_grid_10x10",
        "robot.csv camera.csv",
    ),
    (
        "Positioner with two axes",
        "Camera in the cell, target on a positioner.",
        "industrial_kinematic",
        "robot.csv camera.csv --setup eye-to-hand",
    ),
    ("Franka FR3, joints with URDF", "The arm's own errors are part of the fit.", "fr3_philnad",
     "camera.csv --joints joints.csv --urdf model.urdf"),
    ("Franka FR3, flange poses", "The same poses without joints.", "fr3_philnad", "robot.csv camera.csv"),
    ("Arm with a board, published poses", "The data of a paper on the covariance of X.", "nguyen_pham",
     "robot.csv camera.csv"),
    ("Published poses with wrong rows", "Left as they were published.", "wu_2019_as_published", "robot.csv camera.csv"),
    ("Four fixed cameras, the first", "One arm and several cameras in the cell, each calibrated alone.",
     "metric_medium",
     "robot.csv camera_1.csv --pair time --setup eye-to-hand"),
    ("Four fixed cameras, the second", "The same arm and target.", "metric_medium",
     "robot.csv camera_2.csv --pair time --setup eye-to-hand"),
    ("Hundreds of poses of a moving arm", "Robot poses interpolated at the times of the camera.",
     "ethz_robot_arm_sync", "robot.csv camera.csv --only 300-699"),
)  # fmt: skip


def main() -> None:
    """Run all commands and write the page."""
    folder = Path(os.environ["UQ_HANDEYE_DATA"])
    parts = [HEAD]
    for title, words, name, arguments in RIGS:
        command = [sys.executable, "-m", "uq_handeye", "calibrate", *arguments.split()]
        done = subprocess.run(command, cwd=folder / name, capture_output=True, text=True, check=False)
        screen = done.stdout.rstrip() or done.stderr.rstrip()
        shown = f"$ uq-handeye calibrate {arguments}\n{screen}\n(exit status {done.returncode})"
        parts.append(f"## {title}\n\n{words}\n\n".replace("\n\n\n", "\n") + f"```text\n{shown}\n```\n\n")
        print(f"{title}: {done.returncode}", flush=True)
    PAGE.write_text("".join(parts).rstrip() + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
