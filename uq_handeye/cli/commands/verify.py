"""Command ``verify``: a stored result tested by points that the camera saw and the tool touched."""

from pathlib import Path
from typing import TYPE_CHECKING

from ...core.files.csv_text import csv_text
from ...core.files.json_files import json_text
from ...errors import InputError
from ..delivery import deliver_answer
from ..exit_status import ExitStatus
from ..names import UNITS
from ..printing import shown
from ..stored import OneOfRig
from ..touches import TouchOptions
from ..values import metres, one_of

if TYPE_CHECKING:
    from ...calibration.result import Calibration
    from ...core.geometry.se3 import Array
    from ...use.verification.result import Verification
    from ...use.verification.verify_cameras import CameraVerification
    from ...use.verification.verify_poses import PoseVerification


def verify_command(
    result: Path,
    touching: TouchOptions,
    chosen: OneOfRig,
    touches: Path | None = None,
    show: str = "0.5mm",
    candidates: Path | None = None,
    poses: tuple[Path, Path] | None = None,
    camera_poses: Path | None = None,
    as_json: bool = False,
    output: Path | None = None,
) -> int:
    """Test a stored result by touching points that the camera saw.

    Examples:
      uq-handeye verify result/result.json touches.csv --tcp-sd 0.2mm
      # Touched with a tool whose offset is unknown; noise of the seen points
      uq-handeye verify result/result.json touches.csv --tcp-sd 0.2mm \\
          --point-sd 0.3mm --tool-sd unknown
      # Points that the left camera of a rig saw
      uq-handeye verify result/result.json touches.csv --camera left --tcp-sd 0.2mm
      # How many touches until a bias of 1 mm would show
      uq-handeye verify result/result.json touches.csv --tcp-sd 0.2mm --show 1mm

    Exit status 4 if the touches contradict the result.

    Arguments:
      touches = TOUCHES.csv: Points seen and touched, one row each. Columns: see the page.

    Options (Touches):
      --poses ROBOT.csv CAMERA.csv: New poses in place of touches: an independent data set of the same cell.

      --camera-poses FILE: Camera poses of the same rig by caliscope, aniposelib, multical or vision-calibration, in
        place of touches: the relative poses are compared. --units is the length of one unit there, e.g. 25mm.

    Options (Output):
      * -o, --output DIR <named_folder>: Folder for verification.json and points.csv (m).
      * --show LENGTH: Bias that should show, e.g. 0.5mm. The answer says how many touches it takes.
      --candidates FILE.csv: Points that could be touched next, x,y,z in the camera frame (m). Default: the region seen
        so far.
    """
    from ...use.verification.verify import verify

    if sum(data is not None for data in (touches, poses, camera_poses)) != 1:
        raise InputError(
            "Give one of TOUCHES.csv, points seen and touched, --poses ROBOT.csv CAMERA.csv, and --camera-poses FILE."
        )
    if camera_poses is not None:
        return _by_cameras(result, camera_poses, touching, as_json, output)
    stored = chosen.read(result)
    if poses is not None:
        return _by_poses(stored, poses, touching, as_json, output)
    assert touches is not None
    given = touching.read(touches, stored.kinematics)
    found = verify(stored, given, show=show, candidates=None if candidates is None else _points(candidates))
    return _deliver(found, as_json, output, {"points.csv": _csv(found)})


def _by_cameras(result: Path, camera_poses: Path, touching: TouchOptions, as_json: bool, output: Path | None) -> int:
    """Compare the relative poses of a rig with those of another program."""
    from ...calibration.load import load
    from ...core.presentation.units import LENGTH_UNITS
    from ...read.camera_poses import read_camera_poses
    from ...use.verification.verify_cameras import verify_cameras

    text = touching.units
    unit = LENGTH_UNITS[text] if text in UNITS else metres(text, "--units")
    found = verify_cameras(load(result), read_camera_poses(camera_poses), unit)
    return _deliver(found, as_json, output, {})


def _by_poses(
    stored: "Calibration", poses: tuple[Path, Path], touching: TouchOptions, as_json: bool, output: Path | None
) -> int:
    from ...read import read_poses
    from ...use.verification.verify_poses import verify_poses

    data = read_poses(*poses, setup=stored.setup, units=one_of(touching.units, "--units", UNITS))
    found = verify_poses(stored, data)
    return _deliver(found, as_json, output, {})


def _deliver(
    found: "Verification | PoseVerification | CameraVerification",
    as_json: bool,
    output: Path | None,
    tables: dict[str, str],
) -> int:
    """Print a verification, write its files, and return the exit status."""
    from ...core.presentation.document import document_of

    text = json_text(found.to_dict())
    deliver_answer(text, shown(document_of(found)), as_json, output, lambda: {"verification.json": text, **tables})
    return ExitStatus.CONTRADICTED if found.contradicted else ExitStatus.DONE


def _points(path: Path) -> "Array":
    """Read points x, y, z (m, or the unit that the names say) of a table with a header, or of an array of NumPy."""
    import numpy as np

    from ...core.files.one_line import short
    from ...core.files.open import opened, shown
    from ...core.files.table import Places, Schema, read_table
    from ...core.presentation.units import LENGTH_UNITS
    from ...formats.columns import meaning_and_unit
    from ...formats.numpy_poses import read_one_array

    def places(names: list[str], line: str, where: str) -> Places:
        meant = [meaning_and_unit(name)[0] for name in names]
        if missing := [axis for axis in "xyz" if axis not in meant]:
            raise InputError(f"{where}: expected the header x,y,z (m), got {short(line)}: no {', '.join(missing)}.")
        return Places([meant.index(axis) for axis in "xyz"])

    with opened(path, 10_000_000) as file:
        if path.suffix == ".npy":
            return read_one_array(file.read(), shown(path))
        table = read_table(file, shown(path), Schema("the header x,y,z", "point", places))
    table.require_finite()
    units = (meaning_and_unit(table.column(k))[1] for k in range(3))
    return np.asarray(table.values * [LENGTH_UNITS[unit or "m"] for unit in units])


def _csv(found: "Verification") -> str:
    table = found.points
    head = "point,difference_x,difference_y,difference_z,distance,sd_x,sd_y,sd_z,p_value,differs"
    rows = [
        [name, *d, length, *sd, p, str(flag).lower()]
        for name, d, length, sd, p, flag in zip(
            table.names, table.difference.tolist(), table.distance.tolist(), table.std.tolist(),
            table.p_value.tolist(), table.flagged.tolist(), strict=True,
        )
    ]  # fmt: skip
    return csv_text([head.split(","), *rows])
