r"""Chou and Kamel (1991): the quaternion of X as the null vector of a linear system, then the translation.

``q_A q_X = q_X q_B`` gives four equations per pair that are linear in q_X. As the scalar parts of q_A and q_B are equal
without noise, they are written with the vector parts a, b only,

    [ 0      -(a - b)^T   ]
    [ a - b   [a + b]x    ] q_X = 0

stacked over the pairs and solved by singular value decomposition: the right singular vector of the smallest singular
value, which is the eigenvector of the 4x4 Gram matrix. The sum of squares is ``sum |a - R_X b|^2``: the same function
of R_X as in `horaud`, by another route, so that the two methods agree to rounding.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ...core.geometry.se3 import Array, skew
from ..procrustes.degeneracy import DEGENERATE, NO_ROTATION
from .common.axes import Signs, quaternions
from .common.linear import translation_factors, with_translation
from .common.method import Estimate, Method, require
from .common.moments import Factors, Moments, MomentSolver


def _rows() -> Array:
    """The 4x4 system as a linear function of (a, b): (6, 4, 4)."""
    rows = np.zeros((6, 4, 4))
    for k, e in enumerate(np.eye(3)):
        for j, sign in ((k, 1.0), (3 + k, -1.0)):
            rows[j, 0, 1:], rows[j, 1:, 0] = -sign * e, sign * e
            rows[j, 1:, 1:] = skew(e)
    return rows


# Gram matrix of the rows as a linear function of sum (a, b)(a, b)^T
_GRAM = np.einsum("jra,krb->jkab", _rows(), _rows()).reshape(36, 16)


def _factors(A: Array, B: Array, signs: Signs | None) -> Factors:
    q_A, q_B = quaternions(A, B, signs)
    ab = np.concatenate([q_A[..., 1:], q_B[..., 1:]], axis=-1)
    return (ab, ab), translation_factors(A, B)


def _solution(moments: Moments, N: int) -> Estimate:
    ab, of_translation = moments
    values, vectors = np.linalg.eigh((ab.reshape(-1, 36) @ _GRAM).reshape(-1, 4, 4))
    gap = values[:, 1] - values[:, 0]
    require((gap > DEGENERATE * values[:, 3]) & (values[:, 3] > NO_ROTATION * N), "the rotation axes are parallel.")
    R = Rotation.from_quat(vectors[..., 0], scalar_first=True).as_matrix()
    return with_translation(R, of_translation, N)


METHOD = Method(
    name="chou",
    authors="J. C. K. Chou and M. Kamel",
    year=1991,
    title="Finding the Position and Orientation of a Sensor on a Robot Manipulator Using Quaternions. "
    "Int. J. Robotics Research 10(3), 240-254",
    doi="10.1177/027836499101000305",
    structure="separated",
    form="closed form",
    minimises="sum |a - R_X b|^2 over unit quaternions, a and b the vector parts of q_A and q_B, then "
    "sum |(R_A - I) t - (R_X t_B - t_A)|^2",
    singular="motions of 180 degrees, unless others fix the sign of their axes",
    solver=MomentSolver(_factors, _solution),
)
