r"""Relative poses of the cameras of a rig against those of another program.

With ``C_i = camera_i_T_common`` of the other program the pose of camera j in camera i is ``C_i C_j^-1``. Its difference
from that of the rig is compared with the covariance of the rig alone: most programs state none.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.special import chdtrc

from ...calibration.load import Result
from ...core.files.records import Record
from ...core.geometry.rotations import Rotation
from ...core.geometry.se3 import Array, inverse
from ...core.levels import UNUSUAL
from ...core.presentation.document import COLUMNS, Answer, Document, Paragraph, Table, document_of
from ...core.presentation.numbers import digits, probability
from ...core.presentation.shown import Shown
from ...errors import InputError
from ...read.camera_poses import CameraPoses

# Difference of the lengths from which on the unit of the other program is doubted.
MAX_SCALE_DIFFERENCE = 0.02


@dataclass(frozen=True)
class CameraComparison(Record):
    """One pair of cameras: the difference of the other program's relative pose from that of the rig."""

    _in_file: ClassVar[str] = "frame rotation translation sd p_value"

    frame: str
    rotation: float  # rad
    translation: float  # m
    sd: tuple[float, float]  # of the rig, rad and m
    p_value: float


@dataclass(frozen=True)
class CameraVerification(Record, Shown):
    """Relative poses of cameras by another program against those of a rig."""

    columns = COLUMNS
    _in_file: ClassVar[str] = "program cameras pairs scale contradicted"

    program: str
    cameras: dict[str, str]  # names in the file by those of the rig
    pairs: tuple[CameraComparison, ...]
    scale: float  # length of the rig over that of the file

    @property
    def contradicted(self) -> bool:
        """True if a pair differs at the level of 5 %, divided by their number."""
        return min(one.p_value for one in self.pairs) < UNUSUAL.probability / len(self.pairs)


def verify_cameras(rig: Result, other: CameraPoses, unit: float = 1.0) -> CameraVerification:
    """Compare the relative poses of a rig with those of another program, whose length unit is ``unit`` m.

    Cameras are matched by name; where no name is in both, and as many cameras are, in their order.
    """
    own, names = list(rig.camera_names), list(other.poses)
    match = {name: name for name in own if name in names}
    if not match and len(own) == len(names):
        match = dict(zip(own, names, strict=True))
    pairs, lengths = [], []
    for pair in rig.pairs:
        one, two = pair.frame.split("_T_")
        if one not in match or two not in match:
            continue
        T = other.poses[match[one]] @ inverse(other.poses[match[two]])
        T[:3, 3] *= unit
        lengths.append((float(np.linalg.norm(pair.pose[:3, 3])), float(np.linalg.norm(T[:3, 3]))))
        pairs.append(_compared(pair.frame, pair.pose, pair.covariance, T))
    if not pairs:
        raise InputError(
            f"No pair of cameras on one carrier is in both: the rig has {', '.join(own)}, the file of {other.program} "
            f"{', '.join(names)}. Rename the cameras of one of them."
        )
    a, b = np.array(lengths).T
    scale = float(a @ b / (b @ b)) if (b > 0).any() else 1.0
    return CameraVerification(other.program, match, tuple(pairs), scale)


def _compared(frame: str, ours: Array, covariance: Array, theirs: Array) -> CameraComparison:
    turn = Rotation.from_matrix(theirs[:3, :3] @ ours[:3, :3].T).as_rotvec()
    e = np.concatenate([turn, theirs[:3, 3] - ours[:3, 3]])
    root = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
    d2 = float(e / root @ np.linalg.pinv(covariance / np.outer(root, root), hermitian=True) @ (e / root))
    sd = tuple(float(np.sqrt(np.trace(covariance[k : k + 3, k : k + 3]))) for k in (0, 3))
    size = float(np.linalg.norm(e[:3])), float(np.linalg.norm(e[3:]))
    return CameraComparison(frame, *size, (sd[0], sd[1]), float(chdtrc(6, d2)))


@document_of.register(CameraVerification)
def camera_verification_document(found: CameraVerification) -> Document:
    """The answer, and a row for each pair."""
    n, differ = len(found.pairs), found.contradicted
    word = f"{n} relative {'pose' if n == 1 else 'poses'} of cameras by {found.program}"
    least = probability(min(one.p_value for one in found.pairs), 2)
    said = "DIFFERS" if differ else "AGREES"
    ending = "s" if n == 1 else ""
    verb = f"differ{ending} from the rig by more than its uncertainty" if differ else f"agree{ending} with the rig"
    rows = [
        [
            one.frame, digits(np.degrees(one.rotation), 2), digits(np.degrees(one.sd[0]), 2),
            digits(1e3 * one.translation, 2), digits(1e3 * one.sd[1], 2), digits(one.p_value, 2),
        ]
        for one in found.pairs
    ]  # fmt: skip
    head = ["pose", "rotation", "sd of the rig", "translation", "sd of the rig", "p"]
    notes = ["The uncertainty does not cover the error of the other program, which states none here."]
    if abs(found.scale - 1.0) > MAX_SCALE_DIFFERENCE:
        notes.append(
            f"Lengths of the rig are {digits(found.scale, 4)} times those of the file. If its unit is another one, "
            "such as the side of a square, give it: --units 25mm."
        )
    if any(one != other for one, other in found.cameras.items()):
        notes.append(f"Cameras in their order: {', '.join(f'{a} is {b}' for a, b in found.cameras.items())}.")
    return [
        [Answer(f"{said}: {word} {verb} (least {least}).", "failed" if differ else "ok")],
        [Table("Differences", head, rows, units=("", "deg", "deg", "mm", "mm", ""))],
        [Paragraph(note, hang="  ") for note in notes],
    ]
