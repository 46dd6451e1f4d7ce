"""Noise models as plain numbers, and back."""

from __future__ import annotations

from typing import Any

from ..geometry.se3 import Array
from .joint_covariance import JointCovariance
from .models import Noise, PairNoise, PoseNoise
from .pose_prior import PosePrior


def noise_to_dict(noise: Noise | None) -> dict[str, Any] | None:
    """Type and covariances as plain numbers."""
    if noise is None:
        return None
    sides = ("A", "B") if isinstance(noise, PairNoise) else ("robot", "camera")
    parts = {name: _covariance_to_dict(getattr(noise, name)) for name in sides}
    prior = {} if noise.prior is None else {"prior": noise.prior.to_dict()}
    return {"type": type(noise).__name__, **parts, **prior}


def noise_from_dict(data: dict[str, Any]) -> Noise:
    """The inverse of `noise_to_dict`."""
    prior = None if data.get("prior") is None else PosePrior.from_dict(data["prior"])
    if data["type"] == "PairNoise":
        return PairNoise(data["A"], data["B"], prior=prior)
    return PoseNoise(*(_covariance_from_dict(data[name]) for name in ("robot", "camera")), prior=prior)


def _covariance_to_dict(S: Array | JointCovariance | None) -> Any:
    if isinstance(S, JointCovariance):
        return S.to_dict()
    return None if S is None else S.tolist()


def _covariance_from_dict(data: Any) -> Any:
    return JointCovariance.from_dict(data) if isinstance(data, dict) else data
