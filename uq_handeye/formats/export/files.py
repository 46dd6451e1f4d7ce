"""A calibration as a file of another program: JSON, ROS, URDF, OpenCV, NPZ, and as robots write poses."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ...core.files.atomic import write_atomically
from ...core.files.open import StrPath, as_path, shown
from ...core.geometry.conventions import TOOLKIT
from ...errors import InputError, require_one_of
from ..controllers.forms import CONTROLLERS, WRITTEN, written_poses
from ..opencv_storage import matrix_lines, yaml_number
from .snippets import (
    NOT_DETERMINED,
    Exportable,
    Transform,
    open_comments,
    opencv_name,
    transforms_of,
    urdf_joint,
    yaml_fields,
)

# What a ROS file says of its covariance.
_ROS = "(x, y, z, rotation about x, y, z), translation first, fixed axes of the parent frame; m and rad; 6x6 row by row"
OWN_FRAMES = "# Put the names of your own frames in; the camera is the frame with z forward, which ROS calls optical."


def ros_text(result: Exportable) -> str:
    """YAML with a ``TransformStamped`` and, where the covariance is determined, a ``PoseWithCovarianceStamped``.

    The keys below each message are its fields, as ``geometry_msgs`` names them.
    """
    X, inverse = transforms_of(result)
    lines = [
        f"# {X.name} by uq-handeye: translation first (m), then the unit quaternion (x, y, z, w).",
        OWN_FRAMES,
        *transform_stamped("transform_stamped", X),
        f"# The inverse, {inverse.name}.",
        *transform_stamped("inverse_transform_stamped", inverse),
    ]
    return "\n".join([*lines, *pose_with_covariance(X, open_comments(result)), ""])


def pose_with_covariance(X: Transform, comments: Sequence[str] = ()) -> list[str]:
    """Lines of a ``PoseWithCovarianceStamped``, or of the reason why there is none."""
    covariance = X.covariance_in("ros")
    if covariance is None:
        return [f"# {NOT_DETERMINED}"]
    return [
        f"# Covariance of {_ROS}.",
        *(f"# {line}" for line in comments),
        "pose_with_covariance_stamped:",
        f"  header: {{frame_id: {X.parent}}}",
        "  pose:",
        "    pose:",
        f"      position: {yaml_fields('xyz', X.t)}",
        f"      orientation: {yaml_fields('xyzw', X.quaternion)}",
        "    covariance: [",
        *(f"      {', '.join(map(yaml_number, row))}," for row in covariance),
        "    ]",
    ]


def transform_stamped(key: str, X: Transform) -> list[str]:
    """Lines of a ``TransformStamped``."""
    return [
        f"{key}:",
        f"  header: {{frame_id: {X.parent}}}",
        f"  child_frame_id: {X.child}",
        "  transform:",
        f"    translation: {yaml_fields('xyz', X.t)}",
        f"    rotation: {yaml_fields('xyzw', X.quaternion)}",
    ]


def launch_text(result: Exportable) -> str:
    """A launch file of ROS 2, in Python, with the node that publishes X as a static transform."""
    X, _ = transforms_of(result)
    comments = [
        f"# {X.name} by uq-handeye: translation first (m), then the unit quaternion, scalar last.",
        OWN_FRAMES,
        *(f"# {line}" for line in open_comments(result)),
    ]
    return "\n".join(launch_lines(comments, node_lines(X)))


def node_options(X: Transform) -> list[str]:
    """Arguments of ``static_transform_publisher``."""
    numbers = zip(("x", "y", "z", "qx", "qy", "qz", "qw"), [*X.t.tolist(), *X.quaternion.tolist()], strict=True)
    return [
        *(f"--{name} {value!r}" for name, value in numbers),
        f"--frame-id {X.parent}",
        f"--child-frame-id {X.child}",
    ]


def node_lines(X: Transform) -> list[str]:
    """Lines of the node that publishes a static transform."""
    given = (f"                    {', '.join(map(repr, option.split()))}," for option in node_options(X))
    return [
        "            Node(",
        '                package="tf2_ros",',
        '                executable="static_transform_publisher",',
        "                arguments=[",
        *(line.replace("'", '"') for line in given),
        "                ],",
        "            )",
    ]


def launch_lines(comments: Sequence[str], nodes: Sequence[str]) -> list[str]:
    """Lines of a launch file with these nodes."""
    several = sum(line.strip() == "Node(" for line in nodes) > 1
    return [
        *comments,
        "from launch import LaunchDescription",
        "from launch_ros.actions import Node",
        "",
        "",
        "def generate_launch_description():",
        "    return LaunchDescription(",
        "        [",
        *(f"{line}," if several and line == "            )" else line for line in nodes),
        "        ]",
        "    )",
        "",
    ]


def urdf_text(result: Exportable) -> str:
    """A robot of two links and the fixed joint between them, to be included in another model."""
    X, _ = transforms_of(result)
    said = (
        NOT_DETERMINED if X.covariance is None else "URDF has no place for the covariance; the JSON and ROS files do."
    )
    said = " ".join([said, *open_comments(result)[:1]])
    return "\n".join(
        [
            '<?xml version="1.0"?>',
            f"<!-- {X.name} by uq-handeye: xyz in metres, rpy in rad about the fixed axes x, y, z. {said} -->",
            '<robot name="uq_handeye">',
            f'  <link name="{X.parent}"/>',
            f'  <link name="{X.child}"/>',
            *(f"  {line}" for line in urdf_joint(X, digits=17).splitlines()),
            "</robot>",
            "",
        ]
    )


def opencv_text(result: Exportable) -> str:
    """FileStorage YAML: 4x4, R and t of X and of its inverse, and the covariances (6x6), with their convention."""
    lines = ["%YAML:1.0", "---", *(f"# {line}" for line in open_comments(result))]
    for X in transforms_of(result):
        name = opencv_name(X)
        lines += [*matrix_lines(X.name, X.T), *matrix_lines(f"R_{name}", X.R), *matrix_lines(f"t_{name}", X.t[:, None])]
        if X.covariance is not None:
            lines += matrix_lines(f"covariance_{X.name}", X.covariance)
    said = NOT_DETERMINED if result.covariance is None else f"Covariances of {TOOLKIT}"
    return "\n".join([*lines, 'units: "m"', f'convention: "{said}"', ""])


def npz_bytes(result: Exportable) -> bytes:
    """Arrays by name; texts are zero-dimensional arrays, so that nothing is pickled."""
    arrays: dict[str, Any] = {
        "X": result.X,
        "X_inverse": result.inverse,
        "covariance": result.covariance,
        "covariance_inverse": result.covariance_inverse,
        "W": result.W,
        "covariance_W": result.covariance_W,
        "open_directions": None if result.opened is None else result.opened.basis,
        "frame": result.frame,
        "frame_W": result.frame_W,
        "units": "m",
        "convention": NOT_DETERMINED if result.covariance is None else f"covariances of {TOOLKIT}",
    }
    buffer = io.BytesIO()
    known: dict[str, Any] = {name: np.asarray(value) for name, value in arrays.items() if value is not None}
    np.savez(buffer, **known)
    return buffer.getvalue()


def pose_form_text(result: Exportable, format: str) -> str:
    """X as the controller of a robot, or software of a 3-D camera, writes a pose (`formats.controllers.writing`).

    Comments say what it is, and how well it is known; the full covariance is in the JSON and ROS files.
    """
    X, _ = transforms_of(result)
    form = CONTROLLERS.get(format)
    by = "" if form is None else f", as {form.maker} writes it ({form.units}, {form.rotation})"
    comments = [f"{X.name}: pose of the {X.child} in the {X.parent} frame{by}; by uq-handeye."]
    if X.covariance is None:
        comments.append(NOT_DETERMINED)
    else:
        angle, distance = (
            float(np.sqrt(np.linalg.eigvalsh(block)[-1])) for block in (X.covariance[:3, :3], X.covariance[3:, 3:])
        )
        comments.append(f"1 sigma, worst direction: {1e3 * distance:.3g} mm, {np.degrees(angle):.3g} deg.")
    return written_poses(X.T[None], format, [X.name], [*comments, *open_comments(result)])


_WRITERS: dict[str, Callable[[Exportable], str | bytes]] = {
    "json": lambda result: result.to_json(),
    "ros": ros_text,
    "launch": launch_text,
    "urdf": urdf_text,
    "opencv": opencv_text,
    "npz": npz_bytes,
    **{format: partial(pose_form_text, format=format) for format in WRITTEN},
}
FORMATS = tuple(_WRITERS)

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


def write_export(result: Exportable, path: StrPath, format: str | None = None) -> Path:
    """Write X for another program, whole or not at all.

    Parameters
    ----------
    result : Calibration
    path : path of the file
    format : one of `FORMATS`, or None
        None takes it from the suffix: .json, .yaml and .yml (ros), .py (launch), .urdf, .npz. All others must be asked
        for: the suffix does not tell them.

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    InputError
        An unknown format, a suffix that says none or another one, a file that cannot be written.
    """
    target, name = format_of(path, format, FORMATS)
    write_atomically(target, exported(result, name))
    return target


def exported(result: Exportable, format: str) -> str | bytes:
    """Return the content of a file of one of `FORMATS`."""
    return _WRITERS[format](result)


def format_of(path: StrPath, format: str | None, known: tuple[str, ...]) -> tuple[Path, str]:
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
