r"""Miss distance of the tool at a point that the camera sees, over the workspace and near the calibrated poses.

Postures q are drawn over the joint limits (an infinite limit of a revolute joint is half a turn to each side, one of a
prismatic joint the end of its calibrated range, widened by half), and those of the calibration are taken as they are.
Eye-in-hand, the camera sees a point straight ahead of it at a distance, at q; joints q' at which the origin of the
flange is at the point are found from q by damped least squares, within the limits. Postures from which none are
found are left out. Eye-to-hand, the flange is at q and the point there. The covariance is that of `predict`, tool
against point, with the noise of joints and robot at both.

*Nominal poses.* A user who keeps ``FK(q; 0)`` for both has the mean error ``miss(FK(.; e)) - miss(FK(.; 0))`` in
addition, with e as estimated.

*Local poses* are so alike that errors of the kinematics are hardly visible in them: their tips lie close together next
to the reach, and most joints use little of their range. X and the errors of the arm are then determined together near
these poses, and the errors by themselves hardly at all: predictions elsewhere are as uncertain as the prior of the
errors.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...core.geometry.se3 import Array
from ...core.read_only import ReadOnlyArrays
from ...findings import Finding
from ...fit.diagnostics.task_space import PointUncertainty
from ...model.errors.models import is_joint
from ...model.kinematics.chain import Kinematics
from ...model.kinematics.kinematic_errors import EXACT
from ..analysis import FittedKinematics
from ..estimated import Estimated
from .predict import predict_camera, robot_ahead, seen_at, tip_at

# Largest damping of the search for a posture that reaches the point.
DAMPING_M = 0.02
# The tool has reached the point where it is nearer than this.
ARRIVED_M = 1e-4
# The workspace is described where at least this many of its postures reach the point.
MIN_POSTURES = 30
# Poses can only be local where no two tips are farther apart than this share of the reach.
LOCAL_SPAN = 0.5
# Poses are local if, in addition, half of the joints use less than this share of their ranges.
LOCAL_RANGE = 1 / 3
# The finding is a caution where predictions over the workspace are this many times as uncertain as near the poses.
MAX_GROWTH_ELSEWHERE = 3.0


@dataclass(frozen=True, eq=False)
class WorkspacePrediction(ReadOnlyArrays):
    """Misses of the tool at m postures of the workspace, and at k of the calibration; see the module."""

    distance: float  # m, from the camera to the point (eye-in-hand)
    place: Array  # (m, 2) m: distance of the flange from the vertical through joint 1, height above the base
    radius_95: Array  # (m,) m: a sphere of it holds the miss with at least 95 %
    bias: Array  # (m,) m: mean error with nominal poses, which is not in the radius
    away: Array  # (m,) m: of the flange from the nearest calibrated pose
    near_place: Array  # (n, 2) of the calibrated poses
    near_radius_95: Array  # (k,) of those from which the tool reaches the point
    near_bias: Array  # (k,)
    anywhere: float  # m: 95 % of the misses are below, over all postures of the workspace
    near: float | None  # m: over those of the calibration; None: the tool reaches the point from none of them

    @property
    def nominal(self) -> float:
        """Mean error with nominal poses over the workspace, RMS, m."""
        return float(np.sqrt(np.mean(self.bias**2)))


def over_workspace(result: Estimated, distance: float, postures: int = 1500) -> WorkspacePrediction | None:
    """Misses over the workspace with the point ``distance`` (m) from the camera, at most half the reach.

    None where the calibration has no joints or no errors of them, where the noise of the robot poses is joint over all
    of them and does not extend to a new one, or where the tool reaches hardly any point.
    """
    fitted = result.kinematics
    if fitted is None or result.posterior is None or result.W is None:
        return None
    of_robot = getattr(result.noise, "robot", None)
    if of_robot is not None and is_joint(getattr(of_robot, "own", of_robot)):
        return None
    distance = min(distance, 0.5 * fitted.chain.reach)
    rng = np.random.default_rng(0)
    low, high = ends(fitted)
    everywhere = rng.uniform(low, high, (postures, len(low)))
    some = np.unique(np.linspace(0, len(fitted.joints) - 1, 200).round().astype(int))
    near = np.clip(fitted.joints[some], low, high)
    far, close = (_Views.of(result, fitted, distance, q) for q in (everywhere, near))
    if len(far.radius_95) < MIN_POSTURES:
        return None
    chain = fitted.chain
    calibrated = fitted.at(fitted.joints)[:, :3, 3]
    away = np.array([np.sqrt(((calibrated - at) ** 2).sum(axis=-1).min()) for at in far.flange])
    return WorkspacePrediction(
        float(distance), _section(chain, far.flange), far.radius_95, far.bias, away, _section(chain, calibrated),
        close.radius_95, close.bias, far.pooled, close.pooled if len(close.radius_95) else None,
    )  # fmt: skip


def ends(fitted: FittedKinematics) -> tuple[Array, Array]:
    """(L,) the ranges over which postures are drawn."""
    low, high = fitted.chain.limits.T
    least, most = fitted.joints.min(axis=0), fitted.joints.max(axis=0)
    more = 0.5 * (most - least)
    turns = fitted.chain.revolute
    low = np.where(np.isfinite(low), low, np.where(turns, -np.pi, least - more))
    high = np.where(np.isfinite(high), high, np.where(turns, np.pi, most + more))
    return np.asarray(low), np.asarray(high)


class _Views(NamedTuple):
    """Postures from which the tool reaches what the camera sees."""

    flange: Array  # (n, 3)
    radius_95: Array  # (n,)
    pooled: float
    bias: Array  # (n,)

    @classmethod
    def of(cls, result: Estimated, fitted: FittedKinematics, distance: float, q: Array) -> _Views:
        """Return them for the postures among q that are possible."""
        chain, X = fitted.chain, result.X
        zero = np.zeros(3)
        if result.setup == "eye-to-hand":
            there = q
            ahead, reached = None, robot_ahead(result, q, chain.poses(q))
            points = (reached.poses[:, :3, 3] - X[:3, 3]) @ X[:3, :3]
        else:
            points = np.array([0.0, 0.0, distance])
            goal = _carried(fitted.at(q), X[:3, :3] @ points + X[:3, 3])
            there, arrived = brought_to(fitted, q, goal)
            q, there = q[arrived], there[arrived]
            ahead, reached = (robot_ahead(result, at, chain.poses(at)) for at in (q, there))
        flange = fitted.at(q)[:, :3, 3]
        found = tip_at(reached, zero).less(seen_at(result, points, ahead))
        S = found.covariance(result)
        radius_95 = PointUncertainty(found.at, S, "base", tails=result.tails).radius_95
        values = np.linalg.eigvalsh(S)  # lengths do not ask for directions
        drawn = np.random.default_rng(1).normal(size=(100, len(S), 3)) * np.sqrt(np.maximum(values, 0.0))
        pooled = float(np.sqrt(np.quantile((drawn**2).sum(axis=-1), 0.95))) if len(S) else 0.0
        moved = fitted.at(there)[:, :3, 3] - chain.poses(there)[:, :3, 3]
        if ahead is not None:
            in_flange = X[:3, :3] @ points + X[:3, 3]
            moved = moved - (_carried(fitted.at(q), in_flange) - _carried(chain.poses(q), in_flange))
        return cls(flange, radius_95, pooled, np.linalg.norm(moved, axis=-1))


def _carried(T: Array, p: Array) -> Array:
    return np.asarray((T[..., :3, :3] @ p[..., None])[..., 0] + T[..., :3, 3])


def brought_to(fitted: FittedKinematics, q: Array, goal: Array) -> tuple[Array, Array]:
    """Joints near q (m, L), within their ends, at which the origin of the flange is at ``goal`` (m, 3); and where."""
    low, high = ends(fitted)
    q = q.copy()
    off = goal - fitted.at(q)[:, :3, 3]
    for _ in range(25):
        left = np.flatnonzero((off**2).sum(axis=-1) > ARRIVED_M**2)
        if not len(left):
            break
        J = fitted.chain.jacobian(q[left], fitted.e)[:, 3:]
        # Joints at an end that would go beyond it stay there.
        step = _damped(J, off[left])
        stuck = ((q[left] <= low) & (step < 0)) | ((q[left] >= high) & (step > 0))
        step = _damped(np.where(stuck[:, None], 0.0, J), off[left])
        largest = np.abs(step).max(axis=-1, keepdims=True)
        q[left] = np.clip(q[left] + step / np.maximum(1.0, 2.0 * largest), low, high)
        off[left] = goal[left] - fitted.at(q[left])[:, :3, 3]
    return q, (off**2).sum(axis=-1) <= ARRIVED_M**2


def _damped(J: Array, off: Array) -> Array:
    """(m, L) ``J^T (J J^T + damping^2 I)^-1 off``, with less damping near the goal."""
    damping = np.minimum(DAMPING_M**2, (off**2).sum(axis=-1))[:, None, None] + 1e-9
    return np.asarray((J.mT @ np.linalg.solve(J @ J.mT + damping * np.eye(3), off[..., None]))[..., 0])


def _section(chain: Kinematics, at: Array) -> Array:
    """(m, 2) distance from the vertical through joint 1, and height above the base."""
    up = chain.up
    origin = chain.joints[0].origin[:3, 3]
    height = at @ up
    across = at - origin
    across = across - (across @ up)[:, None] * up
    return np.stack([np.linalg.norm(across, axis=-1), height], axis=-1)


def local_findings(result: Estimated) -> list[Finding]:
    """Return one finding for local poses with joints: their span, the errors resolved, and the accuracy elsewhere."""
    fitted = result.kinematics
    if fitted is None or result.posterior is None or fitted.how == EXACT or not len(fitted.kept):
        return []
    chain, q = fitted.chain, fitted.joints
    some = q[np.linspace(0, len(q) - 1, min(len(q), 100)).astype(int)]
    tips = chain.poses(some)[:, :3, 3]
    span = float(np.linalg.norm(tips[:, None] - tips, axis=-1).max()) / max(chain.reach, 1e-9)
    used = float(np.median(range_shares(chain, q)))
    if span >= LOCAL_SPAN or used >= LOCAL_RANGE:
        return []
    here, elsewhere = (_spread(result, at) for at in (some, chain.spread(100)))
    told = [{"group": group, "share": share} for group, share in fitted.told().items()]
    values = {"span": span, "used": used, "told": told, "here": here, "elsewhere": elsewhere}
    return [
        Finding("prediction.local_joints", "caution" if elsewhere > MAX_GROWTH_ELSEWHERE * here else "note", values)
    ]


def range_shares(chain: Kinematics, q: Array) -> Array:
    """(L,) shares of their ranges that the joints (n, L) use; without limits the range is one revolution, or 2 m."""
    width = np.diff(chain.limits, axis=1)[:, 0]
    full = np.where(np.isfinite(width), width, np.where(chain.revolute, 2 * np.pi, 2.0))
    return np.asarray(np.minimum((q.max(axis=0) - q.min(axis=0)) / full, 1.0))


def _spread(result: Estimated, q: Array) -> float:
    """RMS error (m) expected of where the camera sees the target at joints (t, L)."""
    S = predict_camera(result, q, new_measurement=False).covariance[:, 3:, 3:]
    return float(np.sqrt(np.trace(S, axis1=1, axis2=2).mean()))
