"""Camera poses: ``camera`` from pictures or corners of a board, ``points`` from points of a target measured in 3-D."""

import warnings
from pathlib import Path

from ...core.runtime.progress import working
from ...errors import InputError, InputWarning
from ..delivery import deliver_camera_poses
from ..messages import progress_wanted, timed
from ..options.common import UNITS, made_of, one_of
from ..pictures import BoardOptions, LensOptions, read_two_numbers

TABLES = (".csv", ".txt", ".tsv")


@made_of(board=BoardOptions, lens=LensOptions)
def camera_command(
    files: list[str],
    board: "BoardOptions",
    lens: "LensOptions",
    image_size: str | None = None,
    units: str | None = None,
    as_json: bool = False,
    output: Path | None = None,
) -> None:
    """Calibrate a camera from pictures of a board.

    Examples:
      uq-handeye camera 'img/*.png' --board 9x6 --square 20mm -o camera/
      # Then estimate X from the robot poses and this camera
      uq-handeye calibrate robot.csv camera/ -o result/
      # Corners found by another program, with the header row,x,y,z,u,v
      uq-handeye camera corners.csv --image-size 1920x1080 -o camera/

    Estimates the intrinsics, the shape of the board, the pose of the camera at
    each picture, and the joint covariance of all of them.

    Picture k, from 0 in the order of the names (img2 before img10), belongs to
    row k of the robot poses.

    Arguments:
      files = PICTURES: Pictures, e.g. 'img/*.png', or one table of corners (.csv).

    Options (Table of corners):
      * --image-size WxH: Size of the pictures (px), e.g. 1920x1080.
      --units UNIT <UNITS>: Length unit of the table of corners. Default: m.

    Options (Output):
      * -o, --output DIR <named_folder>: Folder for camera poses, intrinsics and report. It holds camera.csv,
        camera_covariance.npz, intrinsics.json, intrinsics.yaml (OpenCV), corners.csv, board.csv (the board as measured)
        and the report.
    """
    if len(files) == 1 and Path(files[0]).suffix.lower() in TABLES:
        if board.given and board.file is None:
            raise InputError(
                f"{', '.join(board.given)}: for pictures, but {files[0]} is a table of corners. Remove it."
            )
        from ...model.camera.corners import read_corners

        size = None if image_size is None else read_two_numbers(image_size, "--image-size", "1920x1080")
        with timed(f"reading {files[0]}"):
            corners = read_corners(files[0], "m" if units is None else one_of(units, "--units", UNITS))
    else:
        for name, value in (("--image-size", image_size), ("--units", units)):
            if value is not None:
                raise InputError(f"{name} applies to a table of corners (.csv), not to pictures. Remove the option.")
        from ...model.camera.board import detect_board

        size = None
        with timed("looking for the board"):
            corners = detect_board(files, board.read(), progress=progress_wanted())
    found = lens.calibrate(corners, size, board.shape())
    from ...model.camera.result import to_dict

    deliver_camera_poses(found, to_dict, output, as_json, "camera/")


def points_command(
    points: Path,
    target: Path | None = None,
    noise: str | None = None,
    units: str | None = None,
    target_units: str | None = None,
    as_json: bool = False,
    output: Path | None = None,
) -> None:
    """Compute camera poses from points of a target measured in 3-D.

    Examples:
      uq-handeye points points.csv --target target.csv -o seen/
      # Then estimate X from the robot poses and these poses
      uq-handeye calibrate robot.csv seen/ -o result/
      # Target not measured: its shape is estimated, too
      uq-handeye points points.csv -o seen/
      # Tracker with the same noise in all directions
      uq-handeye points points.csv --target target.csv --noise isotropic

    For depth cameras, structured light and trackers. Each pose needs three
    points that are not in a line. The noise is estimated across and along the
    line of sight; wrong points are left out and named.

    Arguments:
      POINTS: Points in the frame of the camera, CSV with the header pose,point,x,y,z (m). Pose k, from 0, belongs to
        row k of the robot poses.

    Options:
      * --target FILE: Points in the frame of the target, CSV with the header point,x,y,z (m). Default: the shape of the
        target is estimated with the poses.
      * --noise SD: Standard deviations of a point across and along the line of sight, e.g. 0.1mm,0.5mm. One value, or
        isotropic to estimate one: the same in all directions (trackers). Default: both are estimated.
      * --units UNIT <UNITS>: Length unit of POINTS. Default: m.
      --target-units UNIT <UNITS>: Length unit of the target. Default: m.

    Options (Output):
      * -o, --output DIR <named_folder>: Folder for camera poses and their covariance. It holds camera.csv,
        points_covariance.npz, points.json, points.csv, target.csv and residuals.png, and takes the place of CAMERA in
        the other commands.
    """
    from ...model.points.estimate import poses_from_points
    from ...model.points.files.point_file import read_points, read_target
    from ...model.points.result import to_dict

    if target is None and target_units is not None:
        raise InputError("--target-units needs --target. Give the file of the target, or remove the option.")
    of_points, of_target = (
        None if unit is None else one_of(unit, name, UNITS)
        for unit, name in ((units, "--units"), (target_units, "--target-units"))
    )
    with timed(f"reading {points}"):
        measured = read_points(points, of_points)
        known = None if target is None else read_target(target, of_target)
    with timed("fitting poses"), working("fitting poses", progress_wanted()), warnings.catch_warnings():
        if not as_json:
            warnings.simplefilter("ignore", InputWarning)  # the summary has them
        found = poses_from_points(measured, known, noise)
    deliver_camera_poses(found, to_dict, output, as_json, "seen/")
