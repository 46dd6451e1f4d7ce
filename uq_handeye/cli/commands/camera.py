"""Command ``camera``: intrinsics and board poses from pictures or corners of a board."""

import warnings
from pathlib import Path

from ...errors import InputError, InputWarning
from ..boards import BoardOptions, read_two_numbers
from ..delivery import deliver_camera_poses
from ..messages import progress_wanted, timed
from ..names import UNITS
from ..pictures import LensOptions
from ..values import one_of
from ..views import PIXEL_ORIGINS

TABLES = (".csv", ".txt", ".tsv")


def camera_command(
    files: list[str],
    board: BoardOptions,
    lens: LensOptions,
    image_size: str | None = None,
    units: str | None = None,
    pixel_origin: str | None = None,
    as_json: bool = False,
    output: Path | None = None,
) -> int:
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
      --pixel-origin NAME <PIXEL_ORIGINS>: What the table has at pixel (0, 0): the centre of the first pixel or its
        corner, as AprilTag's libraries have. Default: centre.

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
        from ...model.camera.corners_file import read_corners

        size = None if image_size is None else read_two_numbers(image_size, "--image-size", "1920x1080")
        with timed(f"reading {files[0]}"):
            corners = read_corners(files[0], "m" if units is None else one_of(units, "--units", UNITS))
        if pixel_origin is not None and one_of(pixel_origin, "--pixel-origin", PIXEL_ORIGINS) == "corner":
            from ...model.camera.pixel_origin import corners_from_centre

            corners = corners_from_centre(corners)
    else:
        for name, value in (("--image-size", image_size), ("--units", units), ("--pixel-origin", pixel_origin)):
            if value is not None:
                raise InputError(f"{name} applies to a table of corners (.csv), not to pictures. Remove the option.")
        from ...model.camera.board import detect_board

        size = None
        with timed("looking for the board"):
            corners = detect_board(files, board.read(), progress=progress_wanted())
    with warnings.catch_warnings():
        if not as_json:
            warnings.simplefilter("ignore", InputWarning)  # the summary has them
        found = lens.calibrate(corners, size, board.shape())
    from ...model.camera.calibration_files import to_dict
    from ...read import json_text

    return deliver_camera_poses(found, lambda: json_text(to_dict(found)), output, as_json, "camera/")
