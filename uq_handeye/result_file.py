"""The parts of a `Calibration` from the plain numbers, lists and text of its file; `stored` checks what comes out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from typing import Any, NamedTuple, TypeVar

from .analysis import StoredAnalysis
from .estimators.registry import METHODS, ROBOT_WORLD_METHODS
from .goodness_of_fit import GoodnessOfFit
from .likelihood import ESTIMATORS
from .noise import Noise, PairNoise, PoseNoise, checked_covariance
from .noise_estimation import NoiseEstimate
from .pose_table import PoseTable
from .poses import SETUPS
from .provenance import Provenance
from .reference import Reference
from .request import COVARIANCES
from .residuals import Residuals
from .se3 import Array, as_transforms
from .timing import TimeOffset

T = TypeVar("T")

# Parts that are taken as they are, covariances (6, 6), and what some parts may be.
_PLAIN = ("iterations", "covariance_kind", "method", "scale", "kind", "setup", "n_poses", "n_pairs")
_COVARIANCES = ("covariance", "covariance_W", "bound")
_KNOWN = {
    "method": (*ESTIMATORS, *METHODS, *ROBOT_WORLD_METHODS),
    "covariance_kind": COVARIANCES,
    "kind": (None, "pairs", "poses", "literal"),
    "setup": (None, *SETUPS),
}


class FourDPA(NamedTuple):
    """What 4DPA alone makes of the same data."""

    X: Array  # (4, 4)
    covariance: Array | None  # (6, 6), to first order, at the same noise


def parts_of(data: dict[str, Any]) -> dict[str, Any]:
    """The arguments of `Calibration`; raises whatever comes (KeyError for parts that are missing)."""
    for name, known in _KNOWN.items():
        if data[name] not in known:
            raise ValueError(f"{name} is {data[name]!r:.40}")
    X = _pose(data, "X")
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
        "provenance": _read(data, "provenance", Provenance.from_dict),
        "time_offset": _read(data, "time_offset", TimeOffset.from_dict),
        "noise": _read(data, "noise", noise_from_dict),
        "residuals": Residuals(**data["residuals"]),
        "warnings": tuple(data["warnings"]),
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


def noise_to_dict(noise: Noise | None) -> dict[str, Any] | None:
    """Type and covariances as plain numbers."""
    if noise is None:
        return None
    parts = {field.name: getattr(noise, field.name) for field in fields(noise)}
    return {"type": type(noise).__name__} | {name: None if S is None else S.tolist() for name, S in parts.items()}


def noise_from_dict(data: dict[str, Any]) -> Noise:
    """The inverse of `noise_to_dict`."""
    if data["type"] == "PairNoise":
        return PairNoise(data["A"], data["B"])
    return PoseNoise(data["robot"], data["camera"])
