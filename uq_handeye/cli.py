"""The command ``uq-handeye``: parses, calls, prints.

Exit status: 0 success; 2 bad usage or bad input, with one line on stderr; 1 an internal error, or a run that lost its
workers; 130 Ctrl-C, with one line on stderr.
"""

from __future__ import annotations

import signal
import sys
import warnings
from contextlib import suppress
from importlib import resources
from pathlib import Path
from typing import Annotated, Any

import typer

from . import __version__
from .calibration import calibrate
from .cli_cross_check import cross_check_command
from .cli_options import (
    CameraFile,
    CameraNoise,
    CameraUnits,
    JsonOption,
    NoiseFile,
    OutputOption,
    PairsOption,
    RobotFile,
    RobotNoise,
    RobotUnits,
    SetupOption,
    Units,
    emit,
    named_folder,
    noise_of,
    poses_of,
    prior_of,
)
from .cli_plan import plan_command
from .cli_posterior import posterior_command
from .cli_validate import INTERRUPTED, validate_command
from .comparison import Comparison, compare
from .errors import InputError, InputWarning, NotConvergedError
from .estimators import METHODS, ROBOT_WORLD_METHODS
from .io import pose_text, read_pose_file, read_poses, write_files
from .likelihood import ESTIMATORS
from .noise import PoseNoise
from .poses import SETUPS
from .report import comparison_text, text
from .resampling import KINDS as OF_RESIDUALS
from .result import Calibration
from .simulation import simulate

app = typer.Typer(
    help="Hand-eye calibration AX = XB with its uncertainty.",
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)

# The noise that the embedded data set was simulated with; data/README.md has the command.
DEMO_NOISE = {"robot": ("0.02deg", "0.05mm"), "camera": ("0.1deg", "0.5mm")}

# Typer carries its own copy of Click or uses the installed one, depending on its version.
ClickException: type[Exception] = typer.BadParameter.__mro__[2]


def _print_result(result: Calibration, as_json: bool, output: Path | None, threshold: float) -> None:
    if output is not None:
        _write_result(result, output)
    if as_json:
        emit(result.to_json())
    else:
        # On a terminal the warnings stand above already; a file should keep them.
        emit(text.summary(result, threshold) if sys.stdout.isatty() else result.summary(threshold))


def _write_result(result: Calibration, directory: Path) -> None:
    files: dict[str, Any] = {"result.json": result.to_json()}
    if result.table is not None:
        files["poses.csv"] = result.table.to_dataframe().to_csv(index=False, lineterminator="\n")
    if result.covariance is not None:
        from .report.ellipses import covariance_ellipses, render  # Matplotlib is slow to import

        parent = result.frame.split("_T_")[0]
        title = f"{result.frame} by {result.method}: errors in the {parent} frame"
        figure = covariance_ellipses(result.X, result.covariance, title=title)
        files |= {f"ellipses.{kind}": render(figure, kind) for kind in ("png", "svg")}
    write_files(directory, files)
    for name in {"poses.csv", "ellipses.png", "ellipses.svg"} - set(
        files
    ):  # those of an earlier run are not of this result
        (directory / name).unlink(missing_ok=True)


@app.command("calibrate")
def calibrate_command(
    robot: RobotFile,
    camera: CameraFile,
    setup: SetupOption = "eye-in-hand",
    robot_noise: RobotNoise = None,
    camera_noise: CameraNoise = None,
    noise: NoiseFile = None,
    pairs: PairsOption = "all",
    method: Annotated[
        str | None,
        typer.Option(
            help=f"Estimator: {', '.join([*ESTIMATORS, *METHODS, *ROBOT_WORLD_METHODS])}. Left out: efficient, or "
            "4dpa where --scale or --kind ask for it."
        ),
    ] = None,
    scale: Annotated[
        float | None, typer.Option(help="Scaling factor d of 4dpa; left out, its limit in closed form.")
    ] = None,
    kind: Annotated[
        str | None,
        typer.Option(help="Propagation of noise by published methods: poses, pairs, or literal for noise on pairs."),
    ] = None,
    covariance: Annotated[
        str,
        typer.Option(
            help="Covariance of the result: model, sigma-points (beyond first order), or without noise model "
            f"{', '.join(OF_RESIDUALS)}."
        ),
    ] = "model",
    robust: Annotated[
        bool | None,
        typer.Option(
            "--robust/--no-robust",
            help="Weight wrong detections down and name them. Left out: where the noise is estimated.",
        ),
    ] = None,
    robot_prior: Annotated[
        str | None,
        typer.Option(
            metavar="ROT,TRANS",
            help="Data sheet of the robot, for noise that is estimated, e.g. '?,0.05mm'; ? is unknown.",
        ),
    ] = None,
    camera_prior: Annotated[
        str | None, typer.Option(metavar="ROT,TRANS", help="The same of the camera poses, e.g. '0.1deg,?'.")
    ] = None,
    prior_factor: Annotated[
        float, typer.Option(help="The data sheet is right within this factor (1 sigma); 1 takes it as exact.")
    ] = 2.0,
    seed: Annotated[int, typer.Option(help="Seed of random subsets and bootstrap.")] = 0,
    units: Units = "m",
    robot_units: RobotUnits = None,
    camera_units: CameraUnits = None,
    threshold: Annotated[float, typer.Option(min=0.0, max=1.0, help="List correlations from here up.")] = 0.5,
    as_json: JsonOption = False,
    output: OutputOption = None,
) -> None:
    """X and its covariance from two pose files.

    Example: uq-handeye calibrate robot.csv camera.csv -o result/

    With known noise: append --robot-noise 0.02deg,0.05mm --camera-noise 0.1deg,0.5mm. Without, it is estimated from the
    data. The files have the header timestamp,x,y,z,qx,qy,qz,qw (unit quaternion, scalar last) and are paired by row.
    """
    model = noise_of(robot_noise, camera_noise, noise)
    prior = prior_of(robot_prior, camera_prior, prior_factor)
    poses = poses_of(robot, camera, setup, (robot_units or units, camera_units or units))
    result = calibrate(
        poses,
        noise=model,
        method=method,
        pairs=pairs,
        scale=scale,
        kind=kind,
        covariance=covariance,
        robust=robust,
        prior=prior,
        seed=seed,
    )
    _print_result(result, as_json, output, threshold)


@app.command("compare")
def compare_command(
    robot: RobotFile,
    camera: CameraFile,
    setup: SetupOption = "eye-in-hand",
    robot_noise: RobotNoise = None,
    camera_noise: CameraNoise = None,
    noise: NoiseFile = None,
    pairs: PairsOption = "all",
    methods: Annotated[
        str | None,
        typer.Option(
            metavar="NAME,NAME,...",
            help=f"Some of {', '.join(METHODS)}; or {', '.join(ROBOT_WORLD_METHODS)}, on poses. Left out: the former.",
        ),
    ] = None,
    reference: Annotated[str, typer.Option(help="Method from which differences are taken.")] = "4dpa",
    units: Units = "m",
    robot_units: RobotUnits = None,
    camera_units: CameraUnits = None,
    as_json: JsonOption = False,
    as_csv: Annotated[bool, typer.Option("--csv", help="Print the table as CSV.")] = False,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="DIR", callback=named_folder, help="Write comparison.json, .csv, .png, .svg."
        ),
    ] = None,
) -> int:
    """All published methods on the same pairs: a table, and a figure of who agrees.

    Example: uq-handeye compare robot.csv camera.csv --robot-noise 0.02deg,0.05mm --camera-noise 0.1deg,0.5mm -o out/

    A method that fails keeps its row, which says why. Exit status 2 if every method fails. The table is up to 120
    columns wide; on a narrower terminal append | less -S, or use --csv.
    """
    if as_json and as_csv:
        raise InputError("Give either --json or --csv, not both.")
    names = None if methods is None else _methods(methods, "--methods")
    (base,) = _methods(reference, "--reference", most=1)
    model = noise_of(robot_noise, camera_noise, noise)
    poses = poses_of(robot, camera, setup, (robot_units or units, camera_units or units))
    result = compare(poses, noise=model, methods=names, pairs=pairs, reference=base, progress=True)
    if as_json or as_csv:
        emit(result.to_json() if as_json else result.to_csv())
    else:  # on a terminal the warnings stand above already
        emit(comparison_text.table(result, warnings=not sys.stdout.isatty()))
    if output is not None:  # after the table, which is not to be lost if this fails
        _write_comparison(result, output)
    if result.reference is None:
        some = any(row.X is not None for row in result.rows)
        _fail(f"{'No method gave a result to rely on' if some else 'Every method failed'}; the table says why.")
    return 0


def _methods(text: str, option: str, most: int | None = None) -> list[str]:
    """The methods of a list with commas, in small letters or capitals."""
    known = [*METHODS, *ROBOT_WORLD_METHODS]
    names = [name for part in text.split(",") if (name := part.strip().lower())]
    wrong = [part.strip() for part in text.split(",") if part.strip() and part.strip().lower() not in known]
    if wrong or not names or (most and len(names) > most):
        what = "one method" if most == 1 else "methods"
        got = repr(wrong[0]) if wrong else repr(text)
        raise InputError(f"Expected {option} to name {what} among {', '.join(known)}, got {got}.")
    return names


def _write_comparison(result: Comparison, directory: Path) -> None:
    from .report.comparison_figure import comparison_figure, png  # Matplotlib is slow to import
    from .report.ellipses import render

    figure = comparison_figure(result)
    files: dict[str, Any] = {"comparison.json": result.to_json(), "comparison.csv": result.to_csv()}
    write_files(directory, files | {"comparison.png": png(figure), "comparison.svg": render(figure, "svg")})


@app.command()
def demo(as_json: JsonOption = False, output: OutputOption = None) -> None:
    """The main job on an embedded data set whose truth is known.

    Example: uq-handeye demo -o demo/
    """
    with resources.as_file(resources.files("uq_handeye") / "data") as data:
        poses = read_poses(data / "robot.csv", data / "camera.csv")
        _, truth = read_pose_file(data / "truth.csv")
    result = calibrate(poses, noise=PoseNoise.isotropic(**DEMO_NOISE))
    _print_result(result, as_json, output, 0.5)
    if not as_json:
        emit("\n" + text.against_truth(result, truth[0]))


app.command("plan")(plan_command)
app.command("validate")(validate_command)
app.command("posterior")(posterior_command)
app.command("cross-check")(cross_check_command)


@app.command("simulate")
def simulate_command(
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Folder to write.")],
    n_poses: Annotated[int, typer.Option("--poses", "-n", help="Number of poses.")] = 20,
    setup: SetupOption = "eye-in-hand",
    robot_noise: RobotNoise = None,
    camera_noise: CameraNoise = None,
    noise: NoiseFile = None,
    distance: Annotated[str, typer.Option(help="Camera to target, NEAREST,FARTHEST.")] = "0.4m,0.8m",
    tilt: Annotated[str, typer.Option(help="Largest angle between line of sight and target normal.")] = "35deg",
    roll: Annotated[str, typer.Option(help="Largest roll about the line of sight, either way.")] = "60deg",
    seed: Annotated[int, typer.Option(help="Seed of the random numbers.")] = 0,
) -> None:
    """Pose files of a simulated rig: robot.csv, camera.csv and truth.csv.

    Example: uq-handeye simulate -o sim/ --poses 30 --camera-noise 0.1deg,0.5mm --seed 1
    """
    model = noise_of(robot_noise, camera_noise, noise)
    if model is not None and not isinstance(model, PoseNoise):
        raise InputError("simulate needs noise on poses ([robot], [camera]), got noise on motions ([A], [B]).")
    if seed < 0:
        raise InputError(f"Expected --seed to be 0 or more, got {seed}.")
    if n_poses < 1:
        raise InputError(f"Expected --poses to be at least 1, got {n_poses}.")
    near, _, far = distance.partition(",")
    poses = simulate(n_poses, noise=model, setup=setup, distance=(near, far or near), tilt=tilt, roll=roll, seed=seed)
    assert poses.truth is not None and poses.timestamps is not None  # simulate() gives both
    write_files(
        output,
        {
            "robot.csv": pose_text(poses.robot, poses.timestamps),
            "camera.csv": pose_text(poses.camera, poses.timestamps),
            "truth.csv": pose_text(poses.truth.X[None]),
        },
    )
    print(f"Wrote robot.csv, camera.csv and truth.csv ({SETUPS[setup]}) to {output}")


@app.callback(invoke_without_command=True)
def _start(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    if version:
        print(f"uq-handeye {__version__}")
    elif context.invoked_subcommand is None:
        print(context.get_help())


def main(arguments: list[str] | None = None) -> None:
    """Run the command; every expected failure is one line on stderr and exit status 2."""
    warnings.simplefilter("always", InputWarning)
    warnings.showwarning = _show_warning
    try:
        status = app(arguments, standalone_mode=False)
        sys.stdout.flush()
    except ClickException as error:
        _fail(f"{error.format_message()} (see uq-handeye --help)")  # type: ignore[attr-defined]
    except (InputError, NotConvergedError) as error:
        _fail(str(error))
    except OSError as error:  # files have their own messages, so this is the standard output
        sys.stdout = None  # or Python would try, and fail, to flush it once more
        _fail(f"Cannot write the output: {error.strerror or error}.")
    except (typer.Abort, KeyboardInterrupt):
        status = INTERRUPTED
    if status == INTERRUPTED:  # of a command that has printed what it had, or of Typer, which catches the exception
        with suppress(ValueError):  # not in the main thread
            signal.signal(signal.SIGINT, signal.SIG_IGN)  # once more would end this line too
        print("uq-handeye: interrupted", file=sys.stderr)
    raise SystemExit(status if isinstance(status, int) else 0)


def _fail(message: str) -> None:
    print(f"uq-handeye: error: {' '.join(message.split())}", file=sys.stderr)
    raise SystemExit(2)


def _show_warning(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
    label = "warning" if issubclass(category, InputWarning) else category.__name__
    print(f"uq-handeye: {label}: {message}", file=sys.stderr)
