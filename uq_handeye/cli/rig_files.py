"""Rig files and cameras by name: which files a rig is of, and what a rig of one camera gives `calibrate`."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from .messages import given_options
from .names import PAIRINGS
from .pose_files import OF_FILE, values_of_files
from .values import one_of

if TYPE_CHECKING:
    from ..model.poses.pose_pairs import PosePairs
    from ..model.rig.description import Rig
    from ..model.rig.noise_by_name import NoiseByName
    from ..model.shared_errors.shared_error import SharedError
    from .noise import Given
    from .pose_files import PoseFiles

    Described = tuple[Rig, NoiseByName | None]

# Options of the files of several cameras.
OF_FILES = {"--camera", "--setup", "--pair", "--time-tolerance", "--robot-noise", "--camera-noise", "--noise",
             "--robot-frame", "--camera-frame",
             "--format", "--units", "--rotation", "--quaternion"}  # fmt: skip
# What a rig file says itself: files, how they are read, noise, pictures, boards and arms.
_SAID_BY_FILE = OF_FILES | {
    "CAMERA", "--offset", "--bag", "--robot", "--still", "--watch", "--images", "--board", "--square",
    "--marker", "--dictionary", "--pattern", "--spacing", "--intrinsics", "--camera-matrix", "--image-size",
    "--joints", "--joint-units", "--urdf", "--robot-model", "--dh", "--ur-calibration", "--base", "--tip",
    "--touches", "--robot-prior", "--camera-prior", "--prior-factor",
}  # fmt: skip


def is_rig_file(file: Path | None) -> bool:
    """Return whether a file in place of ROBOT describes a rig."""
    return file is not None and file.suffix.lower() == ".toml"


def read_rig_file(files: "PoseFiles") -> "Described":
    """Return the rig of a file and its noise; only options that a rig file leaves open may be given."""
    from ..read.rig.rig_file import read_rig

    assert files.robot is not None
    if wrong := [name for name in given_options() if name in _SAID_BY_FILE]:
        raise InputError(f"{', '.join(wrong)}: a rig file says that itself. Remove it, or change {files.robot}.")
    return read_rig(files.robot)


def several_cameras(described: "Described | None", cameras: tuple[str, ...]) -> bool:
    """Return whether a rig has several cameras, targets or arms: all others are poses side by side."""
    if described is None:
        return len(cameras) > 1
    from ..model.rig.single import is_single

    return not is_single(described[0])


def named_camera(files: "PoseFiles", cameras: tuple[str, ...]) -> "tuple[PoseFiles, str | None]":
    """Return the files with the one of ``--camera NAME=FILE`` as CAMERA, and its name; as they are without."""
    if not cameras:
        return files, None
    ((name, file),) = named_files(cameras).items()
    if files.camera is not None:
        raise InputError(f"The camera is given twice, {files.camera} and --camera {cameras[0]}. Remove one of them.")
    return replace(files, camera=file), name


def poses_of_rig_file(
    described: "Described", given: "Given"
) -> "tuple[PosePairs, Any, list[SharedError] | None, dict[str, Any]]":
    """Return poses, noise, shared errors and further arguments of `calibrate` of one camera in a rig file."""
    from ..model.rig.single import single_of

    poses, options = single_of(*described)
    shared, noise = given.shared, options.pop("noise", None)
    if "kinematics" in options and shared.robot_class is not None:
        options["kinematic_errors"] = replace(options["kinematic_errors"], robot_class=shared.robot_class)
        shared = shared._replace(robot_class=None)
    return poses, noise, shared.errors(poses, noise), options


def named_files(cameras: Iterable[str]) -> dict[str, Path]:
    """Return files by the names of cameras."""
    named: dict[str, Path] = {}
    for text in cameras:
        name, _, file = (part.strip() for part in text.partition("="))
        if not name or not file:
            raise InputError(f"Expected --camera to be NAME=FILE such as left=left.csv, got {text!r}.")
        if name in named:
            raise InputError(f"The camera {name!r} is given twice, {named[name]} and {file}. Rename one of them.")
        named[name] = Path(file)
    return named


def tolerance_of_views(files: "PoseFiles") -> float:
    """Seconds by which the time of a view may differ from that of its robot pose."""
    how = None if files.pair is None else one_of(files.pair, "--pair", PAIRINGS)
    if how == "async":
        raise InputError(
            "--pair async: not for several cameras. Put each on the clock of the robot with uq-handeye sync."
        )
    if how == "rows":
        raise InputError("--pair rows: several cameras are matched by time or pose name. Remove it.")
    if files.time_tolerance is not None and how != "time":
        raise InputError("--time-tolerance needs --pair time. Add it.")
    return 0.0 if how is None else 0.02 if files.time_tolerance is None else files.time_tolerance


def reading_of_views(files: "PoseFiles", cameras: list[str]) -> dict[str, dict[str, Any]]:
    """Return how files are read, by robot and the names of cameras."""
    of_files = {name: values_of_files(getattr(files, name), f"--{name}", cameras) for name in OF_FILE}
    frames = values_of_files(files.camera_frame, "--camera-frame", cameras) | {"robot": files.robot_frame}
    found = {}
    for name, frame in frames.items():
        form, order = of_files["rotation"][name], of_files["quaternion"][name]
        if form is not None and order is not None:
            raise InputError(f"--rotation and --quaternion are both given for the file of {name}. Remove one of them.")
        found[name] = {"units": of_files["units"][name], "format": of_files["format"][name], "rotation": form or order,
                       "frame": frame}  # fmt: skip
    return found
