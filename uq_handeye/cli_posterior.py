"""The command ``uq-handeye posterior``: samples of the posterior of X."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from .cli_options import (
    CameraFile,
    CameraNoise,
    CameraUnits,
    JsonOption,
    NoiseFile,
    RobotFile,
    RobotNoise,
    RobotUnits,
    SetupOption,
    Units,
    emit,
    named_folder,
    noise_of,
    poses_of,
)
from .errors import InputError
from .io import write_files
from .motions import relative_motions
from .noise import PairNoise

CHAIN = "chain.h5"


def posterior_command(
    robot: RobotFile,
    camera: CameraFile,
    setup: SetupOption = "eye-in-hand",
    robot_noise: RobotNoise = None,
    camera_noise: CameraNoise = None,
    noise: NoiseFile = None,
    pairs: Annotated[
        str,
        typer.Option("--pairs", help="For noise on motions ([A], [B]): disjoint, or consecutive."),
    ] = "disjoint",
    samples: Annotated[int, typer.Option(help="Effective samples of every coordinate.")] = 10_000,
    scales: Annotated[
        bool | None,
        typer.Option(
            "--scales/--no-scales",
            help="Sample unknown factors on the noise of robot and camera, too. Left out: if it is estimated.",
        ),
    ] = None,
    student_t: Annotated[
        float | None,
        typer.Option("--student-t", metavar="NU", help="Heavy-tailed likelihood of NU degrees of freedom, e.g. 5."),
    ] = None,
    walkers: Annotated[int, typer.Option(help="Number of walkers.")] = 128,
    max_steps: Annotated[int, typer.Option(help="Steps of every walker at most.")] = 10_000,
    seed: Annotated[int, typer.Option(help="Seed of the random numbers.")] = 0,
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
            help=f"Keep the chain ({CHAIN}) here, and write posterior.json, corner.png and corner.svg.",
        ),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the chain in -o DIR.")] = False,
) -> None:
    """The posterior of X by Markov chain Monte Carlo, with a flat prior, until enough samples are effective.

    Example: uq-handeye posterior robot.csv camera.csv --robot-noise 0.02deg,0.05mm --camera-noise 0.1deg,0.5mm -o out/

    Nothing is reported before the chain has converged (autocorrelation time, split R-hat, effective samples). With -o a
    run that was interrupted, or has not converged, goes on with --resume and ends in the same numbers.
    """
    from .validation.posterior import sample_posterior

    if resume and output is None:
        raise InputError("--resume needs -o DIR, the folder of the run to go on with.")
    model = noise_of(robot_noise, camera_noise, noise)
    poses = poses_of(robot, camera, setup, (robot_units or units, camera_units or units))
    if output is not None:
        write_files(output, {})  # makes the folder, or says why not
        output.mkdir(parents=True, exist_ok=True)
    result = sample_posterior(
        relative_motions(poses, pairs) if isinstance(model, PairNoise) else poses,
        model,
        seed=seed,
        samples=samples,
        scales=scales,
        student_t=student_t,
        walkers=walkers,
        file=None if output is None else output / CHAIN,
        resume=resume,
        max_steps=max_steps,
        progress=True,
    )
    emit(result.to_json() if as_json else result.summary())
    if output is not None:
        from .report.ellipses import render  # Matplotlib is slow to import
        from .report.posterior_figure import corner

        figure = corner(result)
        files: dict[str, Any] = {"posterior.json": result.to_json()}
        write_files(output, files | {f"corner.{kind}": render(figure, kind) for kind in ("png", "svg")})
