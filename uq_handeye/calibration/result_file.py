"""Conversion of a `Calibration` to the plain numbers, lists and text of its file, and back."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any, TypeVar

import numpy as np

from ..core.files.about import as_about
from ..core.files.records import parts_of
from ..core.files.source import versions
from ..core.files.tree_values import is_map
from ..core.geometry.checks import as_covariance, as_pose
from ..core.geometry.frames import SETUPS
from ..core.geometry.se3 import Array
from ..fit.graph.constraint import require_noise_fits
from ..fit.graph.gauss_helmert import ESTIMATORS
from ..fit.graph.points import OpenSizes
from ..fit.graph.posterior import Posterior
from ..fit.graph.request import COVARIANCES
from ..methods.registry import METHODS, ROBOT_WORLD_METHODS
from ..model.errors.key import ErrorKey
from ..model.errors.models import noise_from_dict
from ..model.poses.motions import Motions, relative_motions
from ..model.poses.pose_data import data_from_dict
from ..model.poses.pose_pairs import PosePairs
from ..model.shared_errors.by_poses import ColumnsByPoses
from .accuracy import Statement
from .analysis import StoredAnalysis
from .parts import PARTS
from .stored_result import OF_CAMERA, read_result

C = TypeVar("C", bound=Statement)

# Of the noise of the estimate, where it is the noise of the result.
AS_NOISE = "as noise"
# Of the poses that the errors of the posterior were bound to, where they are the data without the excluded ones.
AS_DATA = "as data"
# Parts that follow from other parts of the file.
DERIVED = "frame std correlation quaternion_xyzw=quaternion inverse covariance_inverse frame_W std_W efficiency"
# Parts that are named otherwise in the file, and what some parts may be.
_KEYS = {"fourdpa": "4dpa", "shared_at_sizes": "shared", "table": "poses", "opened": "open"}
_KNOWN = {
    "method": (*ESTIMATORS, *METHODS, *ROBOT_WORLD_METHODS),
    "covariance_kind": COVARIANCES,
    "kind": (None, "pairs", "poses", "literal"),
    "setup": (None, *SETUPS),
}


def from_dict(kind: type[C], data: Any) -> C:
    """Return the inverse of `to_dict`; raises `InputError` on anything else.

    Parts that are missing, of another type, not finite, or that do not belong to each other.
    """

    def made(data: dict[str, Any]) -> C:
        if type(data.get("usable", True)) is not bool:
            raise ValueError(f"usable is {data['usable']!r:.40}, expected true or false")
        result: C = kind(**_parts_of(data, kind))
        _require_whole(result)
        _require_usable_as_stated(data, result)
        return result

    return read_result(data, OF_CAMERA, DERIVED, made)


def _require_usable_as_stated(data: dict[str, Any], result: Statement) -> None:
    """Raise where this version would have written another answer; the rules of others may differ."""
    origin = result.provenance
    if origin is None or origin.versions != versions():
        return
    for name, found in (("usable", result.usable), ("answered", result.answered)):
        if data.get(name, found) != found:
            raise ValueError(f"{name} is {data[name]!r}, but its findings say {found!r}")


def _require_whole(result: Statement) -> None:
    """Raise where the parts are not of one data set and one fit."""
    if (fit := result.fit) is not None and not (fit.dof > 0 and np.isclose(fit.sigma0**2, fit.chi2 / fit.dof)):
        raise ValueError(f"sigma0 {fit.sigma0!r} is not that of {fit.chi2!r} with {fit.dof!r} degrees of freedom")
    if result.excluded and list(result.excluded) != sorted({k for k in result.excluded if type(k) is int and k >= 0}):
        raise ValueError(f"the excluded poses are {result.excluded!r:.60}")
    if result.data is not None:
        if isinstance(result.data, PosePairs) and result.excluded and result.excluded[-1] >= result.data.n:
            raise ValueError(f"pose {result.excluded[-1]} of {result.data.n} is excluded")
        data = result.counted
        assert data is not None
        _require_one_data_set(data, result)
    if result.W is None and (result.covariance_W is not None or (result.table and result.table.item == "pose")):
        raise ValueError("W is missing")
    if result.table is None:
        return
    of_motions = result.table.item == "motion"
    count = result.n_pairs if of_motions else result.n_poses
    if not of_motions and tuple(result.table.excluded) != result.excluded:
        raise ValueError(f"poses {result.table.excluded} are excluded in the table, not {list(result.excluded)}")
    rows = len(result.table.counted)
    sizes = {rows} if result.analysis is None else {rows, result.analysis.diagnostics.n}
    if sizes != {count}:
        raise ValueError(f"{count} {result.table.item}s, and parts that are of {sorted(sizes)}")


def _require_one_data_set(data: PosePairs | Motions, result: Statement) -> None:
    """Raise where the poses (or motions) are not as many as the result and its noise are of."""
    poses = data.poses
    match data:
        case Motions():
            if result.n_pairs != data.N:
                raise ValueError(f"{result.n_pairs} motions, and data that hold {data.N}")
            motions = data
        case PosePairs():
            motions = relative_motions(data, [[0, 1]])
    if (None if poses is None else poses.n) != result.n_poses:
        raise ValueError(f"{result.n_poses} poses, and data that hold {0 if poses is None else poses.n}")
    require_noise_fits(result.noise, motions)


def _parts_of(data: dict[str, Any], kind: type[C]) -> dict[str, Any]:
    """The arguments of `Calibration`; raises whatever comes (KeyError for parts that are missing)."""
    for name, known in _KNOWN.items():
        if data[name] not in known:
            raise ValueError(f"{name} is {data[name]!r:.40}")
    X, analysis = as_pose(data["X"], "X"), data["analysis"]
    if (data.get("posterior") or {}).get("bound") == AS_DATA:
        kept = np.delete(np.arange(len(data["data"]["robot"])), data.get("excluded", []))
        poses = [np.array(data["data"][side], dtype=float)[kept, :3].tolist() for side in ("robot", "camera")]
        data = data | {"posterior": data["posterior"] | {"bound": poses}}
    noise = None if data["noise"] is None else noise_from_dict(_whole_noise(data))
    estimate = data["noise_estimate"]
    if (once := estimate is not None and estimate.get("noise") == AS_NOISE) and noise is None:
        raise ValueError("noise is missing, which noise_estimate refers to")
    if (posterior := data.get("posterior")) is not None:  # with open sizes by the rows that it is made of
        if "open" in posterior:
            posterior = OpenSizes.from_dict(posterior, noise).posterior
        else:
            posterior = Posterior.from_dict(posterior)
    if once:
        data = data | {"noise_estimate": estimate | {"noise": None}}
    given = {
        "noise": noise,
        "analysis": None if analysis is None else StoredAnalysis.of(analysis, X),
        "about": as_about(data.get("about", {})),
        "joint_posterior": posterior,
        "bound": _covariance(data, "bound"),
        "data": None,
        "corrected": None if data.get("corrected") is None else np.array(data["corrected"], dtype=float),
    }
    data = data | {name: data.get(key) for name, key in _KEYS.items()}
    found: dict[str, Any] = {}
    for of in PARTS.values():
        read = {one.name: given[one.name] for one in fields(of) if one.name in given}
        found |= parts_of(of, data, "calibration", **read)
    found |= {"X": X, "W": None if data["W"] is None else as_pose(data["W"], "W")}
    found |= {name: _covariance(data, name) for name in ("covariance", "covariance_W")}
    found = parts_of(kind, data, "calibration", **found, **dict.fromkeys(PARTS))
    if once:
        found["noise_estimate"] = replace(found["noise_estimate"], noise=found["noise"])
    if data.get("data") is not None:
        origin = found["provenance"]
        found["data"] = data_from_dict(data["data"], data["setup"], () if origin is None else origin.sources)
    return found


def columns_of(data: dict[str, Any]) -> ColumnsByPoses | None:
    """Return the columns of shared errors that follow from the poses in a file; None where it does not hold these."""
    bound, at, shared = (data.get("posterior") or {}).get("bound"), data.get("corrected"), data.get("shared")
    if bound is None or at is None or not shared:
        return None
    first, second = (np.array(poses, dtype=float) for poses in (bound, at))
    sd = {ErrorKey.from_dict(error["key"]): float(error["size"]) for error in shared}
    reach = next((error["accuracy"][-1] for error in shared if error.get("accuracy") is not None), None)
    times = data["posterior"].get("times")
    setup = str(data["setup"])
    return ColumnsByPoses(_pairs(first, setup, times), _pairs(second, setup, times), sd, reach)


def _pairs(poses: Array, setup: str, times: Any) -> PosePairs:
    """Return pairs of poses (2, n, 3, 4)."""
    robot, camera = (np.concatenate([T, _last_row(T)], axis=1) for T in poses)
    return PosePairs(robot, camera, setup, None if times is None else np.array(times, dtype=float))


def bound_to_data(bound: tuple[Array, Array] | None, data: PosePairs | Motions | None) -> bool:
    """Return whether the poses that errors were bound to are those of the data, which the file holds."""
    return (
        bound is not None
        and isinstance(data, PosePairs)
        and np.array_equal(bound[0], data.robot)
        and np.array_equal(bound[1], data.camera)
    )


def _last_row(T: Array) -> Array:
    return np.broadcast_to([[[0.0, 0.0, 0.0, 1.0]]], (len(T), 1, 4))


def _whole_noise(data: dict[str, Any]) -> dict[str, Any]:
    """Return the noise in a file with the columns that follow from the poses."""
    noise = dict(data["noise"])
    for side, S in noise.items():
        if is_map(S) and "by_poses" in S:
            columns = columns_of(data)
            if columns is None:
                raise ValueError("the poses are missing from which the columns of its errors follow")
            noise[side] = columns.completed(S)
    return noise


def _covariance(data: dict[str, Any], name: str) -> Array | None:
    return None if data[name] is None else as_covariance(data[name], name)
