"""Command ``predict``: points and camera poses at other robot poses."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ...core.files.csv_text import csv_text
from ...core.limits import MAX_PRINTED_ROWS
from ...errors import InputError
from ..delivery import deliver_answer, refused_as_not_usable
from ..exit_status import ExitStatus
from ..stored import OneOfRig, refuse, run_each
from ..values import coordinates

if TYPE_CHECKING:
    from ...calibration.prediction.predict import CameraPrediction
    from ...calibration.result import Calibration
    from ...core.geometry.se3 import Array
    from ...core.presentation.document import Paragraph
    from ...fit.diagnostics.task_space import PointUncertainty


TableRow = list[float | str]


class Places(NamedTuple):
    """Options of the robot poses to predict at.

    Options (Robot poses):
      * --joints FILE.csv: Joint values to predict at, named as in the calibration.
      * --robot FILE.csv: Robot poses base_T_gripper to predict at. For a calibration without joints, or with --joints
        if the controller's poses differ from those of the joints.
      --units UNIT <UNITS>: Length unit of --robot: {UNITS}. Default: as its format says, else m.
      --format NAME <FORMAT_NAMES>: Format of --robot, as of calibrate. Default: told by the content.
    """

    joints: Path | None = None
    joint_units: str | None = None
    robot: Path | None = None
    units: str | None = None
    format: str | None = None


class PredictOptions(NamedTuple):
    """Options of what is predicted.

    Options:
      * --point X,Y,Z: Point in camera coordinates, e.g. 0mm,0mm,300mm. Predicts its position in the base frame.
        Repeatable.
      * --reached-at FILE.csv: Joint values that bring the tool to the points of --joints. Row by row; predicts how far
        it misses.
      * --tool X,Y,Z: Tool tip in the flange frame, for --reached-at. For example 0mm,0mm,150mm. Default: its origin.
      * --camera: Predict camera_T_target, the poses that the camera should see.
      --of CAMERA: With the result of a rig: the camera whose points or poses are predicted. Default: each.
      of_target = --target NAME: With the result of a rig: the target that this camera sees. Default: the one that it
        sees most often.
      --into CAMERA: With the result of a rig: predict --point in the frame of this camera. Default: the base of its
        arm.
      * --length L: Side of a square that the camera measures, e.g. 100mm. Predicts the error of a length, a plane and a
        point, by calibration and measurement. With --at and --pixel-noise.
      --at D: With --length: distance of the square from the camera, e.g. 0.5m.
      --pixel-noise S: With --length: noise of its corners, e.g. 0.2px.
      --focal-length F: With --length: focal length, e.g. 1000px. Default: of the pictures of the calibration.
      --no-noise: With --camera: leave out the noise of a new measurement.
    """

    point: list[str] | None = None
    reached_at: Path | None = None
    tool: str | None = None
    camera: bool = False
    of: str | None = None
    of_target: str | None = None
    into: str | None = None
    length: str | None = None
    at: str | None = None
    pixel_noise: str | None = None
    focal_length: str | None = None
    no_noise: bool = False

    def require_possible(self, at: Places, setup: str | None) -> None:
        """Raise `InputError` for options that are impossible or exclude each other."""
        if self.into is not None:
            raise InputError("--into is for the result of several cameras. Remove it.")
        of_task = {"--at": self.at, "--pixel-noise": self.pixel_noise}
        if self.length is not None:
            if missing := [name for name, value in of_task.items() if value is None]:
                raise InputError(f"--length needs {missing[0]}. Add it, e.g. --at 0.5m --pixel-noise 0.2px.")
            others = {"--point": self.point, "--camera": self.camera, "--joints": at.joints, "--robot": at.robot}
            if given := [name for name, value in others.items() if value]:
                raise InputError(f"--length is predicted at the calibrated poses. Remove {given[0]}.")
            return
        more = of_task | {"--focal-length": self.focal_length}
        if given := [name for name, value in more.items() if value is not None]:
            raise InputError(f"{given[0]} needs --length, the side of the square. Add it.")
        if bool(self.point) == self.camera:
            raise InputError("Give either --point X,Y,Z in camera coordinates, or --camera for camera poses.")
        if self.no_noise and not self.camera:
            raise InputError("--no-noise needs --camera: a point in the base frame is not a measurement.")
        if self.reached_at is not None and self.camera:
            raise InputError("--reached-at needs --point, the point that the tool is brought to.")
        if self.tool is not None and self.reached_at is None:
            raise InputError("--tool needs --reached-at FILE.csv, the joint values at the point. Add it.")
        fixed = setup == "eye-to-hand" and self.point
        if at.joints is None and at.robot is None and self.reached_at is None and not fixed:
            raise InputError("No robot poses to predict at. Give --joints FILE.csv or --robot FILE.csv.")
        if at.joint_units is not None and at.joints is None and self.reached_at is None:
            raise InputError("--joint-units needs --joints. Remove it.")
        for name, value in (("--units", at.units), ("--format", at.format)):
            if value is not None and at.robot is None:
                raise InputError(f"{name} needs --robot. Remove it.")


def predict_command(
    result: Path, places: Places, wanted: PredictOptions, as_json: bool = False, output: Path | None = None
) -> int:
    r"""Predict target points or camera poses at other robot poses.

    Examples:
      # Point in front of the camera, in the base frame, at each row of q.csv
      uq-handeye predict result/result.json --joints q.csv \
          --point 0mm,0mm,300mm
      # Pose of the target that the camera should see
      uq-handeye predict result/result.json --joints q.csv --camera
      # How far a tool misses the point, errors common to both removed
      uq-handeye predict result/result.json --joints q.csv \
          --point 0mm,0mm,300mm --reached-at there.csv --tool 0mm,0mm,150mm
      # A length of 100 mm, a plane and a point that the camera measures
      uq-handeye predict result/result.json --length 100mm --at 0.5m \
          --pixel-noise 0.2px --focal-length 1000px
      # Left camera of a rig: poses of the target that it should see
      uq-handeye predict result/result.json --of left --camera --robot poses.csv
      # Point of the left camera of a rig, in the frame of the right one
      uq-handeye predict result/result.json --of left --into right \
          --point 0mm,0mm,300mm --robot poses.csv

    The uncertainty combines X, the target pose and the robot.

    Options (Output):
      * -o, --output DIR <named_folder>: Folder for predictions.csv (m, rad) and predictions.json.
    """
    import numpy as np

    from ...calibration.load import load
    from ...read import json_text

    found: Any = load(result)
    if refused_as_not_usable(found, result, "predicted"):
        return ExitStatus.NOT_USABLE
    if wanted.into is not None and len(found.camera_names) > 1:
        _predict_into(found, wanted, places.robot, as_json, output)
        return ExitStatus.DONE
    if cameras := OneOfRig(wanted.of, wanted.of_target).each(result, "--of"):
        return run_each(
            cameras,
            as_json,
            output,
            lambda name, folder: predict_command(result, places, wanted._replace(of=name), as_json, folder),
        )
    stored = OneOfRig(wanted.of, wanted.of_target).of(found, result, "--of")
    wanted.require_possible(places, stored.setup)
    points = None if not wanted.point else np.array([coordinates(text, "--point") for text in wanted.point])
    tip = None if wanted.tool is None else np.array(coordinates(wanted.tool, "--tool"))
    if wanted.length is not None:
        _deliver_task(stored, wanted, as_json, output)
        return ExitStatus.DONE
    times, at = _read_places(stored, str(result), places, wanted.reached_at)
    if points is not None:
        here = points if at else points[None]  # of a fixed camera at no robot pose
        found = stored.predict(here, tool=tip, **{name: values[:, None] for name, values in at.items()})
        rows, data = _point_rows(found, times), found.to_dict()
        text = _text_of_points(found, len(times), stored, wanted.reached_at is not None)
    else:
        seen = stored.predict_camera(**at, new_measurement=not wanted.no_noise)
        rows, data, text = _pose_rows(seen, times), seen.to_dict(), _text_of_poses(seen)
    plain = json_text(data | {"timestamps": times.tolist()})
    files = {"predictions.csv": csv_text(rows), "predictions.json": plain}
    deliver_answer(plain, text, as_json, output, lambda: files)
    return ExitStatus.DONE


def _deliver_task(stored: "Calibration", wanted: PredictOptions, as_json: bool, output: Path | None) -> None:
    from ...core.presentation.document import document_of, to_text
    from ...read import json_text

    assert wanted.length is not None and wanted.at is not None and wanted.pixel_noise is not None
    task = stored.predict_task(wanted.length, wanted.at, wanted.pixel_noise, wanted.focal_length)
    rows: list[TableRow] = [["measured", "unit", "calibration_sd", "measurement_sd", "total_sd"]]
    rows += [[part.quantity, part.unit, part.calibration, part.measurement, part.total] for part in task.parts]
    plain = json_text(task.to_dict())
    files = {"task.csv": csv_text(rows), "task.json": plain}
    deliver_answer(plain, to_text(document_of(task)), as_json, output, lambda: files)


def _read_places(
    stored: "Calibration", name: str, places: Places, reached_at: Path | None
) -> "tuple[Array, dict[str, Array]]":
    """Read timestamps (or row numbers), and joints and robot poses by the arguments of `predict`."""
    import numpy as np

    from ...model.kinematics.joints_file import read_joints
    from ...read.robot_poses import read_robot_poses

    at: dict[str, Array] = {}
    names: dict[str, Path] = {}
    times: list[Array | None] = []
    for argument, file in (("joints", places.joints), ("reached_at", reached_at)):
        if file is None:
            continue
        if stored.kinematics is None:
            raise InputError(
                f"{name} holds no joints. Give --robot (poses base_T_gripper), or calibrate with --joints and --urdf."
            )
        table = read_joints(file, stored.kinematics.chain, places.joint_units)
        at[argument], names[argument] = table.q, file
        times.append(table.timestamps)
    if places.robot is not None:
        sources = () if stored.provenance is None else stored.provenance.sources
        like = sources[0].format if sources else None  # as the robot of the calibration wrote its poses
        stamps, at["robot"] = read_robot_poses(places.robot, like, units=places.units, format=places.format)
        names["robot"] = places.robot
        times.append(stamps)
    if len({len(values) for values in at.values()}) > 1:
        counts = " and ".join(f"{names[argument]} has {len(values)}" for argument, values in at.items())
        raise InputError(f"{counts} rows: expected one row in each file per prediction.")
    known = next((stamps for stamps in times if stamps is not None), None)
    return np.arange(float(len(next(iter(at.values()))) if at else 1)) if known is None else known, at


def _point_rows(found: "PointUncertainty", times: "Array") -> list[TableRow]:
    rows: list[TableRow] = [["timestamp", "point", *"xyz", "sd_x", "sd_y", "sd_z", "radius_95", *_pairs("xyz")]]
    radius = found.radius_95
    for i, time in enumerate(times.tolist()):
        for j in range(found.points.shape[1]):
            rows.append([time, j, *_plain(found.points[i, j], found.std[i, j], radius[i, j], found.covariance[i, j])])
    return rows


def _pose_rows(seen: "CameraPrediction", times: "Array") -> list[TableRow]:
    from scipy.spatial.transform import Rotation

    names = ("theta_x", "theta_y", "theta_z", "tau_x", "tau_y", "tau_z")
    head = ["timestamp", *"xyz", "qx", "qy", "qz", "qw", *(f"sd_{name}" for name in names), *_pairs(names)]
    quaternions = Rotation.from_matrix(seen.poses[:, :3, :3]).as_quat(canonical=True)
    parts = zip(times.tolist(), seen.poses, quaternions, seen.std, seen.covariance, strict=True)
    return [head, *([time, *_plain(T[:3, 3], q, sd, S)] for time, T, q, sd, S in parts)]


def _pairs(names: Sequence[str]) -> list[str]:
    """Names of the covariances above the diagonal and on it, row by row."""
    return [f"cov_{first}_{other}" for i, first in enumerate(names) for other in names[i:]]


def _plain(*parts: "Array") -> TableRow:
    """Numbers in a row; of a matrix those on and above its diagonal."""
    import numpy as np

    flat = (part[np.triu_indices(len(part))] if np.ndim(part) == 2 else np.ravel(part) for part in parts)
    return [value for part in flat for value in part.tolist()]


def _text_of_points(found: "PointUncertainty", n: int, stored: "Calibration", reached: bool) -> str:
    from ...core.presentation.document import Heading, Paragraph, Table, to_text

    k = found.points.shape[1]
    worst = 1e3 * float(found.radius_95.max())
    head = ["row", "point", "x", "y", "z", "sd x", "sd y", "sd z", "95 %"]
    cells = [
        [str(i), str(j), *_mm(found.points[i, j]), *_mm(found.std[i, j]), f"{1e3 * found.radius_95[i, j]:.3f}"]
        for i in range(n)
        for j in range(k)
    ]
    where = f"{k} at {n} robot {'pose' if n == 1 else 'poses'}"
    if reached:
        what = f"Tip of the tool minus the point, in the frame {found.frame}: {where}"
        known = f"The tip is within {worst:.3g} mm of where this says, with at least 95 % probability."
    else:
        what = f"Points in the frame {found.frame}: {where}"
        known = f"A sphere of {worst:.3g} mm holds each point with at least 95 % probability."
        if stored.setup != "eye-in-hand":
            known += " The camera stands still: the robot does not move the points."
    return to_text(
        [
            [Heading(what), Paragraph(known)],
            Table("", head, cells[:MAX_PRINTED_ROWS], units=["", "", *["mm"] * 7], named=False),
            _more(len(cells)),
        ]
    )


def _text_of_poses(seen: "CameraPrediction") -> str:
    import numpy as np

    from ...core.presentation.document import Heading, Paragraph, Table, to_text

    n = len(seen.poses)
    noise = "with the noise of one new measurement" if seen.new_measurement else "without noise of measurement"
    head = ["row", "x", "y", "z", "rotation x", "y", "z", "translation x", "y", "z"]
    units = ["", "mm", "mm", "mm", "sd, deg", "", "", "sd, mm", "", ""]
    cells = [
        [str(i), *_mm(T[:3, 3]), *(f"{value:.4f}" for value in np.degrees(sd[:3])), *_mm(sd[3:])]
        for i, (T, sd) in enumerate(zip(seen.poses, seen.std, strict=True))
    ]
    return to_text(
        [
            [
                Heading(f"camera_T_target at {n} robot {'pose' if n == 1 else 'poses'}"),
                Paragraph(f"Predicted {noise}."),
            ],
            Table("", head, cells[:MAX_PRINTED_ROWS], units=units, named=False),
            _more(n),
        ]
    )


def _more(n: int) -> "list[Paragraph]":
    from ...core.presentation.document import Paragraph

    return [Paragraph(f"{n - MAX_PRINTED_ROWS} more rows: -o DIR or --json has all.")] if n > MAX_PRINTED_ROWS else []


def _mm(values: "Array") -> list[str]:
    return [f"{1e3 * value:.3f}" for value in values]


def _predict_into(stored: Any, asked: Any, robot: Path | None, as_json: bool, output: Path | None) -> None:
    """Predict points of one camera of a rig in the frame of another, for ``predict``."""
    import numpy as np

    from ...read import json_text
    from ...read.rig.pose_rows import read_rows

    refuse("--of", "--into", "--point", "--robot", "--units", "--format")
    camera, point = asked.of, asked.point
    if camera is None or not point:
        raise InputError("--into needs --of CAMERA and --point X,Y,Z in the frame of that camera. Add them.")
    arms = list(stored.rig.arms)
    if robot is not None and len(arms) > 1:
        raise InputError("--robot: the rig has several arms; predict in Python with the poses of each.")
    at = None if robot is None else {arms[0]: read_rows(robot, "robot").poses}
    points = np.array([coordinates(text, "--point") for text in point])
    found = stored.predict(camera, points, at, asked.into)
    data = json_text(found.to_dict())
    head = " ".join([*(f"{name:>11}" for name in "xyz"), *(f"{f'sd {name}':>8}" for name in "xyz")])
    lines = [f"Points of {camera} in the frame {found.frame}", f"{'row':>4} {'point':>5} {head}  (mm)"]
    for i in range(len(found.points)):
        for j, (x, sd) in enumerate(zip(1e3 * found.points[i], 1e3 * found.std[i], strict=True)):
            numbers = " ".join([*(f"{value:>11.3f}" for value in x), *(f"{value:>8.3f}" for value in sd)])
            lines.append(f"{i:>4} {j:>5} {numbers}")
    deliver_answer(data, "\n".join(lines) + "\n", as_json, output, lambda: {"predictions.json": data})
