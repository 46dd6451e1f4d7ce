"""Noise models as plain numbers, and back."""

from __future__ import annotations

from typing import Any

from .joint_covariance import JointCovariance
from .models import Noise, PairNoise, PoseNoise
from .pose_prior import PosePrior


def noise_to_dict(noise: Noise | None) -> dict[str, Any] | None:
    """Type and covariances as plain numbers."""
    return None if noise is None else noise.to_dict()


def noise_from_dict(data: dict[str, Any]) -> Noise:
    """The inverse of `noise_to_dict`."""
    prior = None if data.get("prior") is None else PosePrior.from_dict(data["prior"])
    if data["type"] == "PairNoise":
        return PairNoise(data["A"], data["B"], prior=prior)
    sides = (data[name] for name in ("robot", "camera"))
    return PoseNoise(*(JointCovariance.from_dict(S) if isinstance(S, dict) else S for S in sides), prior=prior)
