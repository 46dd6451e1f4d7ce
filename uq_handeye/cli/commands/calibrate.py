"""Commands ``calibrate`` and ``demo``: X with its uncertainty, as text, files and report."""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ...errors import InputError
from ...runtime.progress import working
from ..arm_options import Arm, arm_of
from ..groups import ESTIMATION
from ..messages import command_line, progress_wanted, timed
from ..noise_options import Given, given_of, pose_prior_of, prior_of
from ..options import (
    AT_THE_BOUND,
    BUNDLE,
    COVARIANCE_NAMES,
    OUTPUT,
    PUBLISHED,
    ROBOT_WORLD,
    JsonOption,
    PairsOption,
    cores,
    emit,
    flag,
    folder_option,
    made_of,
    one_of,
    option,
    require_writable,
)
from ..pose_files import PoseFiles, problem_for
from ..report_options import ReportOptions, report_options_of
from ..views import pictures_of

if TYPE_CHECKING:
    from ...calibration.result import Calibration
    from ...comparison.of_result import Compared
    from ...comparison.result import Comparison
    from ...noise.estimate import NoisePrior
    from ...validation.cross_check.result import CrossCheck
    from ..pictures import Pictures
    from ..views import Views

METHODS = (*AT_THE_BOUND, BUNDLE, *PUBLISHED, *ROBOT_WORLD)

# The noise that the embedded data set was simulated with; data/README.md has the command.
DEMO_NOISE = {"robot": ("0.02deg", "0.05mm"), "camera": ("0.1deg", "0.5mm")}

# X for other programs, beside a result: file by the format of `export`.
EXPORTS = {"ros": "x_ros.yaml", "urdf": "x.urdf", "opencv": "x_opencv.yaml", "npz": "x.npz"}

# Every figure that `report.figures` may draw.
FIGURES = ("ellipses", "rig", "residuals", "budget", "shared", "task_space", "workspace", "methods")

REPORTS = (".html", ".pdf")

ResultFolder = Annotated[
    Path | None,
    folder_option(
        "Folder for the result, figures and exports. It holds result.json, poses.csv, the figures (PNG and SVG; that "
        "of the methods with --report), and X for ROS, URDF, OpenCV and NumPy."
    ),
]
ReportFile = Annotated[
    Path | None,
    option("--report", metavar="FILE", panel=OUTPUT, common=True, help="Report, one .html or .pdf file."),
]
NoCompare = Annotated[bool, flag("--no-compare", panel=OUTPUT, help="Report without the comparison of methods.")]


@made_of(
    given=given_of,
    prior=prior_of,
    beforehand=pose_prior_of,
    files=PoseFiles,
    pictures=pictures_of,
    arm=arm_of,
    wishes=report_options_of,
)
def calibrate_command(
    files: "PoseFiles",
    pictures: "Pictures | Views | None",
    given: "Given",
    prior: "NoisePrior | None",
    beforehand: "dict[str, Any]",
    arm: "Arm | None",
    wishes: "ReportOptions",
    method: Annotated[
        str | None,
        option(
            "--method",
            of=METHODS,
            metavar="NAME",
            panel=ESTIMATION,
            common=True,
            help=f"Estimator. One of {', '.join(METHODS)}; bundle needs pictures. Default: efficient.",
        ),
    ] = None,
    pairs: PairsOption = "all",
    scale: Annotated[
        float | None,
        option(
            "--scale",
            metavar="D",
            panel=ESTIMATION,
            help="Scaling factor d of 4dpa. Default: its limit, in closed form.",
        ),
    ] = None,
    kind: Annotated[
        str | None,
        option(
            "--kind",
            of=("poses", "pairs", "literal"),
            metavar="NAME",
            panel=ESTIMATION,
            help="Noise propagation of published methods: poses, pairs, or literal (noise of pairs).",
        ),
    ] = None,
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
    robust: Annotated[
        bool | None,
        flag(
            "--robust/--no-robust",
            panel=ESTIMATION,
            help="Down-weighting of outliers. Default: on from 5 poses.",
        ),
    ] = None,
    correlation: Annotated[
        str,
        option(
            "--correlation",
            of=("auto", "none"),
            metavar="NAME",
            panel=ESTIMATION,
            help="Correlated errors of neighbouring poses (drift): auto (estimated and included in the covariance) or "
            "none (independent poses).",
        ),
    ] = "auto",
    seed: Annotated[
        int, option("--seed", metavar="N", panel=ESTIMATION, help="Seed of random subsets, bootstrap and cross-check.")
    ] = 0,
    threshold: Annotated[
        float,
        typer.Option(
            min=0.0, max=1.0, metavar="R", help="Smallest correlation that is listed.", rich_help_panel=OUTPUT
        ),
    ] = 0.5,
    report: ReportFile = None,
    no_compare: NoCompare = False,
    with_cross_check: Annotated[
        bool,
        flag("--with-cross-check", panel=OUTPUT, help="Report with Monte Carlo and posterior; takes a minute."),
    ] = False,
    as_json: JsonOption = False,
    output: ResultFolder = None,
) -> None:
    r"""Estimate the camera pose X and its uncertainty.

    Examples:
      # Pictures of a chessboard with 9x6 inner corners, one per robot pose
      uq-handeye calibrate robot.csv --images 'img/*.png' --board 9x6 \
          --square 20mm --report report.html -o result/
      # Camera poses from another program
      uq-handeye calibrate robot.csv camera.csv -o result/
      uq-handeye calibrate robot.csv camera.csv --camera-noise 0.1deg,0.5mm
      # Joint values and robot model in place of robot poses
      uq-handeye calibrate camera.csv --joints joints.csv --urdf robot.urdf

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
    require_writable(report, "--report", REPORTS)
    for name, wanted in (("--no-compare", no_compare), ("--with-cross-check", with_cross_check)):
        if wanted and report is None:
            raise InputError(f"{name} needs --report FILE. Add it.")
    if method is not None:
        method = one_of(method, "--method", METHODS)
    from ...calibration.calibrate import calibrate

    if given.one_side is not None:  # that of the other is estimated beside it
        if prior is not None:
            raise InputError("The noise and a prior of it are both given. Give one of them.")
        prior = given.one_side
    poses, noise, shared = files.read_open(given, pictures, prior, arm)

    with timed("calibrating"):
        result = calibrate(
            poses,
            noise=noise,
            method=method,
            pairs=pairs,
            scale=scale,
            kind=kind,
            covariance=one_of(covariance, "--covariance", COVARIANCE_NAMES),
            robust=robust,
            prior=prior,
            seed=seed,
            correlation=one_of(correlation, "--correlation", ("auto", "none")),
            shared=shared,
            **beforehand,
            **({} if arm is None else arm.of_calibrate),
        )
    result = replace(result, about=wishes.about)
    check = _cross_check(problem_for(result, poses, noise, shared, pairs), seed) if with_cross_check else None
    _deliver(result, as_json, output, report, threshold, not no_compare, check, wishes)


def demo_command(as_json: JsonOption = False, output: ResultFolder = None, report: ReportFile = None) -> None:
    """Calibrate an embedded data set whose true X is known.

    Examples:
      uq-handeye demo
      # Write result.json, figures and exports too
      uq-handeye demo --report demo.html -o demo/
    """
    from importlib import resources

    from ...calibration.calibrate import calibrate
    from ...calibration.report.text import against_truth
    from ...io import read_pose_file, read_poses
    from ...noise.models import PoseNoise

    require_writable(report, "--report", REPORTS)
    with resources.as_file(resources.files("uq_handeye") / "data") as data:
        poses = read_poses(data / "robot.csv", data / "camera.csv")
        _, truth = read_pose_file(data / "truth.csv")
    result = calibrate(poses, noise=PoseNoise.isotropic(**DEMO_NOISE))
    _deliver(result, as_json, output, report, 0.5, True, None)
    if not as_json:
        emit("\n" + against_truth(result, truth[0]))


def _cross_check(problem: dict[str, Any], seed: int) -> "CrossCheck":
    from ...validation.cross_check.run import cross_check

    with timed("cross-check"):
        check = cross_check(**problem, seed=seed, workers=cores(), progress=progress_wanted())
    if not check.complete:
        raise KeyboardInterrupt
    return check


def _deliver(
    result: "Calibration",
    as_json: bool,
    output: Path | None,
    report: Path | None,
    threshold: float,
    comparison: bool,
    check: "CrossCheck | None",
    wishes: ReportOptions | None = None,
) -> None:
    """Write the files, then print: if a file cannot be written, nothing is printed."""
    result = _with_command(result)
    methods: Compared | bool = comparison
    if report is not None and comparison:
        from ...comparison.of_result import compare_beside

        with timed("comparing the methods"), working("comparing the methods", progress_wanted()):
            methods = compare_beside(result)
    if output is not None:
        with timed(f"writing {output}"), working(f"writing {output}", progress_wanted()):
            _write_result(result, output, check, None if isinstance(methods, bool) else methods.comparison)
    if report is not None:
        write_report(result, report, methods, check, **({} if wishes is None else wishes.of_report))
    emit(result.to_json() if as_json else result.summary(threshold))


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


def _write_result(
    result: "Calibration", directory: Path, check: "CrossCheck | None", comparison: "Comparison | None"
) -> None:
    from ...io import write_files
    from ...presentation.ellipses import render  # Matplotlib is slow to import
    from ...report.figures import figures

    files: dict[str, Any] = {"result.json": result.to_json(), **_exports(result)}
    if result.table is not None:
        files["poses.csv"] = result.table.to_dataframe().to_csv(index=False, lineterminator="\n")
    for stem, figure in figures(result, check, comparison).items():
        files |= {f"{stem}.{kind}": render(figure, kind) for kind in ("png", "svg")}
    write_files(directory, files)
    possible = {"poses.csv", *EXPORTS.values(), *(f"{stem}.{kind}" for stem in FIGURES for kind in ("png", "svg"))}
    for name in possible - set(files):  # those of an earlier run are not of this result
        (directory / name).unlink(missing_ok=True)


def _exports(result: "Calibration") -> dict[str, bytes]:
    with TemporaryDirectory() as folder:
        return {name: result.export(Path(folder) / name, format).read_bytes() for format, name in EXPORTS.items()}
