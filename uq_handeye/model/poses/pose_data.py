"""Conversion of poses and motions to plain numbers of a file and back without loss, and their SHA-256."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.files.json_values import Json, JsonObject
from ...core.files.records import array_of
from ...core.files.source import Source
from ...core.geometry.conventions import CovarianceReading
from ...core.geometry.se3 import Array
from ...errors import InputError
from ..errors.joint_covariance import JointCovariance
from .motions import Motions, relative_motions
from .pose_pairs import NAMES, Names, PosePairs
from .scene_facts import SceneFacts
from .timing import Timing

if TYPE_CHECKING:
    from ..camera.result import CameraCalibration


def sha256_of(*stacks: Array) -> str:
    """SHA-256 of poses as float64, little-endian."""
    digest = hashlib.sha256()
    for T in stacks:
        digest.update(np.ascontiguousarray(T, dtype="<f8").tobytes())
    return digest.hexdigest()


def data_to_dict(data: PosePairs | Motions) -> JsonObject:
    """The poses with all that is known of them; motions alone where there are no poses.

    The truth of simulated poses and the files they came from are left out.
    """
    poses, pairs = data.poses, getattr(data, "pairs", None)
    if poses is None:
        return _stacks(data, "A", "B")
    timing, seen = poses.timing, poses.camera_calibration
    return {
        **_stacks(poses, "robot", "camera"),
        **({} if poses.timestamps is None else {"timestamps": poses.timestamps.tolist()}),
        **({} if poses.joints is None else {"joints": poses.joints.tolist()}),
        **({} if timing is None else {"timing": asdict(timing) | {"rate": timing.rate.tolist()}}),
        **({} if seen is None else {"camera_calibration": _camera_to_dict(seen)}),
        **({} if poses.camera_covariance is None else {"camera_covariance": poses.camera_covariance.to_dict()}),
        **({} if poses.camera_read_as is None else {"camera_read_as": poses.camera_read_as.words}),
        **({} if poses.scene is None else {"scene": poses.scene.to_dict()}),
        **({} if poses.names == NAMES else {"names": poses.names._asdict()}),
        **({} if pairs is None else {"pairs": pairs.tolist()}),
    }


def _stacks(data: PosePairs | Motions, *names: str) -> JsonObject:
    stacks = {name: getattr(data, name) for name in names}
    return {"sha256": sha256_of(*stacks.values()), **{name: T.tolist() for name, T in stacks.items()}}


def data_from_dict(data: dict[str, Any], setup: str | None, sources: tuple[Source, ...] = ()) -> PosePairs | Motions:
    """The inverse of `data_to_dict`; raises `InputError`, `KeyError`, `TypeError` or `ValueError` on anything else."""
    sides = ("robot", "camera") if "robot" in data else ("A", "B")
    first, second = (_stack(data[name], f"data.{name}") for name in sides)
    if sha256_of(first, second) != data["sha256"]:
        raise InputError(f"data.{sides[0]} and data.{sides[1]} are not the poses that data.sha256 was made of")
    if sides == ("A", "B"):
        return Motions(first, second)
    if setup is None:
        raise InputError("Expected the setup of the poses, got none")
    n = len(first)
    timing, joints, seen = data.get("timing"), data.get("joints"), data.get("camera_calibration")
    poses = PosePairs(
        first,
        second,
        setup,
        None if data.get("timestamps") is None else array_of(data["timestamps"], (n,), "data.timestamps"),
        None,
        sources,
        None if timing is None else Timing(**(timing | {"rate": array_of(timing["rate"], (n, 6), "data.timing.rate")})),
        None if seen is None else _camera_from_dict(seen, second),
        None if joints is None else array_of(joints, (n, len(joints[0])), "data.joints"),
        None if data.get("camera_covariance") is None else JointCovariance.from_dict(data["camera_covariance"]),
        camera_read_as=(
            None if data.get("camera_read_as") is None else CovarianceReading.parse(str(data["camera_read_as"]))
        ),
        names=Names(**{name: str(value) for name, value in data.get("names", {}).items()}),
        scene=None if data.get("scene") is None else SceneFacts.from_dict(data["scene"]),
    )
    if data.get("pairs") is None:
        return poses
    pairs = array_of(data["pairs"], (len(data["pairs"]), 2), "data.pairs")
    if (pairs != np.floor(pairs)).any():
        raise InputError("Expected data.pairs to be numbers of poses")
    return relative_motions(poses, pairs.astype(np.intp))


def _stack(value: Sequence[Json], name: str) -> Array:
    return array_of(value, (len(value), 4, 4), name)


def _camera_to_dict(camera: CameraCalibration) -> JsonObject:
    from ..camera.calibration_files import camera_to_dict

    return camera_to_dict(camera)


def _camera_from_dict(data: JsonObject, poses: Array) -> CameraCalibration:
    from ..camera.stored_calibration import camera_from_dict

    return camera_from_dict(data, poses)
