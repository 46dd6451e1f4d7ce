r"""First-order covariance of 4DPA's X, in closed form: per pair (T3), pose-aware (T4), literal (45).

Model: the data carry Gaussian errors ``xi = (theta, tau)`` (left rotation, additive translation, rad and m);
X carries ``xi_X`` in the same convention, in the frame of ``A`` (gripper for eye-in-hand). To first order
``xi_X = -sum_i D_i xi_i`` with ``D_i = dX / d(data of pair i)``, so that for independent pairs

    Sigma_X = sum_i D_i Sigma_i D_i^T                                                           (T3)

and for noise on poses, which pairs share, the derivatives are first summed over the pairs of each pose:

    D_k = sum over pairs p that use pose k of D_p (d xi_p / d xi_k),   Sigma_X = sum_k D_k Sigma_k D_k^T   (T4)

Both hold for the limit ``scale=None`` and for the paper's route at finite d, (39)-(48) and (53)-(59). The
literal form of (45) lets all pairs carry the *same* noise and averages the derivative,
``D = sum_i D_i / N``, ``Sigma = D Sigma_b D^T``; for independent noise it is far too small and is kept so that
this can be shown.

The derivatives of the limit (T2). With B carried into the frame of A by X (``R_B' = R R_B R^T``,
``t_B' = R t_B``), ``u, w`` of A and ``p = R v, q = R z`` of B, the estimate solves

    f = sum u x p = 0,     h = sum( u x (t x p) + w x p + u x q ) = 0

and ``df = M theta_X + sum f_i xi_i``, ``dh = M tau_X + h_theta theta_X + sum h_i xi_i`` vanish. With the raw
derivatives ``F_i = [f_i; h_i]``, 6x12,

    Sigma_X = Q (sum F_i Sigma_i F_i^T) Q^T,    Q = [[-M^-1, 0], [M^-1 h_theta M^-1, -M^-1]]
"""

from __future__ import annotations

from typing import Any, NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray

from . import _closed_form
from .errors import DegenerateMotionError, InputError
from .motions import Motions
from .noise import Noise, PairNoise, PoseNoise, factor, is_joint, marginals, require_count
from .procrustes import (
    AXIAL,
    DEGENERATE,
    NO_ROTATION,
    Scaled,
    as_pairs,
    octonion,
    pair_blocks,
    solve_limit,
    solve_scaled,
    trial_blocks,
)
from .se3 import Array, as_transforms, block, entry_rows, inverse, skew, vee

# The scaling factor of the paper's experiments, used where a formula exists at finite d only.
PAPER_SCALE = 1e4
# Pairs whose derivatives are held at once: about 2 kB each.
BLOCK = 4096

_EYE = np.eye(3)


def propagate(
    A: Any,
    B: Any = None,
    noise: Noise | None = None,
    *,
    X: Any = None,
    scale: float | None = None,
    kind: str | None = None,
) -> Array:
    """The 6x6 covariance of 4DPA's X to first order.

    Parameters
    ----------
    A, B : (..., N, 4, 4), or one `Motions` in place of both
    noise : PairNoise or PoseNoise
        PoseNoise needs `Motions` that were made from poses.
    X : (..., 4, 4) or None
        The estimate at which to linearise; None solves for it.
    scale : float or None
        As in `solve`.
    kind : "pairs", "poses", "literal" or None
        ``pairs`` takes the pairs as independent (T3), ``poses`` keeps what pairs share (T4), ``literal`` is
        (45) as printed. None takes ``pairs`` for PairNoise and ``poses`` for PoseNoise.

    Returns
    -------
    (..., 6, 6) covariance of ``xi = (theta, tau)``: left rotation in rad, additive translation.

    Raises
    ------
    InputError
        Shapes that do not fit, a noise model that does not fit the motions.
    DegenerateMotionError
        The motions do not determine X: its variance is infinite along the directions named.

    Examples
    --------
    >>> import numpy as np, uq_handeye as uq
    >>> noise = uq.PoseNoise.isotropic(camera=("1mrad", "1mm"))
    >>> motions = uq.relative_motions(uq.simulate(n_poses=20, noise=noise, seed=1), "all")
    >>> covariance = uq.propagate(motions, noise)
    >>> np.round(np.sqrt(np.diag(covariance)) * 1e3, 2)  # mrad, mm
    array([0.25, 0.28, 0.32, 0.33, 0.38, 0.38])
    """
    motions = A if isinstance(A, Motions) else None
    if motions is not None:
        if isinstance(B, PairNoise | PoseNoise) and noise is None:
            noise, B = B, None
        if B is not None:
            raise InputError("Expected no `B` beside Motions, which hold both A and B.")
        A, B = motions.A, motions.B
    if not isinstance(noise, PairNoise | PoseNoise):
        raise InputError(f"Expected `noise` to be PairNoise or PoseNoise, got {type(noise).__name__}.")
    A, B = as_pairs(A, B)
    kind = _checked_kind(kind, noise, motions, A.shape[-3])
    batch, N = A.shape[:-3], A.shape[-3]
    A, B = A.reshape(-1, N, 4, 4), B.reshape(-1, N, 4, 4)
    if X is not None:
        X = np.broadcast_to(as_transforms(X, "X", stack=False), (*batch, 4, 4)).reshape(-1, 4, 4)
    if kind == "literal":
        return _literal(A, B, noise, X, scale or PAPER_SCALE).reshape(*batch, 6, 6)
    solution = None if scale is None else _linearised(solve_scaled(A, B, scale), X, scale)
    if solution is None and X is None:
        X = solve_limit(A, B)
    covariance = np.empty((len(A), 6, 6))
    for trials in trial_blocks(len(A), N, BLOCK):
        derivatives: _LimitDerivatives | _ScaledDerivatives
        derivatives = _LimitDerivatives(X[trials]) if solution is None else _ScaledDerivatives(*(part[trials] for part in solution), scale)
        total: _Independent | _Shared | _Unshared
        if isinstance(noise, PairNoise):
            total = _Independent(noise)
        else:
            total = (_Shared if kind == "poses" else _Unshared)(motions, noise, trials)
        for pairs in pair_blocks(N, BLOCK):
            total.add(derivatives.block(A[trials, pairs], B[trials, pairs]), pairs)
        Q = derivatives.weight(N)
        covariance[trials] = Q @ total.covariance() @ Q.mT
    return (0.5 * (covariance + covariance.mT)).reshape(*batch, 6, 6)


def _checked_kind(kind: str | None, noise: Noise, motions: Motions | None, N: int) -> str:
    if isinstance(noise, PoseNoise):
        poses = None if motions is None else motions.poses
        if poses is None:
            raise InputError(
                "PoseNoise needs Motions that were made from poses (relative_motions); for motions without poses "
                "use PairNoise."
            )
        require_count(noise.robot, poses.n, "robot", "poses")
        require_count(noise.camera, poses.n, "camera", "poses")
    else:
        require_count(noise.A, N, "A", "motions")
        require_count(noise.B, N, "B", "motions")
    default, allowed = ("poses", ("poses", "pairs")) if isinstance(noise, PoseNoise) else ("pairs", ("pairs", "literal"))
    if kind is not None and kind not in allowed:
        raise InputError(f"Expected `kind` with {type(noise).__name__} to be one of {allowed}, got {kind!r}.")
    return kind or default


# ---------------------------------------------------------------- derivatives of X by the data, block by block
#
# Each gives F (2, 6, 6, T, m): for robot and camera the derivatives of something by the error of the motion, pairs
# last, where NumPy is fastest, and in the end the matrix Q that turns a covariance of the sum of that something into Sigma_X.


class _LimitDerivatives:
    """Raw derivatives of f and h (T2) for X (T, 4, 4)."""

    def __init__(self, X: Array) -> None:
        self.R, self.t = X[:, :3, :3], X[:, :3, 3]
        self.G = np.zeros((len(X), 3, 3))  # sum u p^T
        self.h_theta = np.zeros((len(X), 3, 3))

    def block(self, A: Array, B: Array) -> Array:
        T, m = A.shape[:2]
        entries = entry_rows(A.reshape(-1, 4, 4), B.reshape(-1, 4, 4)).reshape(4, 4, 2, T, m)
        R, t = entries[:3, :3], entries[:3, 3]
        # B in the frame of A: R_B' = R_X R_B R_X^T, t_B' = R_X t_B
        turned = np.einsum("tij,jktm->iktm", self.R, R[:, :, 1])
        np.einsum("tkj,ijtm->iktm", self.R, turned, out=R[:, :, 1])
        t[:, 1] = np.einsum("tij,jtm->itm", self.R, t[:, 1])
        u = np.stack([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
        w = np.einsum("ij...,i...->j...", R, t)
        w += t
        u *= 0.5  # u and p: axis 1 is robot, camera
        w *= 0.5  # w and q
        # [D S E] with du = D theta, dw = E theta + S tau (T3)
        half = 0.5 * R
        by_motion = np.empty((3, 9, 2, T, m))
        D, S = by_motion[:, :3], by_motion[:, 3:6]
        np.negative(half, out=D)
        S[:] = half.swapaxes(0, 1)
        half_trace = half[0, 0] + half[1, 1] + half[2, 2]
        for i in range(3):
            D[i, i] += half_trace
            S[i, i] += 0.5
        # f = u x p and h = u x (t x p) + w x p + u x q, differentiated by w and q, and by u and p
        t_X = skew(self.t)
        vectors = np.empty((3, 7, T, m))
        vectors[:, :2] = t
        np.negative(u[:, 1], out=vectors[:, 2])
        vectors[:, 3] = u[:, 0]
        np.einsum("tij,jtm->itm", t_X, vectors[:, 2], out=vectors[:, 4])
        vectors[:, 4] -= w[:, 1]
        vectors[:, 5:] = w
        crosses = _cross_rows(vectors)
        by_t, by_w, by_u, by_q = crosses[:, :, :2], crosses[:, :, 2:4], crosses[:, :, 4:6], crosses[:, :, 6]
        by_u[:, :, 1] += np.einsum("ijtm,tjk->iktm", by_w[:, :, 1], t_X)
        np.einsum("ij...,jk...->ik...", half.swapaxes(0, 1), by_t, out=by_motion[:, 6:])
        F = np.zeros((2, 6, 6, T, m))
        F_rows = F.transpose(1, 2, 0, 3, 4)
        product = np.einsum("ij...,jk...->ik...", by_w, by_motion)
        F_rows[:3, :3], F_rows[3:, 3:] = product[:, :3], product[:, 3:6]
        np.einsum("ij...,jk...->ik...", by_u, D, out=F_rows[3:, :3])
        F_rows[3:, :3] += product[:, 6:]
        # From the frame of A back to that of B.
        F[1] = np.einsum("ajtm,tjk->aktm", F[1].reshape(12, 3, T, m), self.R).reshape(6, 6, T, m)
        self.G += u[:, 0].swapaxes(0, 1) @ u[:, 1].transpose(1, 2, 0)
        # h_theta = -sum( ([u][t] + [w]) [p] + [u] [q] ), and [p]^T = -[p]
        self.h_theta -= _trials_first(by_u[:, :, 1]) @ _trials_first(by_w[:, :, 0]).mT
        self.h_theta += _trials_first(by_w[:, :, 1]) @ _trials_first(by_q).mT
        return F

    def weight(self, N: int) -> Array:
        # M = tr(G) I - sym(G) has the eigenvectors of sym(G).
        values, vectors = np.linalg.eigh(0.5 * (self.G + self.G.mT))
        values = np.add.reduce(values, axis=-1, keepdims=True) - values  # descending
        determined = (values[:, 0] > NO_ROTATION * N) & (values[:, 2] > DEGENERATE * values[:, 0])
        if not determined.all():
            _raise_infinite(vectors[np.argmin(determined), :, 2])
        M_inverse = (vectors / values[:, None, :]) @ vectors.mT
        Q = np.zeros((len(values), 6, 6))
        np.matmul(M_inverse @ self.h_theta, M_inverse, out=Q[:, 3:, :3])
        Q[:, :3, :3] = Q[:, 3:, 3:] = -M_inverse
        return Q


def _raise_infinite(axis: Array) -> NoReturn:
    directions = np.zeros((2, 6))
    directions[0, :3] = directions[1, 3:] = axis
    raise DegenerateMotionError(
        "The motions do not determine X, or `X` does not belong to them: the variance of its rotation about, and of "
        f"its translation along, {np.round(axis, 3).tolist()} in the frame of `A` is infinite.",
        directions,
    )


def _cross_rows(v: Array) -> Array:
    """``[v]x`` with the vectors along the first axis: (3, ...) -> (3, 3, ...)."""
    result = np.zeros((3, *v.shape))
    result[2, 1], result[0, 2], result[1, 0] = v
    result[1, 2], result[2, 0], result[0, 1] = -v
    return result


def _trials_first(rows: Array) -> Array:
    """(k, l, T, m) -> (T, k, l m), for sums over pairs as one product per trial."""
    k, _, T, _ = rows.shape
    return rows.transpose(2, 0, 1, 3).reshape(T, k, -1)


class _ScaledDerivatives:
    """Derivatives of X at finite d through the octonion, (39)-(48) and (53)-(59)."""

    def __init__(self, sigma: Array, pinv: Array, to_X: Array, scale: float) -> None:
        self.sigma, self.pinv, self.to_X, self.scale = sigma, pinv, to_X, scale

    def by_image(self, A: Array, B: Array) -> Array:
        """``d sigma / d b`` with ``b = (vec E, vec Z)`` (45): (T, m, 8, 32)."""
        E, Z = _closed_form.F2(A, self.scale), _closed_form.F2(B, self.scale)
        q = np.sqrt(2.0) * self.sigma[:, None]
        result = np.empty((*A.shape[:2], 8, 32))
        # (39) with M = -F11: delta q = -(F11 - lambda I)^+ (q^T kron I) delta vec(F11), and sigma = q / sqrt(2)
        result[..., :4, :] = self.pinv[:, None, 0] @ _closed_form.dF11q_db(E, Z, q[..., :4])
        result[..., 4:, :] = self.pinv[:, None, 1] @ _closed_form.dF22q_db(E, Z, q[..., 4:])
        return result * -np.sqrt(0.5)

    def of_octonion(self, A: Array, B: Array) -> Array:
        """``d sigma / d xi``: (2, T, m, 8, 6)."""
        by_image = self.by_image(A, B)
        return np.stack(
            [
                by_image[..., :16] @ _closed_form.dF2_dxi(A, self.scale),
                by_image[..., 16:] @ _closed_form.dF2_dxi(B, self.scale),
            ]
        )

    def block(self, A: Array, B: Array) -> Array:
        return np.moveaxis(self.to_X[:, None] @ self.of_octonion(A, B), (3, 4), (1, 2))

    def weight(self, N: int) -> Array:
        return np.broadcast_to(np.eye(6), (len(self.sigma), 6, 6))


def _linearised(solution: Scaled, X: Array | None, scale: float) -> tuple[Array, Array, Array]:
    """(sigma, pinv, d xi_X / d sigma) at the solution, or at X where it is given."""
    sigma = solution.sigma if X is None else octonion(X, scale)
    pinv = np.stack([solution.pinv_L, solution.pinv_R], axis=1)
    return sigma, pinv, pose_from_octonion_jacobian(sigma, scale)


def pose_from_octonion_jacobian(sigma: Array, scale: float) -> Array:
    """``d xi_X / d sigma``, (..., 8) -> (..., 6, 8), from ``delta c_i = 2 P_i(sigma) delta sigma`` (55).

    The columns c_1, c_2, c_3 hold the rotation, ``[theta]x = dR R^T``; the fourth holds the translation,
    ``tau = d delta c_4`` (59).
    """
    R = _closed_form.sigma_to_R(sigma)[..., :3, :3]
    columns = [2.0 * P(sigma)[..., :3, :] for P in _P]
    dR_Rt = sum(columns[i][..., :, None, :] * R[..., None, :, i, None] for i in range(3))  # (..., 3, 3, 8)
    J = np.empty((*sigma.shape[:-1], 6, 8))
    J[..., 0, :] = 0.5 * (dR_Rt[..., 2, 1, :] - dR_Rt[..., 1, 2, :])
    J[..., 1, :] = 0.5 * (dR_Rt[..., 0, 2, :] - dR_Rt[..., 2, 0, :])
    J[..., 2, :] = 0.5 * (dR_Rt[..., 1, 0, :] - dR_Rt[..., 0, 1, :])
    J[..., 3:, :] = scale * columns[3]
    return J


_P = (_closed_form.P_1, _closed_form.P_2, _closed_form.P_3, _closed_form.P_4)


# ------------------------------------------------------------------------ noise carried through the derivatives


class _Independent:
    """``sum_i F_i Sigma_i F_i^T`` for noise of each pair's own (T3)."""

    def __init__(self, noise: PairNoise) -> None:
        self.factors = noise.factors
        self.sum: Array | float = 0.0

    def add(self, F: Array, pairs: slice) -> None:
        for side, L in zip(F, self.factors, strict=True):
            if L is not None:
                self.sum = self.sum + _outer(_times(side, L if L.ndim == 2 else L[None, pairs]))

    def covariance(self) -> Array:
        return np.asarray(self.sum)


def _times(F: Array, L: Array) -> Array:
    """``F L`` with pairs last: F (6, 6, T, m) and L (6, 6) or (T, m, 6, 6)."""
    if L.ndim == 2:
        return np.asarray((L.T @ F.reshape(6, 6, -1)).reshape(F.shape))
    return np.einsum("ijtm,tmjk->iktm", F, np.broadcast_to(L, (*F.shape[2:], 6, 6)))


def _outer(FL: Array) -> Array:
    """``sum over pairs of FL FL^T`` per trial: (6, 6, T, m) -> (T, 6, 6)."""
    stacked = _trials_first(FL)
    return np.asarray(stacked @ stacked.mT)


class _OnPoses:
    """Derivatives by the left twists of the poses behind the pairs.

    With ``P = G`` (robot) or ``P = inv(C)`` (camera), both motions are ``inv(P_j) P_i``. For left twists
    ``P -> exp(zeta) P`` only ``delta = zeta_i - zeta_j`` enters, so that one 6x6 block serves both poses of a
    pair, with opposite signs:  ``theta = R_j^T delta_theta``, ``tau = R_j^T (delta_rho - [t_i]x delta_theta)``.
    """

    def __init__(self, motions: Motions, noise: PoseNoise, trials: slice) -> None:
        poses, self.pairs = motions.poses, motions.pairs
        robot = poses.robot.reshape(-1, poses.n, 4, 4)[trials]
        camera = poses.camera.reshape(-1, poses.n, 4, 4)[trials]
        # d zeta / d xi: the left twist of T is (theta, tau + [t]x theta); that of inv(T) is minus the right twist
        # of T, -(R^T theta, R^T tau).
        if poses.setup == "eye-in-hand":
            robot, by_robot = robot, block(_EYE, 0.0, skew(robot[..., :3, 3]), _EYE)
        else:
            robot, by_robot = inverse(robot), _minus_right_twist(robot)
        self.by_pose = (by_robot, _minus_right_twist(camera))
        self.noise = (noise.robot, noise.camera)
        entries = [entry_rows(P.reshape(-1, 4, 4)).reshape(4, 4, *P.shape[:2]) for P in (robot, inverse(camera))]
        self.R = [P[:3, :3] for P in entries]
        self.t = [_cross_rows(P[:3, 3]) for P in entries]

    def by_difference(self, F: Array, side: int, pairs: slice) -> Array:
        """``F d xi / d delta`` of one side, F (6, 6, T, m)."""
        i, j = self.pairs[pairs].T
        T, m = F.shape[2:]
        by_twist = np.einsum("ajtm,kjtm->aktm", F.reshape(12, 3, T, m), self.R[side][..., j]).reshape(6, 6, T, m)
        by_twist[:, :3] -= np.einsum("ajtm,jktm->aktm", by_twist[:, 3:], self.t[side][..., i])
        return by_twist


class _Shared(_OnPoses):
    """``sum_k D_k Sigma_k D_k^T`` over poses, ``D_k`` summed over the pairs that use pose k (T4).

    A joint covariance of all poses is used whole: ``D = [D_1 .. D_n]``, ``D Sigma D^T`` (T4b).
    """

    def __init__(self, motions: Motions, noise: PoseNoise, trials: slice) -> None:
        super().__init__(motions, noise, trials)
        self.sums = [np.zeros_like(by_pose) for by_pose in self.by_pose]

    def add(self, F: Array, pairs: slice) -> None:
        incidence = _incidence(self.pairs[pairs], self.sums[0].shape[1])
        for side in (0, 1):
            if self.noise[side] is not None:
                by_difference = self.by_difference(F[side], side, pairs)
                T, m = by_difference.shape[2:]
                spread = incidence @ by_difference.reshape(-1, m).T
                self.sums[side] += spread.reshape(-1, 6, 6, T).transpose(3, 0, 1, 2)

    def covariance(self) -> Array:
        result: Array | float = 0.0
        for total, by_pose, covariance in zip(self.sums, self.by_pose, self.noise, strict=True):
            if covariance is not None:
                D = total @ by_pose
                if not is_joint(covariance):
                    D = D @ factor(covariance)
                row = D.transpose(0, 2, 1, 3).reshape(len(D), 6, -1)
                result = result + (row @ covariance @ row.mT if is_joint(covariance) else row @ row.mT)
        return np.asarray(result)


def _incidence(pairs: NDArray[np.intp], n: int) -> Any:
    """The (n, m) matrix with +1 at pose i and -1 at pose j of each pair."""
    from scipy.sparse import csc_array  # slow to import and needed here only

    m = len(pairs)
    return csc_array((np.tile([1.0, -1.0], m), pairs.ravel(), np.arange(0, 2 * m + 1, 2)), shape=(n, m))


class _Unshared(_OnPoses):
    """Noise of the poses, but each pair as if its poses were its own: what T3 makes of PoseNoise."""

    def __init__(self, motions: Motions, noise: PoseNoise, trials: slice) -> None:
        super().__init__(motions, noise, trials)
        self.sum: Array | float = 0.0
        self.factors = [
            None if covariance is None else by_pose @ factor(marginals(covariance))
            for by_pose, covariance in zip(self.by_pose, self.noise, strict=True)
        ]

    def add(self, F: Array, pairs: slice) -> None:
        for side, L in enumerate(self.factors):
            if L is not None:
                by_difference = self.by_difference(F[side], side, pairs)
                for pose in self.pairs[pairs].T:
                    self.sum = self.sum + _outer(_times(by_difference, L[:, pose]))

    def covariance(self) -> Array:
        return np.asarray(self.sum)


def _minus_right_twist(T: Array) -> Array:
    R_T = T[..., :3, :3].mT
    return -block(R_T, 0.0, 0.0, R_T)


# --------------------------------------------------------------------- the paper's quantities at finite d


class OctonionCovariance(NamedTuple):
    """The octonion of X and its covariance at finite d."""

    sigma: Array  # (..., 8): (q_L, q_R) / sqrt(2)  (18)
    covariance: Array  # (..., 8, 8): (48), of sigma itself


def octonion_covariance(
    A: Any, B: Any, noise: PairNoise, *, scale: float = PAPER_SCALE, literal: bool = False
) -> OctonionCovariance:
    """Sigma_sigma (42)-(48): both diagonal blocks and the cross block (46)-(47), for independent pairs.

    The sum over pairs is ``sum_i D_i Sigma_i D_i^T``; ``literal=True`` takes the averaged derivative and one
    shared Sigma_b of (45) instead. The paper's blocks are those of (q_L, q_R); sigma carries the factor
    1/sqrt(2) of (18), its covariance 1/2, which (48) leaves out and (55) needs.

    Parameters
    ----------
    A, B : (..., N, 4, 4)
    noise : PairNoise
    scale : float
        The scaling factor d.
    """
    if not isinstance(noise, PairNoise):
        raise InputError(f"Expected `noise` to be PairNoise, got {type(noise).__name__}.")
    A, B = as_pairs(A, B)
    _checked_kind(None, noise, None, A.shape[-3])
    batch, N = A.shape[:-3], A.shape[-3]
    A, B = A.reshape(-1, N, 4, 4), B.reshape(-1, N, 4, 4)
    sigma, pinv, to_X = _linearised(solve_scaled(A, B, scale), None, scale)
    S = np.empty((len(A), 8, 8))
    for k in range(len(A)):
        one = slice(k, k + 1)
        derivatives = _ScaledDerivatives(sigma[one], pinv[one], to_X[one], scale)
        S[k] = (_literal_sum if literal else _octonion_sum)(derivatives, A[one], B[one], noise)
    return OctonionCovariance(sigma.reshape(*batch, 8), S.reshape(*batch, 8, 8))


def _octonion_sum(derivatives: _ScaledDerivatives, A: Array, B: Array, noise: PairNoise) -> Array:
    S = np.zeros((8, 8))
    for pairs in pair_blocks(A.shape[1], BLOCK):
        by_pair = derivatives.of_octonion(A[:, pairs], B[:, pairs])[:, 0]
        for D, covariance in zip(by_pair, (noise.A, noise.B), strict=True):
            if covariance is not None:
                S += (D @ (covariance if covariance.ndim == 2 else covariance[pairs]) @ D.mT).sum(axis=0)
    return S


def _literal_sum(derivatives: _ScaledDerivatives, A: Array, B: Array, noise: PairNoise) -> Array:
    """(45): ``D Sigma_b D^T`` with the mean derivative by b and the mean covariance of b over the pairs."""
    N = A.shape[1]
    D, S_b = np.zeros((8, 32)), np.zeros((32, 32))
    for pairs in pair_blocks(N, BLOCK):
        D += derivatives.by_image(A[:, pairs], B[:, pairs])[0].sum(axis=0) / N
        for k, (T, covariance) in enumerate(((A, noise.A), (B, noise.B))):
            if covariance is not None:
                J = _closed_form.dF2_dxi(T[0, pairs], derivatives.scale)
                half = slice(16 * k, 16 * k + 16)
                S_b[half, half] += (
                    J @ (covariance if covariance.ndim == 2 else covariance[pairs]) @ J.mT
                ).sum(axis=0) / N
    return D @ S_b @ D.T


class PaperCovariances(NamedTuple):
    """What (53)-(59) read off Sigma_sigma."""

    R4: Array  # (..., 4, 4): <dR4 dR4^T> on SO(4) (56)
    R: Array  # (..., 3, 3): Sigma_R = <dR dR^T> (58) = tr(Sigma_theta) I - Sigma_theta
    t: Array  # (..., 3, 3): Sigma_t (59)
    R_t: Array  # (..., 3, 3, 3): [i] = <delta R_column_i delta t^T>, d times the blocks c_i, c_4 of (55)


def paper_covariances(sigma: Array, covariance_sigma: Array, scale: float) -> PaperCovariances:
    """Sigma_R, Sigma_t and the rotation-translation cross terms from Sigma_sigma (55)-(59)."""
    P = np.stack([P(sigma) for P in _P], axis=-3)  # (..., 4, 4, 8)
    S = np.asarray(covariance_sigma)[..., None, :, :]
    R4 = 4.0 * (P @ S @ P.mT).sum(axis=-3)  # (56)
    cross = 4.0 * (P[..., :3, :, :] @ S @ P[..., 3:, :, :].mT)  # (55) with i = 1, 2, 3 and j = 4
    Sigma_t = 4.0 * scale**2 * (P[..., 3, :, :] @ np.asarray(covariance_sigma) @ P[..., 3, :, :].mT)
    return PaperCovariances(R4, R4[..., :3, :3], Sigma_t[..., :3, :3], scale * cross[..., :3, :3])


def so4_covariance(X: Array, covariance: Array, scale: float) -> Array:
    """``<dR4 dR4^T>`` of ``R4 = F2(X, d)`` from the 6x6 covariance of X: (65)-(66), (..., 4, 4).

    Exact to first order in the errors. The approximation printed in (66) drops the term of
    ``<theta x tau>``, and (65) prints ``t^T dt`` where ``dt^T dt`` is meant.
    """
    covariance = np.asarray(covariance, dtype=float)
    t = np.asarray(X, dtype=float)[..., :3, 3]
    theta, tau = covariance[..., :3, :3], covariance[..., 3:, 3:]
    cross = covariance[..., :3, 3:]
    Sigma_R = np.trace(theta, axis1=-2, axis2=-1)[..., None, None] * _EYE - theta
    twist = vee(cross.mT)  # <theta x tau>
    Rt = (Sigma_R @ t[..., None])[..., 0]
    result = np.empty((*covariance.shape[:-2], 4, 4))
    result[..., :3, :3] = Sigma_R + tau / scale**2
    result[..., :3, 3] = result[..., 3, :3] = -(twist + Rt) / scale
    result[..., 3, 3] = (
        np.trace(tau, axis1=-2, axis2=-1) + 2.0 * np.sum(t * twist, axis=-1) + np.sum(t * Rt, axis=-1)
    ) / scale**2
    return result


def _literal(A: Array, B: Array, noise: PairNoise, X: Array | None, scale: float) -> Array:
    """Sigma_X through (45) as printed, for the trials of A and B (T, N, 4, 4)."""
    solution = _linearised(solve_scaled(A, B, scale), X, scale)
    result = np.empty((len(A), 6, 6))
    for k in range(len(A)):
        derivatives = _ScaledDerivatives(*(part[k : k + 1] for part in solution), scale)
        S = _literal_sum(derivatives, A[k : k + 1], B[k : k + 1], noise)
        result[k] = derivatives.to_X[0] @ S @ derivatives.to_X[0].T
    return result
