r"""The accuracy of a robot, as its data sheet states it, as a smooth random field over the pose.

A robot is wrong by the same amount whenever it comes back to a pose, and by nearly the same at poses nearby: errors of
its kinematics, which without joint angles nobody can name. The error of the pose x = (t, R) of the flange is taken as
six Gaussian processes (theta, tau), independent of each other, with one kernel

    k(x, x') = (1 + a + a^2 / 3) exp(-a),    a^2 = 5 (|t - t'|^2 / l_t^2 + |R - R'|_F^2 / (2 l_R^2))

(Matern 5/2; the Frobenius norm of two rotations an angle w apart is 2 sqrt(2) sin(w / 2)), ``l_t`` = `LENGTH` times the
reach, the largest distance of the flange from the base among the poses, and ``l_R`` = `ANGLE`. The lengths are those of
simulated six-joint arms with errors of joint offsets, links and transmissions in one branch of their inverse
kinematics: their errors have the correlation 0.5 at a quarter of the reach, and at orientations 100 deg apart.

*What is stated.* A data sheet's accuracy is read as the root mean square, over the workspace, of the distance (and of
the angle) between the pose commanded and the one attained, once the frames of base and tool are aligned: its third in
squares is the variance per axis. The field has `MARGIN` times that standard deviation, as no arm is a draw from this
field.

*Carried, not learned.* The data are not asked of it (`likelihood.carried_errors`): X stays as it is without, and its
covariance grows by what the field does to it. As an unknown of the fit the field would seem to be told by local poses,
because it is none of the errors that real arms have; the ellipsoid is then too small.

*Columns.* With the poses U at hand (at most `MOST_CENTRES` of them, each the one that the others tell least of),
``phi(x) = V^T K_UU^(-1/2) k(U, x)``, V the first m eigenvectors of ``sum_i K^(-1/2) k(U, x_i) k(x_i, U) K^(-1/2)``: one
column for each of the m features and each of the six components, of standard deviation 1. m is the least with which no
more than `LEFT_OUT` of the variance is left out, but not above `MOST_FEATURES`; the columns are scaled so that their
mean variance is the whole. All of it is O(n). A pose far from U has columns near 0: new poses belong among U.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..formatting.units import parse_angle, parse_length
from ..geometry.se3 import Array

ROBOT_ACCURACY = "robot accuracy"
LENGTH = 0.3  # of the reach
ANGLE = 1.5  # rad
MARGIN = 1.5
# Accuracy (m, rad) of an arm of which nothing is known.
TYPICAL = (0.5e-3, float(np.radians(0.07)))
LEFT_OUT = 0.01
MOST_FEATURES = 20
MOST_CENTRES = 150
# Share of the variance below which a further centre says nothing new.
_NOTHING_NEW = 1e-6


class RobotAccuracy(NamedTuple):
    """Accuracy that was declared or assumed of an arm, as numbers."""

    translation: float  # m
    rotation: float  # rad
    reach: float  # m

    def times(self, size: float) -> RobotAccuracy:
        """Another accuracy of the same reach."""
        return self._replace(translation=size * self.translation, rotation=size * self.rotation)


_COMPONENTS = tuple(f"{kind} {axis}" for kind in ("rotation", "translation") for axis in "xyz")


def field_columns(poses: Array, scale: Array, reach: float | None) -> tuple[tuple[str, ...], Callable[[Array], Array]]:
    """The names of the columns that these poses (n, 4, 4) need, and what they are (k, 6, ..) at poses (k, 4, 4)."""
    phi = features(poses, reach)
    m = phi(poses).shape[-1]
    names = tuple(f"{ROBOT_ACCURACY}: {name} {k + 1}" for name in _COMPONENTS for k in range(m))
    return names, lambda at: columns(phi(at), scale)


def deviations(translation: float, rotation: float) -> Array:
    """(6,) standard deviations of the field per axis (rad, m) for a stated accuracy."""
    return np.asarray(MARGIN / np.sqrt(3.0) * np.repeat([rotation, translation], 3))


def columns(phi: Array, scale: Array) -> Array:
    """(n, 6, 6m): the features (n, m) for each of the six components in turn, times its ``scale`` (6,)."""
    n, m = phi.shape
    F = np.zeros((n, 6, 6, m))
    for k in range(6):
        F[:, k, k] = scale[k] * phi
    return F.reshape(n, 6, 6 * m)


def features(poses: Array, reach: float | None = None) -> Callable[[Array], Array]:
    """phi of the module for poses (n, 4, 4): a function of other poses (k, 4, 4), which gives (k, m)."""
    length = LENGTH * ((reach_of(poses) if reach is None else reach) or 1.0)
    centres = poses[_spread(poses, length)]
    values, vectors = np.linalg.eigh(kernel(centres, centres, length))
    half = vectors / np.sqrt(np.maximum(values, _NOTHING_NEW))  # K^(-1/2), turned
    at_poses = kernel(poses, centres, length) @ half
    found, V = np.linalg.eigh(at_poses.T @ at_poses)
    found, V = found[::-1], V[:, ::-1]
    enough = int(np.searchsorted(np.cumsum(found), (1.0 - LEFT_OUT) * len(poses))) + 1
    m = min(enough, MOST_FEATURES, len(found))
    V = V[:, :m] * np.where(V[np.abs(V[:, :m]).argmax(axis=0), np.arange(m)] < 0, -1.0, 1.0)
    map_ = half @ V * np.sqrt(len(poses) / found[:m].sum())
    return lambda at: kernel(at, centres, length) @ map_


def reach_of(poses: Array) -> float:
    """Largest distance (m) of the flange from the base among the poses."""
    return float(np.linalg.norm(poses[:, :3, 3], axis=-1).max())


def kernel(first: Array, second: Array, length: float) -> Array:
    """k (n, m) of the module."""
    d2 = _between(first[:, :3, 3] / length, second[:, :3, 3] / length)
    d2 += _between(*(T[:, :3, :3].reshape(-1, 9) / (np.sqrt(2.0) * ANGLE) for T in (first, second)))
    a = np.sqrt(5.0 * d2)
    return np.asarray((1.0 + a + a * a / 3.0) * np.exp(-a))


def _between(u: Array, v: Array) -> Array:
    """Squared distances (n, m)."""
    d2 = np.sum(u * u, axis=-1)[:, None] + np.sum(v * v, axis=-1) - 2.0 * u @ v.T
    return np.asarray(np.maximum(d2, 0.0))


def _spread(poses: Array, length: float) -> NDArray[np.intp]:
    """Poses that tell of all others, by Cholesky factorisation with pivots: O(n `MOST_CENTRES`^2)."""
    n = len(poses)
    rest, chosen = np.ones(n), []
    L = np.zeros((n, min(n, MOST_CENTRES)))
    for k in range(L.shape[1]):
        i = int(rest.argmax())
        if rest[i] < _NOTHING_NEW:
            break
        L[:, k] = (kernel(poses, poses[i : i + 1], length)[:, 0] - L[:, :k] @ L[i, :k]) / np.sqrt(rest[i])
        rest = np.maximum(rest - L[:, k] ** 2, 0.0)
        rest[i] = 0.0
        chosen.append(i)
    return np.array(chosen, dtype=np.intp)


def stated_accuracy(translation: float | str, rotation: float | str | None) -> tuple[float, float]:
    """Accuracy of position and orientation (m, rad) of two values, or of a text with both; raises `InputError`."""
    if rotation is None:
        parts = [part.strip() for part in translation.split(",")] if isinstance(translation, str) else []
        if len(parts) != 2:
            raise InputError(
                f"Expected the {ROBOT_ACCURACY} to be a length and an angle, such as '0.5mm,0.05deg', got "
                f"{translation!r}."
            )
        translation, rotation = parts
        if any(part.endswith(("deg", "rad")) for part in [translation]):  # the other way round
            translation, rotation = rotation, translation
    move = parse_length(translation, f"the translation of the {ROBOT_ACCURACY}")
    turn = parse_angle(rotation, f"the rotation of the {ROBOT_ACCURACY}")
    if not (0 <= move < np.inf and 0 <= turn < np.inf):
        raise InputError(f"Expected the {ROBOT_ACCURACY} to be finite and >= 0, got {translation!r}, {rotation!r}.")
    return move, turn
