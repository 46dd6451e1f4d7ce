"""Options that several commands share: their types, how they are read, and how output is printed."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from .errors import InputError
from .io import read_noise_file, read_poses
from .noise import Noise, PoseNoise
from .noise_estimation import NoisePrior
from .poses import SETUPS, PosePairs
from .units import parse_deviations


def named_folder(directory: Path | None) -> Path | None:
    """An empty name would mean the current folder."""
    if directory is not None and str(directory) == ".":
        raise InputError("Expected -o to name a folder, got an empty name or '.'; write for example -o result.")
    return directory


SetupOption = Annotated[str, typer.Option("--setup", help=f"{' or '.join(SETUPS)}.")]
RobotNoise = Annotated[
    str | None,
    typer.Option("--robot-noise", metavar="ROT,TRANS", help="Standard deviations, e.g. 0.02deg,0.05mm."),
]
CameraNoise = Annotated[
    str | None,
    typer.Option("--camera-noise", metavar="ROT,TRANS", help="Standard deviations, e.g. 0.1deg,0.5mm."),
]
NoiseFile = Annotated[
    Path | None, typer.Option("--noise", metavar="FILE.toml", help="Noise with full 6x6 covariances.")
]
RobotFile = Annotated[Path, typer.Argument(metavar="ROBOT", help="Robot poses base_T_gripper, CSV.")]
CameraFile = Annotated[Path, typer.Argument(metavar="CAMERA", help="Camera poses camera_T_target, CSV.")]
PairsOption = Annotated[str, typer.Option("--pairs", help="Which poses make a motion: all, consecutive or disjoint.")]
Units = Annotated[str, typer.Option("--units", help="Length unit of both files: m, mm, cm, ...")]
RobotUnits = Annotated[str | None, typer.Option("--robot-units", help="Length unit of the robot file alone.")]
CameraUnits = Annotated[str | None, typer.Option("--camera-units", help="Length unit of the camera file alone.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object.")]
WorkersOption = Annotated[int | None, typer.Option("--workers", help="Processes. Left out: one per core.")]
OutputOption = Annotated[
    Path | None,
    typer.Option(
        "-o",
        "--output",
        metavar="DIR",
        callback=named_folder,
        help="Write result.json, poses.csv, ellipses.png and ellipses.svg here.",
    ),
]


def deviations(value: str, name: str) -> tuple[float, float]:
    """Standard deviations (rad, m) of an option ROTATION,TRANSLATION."""
    rotation, comma, translation = value.partition(",")
    if not comma or "," in translation:
        raise InputError(f"Expected {name} to be ROTATION,TRANSLATION such as 0.02deg,0.05mm, got {value!r}.")
    try:
        return parse_deviations((rotation, translation), name)
    except InputError as error:
        try:
            parse_deviations((translation, rotation), name)
        except InputError:
            raise error from None
        raise InputError(
            f"{name} {value}: rotation and translation look swapped; write {translation},{rotation}."
        ) from None


def noise_of(robot: str | None, camera: str | None, file: Path | None) -> Noise | None:
    """The noise of the three options, or None if none of them is given."""
    if file is not None:
        if robot is not None or camera is not None:
            raise InputError("Give either --noise FILE or --robot-noise and --camera-noise, not both.")
        return read_noise_file(file)
    if robot is None and camera is None:
        return None
    return PoseNoise.isotropic(
        robot=None if robot is None else deviations(robot, "--robot-noise"),
        camera=None if camera is None else deviations(camera, "--camera-noise"),
    )


def prior_of(robot: str | None, camera: str | None, factor: float) -> NoisePrior | None:
    """What the data sheets say, or None if nothing is given."""
    if robot is None and camera is None:
        return None
    return NoisePrior(_partly_known(robot, "--robot-prior"), _partly_known(camera, "--camera-prior"), factor)


def _partly_known(value: str | None, name: str) -> tuple[str | None, str | None] | None:
    if value is None:
        return None
    parts = [part.strip() for part in value.split(",")]
    if len(parts) != 2:
        raise InputError(f"Expected {name} to be ROTATION,TRANSLATION such as ?,0.05mm, got {value!r}.")
    rotation, translation = (None if part in ("", "?") else part for part in parts)
    return rotation, translation


def poses_of(robot: Path, camera: Path, setup: str, units: tuple[str, str]) -> PosePairs:
    """At least three poses from both files; ``units`` of the robot's and of the camera's."""
    poses = read_poses(robot, camera, setup=setup, units=units)
    if poses.n < 3:
        raise InputError(
            f"{robot} and {camera} hold {poses.n} poses; at least 3 poses are needed, which make 2 motions."
        )
    return poses


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def emit(output: str) -> None:
    """Print; a reader that closes the pipe early (`| head`) has seen enough, which is no failure."""
    try:
        sys.stdout.write(output)
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
