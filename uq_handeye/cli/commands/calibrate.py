"""Commands ``calibrate`` and ``demo``: X with its uncertainty, as text, files and report."""

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any

import typer

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
    JsonOption,
    PairsOption,
    cores,
    flag,
    folder_option,
    made_of,
    one_of,
    option,
    require_writable,
)
from ..options.declared import ESTIMATION, OUTPUT
from ..options.noise import Given, given_of, pose_prior_of, prior_of
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
    from ...model.noise.estimate import NoisePrior
    from ...model.shared_errors.sizes import Size
    from ...report.comparison.of_result import Compared
    from ...report.comparison.result import Comparison
    from ...trials.validation.cross_check.result import CrossCheck
    from ..pictures import Pictures
    from ..views import Views

METHODS = (*AT_THE_BOUND, BUNDLE, *PUBLISHED, *ROBOT_WORLD)

# Written by the demo where no other report is asked for.
DEMO_REPORT = Path("demo_report.html")

# X for other programs, beside a result: file by the format of `export`.
EXPORTS = {"ros": "x_ros.yaml", "urdf": "x.urdf", "opencv": "x_opencv.yaml", "npz": "x.npz"}

# Every figure that `report.figures` may draw.
FIGURES = ("ellipses", "rig", "residuals", "budget", "shared", "task_space", "workspace", "methods")

REPORTS = (".html", ".pdf")

ResultFolder = Annotated[
    Path | None,
    folder_option(
        "Folder for the result and exports. It holds result.json, poses.csv, and X for ROS, URDF, OpenCV and NumPy; "
        "with --figures also the figures."
    ),
]
FiguresOption = Annotated[
    bool,
    flag(
        "--figures",
        panel=OUTPUT,
        help="Figures in the folder of -o, as PNG and SVG, that of the methods with --report. Takes some seconds.",
    ),
]
ReportFile = Annotated[
    Path | None, option("--report", metavar="FILE", panel=OUTPUT, common=True, help="Report, one .html or .pdf file.")
]
NoCompare = Annotated[bool, flag("--no-compare", panel=OUTPUT, help="Report without the comparison of methods.")]


@made_of(
    given=given_of,
    prior=prior_of,
    beforehand=pose_prior_of,
    files=PoseFiles,
    pictures=pictures_of,
    robot=given_of_robot,
    touched=TouchesToUse,
    wishes=report_options_of,
    wanted=wanted_of,
)
def calibrate_command(
    files: "PoseFiles",
    pictures: "Pictures | Views | None",
    given: "Given",
    prior: "NoisePrior | None",
    beforehand: "dict[str, Any]",
    robot: "RobotGiven",
    touched: "TouchesToUse",
    wishes: "ReportOptions",
    wanted: "Wanted",
    method: str | None = None,
    size: list[str] | None = None,
    pairs: PairsOption = "all",
    scale: float | None = None,
    kind: str | None = None,
    covariance: Annotated[
        str,
        option(
            "--covariance",
            of=COVARIANCE_NAMES,
            metavar="NAME",
            panel=ESTIMATION,
            help="Covariance of X: model, sigma-points (beyond first order), or one that needs no noise model: "
            f"{', '.join(COVARIANCE_NAMES[2:])}.",
        ),
    ] = "model",
    robust: bool | None = None,
    correlation: str = "auto",
    seed: int = 0,
    threshold: Annotated[
        float,
        typer.Option(
            min=0.0, max=1.0, metavar="R", help="Smallest correlation that is listed.", rich_help_panel=OUTPUT
        ),
    ] = 0.5,
    report: ReportFile = None,
    no_compare: NoCompare = False,
    with_cross_check: bool = False,
    watch: Path | None = None,
    as_json: JsonOption = False,
    output: ResultFolder = None,
    figures: FiguresOption = False,
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

    Options (Estimation):
      * --method NAME <METHODS>: Estimator. One of {METHODS}; bundle needs pictures. Default: efficient.

    Options (Shared errors):
      --size NAME=SIZE[,FACTOR]: Size of an error before the data, e.g. 'robot accuracy=0.3mm,2': a standard deviation,
        and the factor within which it is known (1 sigma). Without a factor: exact. Repeatable. Default: by a table.

    Options (Estimation):
      --scale D: Scaling factor d of 4dpa. Default: its limit, in closed form.
      --kind NAME <poses|pairs|literal>: Noise propagation of published methods: poses, pairs, or literal (noise of
        pairs).
      --robust/--no-robust: Down-weighting of outliers. Default: on from 5 poses.
      --correlation NAME <auto|none>: Correlated errors of neighbouring poses (drift): auto (estimated and included in
        the covariance) or none (independent poses).
      --seed N: Seed of random subsets, bootstrap and cross-check.

    Options (Output):
      --with-cross-check: Report with Monte Carlo and posterior; takes a minute.

    Options (Pose files):
      --watch DIR: Folder in which poses arrive one by one: an answer after each, with the pose to take next. Growing
        files robot.csv and camera.csv, or files robot* and camera* with a pose each, or files that hold both sides
        (JSON); with --images 'DIR/*.png' robot* alone. Ends at PASS of --tolerance, or with Ctrl-C.
    """
    require_writable(report, "--report", REPORTS)
    if is_rig(files.robot, robot.cameras):
        return calibrate_rig_files(
            files, robot.cameras, given, wishes, wanted, method=method, robust=robust, seed=seed, report=report,
            output=output, as_json=as_json,
        )  # fmt: skip
    require_folder(figures, output)
    arm = robot.arm
    if robot.bag is not None:
        if watch is not None:
            raise InputError("--watch takes pose files, not --bag. Calibrate the bag afterwards.")
        files, pictures, arm = robot.bag.beside(files, pictures, arm)
    for name, asked in (("--no-compare", no_compare), ("--with-cross-check", with_cross_check)):
        if asked and report is None:
            raise InputError(f"{name} needs --report FILE. Add it.")
    if method is not None:
        method = one_of(method, "--method", METHODS)
    if kind in BOARDS:
        raise InputError(f"--kind is that of the noise propagation. Name the kind of the board as --pattern {kind}.")
    from ...calibration.calibrate import calibrate

    if given.one_side is not None:  # that of the other is estimated beside it
        if prior is not None:
            raise InputError("The noise and a prior of it are both given. Give one of them.")
        prior = given.one_side
    options: dict[str, Any] = {
        "method": method,
        "pairs": pairs,
        "scale": scale,
        "kind": kind,
        "covariance": one_of(covariance, "--covariance", COVARIANCE_NAMES),
        "robust": robust,
        "prior": prior,
        "seed": seed,
        "correlation": one_of(correlation, "--correlation", ("auto", "none")),
        "sizes": _sizes_of(size or []),
        **beforehand,
    }
    if watch is not None:
        if arm is not None:
            raise InputError("--watch takes no joints and no robot model. Calibrate with them afterwards.")
        if touched.touches is not None:
            raise InputError("--watch takes no --touches. Calibrate with the touches afterwards.")
        question = question_of(given, pictures, options, wanted.tolerance)
        found = Watch(watched(watch, files, pictures, output), question, output, as_json).run()
        if found is None:
            return fail("No X: the poses that arrived do not determine it.")
        found = replace(found, about=wishes.about)
        return deliver_result(
            found, Files(output, report, not no_compare, None, wishes.of_report, figures), wanted, as_json, threshold
        )
    with withheld() as shown:
        poses, noise, shared = files.read_open(given, pictures, prior, arm)
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
            result, last = touched.included_in(result)
            shown += [] if as_json else result.warnings
        except (InputError, NotConvergedError) as error:
            return emit_refusal(error, as_json, shown)
    result = replace(result, about=wishes.about)
    check = _cross_check(problem_for(result, poses, noise, shared, pairs), seed) if with_cross_check else None
    files_wanted = Files(output, report, not no_compare, check, wishes.of_report, figures)
    return deliver_result(result, files_wanted, wanted, as_json, threshold, last)


def demo_command(
    as_json: JsonOption = False, output: ResultFolder = None, report: ReportFile = None, figures: FiguresOption = False
) -> int:
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

    require_writable(report, "--report", REPORTS)
    require_folder(figures, output)
    if report is None and not as_json and not quiet():
        try:
            require_writable(DEMO_REPORT, "--report", REPORTS)
            report = DEMO_REPORT
        except InputError as error:
            LOG.warning("No report is written here. %s", error)
    with resources.as_file(resources.files("uq_handeye") / "data") as data:
        poses = read_poses(data / "robot.csv", data / "camera.csv")
        _, truth = read_pose_file(data / "truth.csv")
    result = calibrate(poses)
    return deliver_result(
        result, Files(output, report, figures=figures), Wanted(None), as_json, more=against_truth(result, truth[0])
    )


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


def require_folder(figures: bool, output: Path | None) -> None:
    """Raise `InputError` for figures that are asked for without a folder."""
    if figures and output is None:
        raise InputError("--figures needs -o DIR. Add it.")


@dataclass(frozen=True)
class Files:
    """Output of a calibration: a folder, whether with figures, a report and its contents."""

    output: Path | None = None
    report: Path | None = None
    comparison: bool = True
    check: "CrossCheck | None" = None
    of_report: dict[str, Any] = field(default_factory=dict)
    figures: bool = False

    def write(self, result: "Calibration", verdict: "Verdict | None") -> str:
        """Write the files, and return their names as a sentence."""
        methods: Compared | bool = self.comparison
        folded = self.report is not None and (self.report.suffix.lower() != ".pdf" or self.of_report.get("details"))
        if self.comparison and (folded or (self.report is not None and self.figures)):  # two pages have none
            from ...report.comparison.of_result import compare_beside

            with timed("comparing the methods"), working("comparing the methods", progress_wanted()):
                methods = compare_beside(result)
        names = []
        if self.output is not None:
            comparison = None if isinstance(methods, bool) else methods.comparison
            with timed(f"writing {self.output}"), working(f"writing {self.output}", progress_wanted()):
                drawn = self._drawn(result, comparison) if self.figures else {}
                names.append(_write_result(result, verdict, self.output, drawn))
        if self.report is not None:
            write_report(result, self.report, methods, self.check, verdict=verdict, **self.of_report)
            names.append(str(self.report))
        return f"Wrote {' and '.join(names)}." if names else ""

    def _drawn(self, result: "Calibration", comparison: "Comparison | None") -> dict[str, bytes]:
        """Draw all figures, each as PNG and SVG."""
        from ...core.presentation.ellipses import render  # Matplotlib is slow to import
        from ...report.figures import figures

        drawn = figures(result, self.check, comparison)
        return {f"{stem}.{kind}": render(figure, kind) for stem, figure in drawn.items() for kind in ("png", "svg")}


def deliver_result(
    result: "Calibration", files: Files, wanted: Wanted, as_json: bool, threshold: float = 0.5, more: str = ""
) -> int:
    """Write the files, then print, with a paragraph ``more``: if a file cannot be written, nothing is printed."""
    from ...calibration.report.next_step import next_step

    result = _with_command(result)
    verdict = wanted.verdict(result)
    written = files.write(result, verdict)
    last = (written, f"Next: {next_step(result, None if files.report is None else str(files.report))}.", more)
    return emit_result(result, verdict, as_json=as_json, last=tuple(filter(None, last)), threshold=threshold)


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
