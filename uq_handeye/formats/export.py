"""Export of calibrations to the files of other programs: JSON, ROS, URDF, OpenCV, TOML, NPZ and robot controllers.

One result (`write_export`), or the poses of a rig with those that follow from them (`write_several`). ROS static
transforms, launch files and URDF are trees, in which each frame has one parent: they hold the poses of the cameras,
targets and bases, and the relative poses, which follow from these, as comments.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..core.files.atomic import write_atomically
from ..core.files.open import StrPath, as_path, shown
from ..core.geometry.conventions import TOOLKIT, convention_of, to_convention
from ..core.geometry.se3 import Array
from ..errors import InputError, require_one_of
from .controllers.forms import CONTROLLERS
from .controllers.written import WRITTEN, written_poses
from .snippets import (
    NOT_DETERMINED,
    OWN_FRAMES,
    Exportable,
    Transform,
    comments_of,
    opencv_name,
    template,
    transforms_of,
)


class Several(NamedTuple):
    """Poses that make trees, further ones that follow from them, and what is to be said of all."""

    poses: Sequence[Transform]
    relative: Sequence[Transform]
    comments: Sequence[str] = ()
    json: str = ""  # of the whole result

    @property
    def every(self) -> list[Transform]:
        """All poses, relative ones last."""
        return [*self.poses, *self.relative]


def _ros_one(result: Exportable) -> str:
    return str(template().ros_one(*transforms_of(result), comments_of(result)))


def _launch_one(result: Exportable) -> str:
    X, _ = transforms_of(result)
    head = f"{X.name} by uq-handeye: translation first (m), then the unit quaternion, scalar last."
    return str(template().launch([head, OWN_FRAMES, *comments_of(result)], [X]))


def _launch_several(of: Several) -> str:
    followed = [f"{X.name}, which follows: {template().node(X)}" for X in of.relative]
    head = "Poses of a rig by uq-handeye: translation first (m), then the unit quaternion, scalar last."
    return str(template().launch([head, OWN_FRAMES, *of.comments, *followed], of.poses))


def _urdf_one(result: Exportable) -> str:
    X, _ = transforms_of(result)
    no_place = "URDF has no place for the covariance; the JSON and ROS files do."
    said = " ".join([NOT_DETERMINED if X.covariance is None else no_place, *comments_of(result)[:2]])
    head = f"{X.name} by uq-handeye: xyz in metres, rpy in rad about the fixed axes x, y, z. {said}"
    return str(template().urdf([head], [X]))


def _urdf_several(of: Several) -> str:
    said = " ".join(["URDF has no place for covariances; the ROS, OpenCV and TOML files do.", *of.comments])
    followed = [f"{X.name}: xyz {' '.join(f'{v:.9g}' for v in X.t)} m" for X in of.relative]
    head = (
        "Poses of a rig by uq-handeye: xyz in metres, rpy in rad about the fixed axes x, y, z. Grippers and world are "
        f"links of the robot's own model. {said}"
    )
    return str(template().urdf([head, *followed], of.poses))


def _opencv_one(result: Exportable, convention: str = "toolkit") -> str:
    said = NOT_DETERMINED if result.covariance is None else f"Covariances of {convention_of(convention).words}"
    named = [(X, opencv_name(X)) for X in transforms_of(result)]
    return str(template().opencv(comments_of(result), named, said, convention))


def _opencv_several(of: Several) -> str:
    return str(template().opencv(of.comments, [(X, X.name) for X in of.every], f"Covariances of {TOOLKIT}"))


def _npz_one(result: Exportable, convention: str = "toolkit") -> bytes:
    def converted(covariance: Array | None, T: Array | None) -> Array | None:
        return None if covariance is None or T is None else to_convention(covariance, T, convention)

    return _npz(
        X=result.X,
        X_inverse=result.inverse,
        covariance=converted(result.covariance, result.X),
        covariance_inverse=converted(result.covariance_inverse, result.inverse),
        W=result.W,
        covariance_W=converted(result.covariance_W, result.W),
        open_directions=None if result.opened is None else result.opened.basis,
        intrinsics=result.intrinsics_words,
        frame=result.frame,
        frame_W=result.frame_W,
        convention=NOT_DETERMINED if result.covariance is None else f"covariances of {convention_of(convention).words}",
    )


def _npz_several(of: Several) -> bytes:
    found: dict[str, Array | None] = {X.name: X.T for X in of.every}
    found |= {f"covariance_{X.name}": X.covariance for X in of.every}
    return _npz(**found, convention=f"covariances of {TOOLKIT} the parent")


def _npz(**arrays: Array | str | None) -> bytes:
    """Arrays by name; texts are zero-dimensional arrays, so that nothing is pickled."""
    buffer = io.BytesIO()
    known = {name: np.asarray(value) for name, value in arrays.items() if value is not None}
    np.savez(buffer, **known, units=np.asarray("m"))  # type: ignore[arg-type]
    return buffer.getvalue()


def _pose_form(result: Exportable, format: str) -> str:
    """X as the controller of a robot, or software of a 3-D camera, writes a pose (`controllers.forms`).

    Comments say what it is, and how well it is known; the full covariance is in the JSON and ROS files.
    """
    X, _ = transforms_of(result)
    form = CONTROLLERS.get(format)
    by = "" if form is None else f", as {form.maker} writes it ({form.units}, {form.rotation})"
    said = NOT_DETERMINED
    if X.covariance is not None:
        blocks = X.covariance[:3, :3], X.covariance[3:, 3:]
        angle, distance = (float(np.sqrt(np.linalg.eigvalsh(block)[-1])) for block in blocks)
        said = f"1 sigma, worst direction: {1e3 * distance:.3g} mm, {np.degrees(angle):.3g} deg."
    head = f"{X.name}: pose of the {X.child} in the {X.parent} frame{by}; by uq-handeye."
    return written_poses(X.T[None], format, [X.name], [head, said, *comments_of(result)])


_OF_ONE: dict[str, Callable[[Exportable], str | bytes]] = {
    "json": lambda result: str(result.to_json()),
    "ros": _ros_one,
    "launch": _launch_one,
    "urdf": _urdf_one,
    "opencv": _opencv_one,
    "npz": _npz_one,
    **{format: partial(_pose_form, format=format) for format in WRITTEN},
}
_OF_SEVERAL: dict[str, Callable[[Several], str | bytes]] = {
    "json": lambda of: of.json,
    "ros": lambda of: str(template().ros(of)),
    "launch": _launch_several,
    "urdf": _urdf_several,
    "opencv": _opencv_several,
    "toml": lambda of: str(template().toml(of, f"Covariances of {TOOLKIT} the parent")),
    "npz": _npz_several,
}
FORMATS = tuple(_OF_ONE)
# Formats whose covariances may be in any convention; others have that of the program they are for, or the toolkit's.
_IN_ANY_CONVENTION: dict[str, Callable[[Exportable, str], str | bytes]] = {"opencv": _opencv_one, "npz": _npz_one}

# What a suffix means, the first by itself.
_SUFFIXES = {
    ".json": ("json",),
    ".yaml": ("ros", "opencv", "zivid"),
    ".yml": ("ros", "opencv", "zivid"),
    ".py": ("launch",),
    ".urdf": ("urdf",),
    ".npz": ("npz",),
    ".toml": ("toml",),
}


def write_export(
    result: Exportable, path: StrPath, format: str | None = None, covariance_convention: str = "toolkit"
) -> Path:
    """Write X for another program, whole or not at all.

    Parameters
    ----------
    result : Calibration
    path : path of the file
    format : one of `FORMATS`, or None
        None takes it from the suffix: .json, .yaml and .yml (ros), .py (launch), .urdf, .npz. All others must be asked
        for: the suffix does not tell them.
    covariance_convention : a name in `conventions.CONVENTIONS`, of the covariances in files of OpenCV and NPZ

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    InputError
        An unknown format, a suffix that says none or another one, a file that cannot be written; a convention of
        covariances for a format that has its own.
    """
    target, name = _format_of(path, format, FORMATS)
    if convention_of(covariance_convention).name == "toolkit":
        content = exported(result, name)
    elif name in _IN_ANY_CONVENTION:
        content = _IN_ANY_CONVENTION[name](result, covariance_convention)
    else:
        raise InputError(
            f"Expected no `covariance_convention` (--covariance-convention) for the format {name}, whose covariance "
            f"has a convention of its own, or none: {' and '.join(_IN_ANY_CONVENTION)} take one."
        )
    write_atomically(target, content)
    return target


def exported(result: Exportable, format: str) -> str | bytes:
    """Return the content of a file of one of `FORMATS`."""
    return _OF_ONE[format](result)


def write_several(of: Several, path: StrPath, format: str | None = None) -> Path:
    """Write the poses as one file and return its path; ``format`` None: by the suffix.

    Raises `InputError` for another format.
    """
    target, name = _format_of(path, format, tuple(_OF_SEVERAL))
    write_atomically(target, several_exported(of, name))
    return target


def several_exported(of: Several, format: str) -> str | bytes:
    """Return the content of a file of a format."""
    return _OF_SEVERAL[format](of)


def _format_of(path: StrPath, format: str | None, known: tuple[str, ...]) -> tuple[Path, str]:
    """Return path and format of an export, one of ``known``; None: by the suffix. Raises `InputError` for others."""
    target = as_path(path)
    suffix = target.suffix.lower()
    if format is None:
        suffixes = [end for end, names in _SUFFIXES.items() if names[0] in known]
        if suffix not in suffixes:
            raise InputError(
                f"Expected {shown(target)} to end in {', '.join(suffixes)}, or `format` (--format) to be one of "
                f"{', '.join(known)}."
            )
        format = _SUFFIXES[suffix][0]
    require_one_of("format", format, known, "--format")
    if format not in _SUFFIXES.get(suffix, (format,)):
        ends = " or ".join(end for end, names in _SUFFIXES.items() if format in names)
        raise InputError(f"Expected a file of the format {format} to end in {ends}, got {shown(target)}.")
    return target, format
