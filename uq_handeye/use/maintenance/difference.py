"""Difference of two results of one rig that were made of different poses, with its covariance and its p-value."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from scipy.special import chdtrc, fdtrc

from ...calibration.estimated import distance_of
from ...calibration.evidence.same_things import CAMERA, ROBOT, THINGS, checked_things, require_same
from ...calibration.prediction.predict import poses_so_far
from ...calibration.result import Calibration
from ...core.files.records import Record
from ...core.geometry.se3 import Array, logarithm
from ...core.levels import CONTRADICTED, UNUSUAL
from ...core.presentation.document import Answer, Block, Document, Paragraph, document_of
from ...core.presentation.numbers import concise, digits, probability
from ...core.presentation.shown import Shown
from ...errors import InputError, require_type
from ...fit.diagnostics.task_space import by_pose
from ...model.poses.pose_pairs import PosePairs
from .in_common import difference_covariance
from .joined_poses import common_poses, counted, holds_request, measured_poses, with_bound_poses
from .update import parts_of, touches_taken

# How the covariance of a difference was made.
POSTERIOR, INDEPENDENT = "posterior", "independent"


@dataclass(frozen=True, eq=False)
class Difference(Record, Shown):
    """New minus old, ``R_new = exp([theta]x) R_old``, ``t_new = t_old + tau``, of X and of W (rad, m; parent frames).

    Attributes
    ----------
    xi : (12,)
        Of X, then of W; of X only, (6,), where one of the results has no covariance of W.
    covariance : (12, 12) or (6, 6)
        Errors that both have from one source count once.
    how : str
        "posterior": both posteriors and what they have from one source (`in_common`); "independent": the sum of both
        covariances, which is assumed.
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
    dof : float or None
        Degrees of freedom of the noise that was estimated; None: it was given.
    """

    _in_file: ClassVar[str] = (
        "frame frame_W difference=xi covariance p_value_X p_value_W p_value at_target=_at_target how same n_poses "
        "methods"
    )

    xi: Array
    covariance: Array
    how: str
    same: tuple[str, ...]
    n_poses: tuple[int | None, int | None]
    methods: tuple[str, str]
    frame: str
    frame_W: str
    point: Array
    lever: Array
    dof: float | None

    @property
    def d2(self) -> float:
        """``xi^T covariance^-1 xi`` of X alone."""
        return self._d2(slice(0, 6))

    @cached_property
    def p_value_X(self) -> float:
        """Probability of a difference of X at least as large if nothing changed."""
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

    def _d2(self, part: slice) -> float:
        return float(self.xi[part] @ np.linalg.solve(self.covariance[part, part], self.xi[part]))

    def _p_value(self, part: slice) -> float:
        d2, k = self._d2(part), part.stop - part.start
        return float(chdtrc(k, d2)) if self.dof is None else float(fdtrc(k, self.dof, d2 / k))


def difference(old: Calibration, new: Calibration, *, same: Sequence[str] | str = ()) -> Difference:
    """Return how far two results of one rig differ, with the covariance of the difference.

    Parameters
    ----------
    old, new : Calibration
        Of the same setup and frames, with a covariance, made of different poses.
    same : names out of "robot", "camera" and "target"
        What is one and the same in both, so that its errors (robot accuracy, focal length, size of the target) are one
        error and cancel in part.

    Raises
    ------
    InputError
        Results with poses in common; another setup; results of motions without poses; no covariance; a part of X that
        is open.

    Examples
    --------
    >>> import uq_handeye as uq
    >>> noise = uq.PoseNoise.isotropic(camera=("1mrad", "0.5mm"))
    >>> poses = uq.simulate(n_poses=30, noise=noise, seed=2)
    >>> old, new = (uq.calibrate(poses.rows(rows), noise=noise) for rows in (range(15), range(15, 30)))
    >>> found = uq.difference(old, new)
    >>> found.how, bool(found.p_value_X > 0.01)
    ('posterior', True)
    """
    for name, result in (("old", old), ("new", new)):
        _require_usable(name, result)
    if old.setup != new.setup:
        raise InputError(f"The old result is {old.frame}, the new one {new.frame}: X of two frames has no difference.")
    named = checked_things(same)
    old, new = with_bound_poses(old), with_bound_poses(new)
    data = [_poses_of(result) for result in (old, new)]
    _require_other_poses(old, new, data)
    if len(same):
        _require_consistent(named, old, new, data)
    # W of a scene is that of a frame which each run of its pictures has of its own
    of_scene = any(getattr(result.data, "scene", None) is not None for result in (old, new))
    numbers = 12 if old.covariance_W is not None and new.covariance_W is not None and not of_scene else 6
    known = named | _same_camera(data)
    S = difference_covariance(old, new, known) if numbers == 12 else None
    how = INDEPENDENT if S is None else POSTERIOR
    if S is None:
        S = _covariance_of(old, numbers) + _covariance_of(new, numbers)
    pairs = [(old.X, new.X)] + ([(old.W, new.W)] if numbers == 12 else [])
    xi = np.concatenate([np.r_[logarithm(b[:3, :3] @ a[:3, :3].T), b[:3, 3] - a[:3, 3]] for a, b in pairs])  # type: ignore[index]
    point = np.array([0.0, 0.0, distance_of(new.analysis)[0]])
    return Difference(
        xi,
        S,
        how,
        tuple(name for name in THINGS if name in known) if how == POSTERIOR else (),
        (old.n_poses, new.n_poses),
        (old.method, new.method),
        new.frame,
        new.frame_W,
        point,
        by_pose(new.X[:3, :3] @ point),
        min((dof for of in (old, new) if (dof := of.reference.dof) is not None), default=None),
    )


def _require_usable(name: str, result: Calibration) -> None:
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


def _require_other_poses(old: Calibration, new: Calibration, data: list[PosePairs | None]) -> None:
    """Raise `InputError` where the results have poses or touches in common, by their numbers or by their hashes."""
    before, now = data
    count = 0 if before is None or now is None else len(common_poses(before, now))
    hashes = [{one["sha256"] for one in (*parts_of(result), *touches_taken(result))} for result in (old, new)]
    if old is new or count or hashes[0] & hashes[1]:
        what = f"{count} poses" if count else "data"
        raise InputError(
            f"The results have {what} in common, so that their difference tests nothing. Calibrate each from its own "
            "poses, or test new poses against the old result: uq-handeye check, and uq-handeye update to add them."
        )


def _require_consistent(
    named: frozenset[str], old: Calibration, new: Calibration, data: list[PosePairs | None]
) -> None:
    """Raise `InputError` where `same` contradicts what the results hold."""
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


def _same_camera(data: list[PosePairs | None]) -> frozenset[str]:
    """Return the camera, where both have poses of one and the same calibration of it."""
    first, second = (None if poses is None else poses.camera_calibration for poses in data)
    if first is None or second is None or not np.array_equal(first.bundle.parameters, second.bundle.parameters):
        return frozenset()
    return frozenset({CAMERA})


@document_of.register
def difference_document(found: Difference) -> Document:
    """A sentence, the numbers of X and W, and what counted once."""
    lines: list[Block] = [_answer(found)]
    lines += [Paragraph(text, hang="  ") for text in (*_pose(found, 0), _point(found))]
    if found.p_value_W is not None:
        lines += [Paragraph(text, hang="  ") for text in _pose(found, 6)]
    return [lines, [Paragraph(text) for text in _made_of(found)]]


def _answer(found: Difference) -> Answer:
    p = found.p_value_X
    if p < UNUSUAL.probability:
        clearly = "differ clearly" if p < CONTRADICTED.probability else "differ"
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
    if found.how == INDEPENDENT:
        return [f"{poses} Assumed: the errors of both are independent, and the covariances add up."]
    rest = [name for name in THINGS if name not in found.same]
    if not found.same:
        return [f"{poses} Assumed: independent errors, also of robot, camera and target."]
    others = f" Assumed: independent errors of {' and '.join(rest)}." if rest else ""
    return [f"{poses} The same in both: {' and '.join(found.same)}.{others}"]
