r"""Causes of a change: each by generalised least squares, and which of them can be separated.

A cause with the columns C (p numbers a, ``E r = C a``) takes ``gain`` from d^2. Causes are compared by

    BIC = deviance(d^2 - gain) + p log(N)

N the number of residuals, the deviance that of `reference`. ``exp(-BIC / 2)`` over the sum of all is the probability of
each if one of them is what happened. The first is named if its probability is at least `CLEAR`, and every other has a
larger ``deviance + p``, p being what chance takes away: that the first takes fewer numbers is not enough. Else all that
together have `CLEAR_SET`, or come so near, are answered as a set.

Exactly the same are, whatever the poses: the base of the robot and what stands in the cell (target, eye-in-hand;
camera, eye-to-hand), and the tool of the robot and what it carries. An image centre that changed is, to first order, a
camera that rotated about its own x and y axes: it is never named without X. One pose cannot separate X from W.

- *X*: ``-J_X delta``, *target*: ``-J_W delta``: the true pose is the estimate moved by delta.
- *focal length*, *image centre*: the true value moved from that used by e: ``-D_C F e`` (`shared_error`).
- *target size*: likewise, of the scale of all translations of the camera poses. With the target in the middle of the
  picture it is the same as the focal length.
- *one pose*: all that is wrong is one of the poses, a wrong detection or robot pose; from three poses on.

Poses that contradict a calibration grossly may be files that are misread or paired wrongly (`misread`). Unlike
`input_checks.misread_files` nothing is fitted: X and W are known, and one pose is enough.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from scipy.optimize import linear_sum_assignment

from ...calibration.evidence.new_poses import PoseEvidence
from ...core.files.records import Record
from ...core.formatting.units import LENGTH_UNITS
from ...core.geometry.se3 import Array, inverse, logarithm
from ...core.runtime.read_only import ReadOnlyArrays
from ...findings import Finding
from ...fit.input_checks.misread_files import rotation_readings
from ...model.poses.pose_pairs import PosePairs
from ...model.posterior.rows import NewRows, PredictiveReference
from ...model.shared_errors.shared_error import SharedError

CAMERA_MOVED, TARGET_MOVED, FOCAL_LENGTH, TARGET_SIZE, IMAGE_CENTRE, ONE_POSE = (
    "X",
    "target",
    "focal length",
    "target size",
    "image centre",
    "one pose",
)
# Probability with which the first cause is named, and that of the set that is answered instead.
CLEAR, CLEAR_SET = 0.98, 0.995
# What the others must have more of in deviance + p.
LEAD = 1.0
# A cause explains the change if what it leaves of d^2 has at least this p-value.
EXPLAINS = 1e-3
# Poses from which on one that is wrong can be separated from a change.
FEWEST_FOR_ONE = 3


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
        """True if what is left of d^2 is what noise makes."""
        return self.p_left >= EXPLAINS


@dataclass(frozen=True, eq=False)
class Causes(ReadOnlyArrays):
    """All causes, the most probable first, and what can be concluded."""

    all: tuple[Cause, ...]

    @property
    def named(self) -> Cause | None:
        """The cause, if one has a clear lead and explains the change."""
        first = self.all[0]
        clear = first.probability >= CLEAR and first.explains and first.name != IMAGE_CENTRE
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
        names = {cause.name for cause, total in of_each if total < CLEAR_SET or self._near(cause)}
        names |= {CAMERA_MOVED} if IMAGE_CENTRE in names else set()
        return tuple(cause for cause in self.all if cause.name in names)

    def _near(self, cause: Cause) -> bool:
        """Return whether a cause leaves hardly more than the first, each without what chance takes away."""
        left, first = (one.deviance + len(one.estimate) for one in (cause, self.all[0]))
        return left - first < LEAD

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

    def add(name: str, C: Array, more: float = 0.0, row: int | None = None) -> None:
        of = evidence.explained_by(C)
        left, p = max(d2 - of.gain, 0.0), C.shape[-1]
        p_left = reference.p_value(left, N - p) if p < N else 1.0
        deviance = reference.deviance(left)
        bic = deviance + p * float(np.log(N)) + more
        found.append((bic, Cause(name, of.estimate, of.covariance, of.gain, p_left, 0.0, deviance, row)))

    for name, C in columns.items():
        add(name, C)
    m = len(evidence.r)
    if m >= FEWEST_FOR_ONE:
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
    """(m,) squared distance of each measurement from what all others predict of it."""
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


# Findings that say that the files are misread, or of another rig.
MISREAD = ("maintenance.misread", "maintenance.pairing", "maintenance.another_rig")
# d^2 per number from which the files are doubted, and its share that another reading may leave.
GROSS, LEFT = 25.0, 0.01
# Also in doubt, where errors of lengths in a wrong unit hide the contradiction: poses that are so far off (`_rough`). A
# reading then has to agree, with d^2 per number below.
FAR, AGREES = 1.0, 2.0
# Poses up to which all pairings are tried.
MOST_PAIRED = 200

# Rows by which one file may begin before the other.
MOST_ROWS = 3
# A factor on translations that differs from 1 by less is a cause among others (`causes`); more so where the focal
# length explains the poses.
SMALL_FACTOR, LENS = 0.03, 0.2

Judge = Callable[..., float]  # poses, and which rows they are of those that were given


def misread(
    X: Array, W: Array, poses: PosePairs, evidence: NewRows, d2_of: Judge, *, least_factor: float = SMALL_FACTOR
) -> Finding | None:
    """Return how else the files may be meant, where that explains a gross contradiction; ``d2_of`` judges poses.

    Factors on translations that differ from 1 by less than ``least_factor`` are not tried.
    """
    d2, as_given = evidence.d2, _rough(X, W, poses.robot, poses.camera, poses.setup)
    if d2 < GROSS * evidence.dof and as_given < FAR:
        return None
    limit = max(LEFT * d2, AGREES * evidence.dof if as_given > FAR else 0.0)
    bare = replace(poses, camera_calibration=None, camera_covariance=None, timing=None, truth=None)
    fits = [
        (found, reading)
        for reading, robot, camera in _readings(bare)
        if _rough(X, W, robot, camera, poses.setup) <= 0.3 * as_given
        and (found := d2_of(replace(bare, robot=robot, camera=camera))) < limit
    ]
    if fits:
        return Finding("maintenance.misread", "caution", min(fits, key=lambda fit: fit[0])[1])
    for side, factor in _factors(X, W, poses).items():
        if abs(factor - 1.0) > least_factor and factor > 0:
            scaled: Any = {side: _scaled(getattr(bare, side), factor)}
            if d2_of(replace(bare, **scaled)) < max(limit, AGREES * evidence.dof):
                return scale_finding(side, factor)
    order = _pairing(X, W, bare, evidence)
    if order is not None and d2_of(replace(bare, camera=bare.camera[order])) < LEFT * d2:
        rows = np.flatnonzero(order != np.arange(len(order)))
        values = {"rows": rows.tolist()[:10], "count": len(rows), "n": poses.n}
        return Finding("maintenance.pairing", "caution", values)
    for shift in (k for size in range(1, MOST_ROWS + 1) for k in (size, -size) if poses.n - size > 1):
        rows = np.arange(max(0, -shift), poses.n - max(0, shift))
        part = replace(bare.rows(rows), camera=bare.camera[rows + shift])
        if d2_of(part, rows) / part.n < LEFT * d2 / poses.n:
            return Finding("maintenance.misread", "caution", {"kind": "rows", "file": None, "shift": shift})
    return None


def scale_finding(side: str, factor: float) -> Finding:
    """Return what is said of poses that agree once the translations of one side are multiplied by a factor."""
    return Finding("maintenance.misread", "caution", {"kind": "scale", "file": side, "factor": factor})


def _readings(poses: PosePairs) -> list[tuple[dict[str, Any], Array, Array]]:
    G, C = poses.robot, poses.camera
    found: list[tuple[dict[str, Any], Array, Array]] = [
        ({"kind": "inverse", "file": "robot"}, inverse(G), C),
        ({"kind": "inverse", "file": "camera"}, G, inverse(C)),
        ({"kind": "inverse", "file": None}, inverse(G), inverse(C)),
        ({"kind": "swapped", "file": None}, C, G),
        *rotation_readings(G, C),
    ]
    for unit in ("mm", "cm", "in"):
        for factor, given, meant in ((LENGTH_UNITS[unit], "m", unit), (1.0 / LENGTH_UNITS[unit], unit, "m")):
            robot, camera = _scaled(G, factor), _scaled(C, factor)
            found += [
                ({"kind": "unit", "file": "robot", "unit": meant, "given": given}, robot, C),
                ({"kind": "unit", "file": "camera", "unit": meant, "given": given}, G, camera),
                ({"kind": "unit", "file": None, "unit": meant, "given": given}, robot, camera),
            ]
    return found


def _factors(X: Array, W: Array, poses: PosePairs) -> dict[str, float]:
    """The factor on the translations of each side that fits best: ``s_G t_G + R_G t_X + s_C R_G R_X t_C = t_W``."""
    G = poses.effective_robot
    moved, seen, bracket = G[:, :3, 3], ((G @ X)[:, :3, :3] @ poses.camera[:, :3, 3:])[..., 0], G[:, :3, :3] @ X[:3, 3]
    of = {"camera": (seen, W[:3, 3] - moved - bracket), "robot": (moved, W[:3, 3] - seen - bracket)}
    return {
        side: float(np.sum(part * meant) / max(float(np.sum(part**2)), 1e-300)) for side, (part, meant) in of.items()
    }


def _rough(X: Array, W: Array, robot: Array, camera: Array, setup: str) -> float:
    """Sum of rotation (rad) and translation (in distances of the camera) that ``G X C`` differs from W by, median."""
    G = inverse(robot) if setup == "eye-to-hand" else robot
    left = G @ X @ camera
    turn = np.linalg.norm(logarithm(left[:, :3, :3] @ W[:3, :3].T), axis=-1)
    shift = np.linalg.norm(left[:, :3, 3] - W[:3, 3], axis=-1)
    size = np.linalg.norm((inverse(X) @ inverse(G) @ W)[:, :3, 3], axis=-1)
    return float(np.median(turn + shift / np.maximum(size, 1e-9)))


def _pairing(X: Array, W: Array, poses: PosePairs, evidence: NewRows) -> Array | None:
    """The order of the camera rows that fits the robot rows best, if it is another."""
    m = poses.n
    if not 2 <= m <= MOST_PAIRED:
        return None
    G = inverse(poses.robot) if poses.setup == "eye-to-hand" else poses.robot
    both = (G @ X)[:, None] @ poses.camera[None]
    turn = np.linalg.norm(logarithm(both[..., :3, :3] @ W[:3, :3].T), axis=-1)
    shift = np.linalg.norm(both[..., :3, 3] - W[:3, 3], axis=-1)
    S = evidence.own.mean(axis=0)
    cost = turn**2 / np.trace(S[:3, :3]) + shift**2 / np.trace(S[3:, 3:])
    order = linear_sum_assignment(np.minimum(cost, 1e4 * np.median(cost)))[1]
    return None if (order == np.arange(m)).all() else np.asarray(order)


def _scaled(T: Array, factor: float) -> Array:
    result = T.copy()
    result[:, :3, 3] *= factor
    return result
