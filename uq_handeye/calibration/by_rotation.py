r"""X from rotations alone: an IMU, a gimbal or a head whose positions are not given.

The model is ``R_G R_X R_C = R_W`` with isotropic errors of equal size, which are estimated from the residuals

    r_i = Log(R_Gi R_X R_Ci R_W^T),      dr_i = R_Gi theta_X - theta_W

by least squares, without the poses that do not fit the others (chi-square of three numbers, one in 10,000). The
covariance is ``s^2 (J^T J)^-1`` with ``s^2 = sum |r|^2 / (3 n - 6)``. The translations of X and W stay open.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..core.geometry.rotations import Rotation
from ..core.geometry.se3 import Array
from ..core.levels import RARE
from ..errors import DegenerateMotionError
from ..findings import Finding
from ..fit.diagnostics.agreement import agreement
from ..fit.graph.open_directions import OpenDirections
from ..fit.graph.reference import Reference
from ..fit.graph.request import Request
from ..fit.graph.starts import MEDIAN_SQUARE
from ..model.poses.pose_pairs import PosePairs
from ..model.poses.residuals import residuals, summarise
from .by_published import bare_result
from .job import Job, job_of
from .result import Calibration

# A pose whose squared residual is beyond this does not fit the others: one good pose in 10,000.
LIMIT = RARE.chi_square(3)


def without_positions(poses: PosePairs) -> bool:
    """Return whether the camera poses, or those of robot and camera, have rotations only."""
    # lengths below 1e-12 m are none: no machine measures them
    return poses.robot.ndim == 3 and float(np.abs(poses.camera[:, :3, 3]).max(initial=0.0)) < 1e-12


def by_rotation(request: Request, poses: PosePairs) -> tuple[Job, Calibration, list[Finding]]:
    """Return the job, the rotation of X with its covariance, and findings; raises `DegenerateMotionError`."""
    job = job_of(replace(request, shared=(), robust=False), poses)
    G, C = poses.effective_robot[:, :3, :3], poses.camera[:, :3, :3]
    start = agreement(_turned(G), _turned(C))
    if start is None:
        raise DegenerateMotionError(
            "The rotations do not determine that of X: they are about one axis, or too small. Rotate about another.",
            np.eye(6),
        )
    R_X = start.rotation
    kept = np.ones(poses.n, dtype=bool) if start.counts is None else start.counts
    R_W = _mean(G[kept] @ R_X @ C[kept])
    J = np.concatenate([G, np.broadcast_to(-np.eye(3), G.shape)], axis=2)  # (n, 3, 6)
    r = np.zeros((poses.n, 3))
    for _ in range(20):  # steps at most
        r = Rotation.from_matrix(G @ R_X @ C @ R_W.T).as_rotvec()
        squares = (r * r).sum(axis=1)
        variance = float(np.median(squares[kept])) / MEDIAN_SQUARE
        kept = squares <= max(LIMIT * variance, 1e-24)
        step = np.linalg.lstsq(J[kept].reshape(-1, 6), -r[kept].reshape(-1), rcond=None)[0]
        R_X, R_W = (Rotation.from_rotvec(part).as_matrix() @ R for part, R in ((step[:3], R_X), (step[3:], R_W)))
        if np.abs(step).max() < 1e-12:
            break
    dof = 3 * int(kept.sum()) - 6
    variance = float((r[kept] ** 2).sum()) / max(dof, 1)
    whole = variance * np.linalg.inv(np.einsum("nij,nik->jk", J[kept], J[kept]))
    X, W = np.eye(4), np.eye(4)
    X[:3, :3], W[:3, :3] = R_X, R_W
    basis = np.zeros((6, 12))
    basis[:3, 3:6], basis[3:, 9:] = np.eye(3), np.eye(3)
    angle, distance = residuals(job.motions.A, job.motions.B, X)
    result = replace(
        bare_result(job, X, W, summarise(angle, 0.0 * distance), None),
        covariance=_of_rotation(whole[:3, :3]),
        covariance_W=_of_rotation(whole[3:, 3:]),
        reference=Reference("t", float(max(dof, 3)), 3),
        opened=OpenDirections(basis, 1.0),
    )
    rows = np.flatnonzero(~kept).tolist()
    values = {"n": poses.n, "noise": float(np.sqrt(variance)), "left_out": rows}
    return job, result, [Finding("calibration.rotation_only", "caution", values)]


def _turned(R: Array) -> Array:
    T = np.zeros((len(R), 4, 4))
    T[:, :3, :3], T[:, 3, 3] = R, 1.0
    return T


def _mean(R: Array) -> Array:
    U, _, Vt = np.linalg.svd(R.sum(axis=0))
    return np.asarray(U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt)


def _of_rotation(S: Array) -> Array:
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = S
    return covariance
