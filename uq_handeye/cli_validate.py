"""The command ``uq-handeye validate``: whether the covariance of a method is true."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .cli_options import (
    CameraFile,
    CameraNoise,
    CameraUnits,
    JsonOption,
    NoiseFile,
    PairsOption,
    RobotFile,
    RobotNoise,
    RobotUnits,
    SetupOption,
    Units,
    WorkersOption,
    cores,
    emit,
    named_folder,
    noise_of,
    poses_of,
)
from .errors import InputError
from .estimators import METHODS, ROBOT_WORLD_METHODS
from .io import json_text
from .likelihood import ESTIMATORS

if TYPE_CHECKING:
    from .noise import Noise
    from .poses import PosePairs
    from .validation.monte_carlo import MonteCarlo

# What the shell expects of a program that Ctrl-C ended; of a run that ended otherwise before its time.
INTERRUPTED, NOT_COMPLETE = 130, 1


def validate_command(
    robot: RobotFile,
    camera: CameraFile,
    setup: SetupOption = "eye-in-hand",
    robot_noise: RobotNoise = None,
    camera_noise: CameraNoise = None,
    noise: NoiseFile = None,
    method: Annotated[
        list[str] | None,
        typer.Option(
            "--method",
            metavar="NAME,NAME,...",
            help=f"One or several of {', '.join([*ESTIMATORS, *METHODS, *ROBOT_WORLD_METHODS])}. Left out: efficient.",
        ),
    ] = None,
    trials: Annotated[
        int | None, typer.Option(help="How many. Left out: 10,000, or with --digits at most 1,000,000.")
    ] = None,
    digits: Annotated[
        int | None, typer.Option(help="Stop once the result is stable to so many digits, 1 to 4 (JCGM 102).")
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of the noise: the same seed gives the same numbers.")] = 0,
    covariance: Annotated[
        str,
        typer.Option(
            metavar="model|each",
            help="Which is tested: that of the method at the true poses, or what each trial reports of itself.",
        ),
    ] = "model",
    pairs: PairsOption = "all",
    scale: Annotated[
        float | None, typer.Option(help="Scaling factor d of 4dpa; left out, its limit in closed form.")
    ] = None,
    sweep_noise: Annotated[
        str | None,
        typer.Option(
            metavar="FACTOR,FACTOR,...",
            help="Where first order ends: the noise covariances times each, e.g. 1,3,10,30,100.",
        ),
    ] = None,
    workers: WorkersOption = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="tcp://HOST:PORT", help="Run on the workers of this Dask scheduler.")
    ] = None,
    units: Units = "m",
    robot_units: RobotUnits = None,
    camera_units: CameraUnits = None,
    figure: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Write a figure, .png or .svg; one per method.")
    ] = None,
    as_json: JsonOption = False,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="DIR",
            callback=named_folder,
            help="Keep the trials here, from which --resume goes on; of several methods in a folder each.",
        ),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the run in DIR, or add trials to it.")] = False,
) -> int:
    """Monte Carlo: draw the noise again and again, calibrate each time, and see whether the covariance is true.

    Example: uq-handeye validate robot.csv camera.csv --robot-noise 0.02deg,0.05mm --camera-noise 0.1deg,0.5mm

    Noise is drawn around the poses as fitted. Without noise options the noise is estimated from the poses. A rejected
    covariance is a result: exit status 0. What ends the run early prints what the trials so far say: Ctrl-C (exit
    status 130), or workers that are lost (exit status 1); with -o DIR, --resume goes on.
    """
    names = _names(method)
    if covariance not in ("model", "each"):
        raise InputError(f"Expected --covariance to be model or each, got {covariance!r}.")
    if resume and output is None:
        raise InputError("--resume needs the folder of the run: give -o DIR.")
    if figure is not None and figure.suffix.lower() not in (".png", ".svg"):  # before the work, not after
        raise InputError(f"Expected --figure to be named .png or .svg, got {str(figure)!r}.")
    if figure is not None and not figure.parent.is_dir():
        raise InputError(f"Cannot write --figure {figure}: there is no folder {figure.parent}; make it first.")
    if output is not None and len(names) > 1 and (output / "manifest.json").exists():
        raise InputError(f"{output} holds the run of one method: give its --method alone, or name a new folder.")
    model = noise_of(robot_noise, camera_noise, noise)
    poses = poses_of(robot, camera, setup, (robot_units or units, camera_units or units))
    if workers is None:
        workers = cores()
    if sweep_noise is not None:
        given = {"--digits": digits, "--scheduler": scheduler, "-o": output, "--scale": scale}
        for option, value in (*given.items(), ("--covariance each", covariance == "each" or None)):
            if value is not None:
                raise InputError(f"--sweep-noise goes without {option}.")
        options = {"seed": seed, "pairs": pairs, **({} if trials is None else {"trials": trials})}
        return _sweep(poses, model, names, _factors(sweep_noise), options, figure, as_json)

    from .validation.monte_carlo import INTERRUPTED as ended_by_hand
    from .validation.monte_carlo import monte_carlo

    results: dict[str, MonteCarlo] = {}
    for name in names:
        result = monte_carlo(
            poses,
            noise=model,
            method=name,
            trials=trials,
            seed=seed,
            workers=workers,
            pairs=pairs,
            scale=scale,
            covariance="each" if covariance == "each" else None,
            digits=digits,
            directory=output if output is None or len(names) == 1 else output / name,
            resume=resume,
            client=scheduler,
            progress=True,
        )
        results[name] = result
        if not as_json:
            emit(("\n" if len(results) > 1 else "") + result.summary())
        if figure is not None:
            result.figure(_of_method(figure, name, names))
        if result.ended_early:
            break
    if as_json:
        parts = [result.to_dict() for result in results.values()]
        emit(json_text(parts[0] if len(names) == 1 else {"methods": parts}))
    if result.reason == ended_by_hand:
        return INTERRUPTED
    if result.ended_early:
        how = "--resume goes on" if output is not None else "with -o DIR, --resume would go on"
        reason = " ".join(result.reason.split())
        print(f"uq-handeye: the run by {result.method} is not complete: {reason}; {how}.", file=sys.stderr)
        return NOT_COMPLETE
    return 0


def _sweep(
    poses: PosePairs,
    noise: Noise | None,
    methods: list[str],
    factors: list[float],
    options: dict[str, Any],
    figure: Path | None,
    as_json: bool,
) -> int:
    from .validation.sweep import sweep

    result = sweep(poses, noise=noise, methods=methods, factors=factors, progress=True, **options)
    emit(result.to_json() if as_json else result.summary())
    if figure is not None:
        result.figure(figure)
    return 0


def _names(given: list[str] | None) -> list[str]:
    """The methods, each once, of options that may be lists with commas."""
    known = [*ESTIMATORS, *METHODS, *ROBOT_WORLD_METHODS]
    names = [name.strip().lower() for part in given or ["efficient"] for name in part.split(",") if name.strip()]
    wrong = next((name for name in names if name not in known), None)
    if wrong is not None or not names:
        raise InputError(f"Expected --method to name methods among {', '.join(known)}, got {wrong or ''!r}.")
    return list(dict.fromkeys(names))


def _factors(text: str) -> list[float]:
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise InputError(f"Expected --sweep-noise to be numbers such as 1,3,10,30,100, got {text!r}.") from None


def _of_method(figure: Path, name: str, names: list[str]) -> Path:
    """The file of a method: its name is put in where there are several."""
    return figure if len(names) == 1 else figure.with_name(f"{figure.stem}-{name}{figure.suffix}")
