"""`ScenePoses`: camera poses from pictures of a scene, and the folder of files that holds them."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.files.atomic import write_files
from ..core.files.json_files import json_text
from ..core.files.json_values import JsonObject
from ..core.files.one_line import OF_DATA, refused
from ..core.files.open import StrPath, as_path, shown
from ..core.files.records import array_of
from ..core.files.source import Source
from ..core.geometry.se3 import Array
from ..core.presentation.document import to_text
from ..core.read_only import ReadOnlyArrays
from ..errors import InputError
from ..findings import Finding, texts
from ..formats.command_folder import arrays_in, description_in, folder_of_command
from ..formats.csv_poses import pose_text
from ..model.errors.joint_covariance import JointCovariance
from ..model.poses.pose_pairs import PosePairs
from ..model.poses.scene_facts import SceneFacts
from .lens import MODEL, NAMES
from .text import scene_document

FORMAT = "uq-handeye scene 1"
POSES, COVARIANCE, SUMMARY, POINTS, INTRINSICS = (
    "camera.csv",
    "scene_covariance.npz",
    "scene.json",
    "points.ply",
    "intrinsics.yaml",
)


@dataclass(frozen=True, eq=False)
class ScenePoses(ReadOnlyArrays):
    """Camera poses from pictures of a scene, up to its scale where the robot did not tell it; see `scene_poses`."""

    poses: Array  # (n, 4, 4) camera_T_scene
    rows: NDArray[np.int64]  # (n,) numbers of their pictures: rows of the robot poses
    covariance: JointCovariance  # of the errors (theta, tau) of all poses, left rotation and additive translation
    intrinsics: dict[str, float]  # fx, fy, cx, cy, k1, k2, p1, p2 of the model brown
    sd: dict[str, float]  # of those that were estimated
    points: Array  # (m, 3) of the scene
    findings: tuple[Finding, ...]
    facts: SceneFacts
    image_size: tuple[int, int]
    names: tuple[str, ...]  # of all pictures
    shown_in: NDArray[np.intp]  # (n,) number of points that each picture shows
    colours: NDArray[np.uint8]  # (m, 3)
    robot: Array | None = None  # (N, 4, 4) of all pictures, base_T_gripper, where it was given
    setup: str = "eye-in-hand"
    sources: tuple[Source, ...] = field(default=(), kw_only=True)

    @property
    def n(self) -> int:
        """Number of poses."""
        return len(self.poses)

    @property
    def warnings(self) -> tuple[str, ...]:
        """The findings that are more than a note, in words."""
        return texts(self.findings)

    @property
    def pairs(self) -> PosePairs:
        """Robot and camera poses with their joint covariance, for `calibrate`."""
        if self.robot is None:
            raise InputError("Expected robot poses for `pairs`: scene_poses(pictures, robot).")
        return self.paired(PosePairs(self.robot[self.rows], self.poses, self.setup))

    def paired(self, pairs: PosePairs) -> PosePairs:
        """Return pairs of these camera poses with all that is known of them."""
        findings = (*pairs.findings, *self.findings)
        return replace(pairs, camera_covariance=self.covariance, scene=self.facts, findings=findings)

    def summary(self, details: bool = False) -> str:
        """Pictures, points, lens and warnings as text; ``details``: the pictures one by one."""
        counts = zip((self.names[row] for row in self.rows), self.shown_in.tolist(), strict=True)
        document = scene_document(self.facts, self.intrinsics, self.sd, self.findings, dict(counts), details)
        return to_text(document)

    def __repr__(self) -> str:
        return f"ScenePoses({self.n} of {len(self.names)} pictures, {len(self.points):,} points)"

    def write(self, folder: StrPath) -> Path:
        """Write everything as files in a folder, all or none, which `read_scene` and `read_poses` take."""
        write_files(folder, scene_files(self))
        return as_path(folder)


def scene_files(found: ScenePoses) -> dict[str, str | bytes]:
    """Return the files of a scene by name."""
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        covariance=found.covariance.own,
        shared=found.covariance.shared,
        rows=found.rows,
        poses=found.poses,
        points=found.points,
        colours=found.colours,
        shown_in=found.shown_in,
    )
    return {
        POSES: pose_text(found.poses, found.rows),
        COVARIANCE: buffer.getvalue(),
        SUMMARY: json_text(to_dict(found)),
        POINTS: _ply(found.points, found.colours),
        INTRINSICS: intrinsics_yaml(found.intrinsics, found.image_size),
    }


def to_dict(found: ScenePoses) -> JsonObject:
    """Return all but poses and points as plain numbers and text."""
    return {
        "format": FORMAT,
        "model": MODEL.name,
        "image_size": list(found.image_size),
        "intrinsics": dict(found.intrinsics),
        "sd": dict(found.sd),
        "pictures": list(found.names),
        "rows": found.rows.tolist(),
        "facts": found.facts.to_dict(),
        "findings": [finding.to_dict() for finding in found.findings],
        "warnings": list(found.warnings),
    }


def _ply(points: Array, colours: NDArray[np.uint8]) -> bytes:
    """Return points as PLY in binary, as viewers of point clouds read it."""
    kinds = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("red", "u1"), ("green", "u1"), ("blue", "u1")]
    table = np.zeros(len(points), dtype=kinds)
    for k, (name, _) in enumerate(kinds):
        table[name] = (points if k < 3 else colours)[:, k % 3]
    of = {"<f4": "float", "u1": "uchar"}
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    lines += [f"property {of[kind]} {name}" for name, kind in kinds]
    return ("\n".join([*lines, "end_header"]) + "\n").encode() + table.tobytes()


def intrinsics_yaml(intrinsics: Mapping[str, float], image_size: tuple[int, int]) -> str:
    """Return the intrinsics as OpenCV's FileStorage writes them."""
    fx, fy, cx, cy, *k = (intrinsics[name] for name in NAMES)
    width, height = image_size

    def matrix(name: str, rows: int, columns: int, values: list[float]) -> str:
        data = ", ".join(repr(float(value)) for value in values)
        return f"{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n   data: [ {data} ]\n"

    return (
        f"%YAML:1.0\n---\nimage_width: {width}\nimage_height: {height}\n"
        + matrix("camera_matrix", 3, 3, [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0])
        + matrix("distortion_coefficients", 1, 5, [*k, 0.0])
    )


def is_scene_folder(path: Path) -> bool:
    """Return whether a folder is one of `ScenePoses.write`."""
    return path.is_dir() and (path / COVARIANCE).exists()


def read_scene(folder: StrPath) -> ScenePoses:
    """Read the scene that `ScenePoses.write` wrote, exactly.

    Raises
    ------
    InputError
        A folder that is none, lacks a file, or whose files do not belong together.
    """
    path = folder_of_command(folder, "scene", (POSES, COVARIANCE, SUMMARY))
    tree, arrays = description_in(path / SUMMARY, FORMAT), arrays_in(path / COVARIANCE)
    with refused(f"{shown(path)}: not what uq-handeye scene writes", OF_DATA):
        return _scene(tree, arrays)


def _scene(tree: Mapping[str, Any], arrays: Mapping[str, Array]) -> ScenePoses:
    n, m = len(arrays["rows"]), len(arrays["points"])
    shapes = {"covariance": (n, 6, 6), "poses": (n, 4, 4), "points": (m, 3), "rows": (n,), "shown_in": (n,)}
    taken = {key: array_of(arrays[key], shape, f"{key} of {COVARIANCE}") for key, shape in shapes.items()}
    shared = np.asarray(arrays["shared"], dtype=float)
    if shared.ndim != 3 or shared.shape[:2] != (n, 6) or list(taken["rows"]) != list(tree["rows"]):
        raise InputError(f"{COVARIANCE} and {SUMMARY} are not of the same run.")
    width, height = (int(value) for value in tree["image_size"])
    return ScenePoses(
        taken["poses"],
        taken["rows"].astype(np.int64),
        JointCovariance(taken["covariance"], shared),
        {name: float(tree["intrinsics"][name]) for name in NAMES},
        {str(name): float(value) for name, value in tree["sd"].items()},
        taken["points"],
        tuple(Finding.from_dict(one) for one in tree["findings"]),
        SceneFacts.from_dict(tree["facts"]),
        (width, height),
        tuple(map(str, tree["pictures"])),
        taken["shown_in"].astype(np.intp),
        np.asarray(arrays["colours"], dtype=np.uint8).reshape(m, 3),
    )
