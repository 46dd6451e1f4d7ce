"""Addition of shared errors to the noise of poses, their removal, and the errors of an arm as shared errors."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import compress
from typing import Any

import numpy as np

from ..errors.columns import MANY_POSES, Columns, some_rows
from ..errors.joint_covariance import JointCovariance
from ..errors.key import ErrorKey, Kind
from ..errors.models import PoseNoise, is_joint, require_count
from ..errors.term import ErrorTerm
from ..poses.pose_pairs import PosePairs
from ..poses.timing import SIDES
from .shared_error import SharedError, the_same


def settled_errors(
    errors: Iterable[SharedError], sizes: Mapping[ErrorKey, float], poses: PosePairs
) -> tuple[SharedError, ...]:
    """Return errors, bound to poses, with the standard deviations of their numbers that a calibration of these settled
    on; those that it left out are none.
    """
    return tuple(
        replace(error, sd=np.array([sizes[key] for key in error.keys]), factor=1.0)
        for error in (error.bound(poses) for error in errors)
        if sizes.keys() >= set(error.keys)
    )


def shared_columns(errors: Sequence[SharedError], poses: PosePairs) -> dict[str, JointCovariance]:
    """Return the effect of the errors on the poses by side: a covariance without noise of its own."""
    found: dict[str, JointCovariance] = {}
    for side in SIDES:
        of_side = [error for error in errors if error.side == side and not error.is_exact]
        if of_side:
            sd = np.concatenate([error.sd for error in of_side])
            F = Columns.of([error.factor_at(poses) for error in of_side], sd).some(np.flatnonzero(sd))
            keys = (key for error in of_side for key in error.keys)
            each = F.rows(slice(None)) if poses.n <= MANY_POSES else F
            found[side] = JointCovariance(np.zeros((poses.n, 6, 6)), each, tuple(compress(keys, sd > 0)))
    return found


def with_shared(noise: PoseNoise, columns: Mapping[str, JointCovariance]) -> PoseNoise:
    """Return the noise with the `shared_columns` added to each side."""
    sides = {side: add_columns(getattr(noise, side), columns.get(side)) for side in SIDES}
    return replace(noise, robot=sides["robot"], camera=sides["camera"])


def without_shared(noise: PoseNoise, errors: Sequence[SharedError]) -> PoseNoise:
    """The noise without the columns of these errors."""
    keys = {key for error in errors for key in error.keys}

    def remaining(S: Any) -> Any:
        if not isinstance(S, JointCovariance):
            return S
        kept = np.array([key is None or keys.isdisjoint((key, key.error)) for key in S.keys])
        if kept.all():
            return S
        if not kept.any():
            return S.own if S.own.any() else None
        return JointCovariance(S.own, S.some(np.flatnonzero(kept)), tuple(compress(S.keys, kept)))

    return replace(noise, robot=remaining(noise.robot), camera=remaining(noise.camera))


def add_columns(covariance: Any, columns: JointCovariance | None) -> Any:
    """A covariance of n poses, or None, with the columns."""
    if columns is None:
        return covariance
    if covariance is None:
        return columns
    require_count(covariance, columns.n, "of a side with shared errors", "poses")
    if isinstance(covariance, JointCovariance):
        return covariance.plus(columns)
    if is_joint(covariance):
        return np.asarray(covariance) + np.asarray(columns)
    return columns.plus(np.broadcast_to(covariance, (columns.n, 6, 6)))


def errors_of_arm(terms: Iterable[ErrorTerm], deviations: Mapping[Kind, float]) -> tuple[SharedError, ...]:
    """Return the groups of errors of an arm with one standard deviation each (rad or m).

    An estimate is that of the arm, ``true - model``: measured poses have the opposite error, which is in the columns.
    """
    return tuple(
        SharedError(
            part.key,
            part.size.unit,
            "robot",
            np.full(part.count, deviations[part.key.kind]),
            part.keys,
            the_same(some_rows(part.columns, slice(None))),
        )
        for part in terms
        if part.columns is not None
    )
