"""The command ``uq-handeye cross-check``: every covariance of one problem, and whether they agree."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

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
from .cli_validate import INTERRUPTED, NOT_COMPLETE
from .io import write_files
from .motions import relative_motions
from .noise import PairNoise


def cross_check_command(
    robot: RobotFile,
    camera: CameraFile,
    setup: SetupOption = "eye-in-hand",
    robot_noise: RobotNoise = None,
    camera_noise: CameraNoise = None,
    noise: NoiseFile = None,
    trials: Annotated[int, typer.Option(help="Monte Carlo trials of each method.")] = 10_000,
    posterior: Annotated[bool, typer.Option(help="Sample the posterior too.")] = True,
    pairs: PairsOption = "all",
    seed: Annotated[int, typer.Option(help="The same seed gives the same numbers.")] = 0,
    workers: WorkersOption = None,
    units: Units = "m",
    robot_units: RobotUnits = None,
    camera_units: CameraUnits = None,
    as_json: JsonOption = False,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="DIR",
            callback=named_folder,
            help="Write cross_check.json, cross_check.csv, cross_check.png and cross_check.svg here.",
        ),
    ] = None,
) -> int:
    """Formulas, Monte Carlo and posterior side by side: every covariance of X, and whether they agree as they must.

    Example: uq-handeye cross-check robot.csv camera.csv --robot-noise 0.02deg,0.05mm --camera-noise 0.1deg,0.5mm -o cc/

    A broken relation is a result: exit status 0. Ctrl-C prints what there is so far (exit status 130); so does a
    run that lost its workers (exit status 1).
    """
    from .report.cross_check_figure import cross_check_figure
    from .report.ellipses import render  # Matplotlib is slow to import
    from .validation.cross_check import cross_check
    from .validation.monte_carlo import INTERRUPTED as ended_by_hand

    model = noise_of(robot_noise, camera_noise, noise)
    poses = poses_of(robot, camera, setup, (robot_units or units, camera_units or units))
    check = cross_check(
        relative_motions(poses, pairs) if isinstance(model, PairNoise) or pairs != "all" else poses,
        noise=model,
        trials=trials,
        seed=seed,
        workers=cores() if workers is None else workers,
        posterior=posterior,
        progress=True,
    )
    if output is not None:
        figure = cross_check_figure(check)
        table = check.to_dataframe().to_csv(index=False, lineterminator="\n")
        files = {"cross_check.json": check.to_json(), "cross_check.csv": table}
        write_files(output, files | {f"cross_check.{kind}": render(figure, kind) for kind in ("png", "svg")})
    emit(check.to_json() if as_json else check.to_text())
    if check.complete:
        return 0
    return INTERRUPTED if check.reason == ended_by_hand else NOT_COMPLETE
