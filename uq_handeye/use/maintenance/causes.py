"""Causes of a change: each is estimated by generalised least squares, and those that can be separated are named.

A cause with the columns C (p numbers a, ``E r = C a``) takes ``gain`` from d^2. Causes are compared by

    BIC = deviance(d^2 - gain) + p log(N)

N the number of residuals, the deviance that of `reference`. ``exp(-BIC / 2)`` over the sum of all is the probability of
each if exactly one of them has happened. The first is named if its probability is at least `MIN_PROBABILITY_NAMED`, and
every other has a larger ``deviance + p``, with p the expected decrease by chance: fewer parameters of the first are not
enough. Otherwise all that together have `MIN_PROBABILITY_OF_SET`, or come so near, are returned as a set.

Two pairs of causes are the same whatever the poses: a move of the robot's base and of the part fixed in the cell
(target, eye-in-hand; camera, eye-to-hand), and a move of the robot's tool and of the part that it carries. An image
centre that changed is, to first order, a camera that rotated about its own x and y axes: it is never named without X.
One pose cannot separate X from W.

- *X*: ``-J_X delta``, *target*: ``-J_W delta``: the true pose is the estimate moved by delta.
- *focal length*, *image centre*: the true value moved from that used by e: ``-D_C F e`` (`shared_error`).
- *target size*: likewise, of the scale of all translations of the camera poses. With the target in the middle of the
  picture it is the same as the focal length.
- *one pose*: only one of the poses is an outlier, by a wrong detection or robot pose; tested from three poses on.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from ...calibration.evidence.new_poses import PoseEvidence
from ...core.files.records import Record
from ...core.geometry.se3 import Array
from ...core.numbers.levels import CONTRADICTED
from ...core.runtime.read_only import ReadOnlyArrays
from ...model.error_terms import keys
from ...model.poses.pose_pairs import PosePairs
from ...model.posterior.rows import NewRows, PredictiveReference
from ...model.shared_errors.shared_error import SharedError

CAMERA_MOVED, TARGET_MOVED, FOCAL_LENGTH, TARGET_SIZE, IMAGE_CENTRE, ONE_POSE = (
    "X",
    "target",
    str(keys.FOCAL_LENGTH),
    "target size",
    "image centre",
    "one pose",
)
# The first cause is named from this probability on; else those that together have the other one are listed.
MIN_PROBABILITY_NAMED, MIN_PROBABILITY_OF_SET = 0.98, 0.995
# A cause is named only if all others have this much more of deviance + p.
MIN_DEVIANCE_LEAD = 1.0
# From three poses on one that is wrong can be separated from a change.
MIN_POSES_FOR_ONE_WRONG = 3


@dataclass(frozen=True, eq=False)
class Cause(Record):
    """One possible cause, as estimated by itself."""

    _in_file: ClassVar[str] = "name estimate covariance gain p_left probability row"

    name: str
    estimate: (
        Array  # (p,) rad and m; true over used, minus 1, of focal length and target size; rad for the image centre
    )
    covariance: Array  # (p, p)
    gain: float  # by how much d^2 falls
    p_left: float  # p-value of what is left of d^2
    probability: float  # among the causes that are compared
    deviance: float  # what is left
    row: int | None = None  # of one pose: which

    @property
    def explains(self) -> bool:
        """True if the rest of d^2 is explained by noise."""
        return self.p_left >= CONTRADICTED.probability


@dataclass(frozen=True, eq=False)
class Causes(ReadOnlyArrays):
    """All causes, the most probable first, and what can be concluded."""

    all: tuple[Cause, ...]

    @property
    def named(self) -> Cause | None:
        """The cause, if one has a clear lead and explains the change."""
        first = self.all[0]
        clear = first.probability >= MIN_PROBABILITY_NAMED and first.explains and first.name != IMAGE_CENTRE
        return first if clear and not any(map(self._near, self.all[1:])) else None

    @property
    def explained(self) -> bool:
        """True if one of the causes by itself explains the change."""
        return any(cause.explains for cause in self.candidates)

    @property
    def candidates(self) -> tuple[Cause, ...]:
        """Causes that cannot be separated from the first, with it."""
        if self.named is not None:
            return self.all[:1]
        before = np.cumsum([0.0, *(cause.probability for cause in self.all)])[:-1]
        of_each = zip(self.all, before, strict=True)
        names = {cause.name for cause, total in of_each if total < MIN_PROBABILITY_OF_SET or self._near(cause)}
        names |= {CAMERA_MOVED} if IMAGE_CENTRE in names else set()
        return tuple(cause for cause in self.all if cause.name in names)

    def _near(self, cause: Cause) -> bool:
        """Return whether a cause leaves hardly more than the first, each without what chance takes away."""
        left, first = (one.deviance + len(one.estimate) for one in (cause, self.all[0]))
        return left - first < MIN_DEVIANCE_LEAD

    def __getitem__(self, name: str) -> Cause:
        return next(cause for cause in self.all if cause.name == name)


def columns_of_causes(evidence: PoseEvidence, setup: str) -> dict[str, Array]:
    """Columns (m, 6, p) of the causes, by name."""
    poses = PosePairs(evidence.robot, evidence.camera, setup)
    J, D_C = evidence.linear.J, evidence.linear.sides[1]
    sized = np.linalg.norm(evidence.camera[:, :3, 3], axis=-1).max() > 0
    found = {CAMERA_MOVED: -J[..., :6], TARGET_MOVED: -J[..., 6:]}
    if sized:
        found[FOCAL_LENGTH] = -D_C @ SharedError.focal_length(1.0).at(poses)
        found[TARGET_SIZE] = -D_C @ SharedError.target_scale(1.0).at(poses)
    found[IMAGE_CENTRE] = -D_C @ SharedError.principal_point(1.0).at(poses)
    return found


def compare_causes(evidence: NewRows, columns: Mapping[str, Array], reference: PredictiveReference) -> Causes:
    """Estimate each cause by itself, and compare them."""
    d2, N = evidence.d2, evidence.dof
    found: list[tuple[float, Cause]] = []

    def add(name: str, C: Array, more: float, row: int | None = None) -> None:
        of = evidence.explained_by(C)
        left, p = max(d2 - of.gain, 0.0), C.shape[-1]
        p_left = reference.p_value(left, N - p) if p < N else 1.0
        deviance = reference.deviance(left)
        bic = deviance + p * float(np.log(N)) + more
        found.append((bic, Cause(name, of.estimate, of.covariance, of.gain, p_left, 0.0, deviance, row)))

    for name, C in columns.items():
        add(name, C, 0.0)
    m = len(evidence.r)
    if m >= MIN_POSES_FOR_ONE_WRONG:
        row, C = _most_outlying(evidence)
        add(ONE_POSE, C, 2.0 * float(np.log(m)), row)
    found.sort(key=lambda one: one[0])
    weight = np.exp(-0.5 * (np.array([bic for bic, _ in found]) - found[0][0]))
    weight = weight / weight.sum()
    return Causes(tuple(
        replace(c, probability=float(w))
        for (_, c), w in zip(found, weight, strict=True)
    ))  # fmt: skip


def distances(evidence: NewRows) -> Array:
    """(m,) squared distance of each measurement from its prediction by all others."""
    m, k = evidence.r.shape
    white = evidence.whitened(np.eye(m * k).reshape(m, k, m * k))
    g = (white.T @ evidence.white).reshape(m, k)  # Sigma^-1 r
    index = np.arange(m)
    P = (white.T @ white).reshape(m, k, m, k)[index, :, index, :]
    return np.asarray(np.einsum("mi,mi->m", g, np.linalg.solve(P, g[..., None])[..., 0]))


def _most_outlying(evidence: NewRows) -> tuple[int, Array]:
    """The pose that the others contradict most, and its columns (m, k, k)."""
    m, k = evidence.r.shape
    row = int(distances(evidence).argmax())
    C = np.zeros((m, k, k))
    C[row] = np.eye(k)
    return row, C
