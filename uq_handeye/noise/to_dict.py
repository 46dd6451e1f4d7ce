"""Noise models as plain numbers, and back."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from ..geometry.se3 import Array
from .joint_covariance import JointCovariance
from .models import Noise, PairNoise, PoseNoise


def noise_to_dict(noise: Noise | None) -> dict[str, Any] | None:
    """Type and covariances as plain numbers."""
    if noise is None:
        return None
    parts = {field.name: getattr(noise, field.name) for field in fields(noise)}
    return {"type": type(noise).__name__} | {name: _covariance_to_dict(S) for name, S in parts.items()}


def noise_from_dict(data: dict[str, Any]) -> Noise:
    """The inverse of `noise_to_dict`."""
    if data["type"] == "PairNoise":
        return PairNoise(data["A"], data["B"])
    return PoseNoise(*(_covariance_from_dict(data[name]) for name in ("robot", "camera")))


def _covariance_to_dict(S: Array | JointCovariance | None) -> Any:
    if isinstance(S, JointCovariance):
        return S.to_dict()
    return None if S is None else S.tolist()


def _covariance_from_dict(data: Any) -> Any:
    return JointCovariance.from_dict(data) if isinstance(data, dict) else data
