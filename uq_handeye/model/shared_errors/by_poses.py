"""Columns of errors that follow from poses, which a file therefore need not hold.

The effect of most errors on the poses is a function of these: that of a focal length, of the view, of a drift, of the
accuracy of an unknown arm. With the poses that they were bound to and the poses at which they were taken, a reader
computes the same columns; `JointCovariance` then has them as before.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ...core.files.json_values import JsonObject
from ...core.geometry.se3 import Array
from ...core.read_only import ReadOnlyArrays
from ..errors.columns import relative_difference, some_rows
from ..errors.joint_covariance import JointCovariance
from ..errors.key import ErrorKey
from ..poses.pose_pairs import PosePairs
from .assumed import assumed_drift, bound_again, error_by_number
from .shared_error import SharedError

# Columns follow from the poses where they agree with those of the fit to this share of the largest number: those of the
# fit are at poses before their corrections were rounded.
MAX_COLUMN_DIFFERENCE = 1e-9


@dataclass(frozen=True, eq=False)
class ColumnsByPoses(ReadOnlyArrays):
    """The poses from which columns follow, and the standard deviations of the numbers of the errors."""

    bound: PosePairs  # that the errors were bound to
    at: PosePairs  # as the fit corrected them
    sd: Mapping[ErrorKey, float]
    reach: float | None = None  # (m) of the robot that its errors were bound with

    @cached_property
    def _drifts(self) -> dict[ErrorKey, SharedError]:
        return {error.key: error for error in assumed_drift(self.bound)}

    def of(self, keys: tuple[ErrorKey, ...]) -> Array | None:
        """Return the columns (n, 6, k) of numbers of one error; None where they do not follow from the poses."""
        key = keys[0].error
        if not self.sd.keys() >= set(keys):
            return None
        error = bound_again(key, self.bound, self.reach) or self._drifts.get(key)
        if error is None and (known := error_by_number(keys[0])) is not None:
            error = known[0].bound(self.bound)
        if error is None or not set(keys) <= set(error.keys):
            return None
        of = [error.keys.index(one) for one in keys]
        return np.asarray(error.at(self.at)[..., of] * np.array([self.sd[one] for one in keys]))

    def shortened(self, S: JointCovariance, written: JsonObject) -> JsonObject:
        """Return ``written``, the plain values of S without columns, with those that do not follow from poses."""
        kept, groups = np.ones(S.columns.shape[-1], dtype=bool), []
        for error in dict.fromkeys(key.error for key in S.keys if key is not None):
            of = [j for j, key in enumerate(S.keys) if key is not None and key.error == error]
            F = S.some(of)
            again = self.of(tuple(key for key in S.keys if key is not None and key.error == error))
            if again is not None and again.shape == F.shape and relative_difference(F, again) <= MAX_COLUMN_DIFFERENCE:
                kept[of] = False
                groups.append(error.to_dict())
        rest = some_rows(S.some(np.flatnonzero(kept)), slice(None)).tolist()
        keys: JsonObject = {"keys": [None if key is None else key.to_dict() for key in S.keys]} if any(S.keys) else {}
        return written | {"shared": rest} | keys | ({"by_poses": groups} if groups else {})

    def completed(self, written: Mapping[str, Any]) -> dict[str, Any]:
        """Return the plain values of a joint covariance with the columns that `shortened` left out."""
        groups = [ErrorKey.from_dict(key) for key in written["by_poses"]]
        keys = [None if key is None else ErrorKey.from_dict(key) for key in written["keys"]]
        rest = np.moveaxis(np.asarray(written["shared"], dtype=float).reshape(self.bound.n, 6, -1), -1, 0)
        columns: list[Any] = [None] * len(keys)
        for error in groups:
            of = [j for j, key in enumerate(keys) if key is not None and key.error == error]
            again = self.of(tuple(key for key in keys if key is not None and key.error == error))
            if again is None:
                raise ValueError(f"the columns of the error {str(error)!r} do not follow from the poses")
            for j, column in zip(of, np.moveaxis(again, -1, 0), strict=True):
                columns[j] = column
        written_ones = [j for j, column in enumerate(columns) if column is None]
        for j, column in zip(written_ones, rest, strict=True):
            columns[j] = column
        return {**written, "shared": np.stack(columns, axis=-1)}
