"""Origin of a result: the files, the numbers in them, the options and the versions; enough to repeat the run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, ClassVar

import numpy as np

from ..files.records import Record
from ..files.source import Source
from ..geometry.se3 import Array
from ..kinematics.chain import Kinematics
from ..kinematics.kinematic_errors import KinematicErrors
from ..noise.camera_noise import CameraNoise
from ..noise.models import Noise, PairNoise, is_joint
from ..poses.motions import Motions
from ..poses.pose_pairs import PosePairs
from ..poses.to_dict import sha256_of
from ..runtime.versions import versions
from ..shared_errors.shared_error import SharedError


@dataclass(frozen=True)
class Provenance(Record):
    """Input, options and versions of a calibration.

    ``data_sha256`` is the SHA-256 of the poses (or motions) as they were used, float64, little-endian, robot first: the
    same numbers give it whatever file they came from. ``options`` are the arguments of `calibrate`; ``command`` is the
    command line where there was one. ``request`` holds the arguments as they were given, by which the same can be asked
    of more poses (`requested`); None in files of older versions.
    """

    _if_any: ClassVar[str] = "request"

    data_sha256: str
    options: dict[str, Any]
    versions: dict[str, str]
    sources: tuple[Source, ...] = field(default=())
    command: str | None = None
    request: dict[str, Any] | None = None


def provenance(data: PosePairs | Motions, options: dict[str, Any], request: dict[str, Any]) -> Provenance:
    """Record what `calibrate` was given."""
    sides = (data.robot, data.camera) if isinstance(data, PosePairs) else (data.A, data.B)
    poses = data if isinstance(data, PosePairs) else data.poses
    sources = () if poses is None else poses.sources
    return Provenance(sha256_of(*sides), options, dict(versions()), sources, request=request)


def requested(
    noise: Noise | CameraNoise | None,
    robust: bool | None,
    shared: Sequence[SharedError] | None,
    joints: Any,
    kinematics: Kinematics | None,
    errors: KinematicErrors | None,
    at: Array | None,
    simulated: bool,
) -> dict[str, Any]:
    """Return arguments of `calibrate` as plain values, as they were given.

    ``at``: the errors of the arm about which the poses of the result stand for those measured (`linear_about`);
    ``simulated``: the poses came with their truth, for which no accuracy of the robot is assumed. Of a covariance that
    is joint over the poses only the fact is kept: it does not extend to others.
    """
    sides: dict[str, Any] | None = None
    if isinstance(noise, CameraNoise):
        sides = {"robot": None, "camera": _side(noise)}
    elif noise is not None:
        names = ("A", "B") if isinstance(noise, PairNoise) else ("robot", "camera")
        sides = {name: _side(getattr(noise, name)) for name in names}
    arm = None
    if kinematics is not None:
        arm = {
            "kinematics": kinematics.to_dict(),
            "joints": None if joints is None else np.asarray(joints, dtype=float).tolist(),
            "errors": None if errors is None else asdict(errors),
            "at": None if at is None else at.tolist(),
        }
    return {
        "noise": sides,
        "robust": None if robust is None else bool(robust),
        "shared": None if shared is None else [error.to_dict() for error in shared],
        "arm": arm,
        "simulated": simulated,
    }


def _side(S: Any) -> Any:
    if isinstance(S, CameraNoise):
        return {"views": None if S.views is None else dict(S.views), "pixel_sd": S.pixel_sd}
    if S is None:
        return None
    return "joint" if is_joint(S) else np.asarray(S).tolist()
