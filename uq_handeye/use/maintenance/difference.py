"""`difference`: two results of one rig, their difference with its covariance, whether chance explains it,
and that in words.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from scipy.special import chdtrc, fdtrc

from ...calibration.estimate.estimated import distance_of
from ...calibration.prediction.predict import poses_so_far
from ...calibration.result import Calibration
from ...core.files.records import Record
from ...core.formatting.numbers import concise, digits, probability
from ...core.geometry.se3 import Array, logarithm
from ...core.presentation.document import Answer, Block, Document, Paragraph, document_of
from ...core.presentation.shown import Shown
from ...errors import InputError, require_type
from ...fit.diagnostics.task_space import by_pose
from ...fit.likelihood.goodness_of_fit import Reference
from ...model.poses.pose_pairs import PosePairs
from ...model.posterior.owners import CAMERA, ROBOT, THINGS, checked_things, require_same
from .in_common import difference_covariance, positive
from .joined_poses import common_poses, counted, holds_request, measured_poses, with_bound_poses
from .update import parts_of, touches_taken

# Directions of a difference whose variance is below this share of that of the two results are not tested: rounding.
NOTHING = 1e-9
# How the covariance of a difference was made.
POSTERIOR, INNOVATION, INDEPENDENT, EQUAL = "posterior", "innovation", "independent", "equal"


@dataclass(frozen=True, eq=False)
class Difference(Record, Shown):
    """New minus old, ``R_new = exp([theta]x) R_old``, ``t_new = t_old + tau``, of X and of W (rad, m; parent frames).

    Attributes
    ----------
    xi : (12,)
        Of X, then of W; of X only, (6,), where one of the results has no covariance of W.
    covariance : (12, 12) or (6, 6)
        What both results were made of counts once.
    how : str
        "posterior": both posteriors and what they have from one source (`in_common`); "innovation": ``C_old - C_new``,
        where one result holds the data of the other, not its poses, and no size of an error was estimated;
        "independent": the sum of both, which is assumed; "equal": one and the same result.
    common : int
        Number of poses that both hold.
    same : tuple of str
        Which of robot, camera and target counted as the same in both.
    n_poses : tuple of int or None
        Of old and new.
    methods : tuple of str
        Of old and new.
    frame, frame_W : str
        Those of X and W.
    point : (3,)
        In the camera frame, m: as far ahead as the target was.
    lever : (3, 6)
        How that point moves, in the parent frame of X, with xi of X.
    scale : (12, 12) or (6, 6)
        Covariance of old plus new, by which rounding is told.
    dof : float or None
        Degrees of freedom of the noise that was estimated; None: it was given.
    """

    _in_file: ClassVar[str] = (
        "frame frame_W difference=xi covariance p_value_X p_value_W p_value at_target=_at_target how "
        "common_poses=common same n_poses methods"
    )

    xi: Array
    covariance: Array
    how: str
    common: int
    same: tuple[str, ...]
    n_poses: tuple[int | None, int | None]
    methods: tuple[str, str]
    frame: str
    frame_W: str
    point: Array
    lever: Array
    scale: Array  # covariance of old plus new, by which rounding is told
    dof: float | None

    @property
    def d2(self) -> float:
        """``xi^T covariance^-1 xi`` of X alone, along what may differ."""
        return self._test(slice(0, 6))[0]

    @cached_property
    def p_value_X(self) -> float:
        """Probability of a difference of X at least as large if nothing changed; 1 for equal results."""
        return self._p_value(slice(0, 6))

    @cached_property
    def p_value_W(self) -> float | None:
        """Probability of a difference of W at least as large; None where W has no covariance."""
        return None if len(self.xi) < 12 else self._p_value(slice(6, 12))

    @cached_property
    def p_value(self) -> float:
        """Probability of a difference of X and W together at least as large."""
        return self._p_value(slice(0, len(self.xi)))

    @property
    def std(self) -> Array:
        """(12,) or (6,) standard deviations of `xi`."""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))

    @property
    def at_target(self) -> tuple[Array, Array]:
        """Move (3,) of the point at the target and its covariance (3, 3), m, in the parent frame of X."""
        return self.lever @ self.xi[:6], self.lever @ self.covariance[:6, :6] @ self.lever.T

    @property
    def _at_target(self) -> dict[str, Array]:
        return dict(zip(("point", "move", "covariance"), (self.point, *self.at_target), strict=True))

    def _p_value(self, part: slice) -> float:
        d2, k = self._test(part)
        if k == 0:
            return 1.0
        return float(chdtrc(k, d2)) if self.dof is None else float(fdtrc(k, self.dof, d2 / k))

    def _test(self, part: slice) -> tuple[float, int]:
        """d^2 and the number of directions along which the results may differ."""
        L = np.linalg.cholesky(self.scale[part, part])
        inner = np.linalg.solve(L, np.linalg.solve(L, self.covariance[part, part]).T)
        values, vectors = np.linalg.eigh(0.5 * (inner + inner.T))
        along = vectors.T @ np.linalg.solve(L, self.xi[part])
        free = values > NOTHING
        return float(np.sum(along[free] ** 2 / values[free])), int(free.sum())


def difference(old: Calibration, new: Calibration, *, same: Sequence[str] | str = ()) -> Difference:
    """Return how far two results of one rig differ, with the covariance of the difference.

    Parameters
    ----------
    old, new : Calibration
        Of the same setup and frames, with a covariance. Poses that both hold are found by their numbers.
    same : names out of "robot", "camera" and "target"
        What is one and the same in both, so that its errors (robot accuracy, focal length, size of the target) are one
        error and cancel in part. Known without being named where the results have poses in common.

    Raises
    ------
    InputError
        Another setup; results of motions without poses; no covariance; a part of X that is open.

    Examples
    --------
    >>> import uq_handeye as uq
    >>> noise = uq.PoseNoise.isotropic(camera=("1mrad", "0.5mm"))
    >>> poses = uq.simulate(n_poses=30, noise=noise, seed=2)
    >>> old, new = (uq.calibrate(poses.rows(range(n)), noise=noise) for n in (20, 30))
    >>> found = uq.difference(old, new)
    >>> found.how, found.common, bool(found.p_value_X > 0.01)
    ('posterior', 20, True)
    """
    for name, result in (("old", old), ("new", new)):
        _require_usable(name, result)
    if old.setup != new.setup:
        raise InputError(f"The old result is {old.frame}, the new one {new.frame}: X of two frames has no difference.")
    named = checked_things(same)
    old, new = with_bound_poses(old), with_bound_poses(new)
    data = [_poses_of(result) for result in (old, new)]
    common = [] if data[0] is None or data[1] is None else common_poses(data[0], data[1])
    numbers = 12 if old.covariance_W is not None and new.covariance_W is not None else 6
    C_old, C_new = (_covariance_of(result, numbers) for result in (old, new))
    _require_consistent(named if len(same) else None, old, new, data, len(common))
    known = frozenset(THINGS if common else {*named, *(_same_camera(data) or ())})
    held = old if _holds(new, old) else new if _holds(old, new) else None
    if _is_one(old, new):
        S, how = np.zeros((numbers, numbers)), EQUAL
    elif (
        numbers == 12
        and (common or held is None)
        and (found := difference_covariance(old, new, common, known)) is not None
    ):
        S, how = found, POSTERIOR
    elif held is not None and not any(map(_has_open_sizes, (old, new))):
        S, how = positive(C_old - C_new if held is old else C_new - C_old), INNOVATION
    else:
        S, how = C_old + C_new, INDEPENDENT
    count = len(common) or (0 if held is None else held.n_poses or 0)
    pairs = [(old.X, new.X)] + ([(old.W, new.W)] if numbers == 12 else [])
    xi = np.concatenate([np.r_[logarithm(b[:3, :3] @ a[:3, :3].T), b[:3, 3] - a[:3, 3]] for a, b in pairs])  # type: ignore[index]
    point = np.array([0.0, 0.0, distance_of(new.analysis)[0]])
    return Difference(
        xi,
        0.5 * (S + S.T),
        how,
        count,
        tuple(name for name in THINGS if name in known) if how == POSTERIOR else (),
        (old.n_poses, new.n_poses),
        (old.method, new.method),
        new.frame,
        new.frame_W,
        point,
        by_pose(new.X[:3, :3] @ point),
        C_old + C_new,
        _dof(old.reference, new.reference, len(common) == old.n_poses),
    )


def _require_usable(name: str, result: Any) -> None:
    require_type(name, result, Calibration, "a Calibration")
    if result.setup is None:
        raise InputError(f"The {name} result is of motions that came without poses: its frames are not known.")
    if result.covariance is None:
        raise InputError(f"The {name} result has no covariance: calibrate it with noise, or with more poses.")
    if result.opened is not None:
        raise InputError(f"The {name} result leaves a part of X open: it has no difference from another.")


def _poses_of(result: Calibration) -> PosePairs | None:
    if holds_request(result):
        return measured_poses(result).rows(counted(result))
    return poses_so_far(result)


def _require_consistent(
    named: frozenset[str] | None, old: Calibration, new: Calibration, data: list[PosePairs | None], common: int
) -> None:
    """Raise `InputError` where `same` contradicts what the results hold."""
    if named is None:
        return
    if common and named != frozenset(THINGS):
        raise InputError(
            f"The results have {common} poses in common, which are of one robot, one camera and one target: leave out "
            "`same` (--same)."
        )
    if not common:
        require_same(named, *data)
    chains = [of.kinematics.chain.to_dict() for of in (old, new) if of.kinematics is not None]
    if ROBOT in named and len(chains) == 2 and chains[0] != chains[1]:
        raise InputError(
            "Expected one robot, as `same` (--same) names it: the results have other kinematics. Leave the robot out "
            "of `same`."
        )


def _covariance_of(result: Calibration, numbers: int) -> Array:
    """(12, 12) of X and W together, or with zeros between them where they are known one by one."""
    assert result.covariance is not None
    if numbers == 6:
        return result.covariance
    if result.posterior is not None and result.covariance_kind == "model":
        return np.asarray(result.posterior.covariance[:12, :12])
    S = np.zeros((12, 12))
    S[:6, :6], S[6:, 6:] = result.covariance, result.covariance_W
    return S


def _same_camera(data: list[PosePairs | None]) -> set[str] | None:
    """The camera, where both have poses of one and the same calibration of it; None where that is not known."""
    seen = [None if poses is None else poses.camera_calibration for poses in data]
    if seen[0] is None or seen[1] is None:
        return None
    one, other = (cam.bundle.parameters for cam in seen if cam is not None)
    return {CAMERA} if np.array_equal(one, other) else set()


def _is_one(old: Calibration, new: Calibration) -> bool:
    if old is new:
        return True
    origins = [result.provenance and result.provenance.data_sha256 for result in (old, new)]
    same = np.array_equal(old.X, new.X) and np.array_equal(old.covariance, new.covariance)  # type: ignore[arg-type]
    return bool(origins[0] is not None and origins[0] == origins[1] and same)


def _holds(whole: Calibration, part: Calibration) -> bool:
    """Return whether a result was made of all data of another, by their hashes."""
    hashes = [{one["sha256"] for one in (*parts_of(result), *touches_taken(result))} for result in (whole, part)]
    return bool(hashes[1]) and hashes[1] < hashes[0]


def _has_open_sizes(result: Calibration) -> bool:
    """Return whether sizes of its errors were estimated: with more poses they and its weights are others."""
    return result.posterior is not None and result.posterior.points is not None


def _dof(old: Reference, new: Reference, inside: bool) -> float | None:
    """Degrees of freedom of the noise: of the new result where it holds all poses of the old, else of the fewer."""
    found = [reference.dof for reference in ((new,) if inside else (old, new)) if reference.dof is not None]
    return min(found) if found else None


# p-values below which a difference is said to be one, and to be clear.
DIFFERS, CLEARLY = 0.05, 0.001


@document_of.register
def difference_document(found: Difference) -> Document:
    """A sentence, the numbers of X and W, and what counted once."""
    lines: list[Block] = [_answer(found)]
    if found.how != "equal":
        lines += [Paragraph(text, hang="  ") for text in (*_pose(found, 0), _point(found))]
        if found.p_value_W is not None:
            lines += [Paragraph(text, hang="  ") for text in _pose(found, 6)]
    return [lines, [Paragraph(text) for text in _made_of(found)]]


def _answer(found: Difference) -> Answer:
    p = found.p_value_X
    if found.how == "equal":
        return Answer(f"{found.frame}: the two results are one: the difference is 0, and there is nothing to test.")
    if p < DIFFERS:
        clearly = "differ clearly" if p < CLEARLY else "differ"
        words = f"The results of {found.frame} {clearly}: by more than their uncertainty explains ({probability(p)})."
        return Answer(words, "caution")
    return Answer(f"The results of {found.frame} agree within their uncertainty ({probability(p, 2)}).")


def _pose(found: Difference, start: int) -> list[str]:
    """Two lines: translation in mm and rotation in deg."""
    frame, p = (found.frame, found.p_value_X) if start == 0 else (found.frame_W, found.p_value_W)
    xi, std = np.asarray(found.xi), np.asarray(found.std)
    parts = [_three("translation", 1e3 * xi[start + 3 : start + 6], 1e3 * std[start + 3 : start + 6], "mm")]
    parts.append(_three("rotation", np.degrees(xi[start : start + 3]), np.degrees(std[start : start + 3]), "deg"))
    assert p is not None
    return [f"{frame}, new minus old ({probability(p, 2)}):", *(f"  {part}" for part in parts)]


def _three(what: str, values: Array, std: Array, unit: str) -> str:
    numbers = [f"{axis} {concise(float(values[k]), float(std[k]))}" for k, axis in enumerate("xyz")]
    return f"{what} {', '.join(numbers)} {unit}; {digits(float(np.linalg.norm(values)), 2)} {unit} in all"


def _point(found: Difference) -> str:
    move, S = found.at_target
    size = float(np.linalg.norm(move))
    along = move / size if size > 0 else np.array([0.0, 0.0, 1.0])
    sd = float(np.sqrt(max(float(along @ S @ along), 0.0)))
    return (
        f"A point at the target, {digits(float(found.point[2]), 2)} m ahead of the camera, moves by "
        f"{concise(1e3 * size, 1e3 * sd, 'mm')}."
    )


def _made_of(found: Difference) -> list[str]:
    n_old, n_new = found.n_poses
    methods = "" if found.methods[0] == found.methods[1] else f" (methods {found.methods[0]} and {found.methods[1]})"
    poses = f"Old: {n_old} poses; new: {n_new} poses{methods}."
    if found.how == "equal":
        return [poses]
    if found.how == "innovation":
        return [f"{poses} One result holds all data of the other: what both hold counts once (C_old - C_new)."]
    if found.how == "independent":
        overlap = f" They share {found.common} poses, so that it is too large." if found.common else ""
        return [f"{poses} Assumed: the errors of both are independent, and the covariances add up.{overlap}"]
    if found.common:
        return [f"{poses} {found.common} poses are in both and count once, as do errors of robot, camera and target."]
    if found.same:
        rest = [name for name in ("robot", "camera", "target") if name not in found.same]
        others = f" Assumed: independent errors of {' and '.join(rest)}." if rest else ""
        return [f"{poses} No pose is in both. The same in both: {' and '.join(found.same)}.{others}"]
    return [f"{poses} No pose is in both. Assumed: independent errors, also of robot, camera and target."]
