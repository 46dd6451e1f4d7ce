"""The commands ``calibrate`` and ``demo``: X with its uncertainty, as text, files and report."""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ...errors import InputError
from ...runtime.progress import working
from ..arm_options import Arm, arm_of
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
        "Write result.json, poses.csv, every figure (PNG, SVG; that of the methods with --report) and X for ROS, URDF, "
        "OpenCV and NumPy here."
    ),
]
ReportFile = Annotated[
    Path | None,
    option("--report", metavar="FILE", panel=OUTPUT, help="Write a report for people: one .html or .pdf file."),
]
NoCompare = Annotated[
    bool, flag("--no-compare", panel=OUTPUT, help="Leave the comparison of methods out of the report.")
]


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
            help=f"Estimator: {', '.join(METHODS)}; bundle is for pictures. Left out: efficient, or 4dpa where --scale "
            "or --kind ask for it.",
        ),
    ] = None,
    pairs: PairsOption = "all",
    scale: Annotated[
        float | None, option("--scale", help="Scaling factor d of 4dpa; left out, its limit in closed form.")
    ] = None,
    kind: Annotated[
        str | None,
        option(
            "--kind",
            of=("poses", "pairs", "literal"),
            metavar="NAME",
            help="Propagation of noise by published methods: poses, pairs, or literal for noise on pairs.",
        ),
    ] = None,
    covariance: Annotated[
        str,
        option(
            "--covariance",
            of=COVARIANCE_NAMES,
            metavar="NAME",
            help="Covariance of the result: model, sigma-points (beyond first order), or without noise model "
            f"{', '.join(COVARIANCE_NAMES[2:])}.",
        ),
    ] = "model",
    robust: Annotated[
        bool | None,
        flag(
            "--robust/--no-robust",
            panel="Wrong detections",
            help="Down-weight outliers and name them, or count all poses in full. Left out: down-weight from 5 poses.",
        ),
    ] = None,
    correlation: Annotated[
        str,
        option(
            "--correlation",
            of=("auto", "none"),
            metavar="NAME",
            help="Errors of neighbouring poses that are correlated, by drift or in time: auto estimates them with the "
            "noise and has them in the covariance, none takes poses as independent.",
        ),
    ] = "auto",
    seed: Annotated[int, option("--seed", help="Seed of random subsets, bootstrap and cross-check.")] = 0,
    threshold: Annotated[float, typer.Option(min=0.0, max=1.0, help="List correlations from here up.")] = 0.5,
    report: ReportFile = None,
    no_compare: NoCompare = False,
    with_cross_check: Annotated[
        bool,
        flag("--with-cross-check", panel=OUTPUT, help="Monte Carlo and posterior in the report, too; takes a minute."),
    ] = False,
    as_json: JsonOption = False,
    output: ResultFolder = None,
) -> None:
    """X and its covariance from robot and camera poses.

    Example: uq-handeye calibrate robot.csv camera.csv --report report.html

    With known noise append --robot-noise 0.02deg,0.05mm and --camera-noise
    0.1deg,0.5mm. Without, it is estimated from the data.

    The default format is CSV with the header timestamp,x,y,z,qx,qy,qz,qw:
    metres, unit quaternion with the scalar last, ROBOT holds base_T_gripper,
    CAMERA holds camera_T_target, and row k of both belongs to the same moment.

    CAMERA may be the folder of uq-handeye camera -o, whose joint covariance is
    used; or go from pictures to X at once:
    uq-handeye calibrate robot.csv --images 'img/*.png' --board 9x6 --square 20mm

    With finished camera poses say what they saw: their noise follows from it.
    uq-handeye calibrate robot.csv camera.csv --board 9x6 --square 20mm
    --camera-matrix 1080,1080,960,540

    With joints and URDF the errors of the robot's kinematics are part of the
    covariance: uq-handeye calibrate camera.csv --joints joints.csv
    --urdf robot.urdf [--robot robot.csv]
    """
    require_writable(report, "--report", REPORTS)
    for name, wanted in (("--no-compare", no_compare), ("--with-cross-check", with_cross_check)):
        if wanted and report is None:
            raise InputError(f"{name} is about the report: give --report FILE, too.")
    if method is not None:
        method = one_of(method, "--method", METHODS)
    from ...calibration.calibrate import calibrate

    if given.one_side is not None:  # that of the other is estimated beside it
        if prior is not None:
            raise InputError("Give either the noise or, for noise that is to be estimated, a prior; not both.")
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
    """The main job on an embedded data set whose truth is known.

    Example: uq-handeye demo --report demo.html
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
    """Files first: where one cannot be written, nothing is printed as if all were well."""
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
    """The report, which names this command line as what made it."""
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
