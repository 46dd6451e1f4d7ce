"""Motions: the relative motions A and B of AX = XB, and which poses each pair was made from.

With ``G = base_T_gripper`` (inverted for eye-to-hand), ``C = camera_T_target`` and a pair ``(i, j)``

    A_ij = inv(G_j) G_i,    B_ij = C_j inv(C_i),    A_ij X = X B_ij                      (paper, (6)-(9))

holds exactly on poses without noise.

Residuals of the motions and the poses by X, and their summary. Views of a target over the poses: the point that moves
least, and the spread of directions. Poses and motions as plain numbers, and back without loss.
"""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.files.records import array_of
from ...core.files.source import Source
from ...core.geometry.checks import as_transforms
from ...core.geometry.nearest_rotation import orthonormalise
from ...core.geometry.se3 import Array, inverse
from ...core.runtime.read_only import ReadOnlyArrays
from ...errors import InputError, require_type
from ..noise.joint_covariance import JointCovariance
from .pose_pairs import PosePairs
from .timing import Timing

if TYPE_CHECKING:
    from ..camera.result import CameraCalibration


@dataclass(frozen=True, eq=False)
class Motions(ReadOnlyArrays):
    """N pairs of relative motions.

    Parameters
    ----------
    A : (..., N, 4, 4)
        Motions of the robot.
    B : (..., N, 4, 4)
        Motions of the camera.
    pairs : (N, 2) integers or None
        The poses ``(i, j)`` each pair was made from.
    poses : PosePairs or None
        Those poses. Both are None for motions that come without poses.
    """

    A: Array
    B: Array
    pairs: NDArray[np.intp] | None = field(default=None)
    poses: PosePairs | None = field(default=None)

    def __post_init__(self) -> None:
        for name in ("A", "B"):
            T = getattr(self, name)
            if self.poses is None:  # what `relative_motions` makes of checked poses needs no second check
                T = as_transforms(T, name)
            object.__setattr__(self, name, np.ascontiguousarray(T))  # rounding follows the order in memory
        if self.A.shape != self.B.shape:
            raise InputError(
                f"Expected `A` and `B` to hold the same number of motions, got shapes {self.A.shape} and "
                f"{self.B.shape}."
            )
        if (self.poses is None) != (self.pairs is None) or (self.pairs is not None and len(self.pairs) != self.N):
            raise InputError("Expected `pairs` and `poses` together, one pair per motion; use relative_motions().")
        super().__post_init__()

    @property
    def N(self) -> int:
        """Number of pairs."""
        return int(self.A.shape[-3])

    def rows(self, index: NDArray[Any]) -> Motions:
        """Some of the motions, by their numbers or a mask."""
        pairs = None if self.pairs is None else self.pairs[index]
        return Motions(self.A[..., index, :, :], self.B[..., index, :, :], pairs, self.poses)

    def __len__(self) -> int:
        return self.N

    def __repr__(self) -> str:
        origin = "" if self.poses is None else f" of {self.poses.n} poses"
        return f"Motions({self.N} pairs{origin})"


def relative_motions(poses: PosePairs, pairs: str | ArrayLike = "consecutive") -> Motions:
    """The motions between the poses of each pair.

    Parameters
    ----------
    poses : PosePairs
    pairs : "consecutive", "disjoint", "all" or an (N, 2) integer array
        ``consecutive``: (0, 1), (1, 2), ...; ``disjoint``: (0, 1), (2, 3), ..., no pose used twice; ``all``:
        every i < j; or any pairs of distinct pose numbers.

    Examples
    --------
    >>> import uq_handeye as uq
    >>> poses = uq.simulate(n_poses=4, seed=0)
    >>> uq.relative_motions(poses, "all").pairs.tolist()
    [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]
    """
    require_type("poses", poses, PosePairs, "PosePairs")
    index = pair_indices(poses.n, pairs)
    i, j = index[:, 0], index[:, 1]
    G, C = poses.effective_robot, poses.camera
    A = inverse(G)[..., j, :, :] @ G[..., i, :, :]
    B = C[..., j, :, :] @ inverse(C)[..., i, :, :]
    return Motions(A, B, index, poses)


def pair_indices(n: int, pairs: Any = "consecutive") -> NDArray[np.intp]:
    """Pose numbers (N, 2) of the pairs; see `relative_motions`."""
    if isinstance(pairs, str):
        if pairs == "consecutive":
            first = np.arange(max(n - 1, 0))
            index = np.stack([first, first + 1], axis=1)
        elif pairs == "disjoint":
            first = np.arange(0, n - 1, 2)
            index = np.stack([first, first + 1], axis=1)
        elif pairs == "all":
            index = np.stack(np.triu_indices(n, 1), axis=1)
        else:
            raise InputError(
                f"Expected `pairs` to be 'consecutive', 'disjoint', 'all' or an (N, 2) integer array, got {pairs!r}."
            )
        return index.astype(np.intp)
    index = np.asarray(pairs)
    if index.ndim != 2 or index.shape[1] != 2 or not np.issubdtype(index.dtype, np.integer):
        raise InputError(f"Expected `pairs` to be an (N, 2) integer array, got shape {index.shape} of {index.dtype}.")
    if index.size and (index.min() < 0 or index.max() >= n):
        bad = index[(index < 0) | (index >= n)][0]
        raise InputError(f"Expected `pairs` to hold pose numbers 0 to {n - 1}, got {bad}.")
    if (index[:, 0] == index[:, 1]).any():
        row = int(np.argmax(index[:, 0] == index[:, 1]))
        raise InputError(f"Expected two different poses in each pair, got {index[row].tolist()} in `pairs`[{row}].")
    return index.astype(np.intp)


def spread_pairs(n: int, limit: int) -> NDArray[np.intp]:
    """All pairs ``i < j`` of n poses, or about ``limit`` of them: every pair whose numbers differ by certain lags."""
    if n * (n - 1) // 2 <= limit:
        return pair_indices(n, "all")
    lags = np.unique(np.linspace(1, n - 1, max(2, 2 * limit // n)).astype(np.intp))
    return np.concatenate([np.stack([np.arange(n - lag), np.arange(lag, n)], axis=1) for lag in lags])


class Residuals(NamedTuple):
    """Residuals of the motions by X: rotation in rad, translation in the unit of the input, over pairs."""

    rotation_rms: float
    rotation_median: float
    rotation_max: float
    translation_rms: float
    translation_median: float
    translation_max: float
    error: float  # (62): sqrt(sum |A X - X B|^2) / N
    pairs: int  # how many pairs were looked at


def rotation_angles(R: Array) -> Array:
    """Rotation angle in [0, pi] of R (..., 3, 3), exact also at 0 and pi: ``atan2(|vee R|, tr R - 1)``."""
    x, y, z = R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]
    return np.asarray(np.arctan2(np.sqrt(x * x + y * y + z * z), np.trace(R, axis1=-2, axis2=-1) - 1.0))


def residuals(A: Array, B: Array, X: Array) -> tuple[Array, Array]:
    """Rotation angle of ``(A X)(X B)^-1`` and length of ``t(A X) - t(X B)`` per pair: two arrays (N,)."""
    difference = A[..., :3, :] @ X - X[..., :3, :] @ B
    squares = np.einsum("...ij,...ij->...", difference[..., :3], difference[..., :3])
    # |R_1 - R_2| = 2 sqrt(2) sin(angle / 2) in the Frobenius norm
    angle = 2.0 * np.arcsin(np.minimum(np.sqrt(squares / 8.0), 1.0))
    offset = difference[..., 3]
    return angle, np.sqrt(np.einsum("...i,...i->...", offset, offset))


def median(values: Array) -> float:
    """``np.median`` of a vector at a fifth of its time, which counts on small data."""
    k = values.size // 2
    if values.size % 2:
        return float(np.partition(values, k)[k])
    low, high = np.partition(values, (k - 1, k))[k - 1 : k + 1]
    return 0.5 * (float(low) + float(high))


def summarise(angle: Array, distance: Array) -> Residuals:
    """`Residuals` from those of each pair."""
    frobenius = 8.0 * np.sin(0.5 * angle) ** 2 + distance**2
    return Residuals(
        float(np.sqrt(np.mean(angle**2))),
        median(angle),
        float(angle.max()),
        float(np.sqrt(np.mean(distance**2))),
        median(distance),
        float(distance.max()),
        float(np.sqrt(frobenius.sum()) / len(angle)),
        len(angle),
    )


def pose_residuals(G: Array, C: Array, X: Array) -> tuple[Array, Array]:
    """Rotation angle and distance (n,) of each ``W_k = G_k X C_k`` from their mean over the better half."""
    W = G @ X @ C
    keep: NDArray[np.bool_] = np.ones(len(W), dtype=bool)
    for _ in range(2):
        R = orthonormalise(W[keep, :3, :3].sum(axis=0))
        angle = rotation_angles(W[:, :3, :3] @ R.T)
        shift = W[:, :3, 3] - W[keep, :3, 3].mean(axis=0)
        distance = np.sqrt(np.einsum("ni,ni->n", shift, shift))
        keep = (angle <= median(angle)) & (distance <= median(distance))
        if keep.sum() < 3:
            keep = distance <= median(distance)
    return angle, distance


# Steps towards the pivot, each with weights 1 / distance.
STEPS = 5


def pivot_of(camera: Array) -> Array:
    """The point of the target (3,), in its frame, that moves least in the camera frame (least sum of distances).

    ``R_i s + t_i`` is the point s in view i; the sum is over its distances to their mean. Directions in which no
    rotation tells s are left at the mean position of the camera.
    """
    R, t = camera[:, :3, :3], camera[:, :3, 3]
    begin = -(R.mT @ t[..., None])[..., 0].mean(axis=0)
    t = t + R @ begin
    s, weights = np.zeros(3), np.full(len(t), 1.0 / len(t))
    for _ in range(STEPS):
        mean_R, mean_t = np.tensordot(weights, R, 1), weights @ t
        M = np.eye(3) - mean_R.T @ mean_R
        s = -np.linalg.pinv(M, rcond=1e-6, hermitian=True) @ (
            np.einsum("n,nij,ni->j", weights, R, t) - mean_R.T @ mean_t
        )
        away = R @ s + t
        distance = np.sqrt(((away - weights @ away) ** 2).sum(axis=1))
        weights = 1.0 / np.maximum(distance, 1e-3 * float(distance.max()) + 1e-300)
        weights /= weights.sum()
    return np.asarray(begin + s)


# The direction in which a camera sees its target varies by less than this share of what any other list of poses shows.
STEADY_VIEW = 0.5


def direction_spread(T: Array) -> float:
    """RMS angle (rad) of the directions of the translations of poses (n, 4, 4) about their mean direction."""
    t = T[:, :3, 3]
    directions = t / np.maximum(np.linalg.norm(t, axis=1, keepdims=True), 1e-12)
    mean = np.mean(directions, axis=0)
    across = np.linalg.norm(np.cross(directions, mean), axis=1)
    return float(np.sqrt(np.mean(np.arctan2(across, directions @ mean) ** 2)))


def sha256_of(*stacks: Array) -> str:
    """SHA-256 of poses as float64, little-endian."""
    digest = hashlib.sha256()
    for T in stacks:
        digest.update(np.ascontiguousarray(T, dtype="<f8").tobytes())
    return digest.hexdigest()


def data_to_dict(data: PosePairs | Motions) -> dict[str, Any]:
    """The poses with all that is known of them; motions alone where there are no poses.

    The truth of simulated poses and the files they came from are left out.
    """
    poses, pairs = data.poses, getattr(data, "pairs", None)
    if poses is None:
        return _stacks(data, "A", "B")
    timing, seen = poses.timing, poses.camera_calibration
    return {
        **_stacks(poses, "robot", "camera"),
        **({} if poses.timestamps is None else {"timestamps": poses.timestamps.tolist()}),
        **({} if poses.joints is None else {"joints": poses.joints.tolist()}),
        **({} if timing is None else {"timing": asdict(timing) | {"rate": timing.rate.tolist()}}),
        **({} if seen is None else {"camera_calibration": _camera_to_dict(seen)}),
        **({} if poses.camera_covariance is None else {"camera_covariance": poses.camera_covariance.to_dict()}),
        **({} if pairs is None else {"pairs": pairs.tolist()}),
    }


def _stacks(data: Any, *names: str) -> dict[str, Any]:
    stacks = {name: getattr(data, name) for name in names}
    return {"sha256": sha256_of(*stacks.values()), **{name: T.tolist() for name, T in stacks.items()}}


def data_from_dict(data: dict[str, Any], setup: str | None, sources: tuple[Source, ...] = ()) -> PosePairs | Motions:
    """The inverse of `data_to_dict`; raises `InputError`, `KeyError`, `TypeError` or `ValueError` on anything else."""
    sides = ("robot", "camera") if "robot" in data else ("A", "B")
    first, second = (_stack(data[name], f"data.{name}") for name in sides)
    if sha256_of(first, second) != data["sha256"]:
        raise InputError(f"data.{sides[0]} and data.{sides[1]} are not the poses that data.sha256 was made of")
    if sides == ("A", "B"):
        return Motions(first, second)
    if setup is None:
        raise InputError("Expected the setup of the poses, got none")
    n = len(first)
    timing, joints, seen = data.get("timing"), data.get("joints"), data.get("camera_calibration")
    poses = PosePairs(
        first,
        second,
        setup,
        None if data.get("timestamps") is None else array_of(data["timestamps"], (n,), "data.timestamps"),
        None,
        sources,
        None if timing is None else Timing(**(timing | {"rate": array_of(timing["rate"], (n, 6), "data.timing.rate")})),
        None if seen is None else _camera_from_dict(seen, second),
        None if joints is None else array_of(joints, (n, len(joints[0])), "data.joints"),
        None if data.get("camera_covariance") is None else JointCovariance.from_dict(data["camera_covariance"]),
    )
    if data.get("pairs") is None:
        return poses
    pairs = array_of(data["pairs"], (len(data["pairs"]), 2), "data.pairs")
    if (pairs != np.floor(pairs)).any():
        raise InputError("Expected data.pairs to be numbers of poses")
    return relative_motions(poses, pairs.astype(np.intp))


def _stack(value: Any, name: str) -> Array:
    return array_of(value, (len(value), 4, 4), name)


def _camera_to_dict(camera: Any) -> dict[str, Any]:
    from ..camera.calibration_files import camera_to_dict

    return camera_to_dict(camera)


def _camera_from_dict(data: dict[str, Any], poses: Array) -> CameraCalibration:
    from ..camera.stored_calibration import camera_from_dict

    return camera_from_dict(data, poses)
