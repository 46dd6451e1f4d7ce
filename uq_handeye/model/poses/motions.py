"""`Motions`, the relative motions A and B of AX = XB, with the poses that each pair was made from.

With ``G = base_T_gripper`` (inverted for eye-to-hand), ``C = camera_T_target`` and a pair ``(i, j)``

    A_ij = inv(G_j) G_i,    B_ij = C_j inv(C_i),    A_ij X = X B_ij                      (paper, (6)-(9))

holds exactly on poses without noise.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.geometry.checks import as_transforms
from ...core.geometry.se3 import Array, inverse
from ...core.read_only import ReadOnlyArrays
from ...errors import InputError, require_type
from ..errors.joint_covariance import Index
from .pose_pairs import PosePairs


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

    def rows(self, index: Index) -> Motions:
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


def pair_indices(n: int, pairs: str | ArrayLike = "consecutive") -> NDArray[np.intp]:
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
