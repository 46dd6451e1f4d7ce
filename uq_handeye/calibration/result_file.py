"""A `Calibration` as the plain numbers, lists and text of its file, and back.

Reading checks types, shapes, that all is finite, and that numbers which others follow from agree with them. Sentences
(``warnings``) are written for other programs and not read: the findings are.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np

from ..diagnostics.pose_table import PoseTable
from ..errors import InputError
from ..estimators.registry import METHODS, ROBOT_WORLD_METHODS
from ..files.about import as_about
from ..files.open import StrPath, as_path, opened
from ..files.validate import misfit, not_finite, unequal
from ..findings import Finding
from ..geometry.checks import as_transforms, checked_covariance
from ..geometry.conventions import CONVENTION
from ..geometry.frames import SETUPS
from ..geometry.se3 import Array
from ..likelihood.constraint import require_noise_fits
from ..likelihood.d2_distribution import Reference
from ..likelihood.gauss_helmert import ESTIMATORS
from ..likelihood.goodness_of_fit import GoodnessOfFit
from ..likelihood.open_directions import OpenDirections
from ..likelihood.rig_bundle import Agreement
from ..likelihood.shared_estimates import SharedEstimate
from ..noise.estimate import NoiseEstimate
from ..noise.models import Noise
from ..noise.to_dict import noise_from_dict
from ..poses.motions import Motions, relative_motions
from ..poses.pose_pairs import PosePairs
from ..poses.residuals import Residuals
from ..poses.timing import TimeOffset
from ..poses.to_dict import data_from_dict
from ..posterior.posterior import Posterior
from ..prediction.fitted_kinematics import FittedKinematics
from ..runtime.versions import versions
from .analysis import Analysis, StoredAnalysis
from .format_3 import FORMAT_3, converted
from .provenance import Provenance
from .request import BUNDLE, COVARIANCES


class Stored(Protocol):
    """Interface of a calibration that was read, as far as it is checked; `Calibration` lies above its file."""

    @property
    def fit(self) -> GoodnessOfFit | None: ...
    @property
    def table(self) -> PoseTable | None: ...
    @property
    def analysis(self) -> Analysis | StoredAnalysis | None: ...
    @property
    def n_poses(self) -> int | None: ...
    @property
    def n_pairs(self) -> int: ...
    @property
    def noise(self) -> Noise | None: ...
    @property
    def data(self) -> PosePairs | Motions | None: ...
    @property
    def counted(self) -> PosePairs | Motions | None: ...
    @property
    def excluded(self) -> tuple[int, ...]: ...
    @property
    def provenance(self) -> Provenance | None: ...
    @property
    def usable(self) -> Any: ...
    @property
    def answered(self) -> Any: ...
    def _derived(self) -> dict[str, Any]: ...


T = TypeVar("T")
C = TypeVar("C", bound=Stored)

FORMAT = "uq-handeye calibration 4"
UNITS = {"rotation": "rad", "translation": "m"}

# Parts that are taken as they are, covariances (6, 6), and what some parts may be.
_PLAIN = ("iterations", "covariance_kind", "method", "scale", "kind", "setup", "n_poses", "n_pairs")
_COVARIANCES = ("covariance", "covariance_W", "bound")
_KNOWN = {
    "method": (*ESTIMATORS, BUNDLE, *METHODS, *ROBOT_WORLD_METHODS),
    "covariance_kind": COVARIANCES,
    "kind": (None, "pairs", "poses", "literal"),
    "setup": (None, *SETUPS),
}


class FourDPA(NamedTuple):
    """4DPA result for the same data."""

    X: Array  # (4, 4)
    covariance: Array | None  # (6, 6), to first order, at the same noise


MAX_BYTES = 500_000_000


def parsed(path: StrPath) -> Any:
    """Return what the JSON of a file holds; raises `InputError` where it is no JSON, or larger than a result can be."""
    with opened(as_path(path), MAX_BYTES) as file:
        text = file.read()
    try:
        return json.loads(text.decode("utf-8"), parse_constant=_refuse)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path} is not JSON: {error}.") from error


def _refuse(constant: str) -> None:
    raise ValueError(f"it holds {constant}")


def from_dict(kind: type[C], data: dict[str, Any]) -> C:
    """The inverse of `to_dict`; raises `InputError` on anything else.

    Parts that are missing, of another type, not finite, or that do not belong to each other. Files of format 3 are
    read; older ones are refused.
    """
    if not isinstance(data, dict) or data.get("format") not in (FORMAT, FORMAT_3):
        found = data.get("format") if isinstance(data, dict) else data
        raise InputError(
            f"Expected a calibration written by to_json() (format {FORMAT!r} or {FORMAT_3!r}), got {found!r:.60}. "
            "Calibrate again to have one of an older format in this one."
        )
    try:
        if (where := not_finite(data, "calibration")) is not None:
            raise ValueError(f"{where} is not finite")
        _require_stated(data)
        if data["format"] == FORMAT_3:
            data = converted(data)
        parts = _parts_of(data)
        poses = parts.pop("data")  # they look after themselves
        result = kind(**parts)
        if (where := misfit(result, kind, "calibration")) is not None:
            raise TypeError(f"{where} is of the wrong type")
        result = kind(**(parts | {"data": poses}))
        _require_whole(result)
        _require_usable_as_stated(data, result)
        with np.errstate(divide="raise", over="raise", invalid="raise"):
            if (where := unequal(result._derived(), data, "calibration")) is not None:
                raise ValueError(f"{where} does not fit the rest")
    except KeyError as error:
        raise InputError(f"The calibration is damaged: {error} is missing.") from error
    except (TypeError, ValueError, AttributeError, LookupError, ArithmeticError) as error:
        raise InputError(f"The calibration is damaged: {str(error).rstrip('.')}.") from error
    return result


def _require_stated(data: dict[str, Any]) -> None:
    """Raise where units, convention or usability are not what this program writes: numbers mean nothing without."""
    for name, expected in (("convention", CONVENTION), ("units", UNITS)):
        if data[name] != expected:
            raise ValueError(f"{name} is {data[name]!r:.60}, expected {expected!r:.60}")
    if type(data.get("usable", True)) is not bool:
        raise ValueError(f"usable is {data['usable']!r:.40}, expected true or false")


def _require_usable_as_stated(data: dict[str, Any], result: Stored) -> None:
    """Raise where this version would have written another answer; the rules of others may differ."""
    origin = result.provenance
    if origin is None or origin.versions != versions():
        return
    for name, found in (("usable", result.usable), ("answered", result.answered)):
        if data.get(name, found) != found:
            raise ValueError(f"{name} is {data[name]!r}, but its findings say {found!r}")


def _require_whole(result: Stored) -> None:
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


def _require_one_data_set(data: PosePairs | Motions, result: Stored) -> None:
    """Raise where the poses (or motions) are not as many as the result and its noise are of."""
    poses = data if isinstance(data, PosePairs) else data.poses
    if isinstance(data, Motions) and result.n_pairs != data.N:
        raise ValueError(f"{result.n_pairs} motions, and data that hold {data.N}")
    if (None if poses is None else poses.n) != result.n_poses:
        raise ValueError(f"{result.n_poses} poses, and data that hold {0 if poses is None else poses.n}")
    motions = data if isinstance(data, Motions) else relative_motions(data, [[0, 1]])
    require_noise_fits(result.noise, motions)


def _parts_of(data: dict[str, Any]) -> dict[str, Any]:
    """The arguments of `Calibration`; raises whatever comes (KeyError for parts that are missing)."""
    for name, known in _KNOWN.items():
        if data[name] not in known:
            raise ValueError(f"{name} is {data[name]!r:.40}")
    X = _pose(data, "X")
    origin = _read(data, "provenance", Provenance.from_dict)
    posterior = data.get("posterior", data.get("joint_posterior"))  # by its earlier name
    poses = None
    if data.get("data") is not None:
        poses = data_from_dict(data["data"], data["setup"], () if origin is None else origin.sources)
    return {
        **{name: data[name] for name in _PLAIN},
        **{name: _covariance(data, name) for name in _COVARIANCES},
        "X": X,
        "W": None if data["W"] is None else _pose(data, "W"),
        "reference": Reference(**data["reference"]),
        "noise_estimate": _read(data, "noise_estimate", NoiseEstimate.from_dict),
        "fourdpa": _read(data, "4dpa", lambda part: FourDPA(_pose(part, "X"), _covariance(part, "covariance"))),
        "fit": _read(data, "fit", lambda part: GoodnessOfFit(**part)),
        "table": _read(data, "poses", PoseTable.from_dict),
        "analysis": _read(data, "analysis", lambda part: StoredAnalysis.from_dict(part, X)),
        "provenance": origin,
        "about": as_about(data.get("about", {})),
        "data": poses,
        "excluded": tuple(data.get("excluded", ())),
        "time_offset": _read(data, "time_offset", TimeOffset.from_dict),
        "shared": tuple(map(SharedEstimate.from_dict, data.get("shared", ()))),
        "opened": None if data.get("open") is None else OpenDirections.from_dict(data["open"]),
        "kinematics": None if data.get("kinematics") is None else FittedKinematics.from_dict(data["kinematics"]),
        "joint_posterior": None if posterior is None else Posterior.from_dict(posterior),
        "agreement": None if data.get("agreement") is None else Agreement.from_dict(data["agreement"]),
        "noise": _read(data, "noise", noise_from_dict),
        "residuals": Residuals(**data["residuals"]),
        "findings": tuple(map(Finding.from_dict, data["findings"])),
    }


def _read(data: dict[str, Any], name: str, reader: Callable[[Any], T]) -> T | None:
    return None if data[name] is None else reader(data[name])


def _pose(data: dict[str, Any], name: str) -> Array:
    pose = as_transforms(data[name], name, stack=False)
    if pose.shape != (4, 4):
        raise ValueError(f"{name} has the shape {pose.shape}")
    return pose


def _covariance(data: dict[str, Any], name: str) -> Array | None:
    if data[name] is None:
        return None
    S = checked_covariance(data[name], name, joint=False)
    if S.shape != (6, 6):
        raise ValueError(f"{name} has the shape {S.shape}")
    return S


def finite(array: Array | None) -> Any:
    """Lists with None for what is infinite; None for what is not there."""
    return None if array is None else [float(x) if np.isfinite(x) else None for x in array]


def plain(array: Array | None) -> Any:
    """Lists, or None for what is not there."""
    return None if array is None else array.tolist()
