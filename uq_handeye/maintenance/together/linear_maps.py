r"""Two estimates as linear maps of the errors of their data, and the covariance of their difference.

To first order an estimate is off by ``xi = sum_i M_i eta_i + f e``: eta_i the errors of pose i of its own, e those that
poses share, with ``M_i = -C J_i^T S^-1 D_i`` of its fit and f the sum of ``M_i F_i``. Two
estimates differ by

    xi_new - xi_old = sum_i (M_i^new - M_i^old) eta_i + (f_new - f_old) e

over the poses of both, M of a pose that one of them lacks being 0, and e only where it is one and the same error in
both; otherwise each has its own. Where all poses of the old estimate are in the new one, and their noise is the same in
both, this is ``C_old - C_new`` (J. Hausman, Econometrica 46 (1978)). Noise that was estimated differs: the errors of a
pose that both hold have the covariance of the new estimate.

Intrinsics that were estimated from the pictures are an error of their own in each, with covariances Sigma_old and
Sigma_new, and the cross-covariance ``a Sigma_new``, a the share of the old poses that the new estimate holds.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...calibration.request import BUNDLE
from ...calibration.result import Calibration
from ...evidence.state import refitted
from ...geometry.se3 import Array
from ...likelihood.gauss_helmert import ESTIMATORS, Fit, offset_sensitivity
from ...noise.camera_noise import INTRINSICS
from ...noise.joint_covariance import JointCovariance, group_of
from ...noise.models import PoseNoise, is_joint
from ...noise.square_roots import pulled, whiten
from ...poses.pose_pairs import PosePairs
from ...poses.timing import SIDES
from ...posterior.owners import CAMERA, owner_of
from ...prediction.predict import reach_stated
from ...shared_errors.accuracy import ROBOT_ACCURACY
from ...shared_errors.shared_error import VIEW, bound_again

# Errors whose numbers belong to the poses of a calibration.
OF_POSES = (ROBOT_ACCURACY, VIEW)
# Intrinsics whose columns on common poses agree so well were not estimated from the pictures again.
FIXED = 1e-6


@dataclass(frozen=True, eq=False)
class LinearMap:
    """An estimate of X and W as a linear map of the errors of its n poses."""

    result: Calibration
    poses: PosePairs
    fit: Fit
    by_side: dict[str, Array]  # (n, 12, 6) M_i
    own: dict[str, Array]  # (n, 6, 6) covariance of eta_i
    columns: dict[str, tuple[str, Array]]  # (n, 6) of each shared error: side, effect of one standard deviation
    intrinsics: Array  # (n, 6, q) those of the camera's intrinsics
    serial: dict[str, Array]  # (n, 6, k) a root of what passes on from pose to pose

    @classmethod
    def of(cls, result: Calibration) -> LinearMap | None:
        """Return the map of a fit of poses; None where the result does not hold what it is made of."""
        fit = refitted(result) if result.method in (*ESTIMATORS, BUNDLE) else None
        if fit is None or result.opened is not None or not isinstance(result.noise, PoseNoise):
            return None
        poses = result.counted
        assert isinstance(poses, PosePairs)
        factor, n = fit.weighted_factor, poses.n
        back = -fit.covariance @ pulled(factor, whiten(factor, fit.linear.J)).mT
        if fit.weights is not None:
            back = np.where((np.asarray(fit.weights) > 0)[:, None, None], back, 0.0)
        own, columns, serial, by_side = {}, {}, {}, {}
        intrinsics = np.zeros((n, 6, 0))
        for side, D in zip(SIDES, fit.linear.sides, strict=True):
            S = getattr(result.noise, side)
            by_side[side] = back @ D
            own[side], serial[side] = np.zeros((n, 6, 6)), np.zeros((n, 6, 0))
            if isinstance(S, JointCovariance):
                own[side] = np.asarray(S.own)
                of_lens = np.array([group_of(name) in ("", INTRINSICS) for name in S.names], dtype=bool)
                if side == CAMERA:
                    intrinsics = S.shared[..., of_lens]
                for k in np.flatnonzero(~of_lens):
                    columns[S.names[k]] = (side, S.shared[..., k])
            elif S is not None and is_joint(S):
                serial[side] = _root(np.asarray(S)).reshape(n, 6, -1)
            elif S is not None:
                own[side] = np.broadcast_to(S, (n, 6, 6))
        return cls(result, poses, fit, by_side, own, columns, intrinsics, serial)

    def sd_of(self, name: str) -> float:
        """Return the standard deviation of the numbers of an error; 0 where the result has none."""
        return next((error.prior_sd for error in self.result.shared if error.error == name), 0.0)

    def moved_by(self, side: str, columns: Array) -> Array:
        """(12, k) how X and W move with errors of the poses of a side, by columns (n, 6, k)."""
        return np.asarray(np.einsum("nij,njk->ik", self.by_side[side], columns))


def difference_covariance(old: LinearMap, new: LinearMap, common: list[tuple[int, int]], same: frozenset[str]) -> Array:
    """(12, 12) of (xi_X, xi_W) new minus old.

    ``common``: numbers of the poses that both hold, (new, old). ``same``: which things (`posterior.owners`) are one
    and the same; with poses in common all are.
    """
    in_new = np.array([pair[0] for pair in common], dtype=np.intp)
    in_old = np.array([pair[1] for pair in common], dtype=np.intp)
    only_old = np.setdiff1d(np.arange(old.poses.n), in_old)
    total = np.zeros((12, 12))
    for side in SIDES:
        M = new.by_side[side].copy()
        M[in_new] -= old.by_side[side][in_old]
        rest = old.by_side[side][only_old]
        total += _summed(M, new.own[side]) + _summed(rest, old.own[side][only_old])
        for maps, root in ((M, new.serial[side]), (rest, old.serial[side][only_old])):
            total += _square(np.einsum("nij,njk->ik", maps, root))
    total += _of_columns(old, new, common, same)
    total += _of_intrinsics(old, new, in_new, in_old, same)
    total += _of_prior(old.fit, new.fit)
    return total + _of_timing(old, new)


def _of_columns(old: LinearMap, new: LinearMap, common: list[tuple[int, int]], same: frozenset[str]) -> Array:
    """Errors with a name, which are one in both where they belong to the same thing.

    Those whose numbers belong to poses are compared in numbers that belong to the poses of both.
    """
    moves = {
        which: {name: of.moved_by(side, F[..., None])[:, 0] for name, (side, F) in of.columns.items()}
        for which, of in (("old", old), ("new", new))
    }
    moves = {which: dict(by_name) for which, by_name in moves.items()}
    for name, pair in _of_both(old, new).items():
        for which, by_number in zip(("old", "new"), pair, strict=True):
            moves[which] = {one: move for one, move in moves[which].items() if group_of(one) != name}
            moves[which] |= {f"{name}: {k + 1}": move for k, move in enumerate(by_number.T)}
    before, now = ({error.name: error.prior_sd for error in of.result.shared} for of in (old, new))
    total = np.zeros((12, 12))
    for name in dict.fromkeys([*moves["old"], *moves["new"]]):
        first, second = moves["old"].get(name), moves["new"].get(name)
        if first is not None and second is not None and (common or owner_of(name) in same):
            if group_of(name) not in OF_POSES:
                first = first * (now[name] / before[name] if before.get(name) and now.get(name) else 1.0)
            total += _square((second - first)[:, None])
        else:
            total += sum((_square(move[:, None]) for move in (first, second) if move is not None), np.zeros(()))
    return total


def _of_both(old: LinearMap, new: LinearMap) -> dict[str, tuple[Array, Array]]:
    """Moves (12, m) of errors whose numbers belong to poses, by name, in numbers of the poses of both."""
    found = {}
    for name in OF_POSES:
        sides = [of.sd_of(name) for of in (old, new)]
        if not any(sides):
            continue
        robot, camera = (np.concatenate([getattr(of.poses, side) for of in (old, new)]) for side in SIDES)
        reach = max((r for of in (old, new) if (r := reach_stated(of.result)) is not None), default=None)
        error = bound_again(name, PosePairs(robot, camera, old.poses.setup), reach)
        assert error is not None
        before, now = (
            sd * of.moved_by(error.side, error.at(of.poses)) for of, sd in zip((old, new), sides, strict=True)
        )
        found[name] = before, now
    return found


def _of_intrinsics(old: LinearMap, new: LinearMap, in_new: Any, in_old: Any, same: frozenset[str]) -> Array:
    """Intrinsics of the camera: fixed and the same, or estimated again from pictures that both hold in part."""
    first, second = (of.moved_by(CAMERA, of.intrinsics) for of in (old, new))
    total = _square(first) + _square(second)
    q = first.shape[1]
    if q == 0 or second.shape[1] != q:
        return total
    if not len(in_new):
        if CAMERA in same:
            cross = first @ second.T
            return np.asarray(total - cross - cross.T)
        return total
    F_old, F_new = (of[rows].reshape(-1, q) for of, rows in ((old.intrinsics, in_old), (new.intrinsics, in_new)))
    turn = np.linalg.lstsq(F_old, F_new, rcond=None)[0]  # of units: k = L_old z_old = L_new z_new
    share = 1.0 if np.abs(turn - np.eye(q)).max() < FIXED else len(in_old) / old.poses.n
    cross = share * first @ turn @ second.T
    return np.asarray(total - cross - cross.T)


def _of_prior(old: Fit, new: Fit) -> Array:
    """Prior knowledge of X and W: one measurement where both have the same."""
    parts = [{} if fit.prior is None else fit.prior.to_dict() for fit in (old, new)]
    gains = [_gain_of_prior(fit) for fit in (old, new)]
    if parts[0] == parts[1]:
        return _square(gains[1] - gains[0])
    return np.asarray(_square(gains[0]) + _square(gains[1]))


def _gain_of_prior(fit: Fit) -> Array:
    if fit.prior is None:
        return np.zeros((12, 12))
    return np.asarray(fit.covariance @ _root(fit.prior.information(12)))


def _of_timing(old: LinearMap, new: LinearMap) -> Array:
    """The clock offset of interpolated poses, one where it is the same number."""
    timings = [of.poses.timing for of in (old, new)]
    moves = [
        np.zeros((12, 1)) if timing is None else timing.std * offset_sensitivity(of.fit, timing)[:, None]
        for of, timing in zip((old, new), timings, strict=True)
    ]
    one = [None if timing is None else (timing.offset, timing.std, timing.side) for timing in timings]
    if one[0] == one[1]:
        return _square(moves[1] - moves[0])
    return np.asarray(_square(moves[0]) + _square(moves[1]))


def _summed(M: Array, own: Array) -> Array:
    return np.asarray(np.einsum("nij,njk,nlk->il", M, own, M))


def _square(moves: Array) -> Array:
    return np.asarray(moves @ moves.T)


def _root(S: Array) -> Array:
    values, vectors = np.linalg.eigh(S)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
