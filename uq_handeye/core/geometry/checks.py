"""Checks of arrays and rigid transforms given by a caller: shapes, finite numbers, valid rotations."""

from __future__ import annotations

from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from .se3 import Array

# max |R^T R - I| of an accepted rotation. A matrix printed with four decimals (entries within 5e-5, so
# |R^T R - I| <= 2 sqrt(3) 5e-5) passes; accepted matrices are used as they are.
ORTHOGONALITY_TOLERANCE = 2e-4


# Translations beyond this overflow when multiplied.
TOO_LONG = 1e75


# Pairs or poses that are looked at together: small enough for the cache, large enough for NumPy.
CHUNK = 8192


def as_numbers(value: Any, name: str) -> Array:
    """``value`` as a float64 array, or an `InputError` that names it."""
    if getattr(getattr(value, "dtype", None), "kind", "") == "c":
        raise InputError(f"Expected `{name}` to hold real numbers, got complex ones.")
    try:
        return np.asarray(value, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(
            f"Expected `{name}` to be an array of numbers of one shape, got {type(value).__name__}."
        ) from error


def as_transforms(value: Any, name: str, stack: bool = True) -> Array:
    """``value`` as checked float64 matrices ``(..., N, 4, 4)`` (or ``(..., 4, 4)`` if not ``stack``).

    Takes arrays, lists, a SciPy ``RigidTransform`` or a list of them. Raises `InputError` naming ``name``, the shape or
    the first offending entry.
    """
    if isinstance(value, list | tuple):
        value = [one.as_matrix() if hasattr(one, "as_matrix") else one for one in value]
    T = as_numbers(value.as_matrix() if hasattr(value, "as_matrix") else value, name)
    wanted = "(..., N, 4, 4)" if stack else "(..., 4, 4)"
    if T.ndim < (3 if stack else 2) or T.shape[-2:] != (4, 4):
        raise InputError(f"Expected `{name}` to have shape {wanted}, got {T.shape}.")
    flat = T.reshape(-1, 4, 4)
    if T.ndim == 2 and _surely_transform(T.tolist()):
        return T
    with np.errstate(over="ignore", invalid="ignore"):  # of huge numbers, which are refused
        for start in range(0, len(flat), CHUNK):
            chunk = flat[start : start + CHUNK]
            rows = entry_rows(chunk)
            if not surely_transforms(rows):
                _explain(flat, start, start + len(chunk), T.shape[:-2], name)
    return T


def as_pose(value: Any, name: str) -> Array:
    """``value`` as one checked finite pose (4, 4); raises `InputError`."""
    T = as_transforms(value, name, stack=False)
    if T.shape != (4, 4) or not np.isfinite(T).all():
        raise InputError(f"Expected `{name}` to be one finite pose (4, 4), got shape {T.shape}.")
    return T


def as_covariance(value: Any, name: str) -> Array:
    """``value`` as one checked covariance (6, 6); raises `InputError`."""
    S = checked_covariance(value, name, joint=False)
    if S.shape != (6, 6):
        raise InputError(f"Expected the covariance `{name}` to have shape (6, 6), got {S.shape}.")
    return S


def entry_rows(*stacks: Array, out: Array | None = None) -> Array:
    """Stacks (n, 4, 4), joined, as (4, 4, m): whole rows of equal entries, which NumPy handles fastest."""
    m = sum(len(T) for T in stacks)
    rows = np.empty((16, m)) if out is None else out
    end = 0
    for T in stacks:
        start, end = end, end + len(T)
        rows[:, start:end] = T.reshape(-1, 16).T
    return rows.reshape(4, 4, m)


def surely_transforms(rows: Array) -> bool:
    """Return whether every ``rows[:, :, k]`` of (4, 4, m) is in SE(3) to about 1e-5, with finite translations.

    |R|^2 = 3 and det R = 1 hold together only for rotations: the squared singular values then have
    arithmetic and geometric mean 1, so all are 1. To second order |R|^2 - 2 det R - 1 = 2 |E|^2 - tr(E)^2
    for R = Q (I + E) with E symmetric. Sufficient, not necessary (`as_transforms` takes a second, entry by
    entry look at what fails here), and false if there is a NaN. Overwrites the corner ``rows[3, 3]`` by its
    deviation from 1.
    """
    R = rows[:3, :3]
    squares = np.einsum("ijm,ijm->m", R, R)
    (a, b, c), (d, e, f), (g, h, i) = R
    determinant = a * (e * i - f * h)
    determinant += b * (f * g - d * i)
    determinant += c * (d * h - e * g)
    squares -= 3.0
    determinant -= 1.0
    rows[3, 3] -= 1.0
    last = rows[3].ravel()
    return bool(
        squares.dot(squares) + determinant.dot(determinant) < 1e-18
        and last.dot(last) < 1e-9
        and np.abs(rows[:3, 3]).max(initial=0.0) < TOO_LONG
    )


def _surely_transform(rows: list[list[float]]) -> bool:
    """`surely_transforms` of one matrix in plain numbers: calls of NumPy would take ten times as long."""
    (a, b, c, x), (d, e, f, y), (g, h, i, z), (j, k, m, n) = rows
    squares = a * a + b * b + c * c + d * d + e * e + f * f + g * g + h * h + i * i - 3.0
    determinant = a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g) - 1.0
    last = j * j + k * k + m * m + (n - 1.0) * (n - 1.0)
    # products, not powers: those of huge numbers are infinite, powers raise
    return squares * squares + determinant * determinant < 1e-18 and last < 1e-9 and abs(x) + abs(y) + abs(z) < TOO_LONG


def _explain(flat: Array, start: int, stop: int, shape: tuple[int, ...], name: str) -> None:
    """Raise the `InputError` that says which matrix in ``start:stop`` is not a pose, and why."""
    for k in range(start, stop):
        T = flat[k]
        at = f"`{name}`[{', '.join(str(i) for i in np.unravel_index(k, shape))}]" if shape else f"`{name}`"
        if not np.isfinite(T).all():
            raise InputError(f"Expected {at} to be finite, got NaN or infinity.")
        if np.abs(T[:3, 3]).max() > TOO_LONG:
            raise InputError(f"Expected the translation of {at} to be below {TOO_LONG:g}, got {T[:3, 3].tolist()}.")
        if np.abs(T[3] - [0, 0, 0, 1]).max() >= ORTHOGONALITY_TOLERANCE:
            raise InputError(f"Expected the last row of {at} to be [0, 0, 0, 1], got {T[3].tolist()}.")
        R = T[:3, :3]
        error = np.abs(R.T @ R - np.eye(3)).max()
        determinant = np.linalg.det(R)
        if determinant < -0.5 and error < 0.1:
            raise InputError(
                f"Expected {at} to hold a rotation, got a left-handed matrix (determinant {determinant:.3f}): "
                "an axis is mirrored."
            )
        if error >= ORTHOGONALITY_TOLERANCE or determinant < 0.5:
            raise InputError(
                f"Expected {at} to hold a rotation, got a matrix that is not orthogonal "
                f"(max |R^T R - I| = {error:.2g}, determinant {determinant:.3g})."
            )


def first_duplicate(times: NDArray[np.float64]) -> tuple[int, int] | None:
    """The first two rows with equal times, or None."""
    order = np.argsort(times, kind="stable")
    same = np.flatnonzero(times[order][1:] == times[order][:-1])
    if not same.size:
        return None
    k = same[np.argmin(order[same + 1])]
    return int(order[k]), int(order[k + 1])


def rows_once(table: Array) -> NDArray[np.intp]:
    """Return the rows of a table (n, k), time first, without those that repeat an earlier one in every number."""
    if first_duplicate(table[:, 0]) is None:
        return np.arange(len(table))
    return np.sort(np.unique(table, axis=0, return_index=True)[1])


def repeats_note(count: int) -> str:
    """Return the note on rows that repeat others."""
    return f"{count} rows that repeat a time and its numbers are left out"


def is_number(value: Any) -> bool:
    """Return whether the value is a number of Python or NumPy; truth values are not."""
    return isinstance(value, Real) and not isinstance(value, bool)


def checked_covariance(value: Any, name: str, joint: bool) -> Array:
    """A covariance (6, 6), (n, 6, 6) or, if ``joint``, (6n, 6n): finite, symmetric, positive semidefinite.

    Rounding is forgiven relative to the variances (asymmetry 1e-6 of ``sqrt(S_ii S_jj)``, eigenvalues of the
    correlation matrix down to -1e-8), and removed from what is returned.
    """
    shapes = "(6, 6), (n, 6, 6) or (6n, 6n)" if joint else "(6, 6) or (N, 6, 6)"
    try:
        S = np.array(value, dtype=float, order="C")
    except (TypeError, ValueError) as error:
        raise InputError(f"Expected the covariance `{name}` to be an array of numbers {shapes}.") from error
    per_item = S.ndim in (2, 3) and S.shape[-2:] == (6, 6) and S.size > 0
    whole = joint and S.ndim == 2 and S.shape[0] == S.shape[1] and S.shape[0] % 6 == 0 and S.shape[0] > 0
    if not (per_item or whole):
        raise InputError(f"Expected the covariance `{name}` to have shape {shapes}, got {S.shape}.")
    if not np.isfinite(S).all():
        raise InputError(f"Expected the covariance `{name}` to be finite, got NaN or infinity.")
    variances = np.diagonal(S, axis1=-2, axis2=-1)
    if (variances < 0).any():
        raise InputError(f"Expected the variances of `{name}` to be >= 0, got {variances.min():.3g}.")
    deviations = np.sqrt(variances)
    if (np.abs(S).max(axis=-1)[deviations == 0] > 0).any():
        raise InputError(
            f"Expected the covariance `{name}` to be positive semidefinite, got a variance of 0 beside a covariance "
            "that is not 0."
        )
    unit = np.where(deviations > 0, deviations, 1.0)
    correlation = S / (unit[..., :, None] * unit[..., None, :])
    asymmetry = np.abs(correlation - correlation.mT).max()
    if asymmetry > 1e-6:
        raise InputError(
            f"Expected the covariance `{name}` to be symmetric, got entries that differ from their mirror images "
            f"by {asymmetry:.2g} of the standard deviations."
        )
    correlation = 0.5 * (correlation + correlation.mT)
    try:
        np.linalg.cholesky(correlation)
    except np.linalg.LinAlgError:
        smallest = np.linalg.eigvalsh(correlation).min()
    else:
        smallest = 0.0
    if smallest < -1e-8:
        raise InputError(
            f"Expected the covariance `{name}` to be positive semidefinite, got a correlation matrix with the "
            f"eigenvalue {smallest:.3g}."
        )
    S = np.asarray(0.5 * (S + S.mT))
    S.flags.writeable = False
    return S
