"""Command ``points``: camera poses from points of a target that were measured in 3-D."""

import warnings
from pathlib import Path

from ...core.progress import working
from ...errors import InputError, InputWarning
from ..delivery import deliver_camera_poses
from ..messages import progress_wanted, timed
from ..names import UNITS
from ..pictures import split_exact
from ..values import one_of
from ..views import camera_of


def points_command(
    points: Path,
    target: Path | None = None,
    noise: str | None = None,
    camera_matrix: str | None = None,
    units: str | None = None,
    target_units: str | None = None,
    as_json: bool = False,
    output: Path | None = None,
) -> int:
    """Compute camera poses from points of a target measured in 3-D.

    Examples:
      uq-handeye points points.csv --target target.csv -o seen/
      # Then estimate X from the robot poses and these poses
      uq-handeye calibrate robot.csv seen/ -o result/
      # Tracker with a noise of 0.1 mm in all directions
      uq-handeye points points.csv --target target.csv --noise 0.1mm -o seen/

    For depth cameras, structured light and trackers. Each pose needs three
    points that are not in a line. Outliers are left out and named.

    Arguments:
      POINTS: Points in the frame of the camera, CSV with the header pose,point,x,y,z (m). Pose k, from 0, belongs to
        row k of the robot poses.

    Options:
      * --target FILE: Points in the frame of the target, CSV with the header point,x,y,z (m). Required.
      * --noise SD: Standard deviations of a point across and along the line of sight, e.g. 0.1mm,0.5mm, or one for all
        directions (trackers). Default: both follow from the residuals.
      --camera-matrix MATRIX[,exact]: Intrinsics fx,fy,cx,cy (px) of the depth camera, or their file: their errors move
        all poses alike, 0.1 % (focal length) and 0.001 focal lengths (centre) unless stated or exact. Default: none.
      * --units UNIT <UNITS>: Length unit of POINTS. Default: m.
      --target-units UNIT <UNITS>: Length unit of the target. Default: m.

    Options (Output):
      * -o, --output DIR <named_folder>: Folder for camera poses and their covariance. It holds camera.csv,
        points_covariance.npz, points.json, points.csv, target.csv and residuals.png, and takes the place of CAMERA in
        the other commands.
    """
    from ...model.points.estimate import poses_from_points
    from ...model.points.point_file import read_points, read_target
    from ...model.points.result import to_dict
    from ...read import json_text

    if target is None:
        raise InputError(
            "--target is missing: give the points of the target in its own frame, from its drawing or a measurement. "
            "If its shape is unknown, measure it with the camera at rest: docs/how-to/points.md, unknown target."
        )
    of_points, of_target = (
        None if unit is None else one_of(unit, name, UNITS)
        for unit, name in ((units, "--units"), (target_units, "--target-units"))
    )
    values, exact = None, False
    if camera_matrix is not None:
        matrix, exact = split_exact(camera_matrix)
        camera = camera_of(matrix)
        values = {
            name: (value, camera.sd[name]) if camera.sd.get(name) else value for name, value in camera.values.items()
        }
    with timed(f"reading {points}"):
        measured = read_points(points, of_points)
        known = read_target(target, of_target)
    with timed("fitting poses"), working("fitting poses", progress_wanted()), warnings.catch_warnings():
        if not as_json:
            warnings.simplefilter("ignore", InputWarning)  # the summary has them
        found = poses_from_points(measured, known, noise, intrinsics=values, exact=exact)
    return deliver_camera_poses(found, lambda: json_text(to_dict(found)), output, as_json, "seen/")
