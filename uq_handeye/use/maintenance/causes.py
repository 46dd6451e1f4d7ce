"""Causes of a change: each is estimated by generalised least squares, and those that can be separated are named.

A cause with the columns C (p numbers a, ``E r = C a``) takes ``gain`` from d^2. Its probability, if exactly one of them
has happened, is proportional to its prior probability times the mean over sizes D of

    exp(-deviance(r^T (Sigma + C D^2 C^T)^-1 r) / 2) / sqrt(det(1 + D C^T Sigma^-1 C D)),        a ~ N(0, D^2)

with the deviance of `reference` (Jeffreys 1961, section 5.2; Kass and Raftery 1995, J. Am. Stat. Assoc. 90, 773). The
sizes D (`prior_sizes`) are those that happen in a lab, one as likely as the other. A bracket that slips, often along
one axis, and a board that is pushed are common; a fixed lens keeps its focal length unless it was turned. The first is
named if its probability is at least `MIN_PROBABILITY_NAMED`, and every other has a larger ``deviance + p``, with p the
expected decrease by chance: fewer parameters of the first are not enough. Otherwise all that together have
`MIN_PROBABILITY_OF_SET` are returned as a set, without those below `MIN_PROBABILITY_LISTED`.

Two pairs of causes are the same whatever the poses: a move of the robot's base and of the part fixed in the cell
(target, eye-in-hand; camera, eye-to-hand), and a move of the robot's tool and of the part that it carries. An image
centre that changed is, to first order, a camera that rotated about its own x and y axes: it is never named without X.
One pose cannot separate X from W.

- *X*: ``-J_X delta``, *target*: ``-J_W delta``: the true pose is the estimate moved by delta.
- *focal length*, *image centre*: the true value moved from that used by e: ``-D_C F e`` (`shared_error`).
- *target size*: likewise, of the scale of all translations of the camera poses. With the target in the middle of the
  picture it is the same as the focal length.
- *one pose*: only one of the poses is an outlier, by a wrong detection or robot pose; tested from three poses on.

Of a rig each camera, target and base has causes of its own, of the same columns and probabilities: it is named in
``of``. One view takes the place of one pose.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from scipy.special import logsumexp

from ...calibration.evidence.new_poses import PoseEvidence
from ...core.files.records import Record, read
from ...core.geometry.se3 import Array
from ...core.levels import CONTRADICTED
from ...core.read_only import ReadOnlyArrays
from ...fit.graph.rows import NewRows, PredictiveReference
from ...model.errors import keys
from ...model.poses.pose_pairs import PosePairs
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
# A cause that is less probable is not listed.
MIN_PROBABILITY_LISTED = 0.01
# A cause is named only if all others have this much more of deviance + p.
MIN_DEVIANCE_LEAD = 1.0

# Prior probabilities of causes in a lab, if one has happened.
PRIORS = {
    CAMERA_MOVED: 0.50,
    TARGET_MOVED: 0.42,
    ONE_POSE: 0.06,
    FOCAL_LENGTH: 0.015,
    IMAGE_CENTRE: 0.003,
    TARGET_SIZE: 0.002,
}
# Standard deviations of the numbers of a cause, one as likely as the other; of moves angle (deg) and shift (mm). A
# bracket slips by less than a board is pushed.
MOVES = {
    CAMERA_MOVED: tuple(product((0.03, 0.3, 3.0), (0.3, 1.0, 3.0, 10.0, 100.0))),
    TARGET_MOVED: tuple(product((0.05, 0.5, 5.0), (1.0, 5.0, 20.0, 100.0))),
}
WRONG_POSES = tuple(product((1.0, 10.0), (10.0, 100.0)))
RATIOS = {FOCAL_LENGTH: (0.005, 0.02), TARGET_SIZE: (0.005, 0.02, 0.1), IMAGE_CENTRE: (1e-3, 3e-3, 1e-2)}
# A part that slides on a face or in a slot: by these lengths (m).
SLIDES_M = (1e-3, 5e-3)


def _of_move(angle: float, shift: float) -> Array:
    return np.diag([np.radians(angle)] * 3 + [1e-3 * shift] * 3)


def prior_sizes(name: str, R: Array | None = None) -> list[Array]:
    """Return the factors D (p, k) of the prior covariances D D^T of a cause.

    ``R`` (3, 3): axes of a part that may slide: a camera along one of its axes, a target in its plane.
    """
    if name in RATIOS:
        return [size * np.eye(2 if name == IMAGE_CENTRE else 1) for size in RATIOS[name]]
    free = [_of_move(*pair) for pair in MOVES.get(name, WRONG_POSES)]
    if R is None:
        return free
    # a part that slides hardly moves otherwise: standard deviations in rad and m
    stays, along = np.diag([2e-4] * 3 + [5e-5] * 3), np.concatenate([np.zeros((3, 3)), R])
    groups = ([0], [1], [2]) if name == CAMERA_MOVED else ([0, 1],)
    return free + [np.concatenate([stays, s * along[:, axes]], axis=1) for s in SLIDES_M for axes in groups]


@dataclass(frozen=True, eq=False)
class Cause(Record):
    """One possible cause, as estimated by itself."""

    _in_file: ClassVar[str] = "name of estimate covariance gain p_left probability deviance row"
    _if_any: ClassVar[str] = "of"

    name: str
    # rad and m; true over used, minus 1, of focal length and target size; rad for the image centre
    estimate: Annotated[Array, "p"]
    covariance: Annotated[Array, "p", "p"]
    gain: float  # by how much d^2 falls
    p_left: float  # p-value of what is left of d^2
    probability: float  # among the causes that are compared
    deviance: float  # what is left
    row: int | None = None  # of one pose: which
    of: str = ""  # camera, target or base of a rig, or the view

    @property
    def label(self) -> str:
        """Name for data: that of what moved in a rig, else the cause, in a rig with its part."""
        moved = self.name in (CAMERA_MOVED, TARGET_MOVED)
        return self.name if not self.of else self.of if moved else f"{self.name} {self.of}"

    @property
    def explains(self) -> bool:
        """True if the rest of d^2 is explained by noise."""
        return self.p_left >= CONTRADICTED.probability


@dataclass(frozen=True, eq=False)
class Causes(ReadOnlyArrays):
    """All causes, the most probable first, and what can be concluded."""

    all: tuple[Cause, ...]

    def to_dict(self) -> list[Any]:
        """Return plain values of all causes."""
        return [cause.to_dict() for cause in self.all]

    @classmethod
    def from_dict(cls, data: Any) -> Causes:
        """Read what `to_dict` wrote."""
        return cls(read(tuple[Cause, ...], data, "causes"))

    @property
    def named(self) -> Cause | None:
        """The cause, if one has a clear lead and explains the change."""
        first = self.all[0]
        clear = first.probability >= MIN_PROBABILITY_NAMED and first.explains and first.name != IMAGE_CENTRE
        others = [cause for cause in self.all[1:] if cause.probability >= MIN_PROBABILITY_LISTED]
        return first if clear and not any(map(self._near, others)) else None

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
        found = [cause for cause, total in of_each if total < MIN_PROBABILITY_OF_SET or self._near(cause)]
        listed = {(one.name, one.of) for one in found if one.probability >= MIN_PROBABILITY_LISTED}
        listed |= {(CAMERA_MOVED, of) for name, of in listed if name == IMAGE_CENTRE}
        return tuple(cause for cause in self.all if (cause.name, cause.of) in listed)

    def _near(self, cause: Cause) -> bool:
        """Return whether a cause leaves hardly more than the first, each without what chance takes away."""
        left, first = (one.deviance + len(one.estimate) for one in (cause, self.all[0]))
        return left - first < MIN_DEVIANCE_LEAD

    def __getitem__(self, name: str) -> Cause:
        return next(cause for cause in self.all if cause.name == name)


class Candidate(NamedTuple):
    """One of the causes that are compared."""

    name: str
    columns: Array  # (m, k, p)
    axes: Array | None = None  # (3, 3) of a part that may slide
    choices: int = 1  # as many causes of this kind share the prior probability
    of: str = ""
    row: int | None = None


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


def candidates_of_poses(evidence: NewRows, columns: Mapping[str, Array], axes: Mapping[str, Array]) -> list[Candidate]:
    """Return the causes of one camera; ``axes``: those (3, 3) of camera and target, by their causes."""
    candidates = [Candidate(name, C, axes.get(name)) for name, C in columns.items()]
    m = len(evidence.r)
    if m >= 3:  # one wrong pose can be separated from a change
        row, C = _most_outlying(evidence)
        candidates.append(Candidate(ONE_POSE, C, choices=m, row=row))
    return candidates


def compare_candidates(
    evidence: NewRows, candidates: Sequence[Candidate], reference: PredictiveReference, dof: int
) -> Causes:
    """Estimate each candidate by itself, and compare them; ``dof``: of d^2."""
    d2 = evidence.d2
    found: list[tuple[float, Cause]] = []
    for one in candidates:
        by = evidence.explained_by(one.columns)
        left, p = max(d2 - by.gain, 0.0), one.columns.shape[-1]
        p_left = reference.p_value(left, dof - p) if p < dof else 1.0
        sizes = prior_sizes(one.name, one.axes)
        log_evidence = _log_evidence(evidence, reference, sizes, one.columns, by.estimate)
        log_evidence += float(np.log(PRIORS[one.name] / one.choices))
        deviance = reference.deviance(left)
        cause = Cause(one.name, by.estimate, by.covariance, by.gain, p_left, 0.0, deviance, one.row, one.of)
        found.append((log_evidence, cause))
    found.sort(key=lambda one: -one[0])
    weight = np.exp(np.array([log_evidence for log_evidence, _ in found]) - found[0][0])
    weight = weight / weight.sum()
    return Causes(tuple(
        replace(c, probability=float(w))
        for (_, c), w in zip(found, weight, strict=True)
    ))  # fmt: skip


def _log_evidence(
    evidence: NewRows, reference: PredictiveReference, sizes: Sequence[Array], C: Array, estimate: Array
) -> float:
    """Return the logarithm of the evidence of a cause (see the module), up to a constant of all."""
    information = evidence.information(C)
    pull, logs = information @ estimate, []
    for D in sizes:
        M, z = np.eye(D.shape[1]) + D.T @ information @ D, D.T @ pull
        left = max(evidence.d2 - float(z @ np.linalg.solve(M, z)), 0.0)
        logs.append(-0.5 * reference.deviance(left) - 0.5 * float(np.linalg.slogdet(M)[1]))
    return float(logsumexp(logs)) - float(np.log(len(logs)))


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
