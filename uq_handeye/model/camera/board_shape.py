r"""The shape of a board: displacements of its points from their nominal places.

Model: the point p_j of a board lies at ``p_j + o_j + B_j w``, o_j an offset that is known, w (q,) coefficients
estimated from pictures, in metres. The fields B come from polynomials in the plane of the board, in three families:

- ``bow2``, ``bow3``, ``bow4``: height over the plane, all monomials of degree 2, up to 3, up to 4 (3, 7, 12 columns);
- ``plane1``: aspect ``(x, -y)`` and shear ``(y, x)`` in the plane;
- ``plane2``: these and the monomials of degree 2 of both coordinates (8 columns).

``bow3+plane2`` has both kinds. The effects of a rigid motion and of the scale of the board are removed: the poses and
the length of a square determine these. With Z (3u, 7) the fields of three shifts, three rotations and the scale at the
u points and M those of the polynomials, degree by degree,

    [Z M] = Q R,    B = sqrt(u) Q_M            so that  B^T B = u I  and  Z^T B = 0

and a coefficient is the root mean square displacement of its field. A longer family begins with the fields of a
shorter one: shapes are nested.

A board that was *measured* (`board.csv`) has the estimated offset, and as fields a factor F of the covariance
``F F^T`` of all its points, with coefficients of standard deviation 1.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from ...core.read_only import ReadOnlyArrays
from ...core.rounding import CHAIN_ROUNDING, SOLUTION_ROUNDING, TINY
from ...errors import InputError
from .measured_board import MeasuredBoard, board_axes

FLAT, MEASURED = "flat", "measured"
BOWS = ("bow2", "bow3", "bow4")  # by the degree of the height
PLANES = ("plane1", "plane2")
# All that a polynomial can be: a bow, a shape in the plane, or both.
SHAPES = (FLAT, *BOWS, *PLANES, *(f"{bow}+{plane}" for bow in BOWS for plane in PLANES))
# Points of a board that is flat are off their plane, and the same point in two tables differs, by less than this share
# of the size of the board: numbers in tables are rounded.
MAX_THICKNESS_SHARE = 1e-6


@dataclass(frozen=True, eq=False)
class BoardShape(ReadOnlyArrays):
    """Shape of the points of one board."""

    name: str  # of `SHAPES`, or "measured"
    names: tuple[str, ...]  # of the coefficients
    points: Array  # (u, 3) as meant, m; each once
    offset: Array  # (u, 3) m
    fields: Array  # (u, 3, q) displacement by coefficient
    sd: Array  # (q,) of the coefficients beforehand; infinite where nothing is known

    @property
    def q(self) -> int:
        """Number of coefficients."""
        return len(self.names)

    @cached_property
    def moves(self) -> list[list[tuple[int, Array]]]:
        """Axes along which each coefficient moves the points, and how far (u,)."""
        fields = np.ascontiguousarray(self.fields.T)
        return [[(axis, by) for axis, by in enumerate(field) if by.any()] for field in fields]

    def rows(self, points: Array) -> NDArray[np.intp]:
        """(m,) which of the board's points these (m, 3) are; raises `InputError` for others."""
        if np.array_equal(points, self.points):
            return np.arange(len(points))
        from scipy.spatial import KDTree  # slow to import

        distance, found = KDTree(self.points).query(points)
        far = np.asarray(distance > MAX_THICKNESS_SHARE * np.ptp(self.points, axis=0).max())
        if far.any():
            odd = points[int(np.argmax(far))]
            raise InputError(
                f"The corner at ({odd[0]:g}, {odd[1]:g}, {odd[2]:g}) m is none of the {len(self.points)} points of the "
                "board that was given: is it another board, or in another unit?"
            )
        return np.asarray(found, dtype=np.intp)

    def displacement(self, coefficients: Array) -> Array:
        """(u, 3) of the points from where they were meant to be."""
        return np.asarray(self.offset + self.fields @ coefficients)

    def measured(self, bend: Array, covariance: Array) -> MeasuredBoard:
        """Return the board with the coefficients ``bend`` (q,) that were found, and their covariance (q, q)."""
        factor = self.fields @ np.linalg.cholesky(covariance) if self.q else self.fields
        return MeasuredBoard(self.name, self.points, self.points + self.displacement(bend), factor)


def flat_shape(points: Array) -> BoardShape:
    """Return the shape of a board (or any other target) whose points (m, 3) are where they are meant to be."""
    unique = np.unique(points, axis=0)
    return BoardShape(FLAT, (), unique, np.zeros_like(unique), np.zeros((len(unique), 3, 0)), np.zeros(0))


def polynomial_shape(name: str, points: Array) -> BoardShape:
    """The shape ``name`` of `SHAPES` for the board with the points (m, 3), some of which may be the same.

    Raises `InputError`: another name; points that lie in no plane, or too few of them to determine the coefficients.
    """
    if name not in SHAPES:
        raise InputError(f"Expected `shape` to be auto or one of {', '.join(SHAPES)}, got {name!r}.")
    flat = flat_shape(points)
    if name == FLAT:
        return flat
    parts = name.split("+")
    degree = max(int(part[-1]) if part in BOWS else 0 for part in parts)
    unique = flat.points
    axes = board_axes(unique)
    local = (unique - unique.mean(axis=0)) @ axes.T
    if np.ptp(local[:, 2]) > MAX_THICKNESS_SHARE * np.ptp(local[:, :2]):
        raise InputError(f"The points of the board lie in no plane, and {name!r} is the shape of a flat board.")
    x, y = (local[:, :2] / np.abs(local[:, :2]).max()).T
    none, one = np.zeros_like(x), np.ones_like(x)
    rigid = [(one, none, none), (none, one, none), (none, none, one), (none, none, y), (none, none, x), (-y, x, none)]
    rigid.append((x, y, none))
    named = [
        (f"z {'x' * (d - k)}{'y' * k}", (none, none, x ** (d - k) * y**k))
        for d in range(2, degree + 1)
        for k in range(d + 1)
    ]
    if parts[-1] in PLANES:
        named += [("aspect", (x, -y, none)), ("shear", (y, x, none))]
    if parts[-1] == "plane2":
        for text, field in (("xx", x * x), ("xy", x * y), ("yy", y * y)):
            named += [(f"x {text}", (field, none, none)), (f"y {text}", (none, field, none))]
    M = np.array([np.stack(field, axis=-1).ravel() for field in (*rigid, *(field for _, field in named))]).T
    Q, R = np.linalg.qr(M / np.maximum(np.linalg.norm(M, axis=0), TINY))
    left = np.diag(R)
    if M.shape[1] > M.shape[0] or (np.abs(left) < CHAIN_ROUNDING).any():
        raise InputError(f"The {len(unique)} points of the board do not determine a shape {name!r}: take 'flat'.")
    B = (Q * np.sign(left))[:, len(rigid) :] * np.sqrt(len(unique))
    B[np.abs(B) < SOLUTION_ROUNDING] = 0.0  # heights and shapes in the plane have nothing in common
    fields = axes.T @ B.reshape(len(unique), 3, -1)
    names = tuple(text for text, _ in named)
    return BoardShape(name, names, unique, flat.offset, fields, np.full(len(names), np.inf))


def possible_shapes(points: Array) -> list[BoardShape]:
    """Return all of `SHAPES` that the points (m, 3) of the board determine, flat first."""
    found = []
    for name in SHAPES:
        with suppress(InputError):
            found.append(polynomial_shape(name, points))
    return found
