r"""Task space: the uncertainty of a point that the camera measures, and which noise it comes from.

Model: a point p_c (3, m) in camera coordinates is expressed in another frame,

    through X      p = R_X p_c + t_X                  in the gripper frame (eye-in-hand) or base frame (eye-to-hand)
    the robot      p = G (X p_c)                      G = base_T_gripper, or gripper_T_base for eye-to-hand
    the target     p = W inv(C) p_c                   W = base_T_target, or gripper_T_target for eye-to-hand

Errors are ``xi = (theta, tau)`` of the poses (left rotation in rad, additive translation in m) and 3-vectors of the
point; those of X, of the robot pose, of the camera pose and of the point are independent of each other. To first order
a pose T with ``q = T p`` adds ``J xi`` with ``J = [-[R p]x, I]`` and turns the covariance of p by R.

*Budget.* Any estimate that is smooth in the data has the error ``xi = sum_k D_k xi_k`` over the poses k of robot and
camera, so that ``Sigma = sum over sources of D Sigma_source D^T``. Sources are the rotation and the translation of
each side; what the covariances between rotation and translation of one side add is its coupling (negative, if it
compensates). For `Fit`, ``D = -C J^T S^-1 D_side`` (`constraint`, `likelihood`). Shares of one variance sum to 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import chdtri

from ..errors import InputError
from ..geometry.se3 import Array, as_numbers, as_transforms, inverse, inverse_jacobian, skew
from ..likelihood.constraint import covariances_of
from ..likelihood.gauss_helmert import Fit
from ..noise.joint_covariance import JointCovariance
from ..noise.models import Noise, PairNoise, checked_covariance, is_joint, require_count
from ..noise.square_roots import pulled, whiten
from ..poses.pose_pairs import SETUPS

# Squared Mahalanobis distance that holds 95 % of a Gaussian in three dimensions.
_WITHIN_95 = float(chdtri(3, 0.05))


@dataclass(frozen=True, eq=False)
class PointUncertainty:
    """Points and their covariances in one frame, in metres."""

    points: Array  # (..., 3)
    covariance: Array  # (..., 3, 3)
    frame: str

    @property
    def std(self) -> Array:
        """(..., 3) standard deviations along the axes of the frame."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1)))

    @property
    def radius_95(self) -> Array:
        """(...) longest half axis of the 95 % ellipsoid: a sphere of this radius holds at least 95 %."""
        return np.asarray(np.sqrt(_WITHIN_95 * np.linalg.eigvalsh(self.covariance)[..., -1]))

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, lists and text."""
        return {
            "frame": self.frame,
            "points": self.points.tolist(),
            "covariance": self.covariance.tolist(),
            "std": self.std.tolist(),
            "radius_95": self.radius_95.tolist(),
        }


def points_covariance(X: Any, covariance: Any, points: Any) -> Array:
    """Covariances (..., 3, 3) of ``X p`` for exact points p (..., 3), from the covariance (6, 6) of X.

    Raises `InputError` for wrong shapes.
    """
    return _carried(*_pose(X, covariance, "X"), _points(points), None)[1]


def through_X(
    X: Any, covariance: Any, points: Any, *, setup: str | None = "eye-in-hand", points_covariance: Any = None
) -> PointUncertainty:
    """Points (..., 3) in camera coordinates, expressed in the parent frame of X.

    Parameters
    ----------
    X, covariance : (4, 4), (6, 6)
    points : (..., 3)
        Metres, in the camera frame.
    setup : "eye-in-hand", "eye-to-hand" or None
        Names the frame: gripper or base; None, for motions that came without poses, "parent frame of X".
    points_covariance : (3, 3), (..., 3, 3) or None
        Noise of the points themselves, in the camera frame.

    Raises
    ------
    InputError
        Wrong shapes or numbers, covariances that are not positive semidefinite, an unknown setup.
    """
    parent = "parent frame of X" if setup is None else _frames(setup)[0]
    p = _points(points)
    return PointUncertainty(*_carried(*_pose(X, covariance, "X"), p, _point_noise(points_covariance, p)), parent)


def through_robot(
    X: Any,
    covariance: Any,
    points: Any,
    robot: Any,
    *,
    robot_covariance: Any = None,
    setup: str = "eye-in-hand",
    points_covariance: Any = None,
) -> PointUncertainty:
    """Points in camera coordinates, expressed in the base frame (eye-in-hand) or gripper frame (eye-to-hand).

    Parameters as for `through_X`, and

    robot : (..., 4, 4)
        ``base_T_gripper`` (whatever the setup) when the points were seen; leading axes broadcast with the points'.
    robot_covariance : (6, 6), (..., 6, 6) or None
        Of the robot pose, independent of X; None is exact.
    """
    _, far = _frames(setup)
    near = through_X(X, covariance, points, setup=setup, points_covariance=points_covariance)
    G, S = _pose(robot, np.zeros((6, 6)) if robot_covariance is None else robot_covariance, "robot")
    if setup == "eye-to-hand":
        J = inverse_jacobian(G)
        G, S = inverse(G), J @ S @ J.mT
    return PointUncertainty(*_carried(G, S, near.points, near.covariance), far)


def through_target(
    W: Any,
    covariance_W: Any,
    points: Any,
    camera: Any,
    *,
    camera_covariance: Any = None,
    setup: str = "eye-in-hand",
    points_covariance: Any = None,
) -> PointUncertainty:
    """Points in camera coordinates, expressed through a view of the target, ``p = W inv(C) p_c``.

    Needs neither X nor the robot: the frame is the base (eye-in-hand) or the gripper (eye-to-hand). Parameters as for
    `through_X`, with W (4, 4), its covariance (6, 6), ``camera = camera_T_target`` (..., 4, 4) and its covariance.
    """
    _, far = _frames(setup)
    C, S = _pose(camera, np.zeros((6, 6)) if camera_covariance is None else camera_covariance, "camera")
    J = inverse_jacobian(C)
    p = _points(points)
    on_target = _carried(inverse(C), J @ S @ J.mT, p, _point_noise(points_covariance, p))
    return PointUncertainty(*_carried(*_pose(W, covariance_W, "W"), *on_target), far)


def _carried(T: Array, S: Array, points: Array, noise: Array | None) -> tuple[Array, Array]:
    """``T p`` and its covariance."""
    R = T[..., :3, :3]
    arm = (R @ points[..., None])[..., 0]
    J = _by_pose(arm)
    total = J @ S @ J.mT
    if noise is not None:
        total = total + R @ noise @ R.mT
    return arm + T[..., :3, 3], np.asarray(total)


def _by_pose(arm: Array) -> Array:
    """``[-[arm]x, I]`` (..., 3, 6)."""
    J = np.empty((*arm.shape, 6))
    J[..., :3] = -skew(arm)
    J[..., 3:] = np.eye(3)
    return J


def _frames(setup: str) -> tuple[str, str]:
    """Parent frame of X, and the frame at the other end of the robot."""
    if setup not in SETUPS:
        raise InputError(f"Expected `setup` to be one of {', '.join(SETUPS)}, got {setup!r}.")
    return ("gripper", "base") if setup == "eye-in-hand" else ("base", "gripper")


def _pose(T: Any, covariance: Any, name: str) -> tuple[Array, Array]:
    S = as_numbers(covariance, f"covariance of {name}")
    if S.ndim < 2 or S.shape[-2:] != (6, 6) or not np.isfinite(S).all():
        raise InputError(f"Expected the covariance of `{name}` to be finite numbers (..., 6, 6), got shape {S.shape}.")
    checked_covariance(S.reshape(-1, 6, 6), f"{name}_covariance" if name in ("robot", "camera") else name, joint=False)
    return as_transforms(T, name, stack=False), S


def _points(points: Any) -> Array:
    p = as_numbers(points, "points")
    if p.ndim < 1 or p.shape[-1] != 3 or not np.isfinite(p).all():
        raise InputError(f"Expected `points` to be finite numbers (..., 3) in metres, got shape {p.shape}.")
    return p


def _point_noise(covariance: Any, points: Array) -> Array | None:
    if covariance is None:
        return None
    S = as_numbers(covariance, "points_covariance")
    if S.shape not in ((3, 3), (*points.shape, 3)) or not np.isfinite(S).all():
        raise InputError(
            f"Expected `points_covariance` to be finite numbers (3, 3) or {(*points.shape, 3)}, got shape {S.shape}."
        )
    padded = np.zeros((S.size // 9, 6, 6))
    padded[:, 3:, 3:] = S.reshape(-1, 3, 3)
    checked_covariance(padded, "points_covariance", joint=False)
    return S


# --------------------------------------------------------------------------------------------------------- budget

# Sources of a covariance that poses share errors in (`JointCovariance`), behind the name of the side.
EACH, SHARED = "(each pose)", "(shared)"
_COMPONENTS = ("theta_x", "theta_y", "theta_z", "tau_x", "tau_y", "tau_z")


@dataclass(frozen=True, eq=False)
class Budget:
    """The covariance of an estimate as a sum over noise sources, and over the poses that the noise is on.

    p components: 6 of X, then 6 of W where there is one; or 3 of a task point.
    """

    sources: tuple[str, ...]
    covariances: Array  # (sources, p, p), in rad and m
    by_pose: Array  # (n, p, p); of a joint noise each pose gets half of what it shares with another
    X: Array  # (4, 4)

    @property
    def covariance(self) -> Array:
        """(p, p), the sum over the sources."""
        return np.asarray(self.covariances.sum(axis=0))

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the p components."""
        if len(self.covariance) == 3:
            return ("x", "y", "z")
        names = tuple(f"X {name}" for name in _COMPONENTS)
        return names if len(self.covariance) == 6 else names + tuple(f"W {name}" for name in _COMPONENTS)

    @property
    def groups(self) -> dict[str, slice]:
        """Blocks of components whose variances add: rotation and translation of X (and W), or the point."""
        p = len(self.covariance)
        if p == 3:
            return {"point": slice(0, 3)}
        return {
            f"{of} {kind}": slice(k, k + 3)
            for of, start in (("X", 0), ("W", 6))[: p // 6]
            for kind, k in (("rotation", start), ("translation", start + 3))
        }

    @property
    def shares(self) -> Array:
        """(sources, p) of the variance of each component; each column sums to 1."""
        return _shares(np.diagonal(self.covariances, axis1=1, axis2=2))

    @property
    def pose_shares(self) -> Array:
        """(n, p) of the variance of each component that comes with each pose; each column sums to 1."""
        return _shares(np.diagonal(self.by_pose, axis1=1, axis2=2))

    @property
    def group_shares(self) -> dict[str, Array]:
        """For each group the shares (sources,) of its trace."""
        variances = np.diagonal(self.covariances, axis1=1, axis2=2)
        return {name: _shares(variances[:, part].sum(axis=1)) for name, part in self.groups.items()}

    def budget_at(self, point: Any) -> Budget:
        """The budget of a point (3,) in camera coordinates (m), expressed in the parent frame of X."""
        p = _points(point)
        if p.shape != (3,) or len(self.covariance) == 3:
            raise InputError(f"Expected one `point` (3,) and the budget of X, got shape {p.shape}.")
        J = _by_pose(self.X[:3, :3] @ p)
        carried = [J @ of[:, :6, :6] @ J.T for of in (self.covariances, self.by_pose)]
        return Budget(self.sources, carried[0], carried[1], self.X)

    def merged(self, *groups: Sequence[str]) -> Budget:
        """With the sources of each group as one, such as those that the data cannot tell apart.

        Raises `InputError` for names that are no sources or that two groups share.
        """
        wanted = [name for group in groups for name in group]
        unknown = [name for name in wanted if name not in self.sources]
        if unknown or len(set(wanted)) < len(wanted):
            raise InputError(
                f"Expected the names to merge to be different sources out of {', '.join(self.sources)}, got "
                f"{', '.join(wanted)}."
            )
        names: list[str] = []
        parts: list[Array] = []
        for name, part in zip(self.sources, self.covariances, strict=True):
            group = next((group for group in groups if name in group), (name,))
            label = " + ".join(group)
            if label in names:
                parts[names.index(label)] = parts[names.index(label)] + part
            else:
                names.append(label)
                parts.append(part)
        return Budget(tuple(names), np.stack(parts), self.by_pose, self.X)

    def table(self) -> str:
        """Shares in percent, one row per source and one column per group, as text."""
        width = max(len(name) for name in ("source", *self.sources))
        shares = self.group_shares
        lines = ["  ".join([f"{'source':<{width}}", *(f"{name:>13}" for name in shares)])]
        for k, source in enumerate(self.sources):
            lines.append("  ".join([f"{source:<{width}}", *(f"{100 * part[k]:11.1f} %" for part in shares.values())]))
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, lists and text."""
        return {
            "sources": list(self.sources),
            "components": list(self.components),
            "covariances": self.covariances.tolist(),
            "shares": self.shares.tolist(),
            "pose_shares": self.pose_shares.tolist(),
            "group_shares": {name: part.tolist() for name, part in self.group_shares.items()},
        }


def budget(fit: Fit, noise: Noise, *, merged: Sequence[Sequence[str]] = ()) -> Budget:
    """The budget of X (and of W) of one fit; see `budget_of_sensitivities`.

    With robust weights it is the covariance that this noise gives the weighted estimate.
    """
    if fit.covariance.ndim != 2:
        raise InputError(f"Expected the `fit` of one problem, got leading axes {fit.covariance.shape[:-2]}.")
    J = fit.linear.J
    factor = fit.weighted_factor
    gain = -fit.covariance @ pulled(factor, whiten(factor, J)).mT  # (n, p, 6)
    first, second = (gain @ D for D in fit.linear.sides)
    return budget_of_sensitivities(first, second, noise, fit.X, merged=merged)


def budget_of_sensitivities(
    D_robot: Array | None,
    D_camera: Array | None,
    noise: Noise,
    X: Array,
    *,
    merged: Sequence[Sequence[str]] = (),
) -> Budget:
    """The budget of an estimate with the derivatives D (n, p, 6) by the errors of every pose (or motion) of each side.

    Parameters
    ----------
    D_robot, D_camera : (n, p, 6) or None
        None where that side is exact. On motions those by A and by B.
    noise : PoseNoise or PairNoise
    X : (4, 4)
        The estimate.
    merged : groups of names
        See `Budget.merged`. Sources are named "robot rotation", "robot translation", "robot coupling", and so for
        "camera"; on motions "A" and "B". A coupling that is zero is left out. Of a `JointCovariance` they are instead
        what each pose has by itself, "camera (each pose)", and what all share, "camera (shared)".

    Raises
    ------
    InputError
        Derivatives missing for a side with noise, noise of another number of poses, unknown names.
    """
    names = ("A", "B") if isinstance(noise, PairNoise) else ("robot", "camera")
    sources: list[str] = []
    parts: list[Array] = []
    by_pose: Array | float = 0.0
    for name, D, S in zip(names, (D_robot, D_camera), covariances_of(noise), strict=True):
        if S is None:
            continue
        if D is None:
            raise InputError(f"Expected derivatives for `{name}`, which has noise, got None.")
        n = len(D)
        require_count(S, n, name, "rows of the derivatives")
        if isinstance(S, JointCovariance):
            together = D @ S.shared  # of the errors that all poses share
            whole = together.sum(axis=0)
            sources += [f"{name} {EACH}", f"{name} {SHARED}"]
            parts += [_summed(D, D @ S.own), whole @ whole.T]
            of_pose = together @ whole.T
            by_pose = by_pose + D @ S.own @ D.mT + 0.5 * (of_pose + of_pose.mT)
            continue
        kinds = []
        for rows in (slice(0, 3), slice(3, 6)):
            E = np.zeros_like(D)
            E[..., rows] = D[..., rows]
            kinds.append((E, _pulled(E, S)))
        rotation, translation = (_summed(E, ES) for E, ES in kinds)
        cross = _summed(kinds[0][0], kinds[1][1])
        sources += [f"{name} rotation", f"{name} translation"]
        parts += [rotation, translation]
        if _has_coupling(S):
            sources.append(f"{name} coupling")
            parts.append(cross + cross.T)
        own = D @ (kinds[0][1] + kinds[1][1]).mT
        by_pose = by_pose + 0.5 * (own + own.mT)
    result = Budget(tuple(sources), np.stack(parts), np.asarray(by_pose), np.asarray(X, dtype=float))
    return result.merged(*merged) if merged else result


def _summed(D: Array, E: Array) -> Array:
    """``sum_k D_k E_k^T`` (p, p)."""
    left, right = (of.swapaxes(0, 1).reshape(of.shape[1], -1) for of in (D, E))
    return np.asarray(left @ right.T)


def _pulled(D: Array, S: Array) -> Array:
    """Row k of ``D S``: sum over l of ``D_l S_lk`` (n, p, 6)."""
    if not is_joint(S):
        return np.asarray(D @ S)
    n, p, _ = D.shape
    return np.asarray((D.swapaxes(0, 1).reshape(p, 6 * n) @ S).reshape(p, n, 6).swapaxes(0, 1))


def _has_coupling(S: Array) -> bool:
    if not is_joint(S):
        return bool(S[..., :3, 3:].any())
    n = len(S) // 6
    return bool(S.reshape(n, 6, n, 6)[:, :3, :, 3:].any())


def _shares(variances: Array) -> Array:
    """Of the sum over the first axis; 0 where it is 0."""
    total = variances.sum(axis=0)
    return np.asarray(variances / np.where(total > 0, total, 1.0))
