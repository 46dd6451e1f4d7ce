"""The command ``camera``, and the pictures that ``calibrate`` takes as well: from board corners to camera poses."""

from pathlib import Path
from typing import Annotated

import typer

from ...errors import InputError
from ...runtime.progress import working
from ..messages import progress_wanted, timed
from ..options import UNITS, JsonOption, emit, folder_option, made_of, one_of, option
from ..pictures import BoardOptions, LensOptions, read_two_numbers

TABLES = (".csv", ".txt", ".tsv")


@made_of(board=BoardOptions, lens=LensOptions)
def camera_command(
    files: Annotated[
        list[str],
        typer.Argument(metavar="CORNERS.csv or 'PATTERN'", help="Corners in a table; or pictures, e.g. 'img/*.png'."),
    ],
    board: "BoardOptions",
    lens: "LensOptions",
    image_size: Annotated[
        str | None,
        option("--image-size", metavar="WIDTHxHEIGHT", help="Of the pictures, in pixels, for corners in a table."),
    ] = None,
    units: Annotated[
        str | None, option("--units", of=UNITS, metavar="UNIT", help="Length unit of a table of corners. Left out: m.")
    ] = None,
    as_json: JsonOption = False,
    output: Annotated[
        Path | None,
        folder_option(
            "Write camera.csv, camera_covariance.npz, intrinsics.json, intrinsics.yaml (OpenCV), corners.csv, "
            "board.csv (the board as measured) and the report here."
        ),
    ] = None,
) -> None:
    """Intrinsics, camera poses and their joint covariance from pictures of a board.

    Example: uq-handeye camera 'img/*.png' --board 9x6 --square 20mm -o camera/

    Or from corners found by another program, with the header row,x,y,z,u,v:
    uq-handeye camera corners.csv --image-size 1920x1080 -o camera/

    Picture k, from 0 in the order of the names (img2 before img10), belongs to
    row k of the robot poses. Then: uq-handeye calibrate robot.csv camera/
    """
    if len(files) == 1 and Path(files[0]).suffix.lower() in TABLES:
        if board.given and board.file is None:
            raise InputError(f"{', '.join(board.given)} are about pictures, and {files[0]} is a table of corners.")
        from ...camera.files.corner_file import read_corners

        size = None if image_size is None else read_two_numbers(image_size, "--image-size", "1920x1080")
        with timed(f"reading {files[0]}"):
            corners = read_corners(files[0], "m" if units is None else one_of(units, "--units", UNITS))
    else:
        for name, value in (("--image-size", image_size), ("--units", units)):
            if value is not None:
                raise InputError(
                    f"{name} is about a table of corners (.csv); pictures tell it themselves: leave it out."
                )
        from ...camera.board import detect_board

        size = None
        with timed("looking for the board"):
            corners = detect_board(files, board.read(), progress=progress_wanted())
    found = lens.calibrate(corners, size, board.shape())
    if output is not None:
        with timed(f"writing {output}"), working(f"writing {output}", progress_wanted()):
            found.write(output)
    if as_json:
        from ...camera.files.folder_writer import to_dict
        from ...io import json_text

        emit(json_text(to_dict(found)))
        return
    text = found.summary()
    if output is None:
        text += "\nNothing was written: give -o camera/ to go on with uq-handeye calibrate robot.csv camera/\n"
    else:
        text += f"\nWrote {output}. Next: uq-handeye calibrate robot.csv {output}\n"
    emit(text)
