"""The command ``uq-handeye plan``: which poses to take next."""

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
    RobotFile,
    RobotNoise,
    RobotUnits,
    SetupOption,
    Units,
    emit,
    noise_of,
    poses_of,
)
from .errors import InputError
from .io import read_pose_file
from .noise import PoseNoise


def plan_command(
    robot: RobotFile,
    camera: CameraFile,
    k: Annotated[int, typer.Option("-k", "--count", help="How many poses to take next.")] = 5,
    candidates: Annotated[
        Path | None,
        typer.Option(
            "--candidates", metavar="FILE.csv", help="Robot poses to choose from, in the units of the robot file."
        ),
    ] = None,
    sample: Annotated[
        int,
        typer.Option(
            help="Without --candidates: how many to draw. They look at the target from near where the camera has been "
            "(0.8 to 1.2 times the distances, 15 deg more tilt, 30 deg more roll), with the robot inside the box of "
            "its positions so far, grown by 15 % of its diagonal: its reach is not known."
        ),
    ] = 200,
    seed: Annotated[int, typer.Option(help="Seed of the candidates drawn.")] = 0,
    criterion: Annotated[
        str,
        typer.Option(
            help="What to make small: trace (mean squared error of points at --length from the camera), logdet (volume "
            "of the ellipsoid) or point (mean squared error of --point)."
        ),
    ] = "trace",
    point: Annotated[
        str | None, typer.Option(metavar="X,Y,Z", help="Camera coordinates with units, e.g. 0mm,0mm,300mm.")
    ] = None,
    length: Annotated[
        str | None, typer.Option(help="For trace; left out, the RMS distance from camera to target so far.")
    ] = None,
    repeat: Annotated[bool, typer.Option("--repeat", help="A candidate may be taken more than once.")] = False,
    setup: SetupOption = "eye-in-hand",
    robot_noise: RobotNoise = None,
    camera_noise: CameraNoise = None,
    noise: NoiseFile = None,
    units: Units = "m",
    robot_units: RobotUnits = None,
    camera_units: CameraUnits = None,
    as_json: JsonOption = False,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE.csv", help="Write the robot poses, in order, in metres."),
    ] = None,
) -> None:
    """Which poses to take next, and the standard deviations of X predicted after each.

    Example: uq-handeye plan robot.csv camera.csv --robot-noise 0.02deg,0.05mm --camera-noise 0.1deg,0.5mm -o next.csv

    Predicted to first order for the noise. Reach and obstacles are not known: look at each pose before you drive there.
    """
    from .planning import plan

    model = noise_of(robot_noise, camera_noise, noise)
    if model is not None and not isinstance(model, PoseNoise):
        raise InputError("plan needs noise on poses ([robot], [camera]), got noise on motions ([A], [B]).")
    for name, value, least in (("-k", k, 1), ("--sample", sample, 1), ("--seed", seed, 0)):
        if value < least:
            raise InputError(f"Expected {name} to be at least {least}, got {value}.")
    if point is not None and point.count(",") != 2:
        raise InputError(f"Expected --point to be X,Y,Z with units such as 0mm,0mm,300mm, got {point!r}.")
    if point is not None and criterion != "point":
        raise InputError(f"--point goes with --criterion point, got --criterion {criterion}.")
    of_robot = robot_units or units
    poses = poses_of(robot, camera, setup, (of_robot, camera_units or units))
    found = plan(
        poses,
        None if candidates is None else read_pose_file(candidates, of_robot)[1],
        k,
        noise=model,
        criterion=criterion,
        point=None if point is None else point.split(","),
        length=length,
        sample=sample,
        seed=seed,
        repeat=repeat,
    )
    if output is not None:
        found.to_csv(output)
    emit(found.to_json() if as_json else found.to_text())
