"""Test whether the poses of an arm are so alike that the errors of its kinematics are hardly visible in them.

Poses are local where their tips lie close together next to the reach, and most joints use little of their range. X and
the errors of the arm are then known together near these poses, and next to nothing of the errors only: predictions
elsewhere are as uncertain as the errors were beforehand.
"""

from __future__ import annotations

import numpy as np

from ...core.geometry.se3 import Array
from ...findings import Finding
from ...model.kinematics.chain import Kinematics
from ...model.kinematics.gravity import spread_postures
from ...model.kinematics.kinematic_errors import EXACT
from ..estimate.estimated import Estimated
from .predict import camera_ahead

# Poses are local where no two tips are farther apart than this share of the reach, and half of the joints use less than
# this share of their ranges; it is a caution where predictions elsewhere are so many times as uncertain as there.
SPAN, RANGE = 0.5, 1 / 3
WORSE = 3.0
# Postures over the workspace, and of the calibration, at which predictions are looked at.
LOOKED_AT = 100


def local_findings(result: Estimated) -> list[Finding]:
    """One finding for local poses with joints: what they span, what they tell, how well predictions are known."""
    fitted = result.kinematics
    if fitted is None or result.posterior is None or fitted.how == EXACT or not len(fitted.kept):
        return []
    chain, q = fitted.chain, fitted.joints
    some = q[np.linspace(0, len(q) - 1, min(len(q), LOOKED_AT)).astype(int)]
    tips = chain.poses(some)[:, :3, 3]
    span = float(np.linalg.norm(tips[:, None] - tips, axis=-1).max()) / max(chain.reach, 1e-9)
    used = float(np.median(range_shares(chain, q)))
    if span >= SPAN or used >= RANGE:
        return []
    revolute = np.array([joint.is_revolute for joint in chain.joints])
    here, elsewhere = (_spread(result, at) for at in (some, spread_postures(chain.limits, revolute, LOOKED_AT)))
    told = [{"group": group, "share": share} for group, share in fitted.told().items()]
    values = {"span": span, "used": used, "told": told, "here": here, "elsewhere": elsewhere}
    return [Finding("prediction.local_joints", "caution" if elsewhere > WORSE * here else "note", values)]


def range_shares(chain: Kinematics, q: Array) -> Array:
    """(L,) what the joints (n, L) use of their ranges: a turn (2 m) where there are no limits."""
    revolute = np.array([joint.is_revolute for joint in chain.joints])
    width = np.diff(chain.limits, axis=1)[:, 0]
    full = np.where(np.isfinite(width), width, np.where(revolute, 2 * np.pi, 2.0))
    return np.asarray(np.minimum((q.max(axis=0) - q.min(axis=0)) / full, 1.0))


def _spread(result: Estimated, q: Array) -> float:
    """RMS error (m) expected of where the camera sees the target at joints (t, L)."""
    assert result.posterior is not None
    A = camera_ahead(result, q).columns[:, 3:]
    return float(np.sqrt(np.mean(np.einsum("tij,jk,tik->t", A, result.posterior.covariance, A))))
