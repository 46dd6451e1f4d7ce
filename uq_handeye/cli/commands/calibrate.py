"""Commands ``calibrate`` and ``demo``: X with its uncertainty, as text, files and report."""

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from ...core.runtime.progress import working
from ...errors import InputError, NotConvergedError
from ..bag_files import RobotGiven, given_of_robot
from ..delivery import ReportOptions, report_options_of
from ..messages import LOG, command_line, fail, progress_wanted, quiet, timed, withheld
from ..new_poses import problem_for
from ..options.common import (
    AT_THE_BOUND,
    BUNDLE,
    COVARIANCE_NAMES,
    PUBLISHED,
    ROBOT_WORLD,
    cores,
    made_of,
    one_of,
    require_writable,
)
from ..options.noise import Given, noise_of, pose_prior_of
from ..options.touches import TouchesToUse
from ..outcome import Wanted, emit_refusal, emit_result, json_of, wanted_of
from ..pictures import KINDS as BOARDS
from ..pose_files import PoseFiles
from ..rigs.calibrate import calibrate_rig_files, is_rig
from ..views import pictures_of
from ..watching import Watch, question_of, watched

if TYPE_CHECKING:
    from ...calibration.result import Calibration
    from ...calibration.statement.tolerance import Verdict
    from ...fit.diagnostics.pose_table import PoseTable
    from ...model.shared_errors.sizes import Size
    from ...report.comparison.of_result import Compared
    from ...report.comparison.result import Comparison
    from ...trials.validation.cross_check.result import CrossCheck
    from ..pictures import Pictures
    from ..views import Views

METHODS = (*AT_THE_BOUND, BUNDLE, *PUBLISHED, *ROBOT_WORLD)
OF_DATA = COVARIANCE_NAMES[2:]

# Written by the demo where no other report is asked for.
DEMO_REPORT = Path("demo_report.html")

# X for other programs, beside a result: file by the format of `export`.
EXPORTS = {"ros": "x_ros.yaml", "urdf": "x.urdf", "opencv": "x_opencv.yaml", "npz": "x.npz"}

# Every figure that `report.figures` may draw.
FIGURES = ("ellipses", "rig", "residuals", "budget", "shared", "task_space", "workspace", "methods")

REPORTS = (".html", ".pdf")


@dataclass(frozen=True)
class Data:
    """Data of a calibration, as they are given."""

    files: PoseFiles
    pictures: "Pictures | Views | None"
    given: Given
    robot: RobotGiven
    touched: TouchesToUse
    watch: Path | None


@made_of(files=PoseFiles, pictures=pictures_of, given=noise_of, robot=given_of_robot, touched=TouchesToUse)
def data_of(
    files: "PoseFiles",
    pictures: "Pictures | Views | None",
    given: "Given",
    robot: "RobotGiven",
    touched: "TouchesToUse",
    watch: Path | None = None,
) -> Data:
    """Return the data of the options.

    Options (Pose files):
      --watch DIR: Folder in which poses arrive one by one: an answer after each, with the pose to take next. Growing
        files robot.csv and camera.csv, or files robot* and camera* with a pose each, or files that hold both sides
        (JSON); with --images 'DIR/*.png' robot* alone. Ends at PASS of --tolerance, or with Ctrl-C.
    """
    return Data(files, pictures, given, robot, touched, watch)


@dataclass(frozen=True)
class Estimation:
    """Options of the estimate.

    Options (Estimation):
      * --method NAME <METHODS>: Estimator. One of {METHODS}; bundle needs pictures. Default: efficient.

    Options (Shared errors):
      --size NAME=SIZE[,FACTOR]: Size of an error before the data, e.g. 'robot accuracy=0.3mm,2': a standard deviation,
        and the factor within which it is known (1 sigma). Without a factor: exact. Repeatable. Default: by a table.

    Options (Estimation):
      --scale D: Scaling factor d of 4dpa. Default: its limit, in closed form.
      --kind NAME <poses|pairs|literal>: Noise propagation of published methods: poses, pairs, or literal (noise of
        pairs).
      --covariance NAME <COVARIANCE_NAMES>: Covariance of X: model, sigma-points (beyond first order), or one that needs
        no noise model: {OF_DATA}.
      --robust/--no-robust: Down-weighting of outliers. Default: on from 5 poses.
      --correlation NAME <auto|none>: Correlated errors of neighbouring poses (drift): auto (estimated and included in
        the covariance) or none (independent poses).
      --seed N: Seed of random subsets, bootstrap and cross-check.
    """

    method: str | None = None
    size: list[str] | None = None
    pairs: str = "all"
    scale: float | None = None
    kind: str | None = None
    covariance: str = "model"
    robust: bool | None = None
    correlation: str = "auto"
    seed: int = 0

    def options(self) -> dict[str, Any]:
        """Return the options as arguments of `calibrate`."""
        if self.kind in BOARDS:
            raise InputError(
                f"--kind is that of the noise propagation. Name the kind of the board as --pattern {self.kind}."
            )
        found = {name: getattr(self, name) for name in ("pairs", "scale", "kind", "robust", "seed")}
        return found | {
            "method": None if self.method is None else one_of(self.method, "--method", METHODS),
            "covariance": one_of(self.covariance, "--covariance", COVARIANCE_NAMES),
            "correlation": one_of(self.correlation, "--correlation", ("auto", "none")),
            "sizes": _sizes_of(self.size or []),
        }


@dataclass(frozen=True)
class Outputs:
    """Files of a result: a folder, whether with figures, and a report.

    Options (Output):
      * -o, --output DIR <named_folder>: Folder for the result and exports. It holds result.json, poses.csv, and X for
        ROS, URDF, OpenCV and NumPy; with --figures also the figures.
    """

    report: Path | None = None
    no_compare: bool = False
    as_json: bool = False
    output: Path | None = None
    figures: bool = False

    def require_possible(self) -> None:
        """Raise `InputError`, before the work, for files that cannot be written or that need another option."""
        require_writable(self.report, "--report", REPORTS)
        if self.figures and self.output is None:
            raise InputError("--figures needs -o DIR. Add it.")
        for name in ("no_compare", "with_cross_check"):
            if getattr(self, name, False) and self.report is None:
                raise InputError(f"--{name.replace('_', '-')} needs --report FILE. Add it.")

    def write(
        self,
        result: "Calibration",
        verdict: "Verdict | None",
        check: "CrossCheck | None" = None,
        of_report: dict[str, Any] | None = None,
    ) -> str:
        """Write the files, and return their names as a sentence."""
        how, comparison = of_report or {}, not self.no_compare
        methods: Compared | bool = comparison
        folded = self.report is not None and (self.report.suffix.lower() != ".pdf" or how.get("details"))
        if comparison and (folded or (self.report is not None and self.figures)):  # two pages have none
            from ...report.comparison.of_result import compare_beside

            with timed("comparing the methods"), working("comparing the methods", progress_wanted()):
                methods = compare_beside(result)
        names = []
        if self.output is not None:
            compared = None if isinstance(methods, bool) else methods.comparison
            with timed(f"writing {self.output}"), working(f"writing {self.output}", progress_wanted()):
                drawn = _drawn(result, check, compared) if self.figures else {}
                names.append(_write_result(result, verdict, self.output, drawn))
        if self.report is not None:
            write_report(result, self.report, methods, check, verdict=verdict, **how)
            names.append(str(self.report))
        return f"Wrote {' and '.join(names)}." if names else ""


@dataclass(frozen=True)
class AllOutputs(Outputs):
    """Further outputs of ``calibrate``.

    Options (Output):
      --threshold R <fraction>: Smallest correlation that is listed.
      --with-cross-check: Report with Monte Carlo and posterior; takes a minute.
    """

    threshold: float = 0.5
    with_cross_check: bool = False


@dataclass(frozen=True)
class DemoOutputs(Outputs):
    """Outputs of ``demo``."""

    no_compare: bool = field(default=False, init=False)


@made_of(
    data=data_of,
    asked=Estimation,
    beforehand=pose_prior_of,
    wishes=report_options_of,
    wanted=wanted_of,
    outputs=AllOutputs,
)
def calibrate_command(
    data: "Data",
    asked: "Estimation",
    beforehand: "dict[str, Any]",
    wishes: "ReportOptions",
    wanted: "Wanted",
    outputs: "AllOutputs",
) -> int:
    r"""Estimate the camera pose X and its uncertainty.

    Examples:
      # Pictures of a chessboard with 9x6 inner corners, one per robot pose
      uq-handeye calibrate robot.csv --images 'img/*.png' --board 9x6 --square 20mm
      # Camera poses from another program; joint values; a ROS bag; several cameras
      uq-handeye calibrate robot.csv camera.csv --report report.html -o result/
      uq-handeye calibrate camera.csv --joints joints.csv --urdf robot.urdf
      uq-handeye calibrate --bag cell.mcap --robot base:tool0 --camera cam:tag
      uq-handeye calibrate robot.csv --camera left=left.csv --camera right=right.csv
      uq-handeye calibrate rig.toml -o result/

    X is gripper_T_camera for eye-in-hand and base_T_camera for eye-to-hand.
    Noise that is not given is estimated from the data.

    CAMERA may be the folder written by uq-handeye camera -o. Its joint
    covariance of all camera poses is used.

    For camera poses from another program, name the target and the camera
    matrix: the camera noise then follows from the view of each pose, e.g.
    --board 9x6 --square 20mm --camera-matrix 1080,1080,960,540.

    With joint values and a robot model, the kinematic errors of the robot are
    part of the covariance. Add --robot robot.csv to compare with the controller.
    """
    given, robot = data.given, data.robot
    if is_rig(data.files.robot, robot.cameras):
        return calibrate_rig_files(data, asked, wishes, wanted, outputs)
    outputs.require_possible()
    if data.watch is not None:
        return _watch(data, asked.options() | beforehand, wishes, wanted, outputs)
    files, pictures, arm = data.files, data.pictures, robot.arm
    if robot.bag is not None:
        files, pictures, arm = robot.bag.beside(files, pictures, arm)
    options = asked.options() | beforehand | {"prior": given.prior}
    from ...calibration.calibrate import calibrate

    with withheld() as shown:
        poses, noise, shared = files.read_open(given, pictures, arm)
        selection = files.selection(poses)
        try:
            with timed("calibrating"):
                result = calibrate(
                    poses,
                    noise=noise,
                    shared=shared,
                    exclude=None if selection is None else selection.excluded.tolist(),
                    **options,
                    **({} if arm is None else arm.of_calibrate),
                )
            result, last = data.touched.included_in(result)
            shown += [] if outputs.as_json else result.warnings
        except (InputError, NotConvergedError) as error:
            return emit_refusal(error, outputs.as_json, shown)
    result = replace(result, about=wishes.about)
    check = None
    if outputs.with_cross_check:
        check = _cross_check(problem_for(result, poses, noise, shared, asked.pairs), asked.seed)
    return deliver_result(result, outputs, wanted, wishes, check=check, threshold=outputs.threshold, more=last)


def _watch(data: Data, options: dict[str, Any], wishes: ReportOptions, wanted: Wanted, outputs: AllOutputs) -> int:
    """Answer after each pose that arrives in the folder of --watch, and deliver the last result."""
    if data.robot.bag is not None:
        raise InputError("--watch takes pose files, not --bag. Calibrate the bag afterwards.")
    if data.robot.arm is not None:
        raise InputError("--watch takes no joints and no robot model. Calibrate with them afterwards.")
    if data.touched.touches is not None:
        raise InputError("--watch takes no --touches. Calibrate with the touches afterwards.")
    assert data.watch is not None
    question = question_of(data.given, data.pictures, options, wanted.tolerance)
    folder = watched(data.watch, data.files, data.pictures, outputs.output)
    found = Watch(folder, question, outputs.output, outputs.as_json).run()
    if found is None:
        return fail("No X: the poses that arrived do not determine it.")
    found = replace(found, about=wishes.about)
    return deliver_result(found, outputs, wanted, wishes, threshold=outputs.threshold)


@made_of(outputs=DemoOutputs)
def demo_command(outputs: "DemoOutputs") -> int:
    """Calibrate an embedded data set whose true X is known.

    Examples:
      uq-handeye demo
      # Also write result.json, exports and figures
      uq-handeye demo --report demo.html -o demo/ --figures

    The noise of the poses is estimated, as it is of your own. Prints the
    estimate, compares it with the true X, and writes the report,
    demo_report.html unless --report names another file.
    """
    from importlib import resources

    from ...calibration.calibrate import calibrate
    from ...calibration.report.text import against_truth
    from ...read import read_pose_file, read_poses

    outputs.require_possible()
    if outputs.report is None and not outputs.as_json and not quiet():
        try:
            require_writable(DEMO_REPORT, "--report", REPORTS)
            outputs = replace(outputs, report=DEMO_REPORT)
        except InputError as error:
            LOG.warning("No report is written here. %s", error)
    with resources.as_file(resources.files("uq_handeye") / "data") as data:
        poses = read_poses(data / "robot.csv", data / "camera.csv")
        _, truth = read_pose_file(data / "truth.csv")
    result = calibrate(poses)
    return deliver_result(result, outputs, Wanted(None), more=against_truth(result, truth[0]))


def _sizes_of(texts: list[str]) -> "dict[str, Size] | None":
    """Return the sizes of --size by name."""
    from ...model.shared_errors.sizes import parse_size

    try:
        found = [parse_size(text) for text in texts]
    except InputError as error:
        raise InputError(f"--size: {error}") from None
    return dict(found) or None


def _cross_check(problem: dict[str, Any], seed: int) -> "CrossCheck":
    from ...trials.validation.cross_check.run import cross_check

    with timed("cross-check"):
        check = cross_check(**problem, seed=seed, workers=cores(), progress=progress_wanted())
    if not check.complete:
        raise KeyboardInterrupt
    return check


def _drawn(result: "Calibration", check: "CrossCheck | None", compared: "Comparison | None") -> dict[str, bytes]:
    """Draw all figures, each as PNG and SVG."""
    from ...core.presentation.ellipses import render  # Matplotlib is slow to import
    from ...report.figures import figures

    drawn = figures(result, check, compared)
    return {f"{stem}.{kind}": render(figure, kind) for stem, figure in drawn.items() for kind in ("png", "svg")}


def deliver_result(
    result: "Calibration",
    outputs: Outputs,
    wanted: Wanted,
    wishes: ReportOptions | None = None,
    *,
    check: "CrossCheck | None" = None,
    threshold: float = 0.5,
    more: str = "",
) -> int:
    """Write the files, then print, with a paragraph ``more``: if a file cannot be written, nothing is printed."""
    from ...calibration.report.next_step import next_step

    result = _with_command(result)
    verdict = wanted.verdict(result)
    written = outputs.write(result, verdict, check, None if wishes is None else wishes.of_report)
    last = (written, f"Next: {next_step(result, None if outputs.report is None else str(outputs.report))}.", more)
    return emit_result(result, verdict, as_json=outputs.as_json, last=tuple(filter(None, last)), threshold=threshold)


def write_report(
    result: "Calibration", file: Path, comparison: "Compared | bool", check: "CrossCheck | None", **options: Any
) -> None:
    """Write the report, which names this command line."""
    with timed(f"writing {file}"), working(f"writing {file}", progress_wanted()):
        _with_command(result).report(file, comparison=comparison, cross_check=check, **options)


def _with_command(result: "Calibration") -> "Calibration":
    if result.provenance is None:
        return result
    return replace(result, provenance=replace(result.provenance, command=command_line()))


def _write_result(result: "Calibration", verdict: "Verdict | None", directory: Path, drawn: dict[str, bytes]) -> str:
    """Write the folder of -o with the figures that were drawn, and return what was written."""
    from ...read import write_files

    files: dict[str, Any] = {"result.json": json_of(result, verdict), **_exports(result)}
    seen = getattr(result.data, "camera_calibration", None)
    if seen is not None:  # the intrinsics, with the poses and corners that belong to them
        from ...model.camera.files.folder_writer import camera_files

        files |= camera_files(seen)
    if result.table is not None:
        files["poses.csv"] = _poses_csv(result.table)
    files |= drawn
    write_files(directory, files)
    possible = {"poses.csv", *EXPORTS.values(), *(f"{stem}.{kind}" for stem in FIGURES for kind in ("png", "svg"))}
    for name in possible - set(files):  # those of an earlier run are not of this result
        (directory / name).unlink(missing_ok=True)
    return f"{directory / 'result.json'} with {len(files) - 1} more files"


def _poses_csv(table: "PoseTable") -> str:
    """Format the table of the poses as pandas writes its `to_dataframe`, without loading pandas."""
    columns: dict[str, Any] = {
        table.item: range(len(table)),
        "rotation_deg": [math.degrees(angle) for angle in table.rotation.tolist()],
        "translation_mm": [1e3 * length for length in table.translation.tolist()],
        "distance2": table.distance2.tolist(),
        "leverage": table.leverage.tolist(),
        "weight": table.weight.tolist(),
        "flag": table.flag,
    }
    rows = zip(*columns.values(), strict=True)
    lines = (",".join("" if value != value else str(value) for value in row) for row in rows)  # NaN is no value
    return "\n".join([",".join(columns), *lines, ""])


def _exports(result: "Calibration") -> dict[str, bytes]:
    with TemporaryDirectory() as folder:
        return {name: result.export(Path(folder) / name, format).read_bytes() for format, name in EXPORTS.items()}
