"""Several poses with their covariances as one file of another program: those of a rig, with relative poses.

ROS static transforms, launch files and URDF are trees, in which each frame has one parent: they hold the poses of the
cameras, targets and bases, and the relative poses, which follow from these, as comments.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...core.files.atomic import write_atomically
from ...core.files.open import StrPath
from ...core.geometry.conventions import TOOLKIT
from ..opencv_storage import matrix_lines
from .files import (
    OWN_FRAMES,
    format_of,
    launch_lines,
    node_lines,
    node_options,
    pose_with_covariance,
    transform_stamped,
)
from .snippets import Transform, urdf_joint


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

    @property
    def said(self) -> list[str]:
        """Comment lines."""
        return [f"# {line}" for line in self.comments]


def ros_text(of: Several) -> str:
    """YAML with a ``TransformStamped`` and a ``PoseWithCovarianceStamped`` of each pose."""
    lines = [
        "# Poses of a rig by uq-handeye: translation first (m), then the unit quaternion (x, y, z, w).",
        OWN_FRAMES,
    ]
    lines += of.said
    for X in of.every:
        note = " Follows from the others; do not publish it beside them." if X in of.relative else ""
        lines += [f"# {X.name}.{note}", f"{X.name}:"]
        lines += [f"  {line}" for line in (*transform_stamped("transform_stamped", X), *pose_with_covariance(X))]
    return "\n".join([*lines, ""])


def launch_text(of: Several) -> str:
    """A launch file of ROS 2 with a node for each static transform."""
    comments = [f"# {X.name}, which follows: {' '.join(node_options(X))}" for X in of.relative]
    head = ["# Poses of a rig by uq-handeye: translation first (m), then the unit quaternion, scalar last.", OWN_FRAMES]
    return "\n".join(launch_lines([*head, *of.said, *comments], [line for X in of.poses for line in node_lines(X)]))


def urdf_text(of: Several) -> str:
    """Links and the fixed joints between them, to be included in the model of the robot."""
    links = dict.fromkeys(name for X in of.poses for name in (X.parent, X.child))
    joints = [f"  {line}" for X in of.poses for line in urdf_joint(X, digits=17).splitlines()]
    said = ["URDF has no place for covariances; the ROS, OpenCV and TOML files do.", *of.comments]
    followed = [f"{X.name}: xyz {' '.join(f'{v:.9g}' for v in X.t)} m" for X in of.relative]
    return "\n".join(
        [
            '<?xml version="1.0"?>',
            "<!-- Poses of a rig by uq-handeye: xyz in metres, rpy in rad about the fixed axes x, y, z. Grippers and "
            f"world are links of the robot's own model. {' '.join(said)} -->",
            *(f"<!-- {text} -->" for text in followed),
            '<robot name="uq_handeye">',
            *(f'  <link name="{name}"/>' for name in links),
            *joints,
            "</robot>",
            "",
        ]
    )


def opencv_text(of: Several) -> str:
    """FileStorage YAML: 4x4, R and t and the covariance (6x6) of each pose."""
    lines = ["%YAML:1.0", "---", *of.said]
    for X in of.every:
        parts = [(X.name, X.T), (f"R_{X.name}", X.R), (f"t_{X.name}", X.t[:, None])]
        if X.covariance is not None:
            parts.append((f"covariance_{X.name}", X.covariance))
        lines += [line for name, values in parts for line in matrix_lines(name, values)]
    return "\n".join([*lines, 'units: "m"', f'convention: "Covariances of {TOOLKIT}"', ""])


def toml_text(of: Several) -> str:
    """TOML with a table of each pose: matrix, quaternion, covariance."""
    lines = [*of.said, 'units = "m, rad"', f'convention = "Covariances of {TOOLKIT} the parent"']
    for what, poses in (("poses", of.poses), ("relative", of.relative)):
        for X in poses:
            lines += [
                "",
                f"[{what}.{X.name}]",
                f'parent = "{X.parent}"',
                f'child = "{X.child}"',
                f"matrix = {X.T.tolist()}",
                f"translation = {X.t.tolist()}",
                f"quaternion_xyzw = {X.quaternion.tolist()}",
                *([] if X.covariance is None else [f"covariance = {X.covariance.tolist()}"]),
            ]
    return "\n".join([*lines, ""])


def npz_bytes(of: Several) -> bytes:
    """Arrays by name: each pose, and its covariance."""
    buffer = io.BytesIO()
    arrays = {X.name: X.T for X in of.every}
    arrays |= {f"covariance_{X.name}": X.covariance for X in of.every if X.covariance is not None}
    np.savez(buffer, **arrays, units=np.array("m"), convention=np.array(f"covariances of {TOOLKIT} the parent"))  # type: ignore[arg-type]
    return buffer.getvalue()


_WRITERS: dict[str, Callable[[Several], str | bytes]] = {
    "json": lambda of: of.json,
    "ros": ros_text,
    "launch": launch_text,
    "urdf": urdf_text,
    "opencv": opencv_text,
    "toml": toml_text,
    "npz": npz_bytes,
}


def write_several(of: Several, path: StrPath, format: str | None = None) -> Path:
    """Write the poses as one file and return its path; ``format`` None: by the suffix.

    Raises `InputError` for another format.
    """
    target, name = format_of(path, format, tuple(_WRITERS))
    write_atomically(target, _WRITERS[name](of))
    return target
