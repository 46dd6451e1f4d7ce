"""Noise models in words: standard deviations per axis, in deg and mm."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...core.presentation.document import Block, Document, Paragraph, Table, document_of
from .camera_noise import CameraNoise
from .joint_covariance import JointCovariance
from .models import PairNoise, PoseNoise, is_joint, size_words

# Correlations from here on are worth a word.
_CORRELATED = 0.05


@document_of.register(PoseNoise)
def pose_noise_document(noise: PoseNoise) -> Document:
    """Return a table with a row per side, and what all poses share."""
    return _document({"robot": noise.robot, "camera": noise.camera}, "pose", noise.prior is not None)


@document_of.register(PairNoise)
def pair_noise_document(noise: PairNoise) -> Document:
    """Return a table with a row for A and one for B."""
    return _document({"A": noise.A, "B": noise.B}, "motion", noise.prior is not None)


def _document(sides: dict[str, Any], item: str, prior: bool) -> Document:
    rows = [[name, *size_words(side), _extent(side, item)] for name, side in sides.items()]
    caption = f"Noise of each {item}, 1 sigma per axis"
    table = Table(caption, ["", "rotation", "translation", "holds for"], rows, frozenset({1, 2, 3}))
    notes: list[Block] = [Paragraph(text) for name, side in sides.items() for text in _notes(name, side)]
    if prior:
        notes.append(Paragraph("A prior of X or W is part of it."))
    return [[table, *notes]]


def _notes(name: str, covariance: Any) -> list[str]:
    """Return sentences on what is not in the table."""
    found = []
    joint = covariance.joint if isinstance(covariance, CameraNoise) else covariance
    if isinstance(covariance, CameraNoise):
        found.append(f"{name}: per pixel of corner noise, which `calibrate` estimates.")
    if isinstance(joint, JointCovariance):
        names = ", ".join(dict.fromkeys(part for part in joint.names if part))
        count = joint.shared.shape[-1]
        if count:
            found.append(f"{name}: the poses share {count} errors{f' ({names})' if names else ''}.")
    elif covariance is not None and is_joint(covariance):
        found.append(f"{name}: one joint covariance of all poses.")
    elif covariance is not None and _correlation(covariance) > _CORRELATED:
        found.append(f"{name}: the components are correlated, up to {_correlation(covariance):.2f}.")
    return found


def _extent(covariance: Any, item: str) -> str:
    """Return what the numbers hold for."""
    if covariance is None or covariance.shape == (6, 6):
        return f"every {item}"
    count = covariance.shape[0] // 6 if covariance.ndim == 2 else covariance.shape[0]
    return f"{count:,} {item}s, median"


def _correlation(covariance: Any) -> float:
    S = np.asarray(covariance).reshape(-1, 6, 6)
    std = np.sqrt(np.diagonal(S, axis1=-2, axis2=-1))
    scale = np.where(std > 0, std, 1.0)
    rho = np.abs(S) / (scale[:, :, None] * scale[:, None, :]) * (1 - np.eye(6))
    return float(np.median(rho.max(axis=(1, 2))))
