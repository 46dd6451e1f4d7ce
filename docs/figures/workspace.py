"""The picture of the workspace in the guide from joints and URDF, from the data that the guide makes.

    python docs/figures/workspace.py [FOLDER]

Writes workspace.png to FOLDER, docs/images if left out.
"""

from __future__ import annotations

import os
import re
import sys
import tempfile
from pathlib import Path

import uq_handeye as uq
from uq_handeye.calibration.report.workspace_figure import workspace_figure
from uq_handeye.core.presentation.ellipses import render
from uq_handeye.read import write_files

DOCS = Path(__file__).resolve().parents[1]


def calibrated() -> uq.Calibration:
    """The calibration of the guide."""
    text = (DOCS / "how-to" / "kinematics.md").read_text(encoding="utf-8")
    made, _ = re.findall(r"^```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    before = os.getcwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            names: dict[str, object] = {}
            exec(compile(made, "kinematics.md", "exec"), names)
            arm = names["arm"]
            assert isinstance(arm, uq.Kinematics)
            poses = uq.read_poses(None, "camera.csv", setup="eye-in-hand", joints="joints.csv", kinematics=arm)
        finally:
            os.chdir(before)
    return uq.calibrate(poses, kinematics=arm, kinematic_errors=uq.KinematicErrors(robot_class="industrial"))


def main(folder: Path) -> None:
    """Write the picture."""
    found = calibrated().over_workspace
    assert found is not None
    write_files(folder, {"workspace.png": render(workspace_figure(found), "png")})


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else DOCS / "images")
