"""Conversion of a `RigCalibration` to the plain numbers, lists and text of its file, and back without loss.

The file holds the rig with all its poses, so that it can be checked, updated and reported from it. Derived numbers
(poses by name, relative poses) are written for other programs, and must agree with the rest when read.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping
from dataclasses import asdict
from typing import Any, TypeVar

import numpy as np

from ..core.files.json_values import Json, JsonObject
from ..core.files.records import attributes, parts_of, plain
from ..core.geometry.se3 import Array
from ..errors import InputError
from ..model.errors.pose_prior import PosePrior
from ..model.kinematics.chain import Kinematics
from ..model.kinematics.kinematic_errors import KinematicErrors
from ..model.rig.description import ArmPoses, Rig, View
from .rig_poses import RigPoses
from .stored_result import OF_RIG, head_of, read_result

C = TypeVar("C", bound=RigPoses)

# Parts of the file besides the fields, which follow from them.
DERIVED = "cameras targets arms relative=relative_poses"
# Sentences and verdicts for other programs, which are not read.
STATED = "headline usable answered reasons checks facts warnings"
_NAME = "rig"


def to_dict(result: RigPoses, fields: tuple[str, ...]) -> JsonObject:
    """Return the result as plain values: derived values for other programs first, then its fields."""
    found = {**head_of(OF_RIG), **attributes(result, DERIVED), **attributes(result, STATED)}
    for name in fields:
        found[name] = rig_to_dict(result.rig) if name == _NAME else plain(getattr(result, name))
    rejected = {
        "rejected": [[camera, target, moment] for camera, target, moment in result.rejected],
        "rejected_poses": [[arm, moment] for arm, moment in result.rejected_poses],
    }
    return found | rejected


def from_dict(kind: type[C], data: Any) -> C:
    """Read the values that `to_dict` writes; raises `InputError` on others, and where parts do not belong together."""

    def made(data: dict[str, Any]) -> C:
        result = kind(**parts_of(kind, data, "calibration", rig=rig_from_dict(data[_NAME])))
        _require_whole(result)
        return result

    return read_result(data, OF_RIG, DERIVED, made)


def _require_whole(result: RigPoses) -> None:
    rig = result.rig
    names = (*rig.cameras, *rig.targets, *list(rig.arms)[1:])
    sizes = {"names": result.names == names, "poses": len(result.poses) == len(names),
             "covariance": len(result.covariance) == 6 * len(names), "weights": len(result.weights) == rig.n_views,
             "pose_names": len(result.pose_names) == len(result.pose_weights)}  # fmt: skip
    if wrong := [name for name, fits in sizes.items() if not fits]:
        raise ValueError(f"{wrong[0]} is not of the cameras, targets, arms and views of the rig")
    if result.posterior is not None and result.posterior.blocks != names:
        raise ValueError("the posterior is of other poses")


# ------------------------------------------------------------------------------------------- rig


def rig_to_dict(rig: Rig) -> JsonObject:
    """Return a rig as plain values; raises `InputError` for names of poses that are neither numbers nor text."""
    found: JsonObject = {
        "arms": {
            name: {"names": _moments(arm.names), "source": arm.source, "poses": _rows(arm.poses)} | _joints(arm)
            for name, arm in rig.arms.items()
        },
        **attributes(rig, "cameras targets"),
        "views": [
            {**attributes(view, "camera target source"), "at": _moments(view.at or ()), "poses": _rows(view.poses)}
            | {name: S.tolist() for name in ("covariance", "intrinsics") if (S := getattr(view, name)) is not None}
            | ({"scene": True} if view.scene else {})
            for view in rig.views
        ],
    }
    if rig.known:
        found["known"] = {
            name: {"pose": None if prior.X is None else prior.X.tolist(), "information": prior.information_X.tolist()}
            for name, prior in rig.known.items()
        }
    return found


def rig_from_dict(data: Mapping[str, Any]) -> Rig:
    """Read the values that `rig_to_dict` writes."""
    arms = {name: _arm(arm) for name, arm in data["arms"].items()}
    views = tuple(
        View(
            view["camera"], view["target"], _poses(view["poses"]), tuple(_moments(view["at"])),
            _numbers(view, "covariance"), str(view["source"]), _numbers(view, "intrinsics"),
            bool(view.get("scene", False)),
        ) for view in data["views"]
    )  # fmt: skip
    known = {
        name: PosePrior(X=np.array(of["pose"], dtype=float), information_X=np.array(of["information"], dtype=float))
        for name, of in data.get("known", {}).items()
    }
    return Rig(arms, data["cameras"], data["targets"], views, known or None)


def _joints(arm: ArmPoses) -> JsonObject:
    if arm.kinematics is None or arm.joints is None:
        return {}
    own = {"kinematics": arm.kinematics.to_dict(), "joints": arm.joints.tolist()}
    return own | {"errors": asdict(arm.errors), "by_poses": arm.by_poses}


def _arm(data: Mapping[str, Any]) -> ArmPoses:
    chain = None if data.get("kinematics") is None else Kinematics.from_dict(data["kinematics"])
    names, source = tuple(_moments(data["names"])), str(data["source"])
    joints, poses = _numbers(data, "joints"), _poses(data["poses"])
    if chain is None:
        return ArmPoses(poses, names, source)
    errors = KinematicErrors(**data["errors"])
    return ArmPoses(poses, names, source, chain, joints, errors, bool(data["by_poses"]))


def _numbers(data: Mapping[str, Any], name: str) -> Array | None:
    return None if data.get(name) is None else np.array(data[name], dtype=float)


def _moments(names: Iterable[Hashable]) -> list[float | str]:
    found: list[float | str] = []
    for name in names:
        if isinstance(name, bool) or not isinstance(name, int | float | str):
            raise InputError(f"Expected names of robot poses to be numbers or text, got {name!r:.40}.")
        found.append(name)
    return found


def _rows(poses: Array) -> Json:
    """Upper three rows of each pose (m, 3, 4)."""
    found: Json = poses[:, :3].tolist()
    return found


def _poses(rows: Any) -> Array:
    T = np.array(rows, dtype=float).reshape(-1, 3, 4)
    return np.concatenate([T, np.broadcast_to([[[0.0, 0.0, 0.0, 1.0]]], (len(T), 1, 4))], axis=1)
