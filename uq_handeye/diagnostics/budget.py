"""Which noise source the variance of a point, or of X, comes from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InputError
from ..geometry.se3 import Array
from ..likelihood.constraint import covariances_of
from ..likelihood.gauss_helmert import Fit
from ..noise.camera_noise import INTRINSICS
from ..noise.joint_covariance import JointCovariance
from ..noise.models import Noise, PairNoise, is_joint, require_count
from ..noise.square_roots import pulled, whiten
from ..runtime.read_only import ReadOnlyArrays
from .task_space import _by_pose, _points

# Sources of a covariance that poses share errors in (`JointCovariance`), behind the name of the side.
EACH, SHARED, IN_TIME = "(each pose)", "(shared)", "(correlated in time)"


_COMPONENTS = ("theta_x", "theta_y", "theta_z", "tau_x", "tau_y", "tau_z")


@dataclass(frozen=True, eq=False)
class Budget(ReadOnlyArrays):
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

    def plus(self, name: str, covariance: Array) -> Budget:
        """With the covariance (p, p) of one more source, or more of one that is there; each pose gets its n-th part."""
        by_pose = self.by_pose + covariance / max(len(self.by_pose), 1)
        if name in self.sources:
            k = self.sources.index(name)
            parts = np.concatenate(
                [self.covariances[:k], [self.covariances[k] + covariance], self.covariances[k + 1 :]]
            )
            return Budget(self.sources, parts, by_pose, self.X)
        return Budget((*self.sources, name), np.concatenate([self.covariances, [covariance]]), by_pose, self.X)

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


def budget(
    fit: Fit,
    noise: Noise,
    *,
    merged: Sequence[Sequence[str]] = (),
    beside: Mapping[str, Array] | None = None,
) -> Budget:
    """The budget of X (and of W) of one fit; see `budget_of_sensitivities`.

    With robust weights it is the covariance that this noise gives the weighted estimate. ``beside`` are moves (p,) of X
    and W by one standard deviation of errors that the noise does not hold, by name.
    """
    if fit.covariance.ndim != 2:
        raise InputError(f"Expected the `fit` of one problem, got leading axes {fit.covariance.shape[:-2]}.")
    J = fit.linear.J
    factor = fit.weighted_factor
    gain = -fit.covariance @ pulled(factor, whiten(factor, J)).mT  # (n, p, 6)
    first, second = (gain @ D for D in fit.linear.sides)
    found = budget_of_sensitivities(first, second, noise, fit.X, merged=merged)
    for name, move in (beside or {}).items():
        found = found.plus(name, np.outer(move, move))
    return found


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
        what each pose has by itself, "camera (each pose)", the shared errors by name, "camera (shared)", and what
        passes on from pose to pose.

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
            if all(S.names) and INTRINSICS not in S.names:  # declared errors beside a noise of its own
                own_names, own_parts = _by_kind(name, D, S.own)
                sources += own_names
                parts += own_parts
            else:
                sources.append(f"{name} {EACH}")
                parts.append(_summed(D, D @ S.own))
            for label in dict.fromkeys(S.names):  # the columns of each error that has a name, and the others
                of_error = whole[:, [known == label for known in S.names]]
                sources.append(label or f"{name} {SHARED}")
                parts.append(of_error @ of_error.T)
            of_pose = together @ whole.T
            by_pose = by_pose + D @ S.own @ D.mT + 0.5 * (of_pose + of_pose.mT)
            if S.serial is not None:
                passed_on = S.serial.times(D.swapaxes(0, 1).reshape(D.shape[1], 6 * n).T).reshape(n, 6, -1)
                sources.append(S.serial.name or f"{name} {IN_TIME}")
                parts.append(_summed(D, passed_on.mT))
                of_pose = D @ passed_on
                by_pose = by_pose + 0.5 * (of_pose + of_pose.mT)
            continue
        names_of, parts_of = _by_kind(name, D, S)
        sources += names_of
        parts += parts_of
        own = D @ _pulled(D, S).mT
        by_pose = by_pose + 0.5 * (own + own.mT)
    result = Budget(tuple(sources), np.stack(parts), np.asarray(by_pose), np.asarray(X, dtype=float))
    return result.merged(*merged) if merged else result


def _by_kind(name: str, D: Array, S: Any) -> tuple[list[str], list[Array]]:
    """Sources and covariances of rotation, translation and, where there is one, their coupling."""
    halves = []
    for rows in (slice(0, 3), slice(3, 6)):
        E = np.zeros_like(D)
        E[..., rows] = D[..., rows]
        halves.append(E)
    turn, shift = halves
    of_shift = _pulled(shift, S)
    sources, parts = (
        [f"{name} rotation", f"{name} translation"],
        [_summed(turn, _pulled(turn, S)), _summed(shift, of_shift)],
    )
    if _has_coupling(S):
        cross = _summed(turn, of_shift)
        sources.append(f"{name} coupling")
        parts.append(cross + cross.T)
    return sources, parts


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
